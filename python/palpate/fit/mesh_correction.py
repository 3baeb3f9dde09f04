"""Corrections of a spot's curves by its finer mesh.

The fit runs on the coarse mesh. Its curves are corrected by the difference that the fine mesh makes at a
set near the optimum, scaled by the size of the coarse curve and moved along the slopes of both, and the fit
is repeated until that set is near enough: what the correction may be wrong by moves no parameter by more
than :data:`NEAR` (space mapping: Bandler et al., IEEE Trans. Microw. Theory Tech. 52, 2004). Without the
slopes the curves would depend on the material as coarse curves do, and intervals with them.
By its slope in the compliance of the contact, the finer mesh also shows what a rigid contact would add.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Self

import numpy as np

from palpate.domain import COMPLIANCE, FloatArray, Indentation, Response, Simulation, channel_of
from palpate.fit.running import Fit
from palpate.fit.spot_term import Correction, SpotTerm, pieces
from palpate.plugins.parametrisation import SpotInputs

NEAR = 2.0
"""Shift of a parameter by the errors of corrections, over its standard deviation by the fit alone, that is
left alone: the interval has these errors. A shift of 1.6 of ``forearm-demo`` is 0.2 of the whole standard
deviation, which has the other causes, too."""

MOVED_ERROR = 0.5
"""Error of a correction over the part of it that slopes have moved to another set, one standard deviation.

Measured between four Yeoh materials, whose corrections differ by up to 4 % of the torque: 0.46 of the force
and 0.58 of the torque at the two spots of ``forearm-demo`` that chose it, 0.46 and 0.57 at the others, with
one sign at all spots."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FineRun:
    """One set at one spot on both meshes: ordinates (n,) at the measured points by channel.

    The corrections lead to a mesh without error, extrapolated, and to a rigid contact.

    Parameters
    ----------
    coarse, fine : mapping of channel to (n,) array
        NaN where a curve does not cover a point.
    left_over : mapping of channel to float
        Error of the finer mesh over the difference of both; nothing is extrapolated without it.
    slopes : mapping of channel to mapping of name to (coarse, fine)
        Change of both curves (n,) per unit of a parameter or of friction, where both have slopes.
    inputs : SpotInputs, optional
        Of the set.
    """

    coarse: Mapping[str, FloatArray]
    fine: Mapping[str, FloatArray]
    left_over: Mapping[str, float] = field(default_factory=dict)
    slopes: Mapping[str, Mapping[str, tuple[FloatArray, FloatArray]]] = field(default_factory=dict)
    inputs: SpotInputs | None = None

    @property
    def corrections(self) -> dict[str, Correction]:
        """Change of each measured point by mesh and contact without error; nothing without a curve."""
        return {name: self._correction(name) for name in self.coarse}

    def _correction(self, channel: str) -> Correction:
        coarse, whole = self.coarse[channel], 1.0 + self.left_over.get(channel, 0.0)
        known = np.isfinite(coarse) & np.isfinite(self.fine[channel])
        square = float(np.sum(coarse[known] ** 2))
        added = whole * np.where(known, self.fine[channel] - coarse, 0.0)
        if (contact := self._by_rigid_contact(channel)) is not None:
            contact = np.where(known, contact, 0.0)
            added = added + contact
        slopes = {}
        for name, (of_coarse, of_fine) in self.slopes.get(channel, {}).items():
            larger = float(np.sum((coarse * of_coarse)[known])) / square if square else 0.0
            # The corrected curve has a rigid contact, however much the coarse contact gives way.
            further = -of_coarse if name == COMPLIANCE else whole * (of_fine - of_coarse)
            slopes[name] = np.where(known, further - larger * added, 0.0)
        return Correction(added=added, coarse=coarse, contact=contact, slopes=slopes, base=self.inputs)

    def _by_rigid_contact(self, channel: str) -> FloatArray | None:
        """Change (n,) of the finer mesh's curve by a rigid contact, to first order; None without slopes."""
        of_contact = self.slopes.get(channel, {}).get(COMPLIANCE)
        if of_contact is None or self.inputs is None or not isinstance(self.inputs.protocol, Indentation):
            return None
        return -self.inputs.protocol.contact_compliance * of_contact[1]


def fine_run(
    term: SpotTerm,
    inputs: SpotInputs,
    coarse: Simulation,
    fine: Simulation,
    left_over: Mapping[str, float] = MappingProxyType({}),
) -> FineRun:
    """Comparison of both meshes at one set; ``left_over`` is the field of :class:`FineRun`.

    Raises
    ------
    NotRankedError
        The finer mesh could not be simulated.
    """
    bare = replace(term, corrections={})
    bare.residuals(fine, inputs)  # raises for a simulation without a rank
    return FineRun(
        coarse={name: bare.values(coarse, inputs, name) for name in term.measured},
        fine={name: bare.values(fine, inputs, name) for name in term.measured},
        left_over=left_over,
        slopes={name: _slopes(bare, inputs, coarse, fine, name) for name in term.measured},
        inputs=inputs,
    )


