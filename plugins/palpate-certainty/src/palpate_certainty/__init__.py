"""Certainty: intervals of the fitted parameters, from a budget of what may be wrong with the curves."""
