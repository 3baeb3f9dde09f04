"""The page of a run, its tables and figures."""
