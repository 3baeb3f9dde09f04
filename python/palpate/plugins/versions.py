"""The version of :mod:`palpate.api`."""

API_VERSION = (1, 0)
"""Major and minor: a new name raises the second; a name that goes, or changes its meaning, the first."""

THIS_VERSION = "this is {}.{}; install another release of palpate, or of the plugin".format(*API_VERSION)
"""What to do about a plugin that needs another version."""
