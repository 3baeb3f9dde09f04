"""Data of a report: a run read back, its tables, units and marks."""
