"""The version of :mod:`palpate.api`, and the distributions that are released with it."""

API_VERSION = (1, 0)
"""Major and minor: a new name raises the second; a name that goes, or changes its meaning, the first."""

THIS_VERSION = "this is {}.{}; install another release of palpate, or of the plugin".format(*API_VERSION)
"""What to do about a plugin that needs another version."""

FIRST_PARTY = frozenset(
    f"palpate-{name}"
    for name in (
        "certainty",
        "dask",
        "febio",
        "forearm",
        "indentation",
        "jax",
        "limb",
        "materials",
        "planning",
        "prediction",
        "report",
        "robot-log",
    )
)
"""Distributions that are released with the core; a name that two plugins claim is theirs."""
