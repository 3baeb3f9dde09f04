"""Proposals of a small study."""

from palpate_planning.candidates import (
    Allowed,
)
from palpate_planning.propose import PlanOptions, propose

ALLOWED = Allowed(protocol={"depth": ["1 mm", "2 mm", "4 mm"], "twist": [[], ["20 deg", "0 deg"]]})


def proposed(run, allowed=ALLOWED, **options):
    study, folder, plugins = run
    return propose(study, folder, plugins, options=PlanOptions(allowed=allowed, n_points=3, **options))
