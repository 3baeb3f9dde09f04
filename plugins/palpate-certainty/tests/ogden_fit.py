"""Columns of error sources, and simulations, of a fit of an Ogden tissue."""

import numpy as np

from palpate_certainty.error_sources import (
    columns_of,
)

TRUTH = np.array([0.08, 4.0])


BOTH = ("force", "torque")


def columns(case, *causes):
    return columns_of(case.end, causes, BOTH)[0]["p1", "force"]


def simulated(case):
    (term,) = case.end.problem.terms
    inputs = case.end.problem.inputs("p1", case.end.best.point)
    return case.end.problem.simulated(term, inputs)
