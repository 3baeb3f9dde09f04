"""Interfaces, hooks, discovery, guards and scaffolds of plugins."""
