"""Laws of scores."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from palpate.domain import BoolArray, Curve, FloatArray
from palpate.domain.component import Component
from palpate.plugins.score import Score
from palpate.testing.components import ComponentContract, missing

LINE = np.linspace(0.0, 4.0, 9)


class ScoreContract(ComponentContract):
    """Laws of a score; override ``score``, and ``measured`` if it scores other curves than a press."""

    has_unit: ClassVar[bool] = False
    """Whether the misfit has the unit of the ordinate, so that N and mN give other numbers."""

    @pytest.fixture
    def score(self) -> Score:
        """Provide the score under test."""
        missing("score", type(self).__name__)

    @pytest.fixture
    def component(self, score: Score) -> Component:
        """Provide the score."""
        return score

    @pytest.fixture
    def measured(self) -> Curve:
        """Provide a measured curve: by itself a press of 4 mm and its release."""
        loading = 0.5 * LINE**1.5
        force = np.concatenate([loading, 0.9 * loading[-2::-1]])
        depth = np.concatenate([LINE, LINE[-2::-1]])
        return Curve(channel="force", abscissa=depth, ordinate=force, std=np.full(force.size, 0.05))

    @pytest.fixture
    def used(self, score: Score, measured: Curve) -> BoolArray:
        """Provide the points that count."""
        return np.asarray(score.weights(measured) > 0.0)

    @pytest.fixture
    def others(self, measured: Curve) -> FloatArray:
        """Provide simulated curves (5, n): softer, stiffer, of another shape, flat and of the other sign."""
        y, ramp = measured.ordinate, np.linspace(0.8, 1.3, measured.ordinate.size)
        return np.stack([0.7 * y, 1.5 * y, ramp * y, 0.0 * y, -y])

    def test_weighs_each_point(self, score: Score, measured: Curve) -> None:
        weights = score.weights(measured)
        assert weights.shape == measured.ordinate.shape, f"weights of shape {weights.shape}"
        assert (np.isfinite(weights) & (weights >= 0.0)).all(), "a weight is negative or not finite"
        assert weights.any(), "no point of the curve counts"

    def test_the_same_curve_has_no_misfit(self, score: Score, measured: Curve, used: BoolArray) -> None:
        residuals = score.residuals(measured, measured.ordinate, used)[used]
        np.testing.assert_array_equal(residuals, 0.0, "the measured curve differs from itself")

    def test_every_curve_has_finite_residuals(
        self, score: Score, measured: Curve, used: BoolArray, others: FloatArray
    ) -> None:
        residuals = score.residuals(measured, others, used)
        assert residuals.shape == others.shape, f"residuals of {others.shape} ordinates: {residuals.shape}"
        assert np.isfinite(residuals[:, used]).all(), "a finite curve has a residual that is not"
        for one, of_all in zip(others, residuals, strict=True):
            said = "residuals of a curve depend on the others that are given with it"
            alone = score.residuals(measured, one, used)
            np.testing.assert_allclose(alone[used], of_all[used], rtol=1e-12, atol=1e-15, err_msg=said)

    def test_a_curve_farther_off_is_worse(self, score: Score, measured: Curve, used: BoolArray) -> None:
        scaled = np.array([0.6, 0.9, 1.0, 1.1, 1.6])[:, None] * measured.ordinate
        misfits = (score.residuals(measured, scaled, used)[:, used] ** 2).sum(axis=1)
        assert misfits[0] > misfits[1] > misfits[2] < misfits[3] < misfits[4], f"misfits {misfits}"

    def test_the_sweep_ranks_by_the_sum_of_squares(
        self, score: Score, measured: Curve, used: BoolArray, others: FloatArray
    ) -> None:
        every = np.ones(used.size, dtype=np.bool_)
        misfits, coverage = score.misfits(measured, every, measured.abscissa, others)
        squares = (score.residuals(measured, others, used)[:, used] ** 2).sum(axis=1)
        np.testing.assert_allclose(misfits, squares, rtol=1e-9, err_msg="misfits() are not Σ r²")
        np.testing.assert_allclose(coverage, 1.0, rtol=1e-12)

    def test_a_weight_is_outside(
        self, score: Score, measured: Curve, used: BoolArray, others: FloatArray
    ) -> None:
        weighted = score.weighted(measured, others, used, 0.25)
        expected = 0.5 * np.where(used, score.residuals(measured, others, used), 0.0)
        np.testing.assert_allclose(weighted, expected, rtol=1e-12, err_msg="a weight w is not √w of r")

    def test_slopes_are_those_of_the_residuals(
        self, score: Score, measured: Curve, used: BoolArray, others: FloatArray
    ) -> None:
        along, step = np.sin(np.arange(used.size)) * np.abs(measured.ordinate).max(), 1e-5
        for curve in others[:3]:
            slopes = score.slopes(measured, curve, used, along)[used]
            ends = [score.residuals(measured, curve + h * along, used)[used] for h in (step, -step)]
            differences, size = (ends[0] - ends[1]) / (2.0 * step), float(np.abs(slopes).max())
            said = "slopes() are not those of residuals()"
            np.testing.assert_allclose(slopes, differences, rtol=1e-4, atol=1e-4 * size, err_msg=said)
        scale = score.slopes(measured, measured.ordinate, used, np.ones(used.size))
        np.testing.assert_allclose(score.scale(measured, used)[used], scale[used], rtol=1e-9)

    def test_it_is_linear_if_it_says_so(
        self, score: Score, measured: Curve, used: BoolArray, others: FloatArray
    ) -> None:
        if score.linear:
            expected = (score.scale(measured, used) * (others - measured.ordinate))[:, used]
            found = score.residuals(measured, others, used)[:, used]
            said = "linear = True, and residuals are not in proportion"
            np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12, err_msg=said)

    def test_residuals_have_no_unit(
        self, score: Score, measured: Curve, used: BoolArray, others: FloatArray
    ) -> None:
        std = None if measured.std is None else 1000.0 * measured.std
        milli = replace(measured, ordinate=1000.0 * measured.ordinate, std=std)
        here, there = (
            score.residuals(m, k * others, used)[:, used] for m, k in ((measured, 1.0), (milli, 1e3))
        )
        expected = 1000.0 * here if self.has_unit else here
        np.testing.assert_allclose(there, expected, rtol=1e-9, atol=1e-12, err_msg="N and mN differ")
