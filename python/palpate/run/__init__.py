"""A run on disk: its files, its lock, its ledger, and what changed since."""
