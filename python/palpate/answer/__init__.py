"""The answer of a run: its values and what may be read of them, in one table."""
