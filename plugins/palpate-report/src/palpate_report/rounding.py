"""Digits of a value that its interval says something of."""

import math

MOST_DECIMALS = 6


def rounded(value: float, lower: float | None = None, upper: float | None = None) -> str:
    """Text of a value, with two digits of the width of its interval; with three digits where it has none."""
    width = 0.0 if lower is None or upper is None else upper - lower
    if not (width > 0.0 and math.isfinite(width) and math.isfinite(value)):
        return f"{value:.3g}"
    decimals = 1 - math.floor(math.log10(width))
    if decimals > MOST_DECIMALS or abs(value) >= 1e6:
        digits = decimals + 1 + math.floor(math.log10(abs(value))) if value else 1
        return f"{value:.{max(1, digits)}g}"
    # Adding zero takes the sign of a rounded zero.
    return f"{round(value, decimals) + 0.0:.{max(0, decimals)}f}"
