"""study.toml: its shape, what its names mean, and where each key is in the file."""