def _slopes(
    term: SpotTerm, inputs: SpotInputs, coarse: Simulation, fine: Simulation, channel: str
) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Slopes (n,) of both meshes' values at the measured points, of the names in which both have any."""
    both = [_slopes_of(term, inputs, each, channel) for each in (coarse, fine)]
    return {name: (slope, both[1][name]) for name, slope in both[0].items() if name in both[1]}


def _slopes_of(
    term: SpotTerm, inputs: SpotInputs, simulation: Simulation, channel: str
) -> dict[str, FloatArray]:
    found: dict[str, FloatArray] = {}
    if simulation.response is None or (curve := simulation.response.curves.get(channel)) is None:
        return found
    here = term.values(simulation, inputs, channel)
    for name, slope in curve.slopes.items():
        largest = float(np.abs(slope).max())
        # Step along a slope, over the largest ordinate, that shows the slope of the values at measured
        # points.
        step = (1e-4 * float(np.abs(curve.ordinate).max()) / largest if largest else 0.0) or 1.0
        moved = Response(curves={channel: replace(curve, ordinate=curve.ordinate + step * slope)})
        found[name] = (term.values(replace(simulation, response=moved), inputs, channel) - here) / step
    return found


def errors_of(
    run: FineRun, term: SpotTerm, inputs: SpotInputs, coarse: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """Ordinates (n,) by which a correction may be wrong at other inputs and curves, by weighed name."""
    found, corrections = {}, run.corrections
    for name in term.weights:
        correction = corrections[channel_of(name)]
        change = correction.change_to(inputs, term.materials)
        found[name] = MOVED_ERROR * correction.moved(coarse[channel_of(name)], change)
    return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EndSlopes:
    """Change of the parameters by errors of the curves where a fit has ended, to first order.

    Parameters
    ----------
    gain : (n_parameters, n) array
        Change of the point of the box by a change of the residuals: J⁺, with flat priors over the ranges.
    sd : (n_parameters,) array
        Standard deviation of the point, as far as the fit itself shows it: by Gauss-Newton from the
        residuals, which are taken to be no less than the budget's discrepancy, and each curve to be no more
        than :data:`INDEPENDENT` points; and by the budget's gain of each channel. Other causes would only
        add to it: no correction is near enough because of them.
    """

    gain: FloatArray
    sd: FloatArray

    @classmethod
    def of(cls, fit: Fit) -> Self:
        """Slopes of a fit where it has ended.

        Raises
        ------
        PalpateError
            There are none.
        """
        found, problem = fit.at_end(), fit.problem
        assert found.residuals is not None
        assert found.jacobian is not None
        residuals, jacobian, budget = found.residuals, found.jacobian, problem.study.budget
        fitted = residuals - problem.residuals_of_nothing()
        curves = list(pieces(problem.terms))
        channels = list(dict.fromkeys(channel_of(name) for _, name, _, _ in curves))
        calibration, expected = np.zeros((residuals.size, len(channels))), np.zeros(residuals.size)
        for term, name, at, scale in curves:
            channel = channel_of(name)
            calibration[at, channels.index(channel)] = budget.gain * fitted[at]
            peak = np.abs(scale * term.measured[channel].ordinate).max()
            expected[at] = budget.discrepancy_of(channel) * peak
        n, n_parameters = jacobian.shape
        variance = float(residuals @ residuals) / max(n - n_parameters, 1)
        variance = max(variance, float(np.mean(expected**2)))
        # Independent points of a curve: its errors are alike at neighbouring points, of which there may be
        # many.
        variance *= max(1.0, n / (10.0 * len(curves)))
        # Variance of a value that may be anywhere in a range of 1.
        inverse = np.linalg.inv(jacobian.T @ jacobian + 12.0 * variance * np.eye(n_parameters))
        gain = inverse @ jacobian.T
        of_gains = np.sum((gain @ calibration) ** 2, axis=1)
        return cls(gain=gain, sd=np.sqrt(variance * np.diag(inverse) + of_gains))

    def shift(self, errors: FloatArray) -> float:
        """Largest shift of a parameter, over its standard deviation, by errors (k, n) of unknown signs."""
        shifts = np.abs(errors @ self.gain.T).sum(axis=0)
        return float((shifts / self.sd).max())
