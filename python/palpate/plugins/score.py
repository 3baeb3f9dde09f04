"""Scores: residuals of a simulated curve against a measured one, from the settings of a study's [scoring]."""

from abc import abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from pydantic import Field

from palpate import _core
from palpate.domain import BoolArray, Curve, FloatArray, Normaliser, PointWeighting, Status
from palpate.domain.component import Component, Settings, SettingsT
from palpate.errors import PluginError, ScoringError
from palpate.plugins.guard import answering_for

STEP = 1e-6
"""Step of differences, over the largest ordinate, or change where all ordinates are zero."""


class Score(Component[SettingsT]):
    """One residual r for each measured point; Σ r² is the misfit of a curve.

    Fopt = Σ weight · misfit, over the channels or phases that a scenario weighs: weights are applied outside.
    A study names a score as ``score`` of ``[scoring]``; its settings are the other keys of that table.
    """

    linear: ClassVar[bool] = False
    """Whether r = scale · (simulated − measured), with factors that no simulated curve changes.

    Intervals are exact to this extent. Those of another score are of first order, and reported as unclear.
    """

    def weights(self, measured: Curve) -> FloatArray:
        """Weight (n,) of each measured point in the coverage: by itself 1; 0 where it has no residual.

        Raises
        ------
        ScoringError
            The curve lacks what the weights are made from.
        """
        return np.ones(measured.abscissa.size)

    @abstractmethod
    def residuals(self, measured: Curve, simulated: FloatArray, used: BoolArray) -> FloatArray:
        """Residuals (..., n), without a unit and zero where both curves are the same.

        Parameters
        ----------
        measured : Curve
            Of n points, whole: a phase has the normaliser of its curve.
        simulated : (..., n) array
            Ordinates of one or more simulated curves at the abscissae of ``measured``, in its unit.
        used : (n,) array of bool
            Points whose residuals count: of the channel or phase, with a weight, and reached by the simulated
            curve. What is returned elsewhere is left out.

        Raises
        ------
        ScoringError
            The measured curve cannot be scored, whatever is simulated.
        """

    def slopes(
        self, measured: Curve, simulated: FloatArray, used: BoolArray, d_simulated: FloatArray
    ) -> FloatArray:
        """Derivative (n,) of the residuals along a change (n,) of the ordinates; by itself by differences."""
        size = float(np.abs(d_simulated[used]).max(initial=0.0))
        if size == 0.0:
            return np.zeros(simulated.shape)
        largest = max(float(np.abs(simulated[used]).max()), float(np.abs(measured.ordinate).max()))
        step = STEP * (largest or size) / size
        ends = [self.residuals(measured, simulated + h * d_simulated, used) for h in (step, -step)]
        return (ends[0] - ends[1]) / (2.0 * step)

    def weighted(self, measured: Curve, simulated: FloatArray, used: BoolArray, weight: float) -> FloatArray:
        """Residuals (..., n) whose squares sum to ``weight`` times the misfit."""
        residuals = np.asarray(self.residuals(measured, simulated, used))
        if residuals.shape != simulated.shape:
            raise PluginError(
                f"score '{self.name}' gave residuals of shape {residuals.shape} for ordinates of shape "
                f"{simulated.shape}; return one for each measured point"
            )
        return np.sqrt(weight) * np.where(used, residuals, 0.0)

    def scale(self, measured: Curve, used: BoolArray, weight: float = 1.0) -> FloatArray:
        """Derivative (n,) of each such residual in the ordinate of its own point, at the measured curve."""
        ones = np.ones(measured.ordinate.size)
        return np.sqrt(weight) * np.where(used, self.slopes(measured, measured.ordinate, used, ones), 0.0)

    def is_pointwise(self, measured: Curve, used: BoolArray) -> bool:
        """True if each residual depends on the ordinate of its own point alone, near the measured curve."""
        signs = np.where(np.arange(used.size) % 3, 1.0, -1.0)
        along = self.slopes(measured, measured.ordinate, used, signs)[used]
        own = (self.scale(measured, used) * signs)[used]
        return np.allclose(along, own, rtol=1e-3, atol=1e-6 * float(np.abs(own).max(initial=0.0)))

    def misfit_of(self, measured: Curve, differences: FloatArray, used: BoolArray) -> float:
        """Misfit of a curve that differs from the measured one by so much (n,); to first order."""
        return float(((self.scale(measured, used) * differences) ** 2).sum())

    def misfits(
        self, measured: Curve, counted: BoolArray, abscissa: FloatArray, simulated: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Misfit and coverage (n_sets,) of simulated curves (n_sets, m) that share their abscissae (m,).

        Parameters
        ----------
        counted : (n,) array of bool
            Points of the channel, or phase.
        abscissa, simulated
            In the order travelled. Points of ``measured`` that they do not reach are not scored.

        Raises
        ------
        CurveError
            The paths do not correspond.
        """
        points, found = self.weights(measured) * counted, np.full((2, len(simulated)), np.nan)
        for i, ordinate in enumerate(simulated):
            values, reached = _core.interpolate(abscissa, ordinate, measured.abscissa)
            used = reached & (points > 0.0)
            found[1, i] = np.average(reached, weights=points)
            if used.any():
                found[0, i] = (weighted(self, measured, values, used, 1.0) ** 2).sum()
        return found[0], found[1]


def weighted(
    score: Score, measured: Curve, simulated: FloatArray, used: BoolArray, weight: float
) -> FloatArray:
    """Checked residuals (..., n), zero where not ``used``, whose squares sum to ``weight`` times the misfit.

    ``simulated`` (..., n) may be anything, also NaN, where not ``used``. A PluginError where the score
    raised, or gave residuals that are not finite or of another shape; a ScoringError where the measured curve
    cannot be scored.
    """
    doing = f"scoring '{measured.channel}'"
    with answering_for(score, doing):
        found = score.weighted(measured, np.where(used, simulated, measured.ordinate), used, weight)
    if not np.isfinite(found).all():
        raise PluginError(
            f"{doing}: score '{score.name}' gave a residual that is not finite; give a finite one for any "
            "finite ordinate"
        )
    return found


LEAST_STD_SHARE = 0.1
"""Share of a curve's root mean square std that is the smallest std of a point.

Otherwise one point with almost no std would outweigh all the others.
"""


class NmseSettings(Settings):
    """Settings of the score ``nmse``."""

    normaliser: Normaliser = Field(default=Normaliser.MEAN_ABS, description="Divisor of the squared error.")
    point_weighting: PointWeighting = Field(
        default=PointWeighting.EQUAL,
        description="Whether each measured point counts the same, or by its standard deviation.",
    )


class Nmse(Score[NmseSettings]):
    """NMSE = Σ w (sim − exp)² / (Σ w · normaliser²), with w = 1 or 1/std² of each measured point.

    The normaliser is of the whole curve, without weights; the NMSE of a phase has the same divisor.
    """

    name = "nmse"
    summary = "squared error over the squared normaliser of the measured curve"
    linear = True

    def weights(self, measured: Curve) -> FloatArray:
        """Weight of each measured point (n,).

        Raises
        ------
        ScoringError
            The curve has no standard deviation, or only zeros, to weigh by.
        """
        if self.settings.point_weighting is PointWeighting.EQUAL:
            return np.ones(measured.ordinate.size)
        if measured.std is None:
            raise ScoringError(
                "no point has a standard deviation; give repeated presses or a loader that gives one, "
                'or set scoring.point_weighting = "equal"'
            )
        scale = float(np.sqrt(np.mean(measured.std**2)))
        if scale == 0.0:
            raise ScoringError('every standard deviation is zero; set scoring.point_weighting = "equal"')
        return 1.0 / np.maximum(measured.std / scale, LEAST_STD_SHARE) ** 2

    def residuals(self, measured: Curve, simulated: FloatArray, used: BoolArray) -> FloatArray:
        """√(w / Σw) · (simulated − measured) / normaliser."""
        return self.weighted(measured, simulated, used, 1.0)

    def slopes(
        self, measured: Curve, simulated: FloatArray, used: BoolArray, d_simulated: FloatArray
    ) -> FloatArray:
        """Exact derivative: √(w / Σw) / normaliser · d_simulated."""
        return np.where(used, d_simulated, 0.0) * self.scale(measured, used)

    def weighted(self, measured: Curve, simulated: FloatArray, used: BoolArray, weight: float) -> FloatArray:
        """Residuals whose squares sum to ``weight`` times the NMSE."""
        return np.where(used, simulated - measured.ordinate, 0.0) * self.scale(measured, used, weight)

    def scale(self, measured: Curve, used: BoolArray, weight: float = 1.0) -> FloatArray:
        """Factors (n,) on simulated − measured."""
        points = self.weights(measured)
        normaliser = _core.normaliser(measured.ordinate, self.settings.normaliser.value)
        scale: FloatArray = np.sqrt(weight * points / points[used].sum()) / normaliser
        return np.where(used, scale, 0.0)

    def misfit_of(self, measured: Curve, differences: FloatArray, used: BoolArray) -> float:
        """NMSE of these differences (n,)."""
        square = float(np.average(differences**2, weights=self.weights(measured) * used))
        return square / _core.normaliser(measured.ordinate, self.settings.normaliser.value) ** 2

    def misfits(
        self, measured: Curve, counted: BoolArray, abscissa: FloatArray, simulated: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """NMSE and coverage of a batch, by the compiled kernel."""
        kernel = _core.Measured(
            measured.abscissa,
            measured.ordinate,
            self.settings.normaliser.value,
            weights=self.weights(measured) * counted,
        )
        return kernel.along(abscissa).score(simulated)


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoringRules:
    """A score, and which simulations are ranked by it.

    Parameters
    ----------
    minimum_coverage : float
        Smallest share of measured points, each counted with its weight, that a simulated curve
        must reach to be ranked.
    rank_partial : bool
        Whether the partial curve of a diverged simulation is ranked if its coverage suffices.
    """

    score: Score = field(default_factory=Nmse)
    minimum_coverage: float = 0.95
    rank_partial: bool = False

    @property
    def ranked_statuses(self) -> tuple[Status, ...]:
        """Statuses of simulations whose curves are ranked."""
        return (Status.OK, Status.DIVERGED) if self.rank_partial else (Status.OK,)

    def is_enough(self, coverage: float) -> bool:
        """Whether a coverage suffices, up to rounding."""
        return coverage >= self.minimum_coverage - 1e-12
