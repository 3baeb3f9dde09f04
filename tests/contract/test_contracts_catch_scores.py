"""Each law of scores fails on what breaks it, with the reason."""

import numpy as np
import pytest

from palpate.domain import Curve
from palpate.plugins.score import Nmse
from palpate.testing import ScoreContract

LINE = np.linspace(0.0, 4.0, 9)
PRESS = Curve(channel="force", abscissa=LINE, ordinate=0.5 * LINE**1.5)
EVERY = np.ones(9, dtype=np.bool_)
OTHERS = np.array([0.7, 1.5, 1.2, 0.0, -1.0])[:, None] * PRESS.ordinate


def made(law, **methods):
    """Score of which these methods are other than those of the NMSE."""
    return type(law, (Nmse,), methods)()


def residuals_of(of):
    return {"residuals": lambda self, measured, simulated, used: of(measured, simulated)}


@pytest.mark.parametrize(
    ("law", "methods", "reason"),
    [
        ("weighs_each_point", {"weights": lambda self, measured: -LINE}, "negative or not finite"),
        ("weighs_each_point", {"weights": lambda self, measured: 0.0 * LINE}, "no point of the curve"),
        ("the_same_curve_has_no_misfit", residuals_of(lambda m, y: y), "differs from itself"),
        ("every_curve_has_finite_residuals", residuals_of(lambda m, y: y + np.nan), "that is not"),
        ("every_curve_has_finite_residuals", residuals_of(lambda m, y: y - y.mean()), "depend on the others"),
        ("a_curve_farther_off_is_worse", residuals_of(lambda m, y: np.sign(y - m.ordinate)), "misfits"),
        ("the_sweep_ranks_by_the_sum_of_squares", residuals_of(lambda m, y: y - m.ordinate), "not Σ r²"),
        ("a_weight_is_outside", {"weighted": lambda self, m, y, used, w: w * (y - m.ordinate)}, "√w"),
        ("slopes_are_those_of_the_residuals", {"slopes": lambda self, m, y, used, along: along}, "not those"),
        ("it_is_linear_if_it_says_so", residuals_of(lambda m, y: np.arctan(y - m.ordinate)), "in proportion"),
        ("residuals_have_no_unit", residuals_of(lambda m, y: y - m.ordinate), "N and mN differ"),
    ],
)  # fmt: skip
def test_a_law_catches_what_breaks_it(law, methods, reason):
    given = {"score": made(law, **methods), "measured": PRESS, "used": EVERY, "others": OTHERS}
    test = getattr(ScoreContract(), f"test_{law}")
    taken = test.__code__.co_varnames[1 : test.__code__.co_argcount]
    test(**{name: {**given, "score": Nmse()}[name] for name in taken})
    with pytest.raises(AssertionError, match=reason):
        test(**{name: given[name] for name in taken})
