"""Page of a run, and of several compared."""
