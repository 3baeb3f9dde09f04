"""Parameter sets: samplers, filters and the design of a study."""
