"""Measured curves: reading, averaging and checking them."""
