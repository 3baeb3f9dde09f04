"""Laws of the emulator: it has the runs it was made from, and is exact where the curves are polynomials."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.stats import qmc

from palpate.domain import Parameter
from palpate.fit.box import Box
from palpate.plugins.registry import load_file
from palpate_certainty.emulator import Emulator, Runs
from palpate_materials.uncoupled import Ogden, Yeoh

pressed = load_file(Path(__file__).parents[3] / "tests" / "data" / "plugins" / "pressed_tissue.py")
seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=10)
X = np.linspace(0.1, 1.0, 9)


def parameters(kinds):
    return [
        Parameter(
            name=f"{kind}{i}",
            unit="MPa" if kind == "modulus" else "1",
            lower=0.5,
            upper=3.0,
            kind=kind,
            description="",
        )
        for i, kind in enumerate(kinds)
    ]


def runs_of(function, values, sloped=None):
    """Runs of an analytic function of values (n, p), slopes by complex steps."""
    step = 1e-30j * np.eye(values.shape[1])
    slopes = np.stack([function(values + each).imag / 1e-30 for each in step], axis=2)
    slopes[len(values) if sloped is None else sloped :] = np.nan
    return Runs(values=values, ordinates=function(values).real, slopes=slopes)


def wavy(values):
    """Curves in proportion to the first two values, and bent by the third."""
    a, b, m = (column[:, None] for column in values.T)
    return a * X + b * X**m + 0.2 * a * b / (a + b) * np.sin(3.0 * X + m)


def drawn(seed, n, d=3):
    return 0.5 + 2.5 * qmc.Halton(d, rng=np.random.default_rng(seed)).random(n)


@few
@given(seeds)
def test_it_reproduces_the_runs_and_slopes_it_was_made_from(seed):
    values = drawn(seed, 12)
    runs = runs_of(wavy, values, sloped=8)
    emulator = Emulator(parameters(["modulus", "modulus", "shape"]), runs, np.ones(9))
    np.testing.assert_allclose(emulator(values), runs.ordinates, atol=4e-4 * runs.ordinates.max())
    step = 1e-4 * np.eye(3)
    for k in range(3):
        slopes = (emulator(values[:8] + step[k]) - emulator(values[:8] - step[k])) / 2e-4
        np.testing.assert_allclose(slopes, runs.slopes[:8, :, k], atol=0.02)


@few
@given(seeds)
def test_it_is_exact_for_a_polynomial_of_second_degree(seed):
    rng = np.random.default_rng(seed)
    form = rng.normal(size=(9, 3, 3))

    def quadratic(values):
        return np.einsum("np,kpq,nq->nk", values, form, values) + values @ form[:, 0].T + 1.0

    runs = runs_of(quadratic, drawn(seed, 8))
    emulator = Emulator(parameters(["shape"] * 3), runs, np.ones(9))
    others = drawn(seed + 1, 20)
    np.testing.assert_allclose(emulator(others), quadratic(others), atol=1e-5 * np.abs(runs.ordinates).max())


@few
@given(seeds, st.floats(0.01, 100.0))
def test_it_is_in_proportion_to_the_moduli_where_the_runs_are(seed, times):
    values = drawn(seed, 10)
    emulator = Emulator(parameters(["modulus", "modulus", "shape"]), runs_of(wavy, values), np.ones(9))
    scaled = values * [times, times, 1.0]
    np.testing.assert_allclose(emulator(scaled), times * emulator(values), rtol=1e-9)


def test_it_is_not_in_proportion_to_the_moduli_where_the_runs_are_not():
    values = drawn(3, 12)
    runs = runs_of(lambda values: wavy(values) + 5.0 * X, values)
    emulator = Emulator(parameters(["modulus", "modulus", "shape"]), runs, np.ones(9))
    np.testing.assert_allclose(emulator(values), runs.ordinates, atol=4e-4 * runs.ordinates.max())


def test_a_run_left_out_is_missed_by_as_much_as_the_emulator_of_the_others_misses_it():
    values = drawn(4, 10)
    runs = runs_of(wavy, values)
    kinds = parameters(["modulus", "modulus", "shape"])
    whole = Emulator(kinds, runs, np.ones(9))
    others = Runs(values=values[1:], ordinates=runs.ordinates[1:], slopes=runs.slopes[1:])
    missed = runs.ordinates[0] - Emulator(kinds, others, np.ones(9))(values[:1])[0]
    assert np.linalg.norm(whole.left_out[0] - missed) < 0.5 * np.linalg.norm(missed) + 1e-5


def simulated(study, points):
    """Runs of strips of tissue at points (n, p) of the box, and the peak of each channel by point."""
    (region,) = study.space.regions
    names = [f"tissue.{p.name}" for p in region.material.parameters]
    columns = [names.index(p.name) for p in study.space.parameters]
    values = np.stack([Box(study.space.parameters).values(point) for point in points])
    thetas = [study.space.thetas(row)["tissue"] for row in values]
    ordinates = np.stack([np.concatenate(pressed.answers(region.material, theta)) for theta in thetas])
    slopes = np.stack([np.concatenate(pressed.derivatives(region.material, theta)) for theta in thetas])
    return Runs(values=values, ordinates=ordinates, slopes=slopes[:, :, columns])


def largest_error(study, n):
    """Largest error at 50 sets over the whole ranges, over the peak of their curves, from n runs."""
    points = qmc.Halton(len(study.space.parameters), rng=np.random.default_rng(1)).random(n + 50)
    runs, others = simulated(study, points[:n]), simulated(study, points[n:])
    halves = slice(0, 20), slice(20, None)
    peak = [np.median(np.abs(runs.ordinates[:, half]).max(axis=1)) for half in halves]
    emulator = Emulator(study.space.parameters, runs, np.repeat(peak, [20, 41]))
    missed = np.abs(emulator(others.values) - others.ordinates)
    return max(
        (missed[:, half].max(axis=1) / np.abs(others.ordinates[:, half]).max(axis=1)).max() for half in halves
    )


@pytest.mark.parametrize(
    ("material", "names", "n", "most"),
    [
        (Ogden(), ("c1", "m1", "kappa"), 20, 0.002),
        (Yeoh(), ("c1", "c2", "c3"), 10, 0.002),
        (Ogden(Ogden.Settings(terms=2)), ("c1", "m1", "c2", "m2", "kappa"), 40, 0.005),
    ],
    ids=["ogden", "yeoh", "two terms"],
)
def test_curves_of_tissue_are_emulated_over_the_whole_ranges(material, names, n, most):
    assert largest_error(pressed.study_of(material, names), n) < most
