"""The stages of a study, one module each, in the order of the method."""
