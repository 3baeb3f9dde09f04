"""Figures of a run, as files and as the page draws them."""
