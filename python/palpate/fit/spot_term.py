"""One spot's part of a problem: from inputs to a job, and from its simulation to residuals.

One residual of the study's score, times √weight, at each measured point of each channel that counts, so
that Σ r² is the spot's Fopt. Points that a curve does not cover are left out: their residuals are zero,
and with the NMSE the others count for them.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from palpate.domain import (
    COMPLIANCE,
    DEEPER,
    FRICTION,
    BoolArray,
    Channel,
    Curve,
    FloatArray,
    Indentation,
    Job,
    Normaliser,
    ParameterName,
    Protocol,
    Response,
    Scenario,
    Simulation,
    channel_of,
)
from palpate.domain.channels import PRESS_AND_TWIST
from palpate.domain.material import Material
from palpate.plugins.parametrisation import SpotInputs
from palpate.plugins.score import Nmse, NmseSettings, ScoringRules, weighted
from palpate.scoring.scores import compare, scored_points
from palpate.simulation.jobs import homogeneous_tests
from palpate.study.reading import Study


class NotRankedError(Exception):
    """A simulation that is not to be ranked has no residuals."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Correction:
    """Change of a curve by a finer mesh and a rigid contact, from one set of simulations on both meshes.

    Curves and their mesh's error are homogeneous of degree 1 in the moduli: at another set the finer mesh
    adds as much more as the coarse curve is larger.

    Parameters
    ----------
    added : (n,) array
        Ordinates of a mesh and contact without error less the coarse ordinates; 0 where a curve is
        missing.
    coarse : (n,) array
        Ordinates of the coarse mesh at that set; NaN where the curve is missing.
    contact : (n,) array, optional
        Part of what is added by a rigid contact, where the solver shows that.
    slopes : mapping of name to (n,) array
        Change of what is added per unit of a parameter or of friction, besides that in proportion to the
        coarse curve; empty where the solver gives none.
    base : SpotInputs, optional
        Of that set.
    """

    added: FloatArray
    coarse: FloatArray
    contact: FloatArray | None = None
    slopes: Mapping[str, FloatArray] = field(default_factory=dict)
    base: SpotInputs | None = None

    def at(self, ordinates: FloatArray, change: FloatArray | None = None) -> FloatArray:
        """Change (..., n) by the finer mesh of coarse curves (..., n), which may have NaN.

        Where the set is another one, ``change`` (..., n) is the one of :meth:`change_to`.
        """
        added: FloatArray = self.ratio(ordinates)[..., None] * self.added
        return added if change is None else added + self.moved(ordinates, change)

    def moved(self, ordinates: FloatArray, change: FloatArray) -> FloatArray:
        """Part (..., n) of the change by the finer mesh of coarse curves (..., n) that slopes have moved.

        The slopes are of the set of this correction, at whose size the other set is a 1 / :meth:`ratio` of
        it. What is added in proportion to itself grows as an exponential, so that it keeps its sign.
        """
        ratio, size = self.ratio(ordinates)[..., None], float(self.added @ self.added)
        step = change / np.where(ratio > 0.0, ratio, 1.0)
        # Change of a correction in proportion to itself up to which it grows as an exponential, then
        # evenly.
        share = np.minimum(step @ self.added / size if size else np.zeros(step.shape[:-1]), 1.0)
        growth = np.divide(np.expm1(share), share, out=np.ones_like(share), where=share != 0.0)
        return ratio * growth[..., None] * step

    def change_to(self, inputs: SpotInputs, materials: Mapping[str, Material]) -> FloatArray:
        """Change (n,) along the slopes to other inputs of what is added to a curve as large as the coarse."""
        change = np.zeros_like(self.added)
        if self.base is not None and self.slopes:
            steps = steps_between(self.base, inputs, materials)
            for name in steps.keys() & self.slopes.keys():
                change += steps[name] * self.slopes[name]
        return change

    def ratio(self, ordinates: FloatArray) -> FloatArray:
        """Size (...) of coarse curves (..., n), over the size of the curve that the correction is from."""
        known = np.isfinite(ordinates) & np.isfinite(self.coarse)
        here = np.linalg.norm(np.where(known, ordinates, 0.0), axis=-1)
        there = np.linalg.norm(np.where(known, self.coarse, 0.0), axis=-1)
        return np.asarray(np.where(there > 0.0, here / np.where(there > 0.0, there, 1.0), 1.0))

    def is_same(self, other: "Correction") -> bool:
        """True if both are of the same pair of simulations."""
        return np.array_equal(self.added, other.added) and np.array_equal(
            self.coarse, other.coarse, equal_nan=True
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpotTerm:
    """One spot of a problem.

    Parameters
    ----------
    weights : mapping of name to float
        Of the channels, and phases such as ``torque/unload``, that count here, above zero.
    protocol : Protocol
        As the study has it at this spot.
    abscissae : mapping of channel to str
        Names of the abscissae, such as ``depth_mm``, by which offsets go.
    corrections : mapping of channel to Correction
        Of the simulated ordinates at the measured points.
    channels : tuple of Channel
        What its jobs observe.
    site : str
        The first spot of the study at the same place of the same limb.
    """

    spot: str
    measured: Response
    weights: Mapping[str, float]
    protocol: Protocol
    materials: Mapping[str, Material]
    rules: ScoringRules
    abscissae: Mapping[str, str]
    corrections: Mapping[str, Correction] = field(default_factory=dict)
    channels: tuple[Channel, ...] = PRESS_AND_TWIST
    site: str = ""

    @property
    def n_points(self) -> int:
        """Number of residuals."""
        return sum(int(self.counted(name).sum()) for name in self.weights)

    def counted(self, name: str) -> BoolArray:
        """Measured points (n,) with a residual that the weight of a name counts."""
        return scored_points(self.rules.score, self.measured[channel_of(name)], name) > 0.0

    def of_channels(self, channels: Collection[str]) -> "SpotTerm":
        """Count every point of these channels alike, as far as they are measured, by a linear score."""
        weights = {name: 1.0 for name in self.measured if name in channels}
        rules = self.rules
        if not rules.score.linear:  # the ordinates themselves
            rules = replace(rules, score=Nmse(NmseSettings(normaliser=Normaliser.UNIT)))
        return replace(self, weights=weights, rules=rules)

    def job(self, inputs: SpotInputs, set_id: int, *, slopes: bool, fine: bool) -> Job:
        """Make the job that simulates these inputs."""
        job = Job(
            spot=self.spot,
            set_id=set_id,
            materials=self.materials,
            thetas=inputs.thetas,
            protocol=inputs.protocol,
            slopes=slopes,
            mesh=inputs.mesh,
            channels=self.channels,
        )
        return job.on_finer_mesh() if fine else job

    def residuals(self, simulation: Simulation, inputs: SpotInputs) -> FloatArray:
        """Residuals (n_points,).

        Raises
        ------
        NotRankedError
            The simulation failed, or its curves do not reach far enough.
        """
        if simulation.status not in self.rules.ranked_statuses:
            why = simulation.message or simulation.status.remedy
            raise NotRankedError(f"{self.spot}: {simulation.status}: {why}")
        seen = self._observed(simulation, inputs)
        return np.concatenate([self._channel(seen, inputs, *each) for each in self.weights.items()])

    def values(self, simulation: Simulation, inputs: SpotInputs, channel: str) -> FloatArray:
        """Simulated ordinates (n,) at the measured points, corrected; NaN where they are not covered.

        Raises
        ------
        NotRankedError
            The curve cannot be compared with the measured one.
        """
        return self._values(self._observed(simulation, inputs), inputs, channel)

    def corrected(self, channel: str, ordinates: FloatArray, inputs: SpotInputs) -> FloatArray:
        """Simulated ordinates (..., n) of a channel with what a finer mesh adds, where that is known."""
        if (correction := self.corrections.get(channel)) is None:
            return ordinates
        return ordinates + correction.at(ordinates, correction.change_to(inputs, self.materials))

    def shifted(self, inputs: SpotInputs) -> Response:
        """Measured curves along the abscissae that these inputs give them."""
        curves = {name: self._shifted(name, inputs) for name in self.measured}
        return Response(curves=curves)

    def _offset(self, channel: str, inputs: SpotInputs) -> float:
        return inputs.offsets.get(self.abscissae.get(channel, ""), 0.0)

    def _shifted(self, channel: str, inputs: SpotInputs) -> Curve:
        curve, offset = self.measured[channel], self._offset(channel, inputs)
        return replace(curve, abscissa=curve.abscissa + offset) if offset else curve

    def _observed(self, simulation: Simulation, inputs: SpotInputs) -> Simulation:
        """Multiply simulated curves by the gains of their channels; before the onset they are at rest."""
        response = simulation.response
        if response is not None and inputs.observe is not None:
            response = inputs.observe(response)
            simulation = replace(simulation, response=response)
        if response is None or not (inputs.gains or inputs.offsets):
            return simulation
        curves = {}
        for name, curve in response.curves.items():
            offset, y = self._offset(name, inputs), inputs.gains.get(name, 1.0) * curve.ordinate
            before = np.array([offset] if offset < 0.0 and curve.abscissa[0] == 0.0 else [])
            after = np.array([offset] if before.size and curve.abscissa[-1] == 0.0 else [])
            curves[name] = Curve(
                channel=name,
                abscissa=np.concatenate([before, curve.abscissa, after]),
                ordinate=np.concatenate([np.repeat(y[0], before.size), y, np.repeat(y[-1], after.size)]),
            )
        return replace(simulation, response=Response(curves=curves))

    def _values(self, seen: Simulation, inputs: SpotInputs, channel: str) -> FloatArray:
        compared = compare(seen, self._shifted(channel, inputs))
        if compared.status not in self.rules.ranked_statuses:
            raise NotRankedError(f"{self.spot}: {compared.message or compared.status.remedy}")
        return self.corrected(channel, compared.values, inputs)

    def _channel(self, seen: Simulation, inputs: SpotInputs, name: str, weight: float) -> FloatArray:
        channel = channel_of(name)
        values, curve = self._values(seen, inputs, channel), self.measured[channel]
        covered = np.isfinite(values)
        points = scored_points(self.rules.score, curve, name)
        coverage = float(np.average(covered, weights=points))
        if not self.rules.is_enough(coverage):
            raise NotRankedError(
                f"{self.spot}: covers {coverage:.3f} of the measured '{name}', less than "
                f"{self.rules.minimum_coverage:g}"
            )
        counts = points > 0.0
        return weighted(self.rules.score, curve, values, covered & counts, weight)[counts]

    def of_ordinates(self, name: str, ordinates: FloatArray, n_terms: int) -> FloatArray:
        """Residuals (..., n) of a weighed name in a problem of so many spots, of ordinates (..., n)."""
        score, curve = self.rules.score, self.measured[channel_of(name)]
        weight, used = self.weights[name], self.counted(name)
        found: FloatArray
        if score.linear:
            found = (ordinates - curve.ordinate) * (self.scale(name, weight, used) / np.sqrt(n_terms))
        else:
            found = weighted(score, curve, ordinates, used, weight) / np.sqrt(n_terms)
        return found

    def scale(self, name: str, weight: float, used: BoolArray) -> FloatArray:
        """Factors (n,) from ordinates to residuals where only the points ``used`` (n,) count.

        Of a score that is not linear, the derivatives at the measured curve.
        """
        curve = self.measured[channel_of(name)]
        return self.rules.score.scale(curve, used & self.counted(name), weight)

    def of_nothing(self) -> FloatArray:
        """Residuals (n_points,) where every simulated ordinate is zero."""
        parts = []
        for name, weight in self.weights.items():
            counted, ordinate = self.counted(name), self.measured[channel_of(name)].ordinate
            parts.append((-ordinate * self.scale(name, weight, counted))[counted])
        return np.concatenate(parts)


def term_of(
    study: Study,
    spot: str,
    scenario: Scenario,
    measured: Response,
    abscissae: Mapping[str, str],
    corrections: Mapping[str, Correction] | None = None,
) -> SpotTerm:
    """State a spot of a study in a scenario; without a weight where it measures no channel of that."""
    return SpotTerm(
        spot=spot,
        measured=measured,
        weights={n: w for n, w in scenario.weighed.items() if channel_of(n) in measured.curves},
        protocol=study.protocol_at(spot) or homogeneous_tests(measured),
        materials={region.region: region.material for region in study.space.regions},
        rules=study.scoring,
        abscissae=abscissae,
        corrections=corrections or {},
        channels=study.observed(measured),
        site=study.site_of(spot),
    )


def pieces(terms: Sequence[SpotTerm]) -> Iterator[tuple[SpotTerm, str, slice, FloatArray]]:
    """Each weighed name of each spot, its residuals, and factors (n_measured,) from ordinates to them."""
    at = 0
    for term in terms:
        for name, weight in term.weights.items():
            inside = term.counted(name)
            scale = term.scale(name, weight, inside) / np.sqrt(len(terms))
            yield term, name, slice(at, at + int(inside.sum())), scale
            at += int(inside.sum())


def is_along_slopes(one: SpotInputs, other: SpotInputs) -> bool:
    """Whether the slopes of a simulation lead from one to the other.

    That is where only parameters, friction, the contact penalty and the one depth of a press differ.
    """
    a, b = one.protocol, other.protocol
    if one.mesh != other.mesh:
        return False
    if isinstance(a, Indentation) and isinstance(b, Indentation):
        same = a.indenter == b.indenter and a.tilt_deg == b.tilt_deg
        return a is b or (same and a.as_deep_as(b).waypoints.is_same(b.waypoints))
    return a is b


def is_same_job(one: SpotInputs, other: SpotInputs) -> bool:
    """Whether both are answered by one simulation: only offsets and gains differ."""
    same = all(np.array_equal(theta, other.thetas[region]) for region, theta in one.thetas.items())
    return same and is_along_slopes(one, other) and _of_contact(one) == _of_contact(other)


def steps_between(
    base: SpotInputs, inputs: SpotInputs, materials: Mapping[str, Material]
) -> dict[str, float]:
    """Changes of materials' parameters and contact from one to the other, by name, that are not zero."""
    here, there = _of_contact(base), _of_contact(inputs)
    steps = {name: there.get(name, value) - value for name, value in here.items()}
    for region, material in materials.items():
        moved = (inputs.thetas[region] - base.thetas[region]).tolist()
        steps |= {
            str(ParameterName(region, p.name)): step
            for p, step in zip(material.parameters, moved, strict=True)
        }
    return {name: step for name, step in steps.items() if step}


def along_slopes(
    simulation: Simulation, base: SpotInputs, inputs: SpotInputs, channels: Collection[str]
) -> Simulation:
    """Curves of some channels at ``inputs`` by the slopes of the simulation at ``base``.

    Where a press is deeper, a curve over the depth is longer.

    Raises
    ------
    NotRankedError
        One of these curves has no slopes.
    """
    taken = steps_between(base, inputs, simulation.job.materials)
    if simulation.response is None or not taken:
        return simulation
    found = {name: curve for name, curve in simulation.response.curves.items() if name in channels}
    for name, curve in found.items():
        if missing := taken.keys() - curve.slopes.keys():
            why = simulation.diagnostics.get("slopes", "")
            lacking = ", ".join(sorted(missing))
            raise NotRankedError(f"{simulation.job.spot}: '{name}' has no slope in {lacking} ({why})")
    over_depth = {channel.name for channel in simulation.job.channels if channel.abscissa == DEEPER}
    longer = 1.0 + taken[DEEPER] / _of_contact(base)[DEEPER] if DEEPER in taken else 1.0
    curves = {
        name: replace(
            curve,
            abscissa=curve.abscissa * (longer if name in over_depth else 1.0),
            ordinate=curve.ordinate + sum(step * curve.slopes[at] for at, step in taken.items()),
        )
        for name, curve in found.items()
    }
    return replace(simulation, response=Response(curves=curves))


def _of_contact(inputs: SpotInputs) -> dict[str, float]:
    """Friction coefficient, contact compliance and depth, by the names of their slopes."""
    protocol = inputs.protocol
    if not isinstance(protocol, Indentation):
        return {}
    found = {FRICTION: protocol.friction, COMPLIANCE: protocol.contact_compliance}
    return found | ({DEEPER: depth} if (depth := protocol.only_depth_mm) else {})
