"""Comparison of solvers with each other and with recorded results."""
