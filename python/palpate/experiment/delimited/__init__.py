"""Delimited text (CSV, TSV and the like): a line of names, perhaps one of units, and rows of numbers."""
