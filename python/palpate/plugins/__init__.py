"""What plugins provide: interfaces, hooks, discovery, guards and scaffolds."""
