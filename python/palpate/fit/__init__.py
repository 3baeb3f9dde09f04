"""The fit: parameters for which the simulated curves are nearest to the measured ones."""
