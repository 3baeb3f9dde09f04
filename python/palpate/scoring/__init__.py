"""Scores of simulated against measured curves, and the sets that they select."""
