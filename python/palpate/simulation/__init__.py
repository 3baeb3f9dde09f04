"""Simulations: jobs, the sweep, what they cost, and their verification."""
