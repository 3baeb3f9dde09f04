"""Curves of all spots at the measured points, simulated and emulated, as functions of the searched values."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from palpate.api import Design, FloatArray, IntArray, PalpateError, ParameterName, Simulation
from palpate.api.fit import (
    Case,
    Correction,
    NotRankedError,
    Problem,
    SpotInputs,
    SpotTerm,
    Trial,
    channel_of,
    is_same_job,
    pieces,
)
from palpate_certainty.emulator import Emulator, Runs

MOST_SETS = 32
"""Sets of a sweep that fit best, and as many others, of which an emulator is made."""

STEP = 0.01
"""Step over a range for the slopes of what a finer mesh adds."""


class SimulatedCurves:
    """Ordinates of every channel at every spot, without corrections by finer meshes.

    Parameters
    ----------
    problem : Problem
        Of the joint fit.
    channels : sequence of str
        Those that any scenario weighs.

    Attributes
    ----------
    places : mapping of (spot, channel) to slice
        Where each curve is among the n ordinates.
    measured, peak : (n,) array
        Measured ordinates, and the largest one of each curve.
    """

    def __init__(self, problem: Problem, channels: Sequence[str]) -> None:
        terms = [replace(term.of_channels(channels), corrections={}) for term in problem.terms]
        self.problem = problem.restated(terms)
        parts = list(pieces(terms))
        self.places = {(term.spot, name): at for term, name, at, _ in parts}
        curves = [term.measured[name].ordinate for term, name, _, _ in parts]
        self.measured = np.concatenate(curves)
        self.peak = np.concatenate([np.full(y.size, np.abs(y).max()) for y in curves])
        self._scale = np.concatenate([scale for *_, scale in parts])

    def runs(self, points: FloatArray, *, slopes: bool) -> Runs:
        """Simulate points (n, n_parameters) of the box; ordinates of those that fail are NaN."""
        found = self.problem.evaluate([Trial(point=point, slopes=slopes) for point in points])
        box, n = self.problem.box, self._scale.size
        ordinates = np.full((len(points), n), np.nan)
        rates = np.full((len(points), n, len(box.names)), np.nan)
        for i, each in enumerate(found):
            if each.residuals is not None:
                ordinates[i] = each.residuals[:n] / self._scale + self.measured
            if each.jacobian is not None:
                rates[i] = each.jacobian[:n] / self._scale[:, None] / box.rates(each.point)
        return Runs(values=box.values(points), ordinates=ordinates, slopes=rates)

    def of_set(self, values: FloatArray, simulations: Mapping[str, Simulation]) -> FloatArray:
        """Ordinates (n,) of a set of the sweep from its simulations by spot.

        NaN where it has failed, or a fit would simulate something else at these values (n_parameters,).
        """
        parts = []
        try:
            for term in self.problem.terms:
                inputs, simulation = self.problem.inputs_at(term, values), simulations[term.spot]
                if not is_same_job(SpotInputs(thetas=simulation.job.thetas, protocol=term.protocol), inputs):
                    raise NotRankedError
                parts.append(term.residuals(simulation, inputs) / np.sqrt(len(self.problem.terms)))
        except (KeyError, NotRankedError, PalpateError):
            return np.full(self._scale.size, np.nan)
        return np.concatenate(parts) / self._scale + self.measured


class EmulatedCurves:
    """An emulator of each spot, from the values that its curves depend on.

    Parameters
    ----------
    simulated : SimulatedCurves
    runs : Runs
    """

    def __init__(self, simulated: SimulatedCurves, runs: Runs) -> None:
        self.simulated, self.runs = simulated, runs
        parameters, states = simulated.problem.parameters, simulated.problem.study.space.states
        self.parts: list[tuple[slice, list[int], Emulator]] = []
        for spot in dict.fromkeys(spot for spot, _ in simulated.places):
            places = [at for (of, _), at in simulated.places.items() if of == spot]
            at = slice(places[0].start, places[-1].stop)
            own = [i for i, p in enumerate(parameters) if ParameterName.parse(p.name).counts_at(spot, states)]
            of_spot = Runs(
                values=runs.values[:, own],
                ordinates=runs.ordinates[:, at],
                slopes=runs.slopes[:, at][:, :, own],
            )
            self.parts.append((at, own, Emulator([parameters[i] for i in own], of_spot, simulated.peak[at])))

    @property
    def left_out(self) -> FloatArray:
        """Ordinates (n_runs, n_ordinates) of each run less what the others predict."""
        return np.concatenate([emulator.left_out for *_, emulator in self.parts], axis=1)

    def __call__(self, values: FloatArray) -> FloatArray:
        """Ordinates (n, n_ordinates) at values (n, n_parameters)."""
        return np.concatenate([emulator(values[:, own]) for _, own, emulator in self.parts], axis=1)

    def variance(self, values: FloatArray) -> FloatArray:
        """Variance (n, n_ordinates) of the ordinates at values (n, n_parameters)."""
        parts = [emulator.variance(values[:, own]) for _, own, emulator in self.parts]
        return np.concatenate(parts, axis=1)


def runs_of_fits(simulated: SimulatedCurves, cases: Sequence[Case]) -> Runs:
    """Runs of all searches of these cases that had slopes, and their ends; simulates nothing."""
    traced = [each for case in cases for fit in case.fits for each in fit.trace if each.jacobian is not None]
    ends = [case.end.best for case in cases if case.end is not None and case.end.best is not None]
    # Slopes by differences are at hand where the fit has been.
    sloped = {each.point.tobytes(): each.point for each in (*traced, *ends)}
    return simulated.runs(np.stack(list(sloped.values())), slopes=True).ended


def runs_of_sets(simulated: SimulatedCurves, design: Design, swept: Sequence[Simulation]) -> Runs | None:
    """Runs of the sets of a sweep that fit best, and of as many others; simulates nothing.

    Returns
    -------
    Runs or None
        None where no set has curves that a fit would simulate.
    """
    names, by_set = [p.name for p in design.parameters], dict[int, dict[str, Simulation]]()
    for each in swept:
        by_set.setdefault(each.job.set_id, {})[each.job.spot] = each
    rows = [dict(zip(names, row, strict=True)) for row in design.values.tolist()]
    values = [simulated.problem.values_of(row) for row in rows]
    found = [(v, simulated.of_set(v, by_set.get(i, {}))) for i, v in enumerate(values)]
    ended = [each for each in found if np.isfinite(each[1]).all()]
    if not ended:
        return None
    misfit = np.array([(((y - simulated.measured) / simulated.peak) ** 2).sum() for _, y in ended])
    chosen = [ended[i] for i in best_and_first(misfit)]
    ordinates = np.stack([y for _, y in chosen])
    return Runs(
        values=np.stack([v for v, _ in chosen]),
        ordinates=ordinates,
        slopes=np.full((*ordinates.shape, values[0].size), np.nan),
    )


def best_and_first(misfit: FloatArray) -> IntArray:
    """Places of the sets of least misfit (n,), and of as many others, by which curves are emulated."""
    best = np.argsort(misfit, kind="stable")[:MOST_SETS]
    return np.unique(np.concatenate([best, np.arange(min(MOST_SETS, misfit.size))]))


class EmulatedProblem:
    """Residuals of a problem by emulated ordinates, at many values at once, and the density of these.

    What is added to curves as large as the coarse one is linear in the materials' textbook values; it is
    taken as linear in the searched ones around the ``fitted``, as not every set is one of a parametrisation.

    Parameters
    ----------
    problem : Problem
        With its corrections by finer meshes.
    curves : SimulatedCurves
    fitted : (n_parameters,) array
        Values where the fit has ended.
    white : (m, n) array, optional
        From the residuals of the problem to independent ones of variance 1, as they are by default.
    emulated : EmulatedCurves, optional
        Gives ordinates where none are given.
    """

    def __init__(
        self,
        problem: Problem,
        curves: SimulatedCurves,
        fitted: FloatArray,
        white: FloatArray | None = None,
        emulated: EmulatedCurves | None = None,
    ) -> None:
        self.problem, self.curves, self.emulated, self._fitted = problem, curves, emulated, fitted
        self._white = np.eye(problem.n_points) if white is None else white
        self._changes = {
            (term.spot, channel): self._linear(term, correction)
            for term in problem.terms
            for channel, correction in term.corrections.items()
        }

    def residuals(self, values: FloatArray, ordinates: FloatArray | None = None) -> FloatArray:
        """Residuals (k, n) at values (k, n_parameters) with ordinates (k, n_ordinates), without priors."""
        parts, terms = [], self.problem.terms
        if ordinates is None:
            assert self.emulated is not None
            ordinates = self.emulated(values)
        for term, name, _, _ in pieces(terms):
            channel = channel_of(name)
            here = ordinates[:, self.curves.places[term.spot, channel]]
            if (correction := term.corrections.get(channel)) is not None:
                change, slopes = self._changes[term.spot, channel]
                here = here + correction.at(here, change + (values - self._fitted) @ slopes)
            parts.append(term.of_ordinates(name, here, len(terms))[:, term.counted(name)])
        return np.concatenate(parts, axis=1)

    def white(self, values: FloatArray, ordinates: FloatArray | None = None) -> FloatArray:
        """Independent residuals (k, m) at values (k, n_parameters) with these ordinates (k, n_ordinates)."""
        of_priors = [
            self.problem.noise * (values[:, i] - p.prior.value) / p.prior.sd
            for i, p in enumerate(self.problem.parameters)
            if p.prior is not None
        ]
        return np.column_stack([self.residuals(values, ordinates), *of_priors]) @ self._white.T

    def misfit(self, values: FloatArray, ordinates: FloatArray | None = None) -> FloatArray:
        """−2 log (k,) of the posterior density, which is even in the coordinates of the box by itself."""
        return (self.white(values, ordinates) ** 2).sum(axis=1)

    def unknown(self, values: FloatArray) -> FloatArray:
        """Variance (k,) of the emulated curves at values (k, n_parameters), as a part of Fopt."""
        assert self.emulated is not None
        variance, found = self.emulated.variance(values), np.zeros(len(values))
        for term, name, _, scale in pieces(self.problem.terms):
            place = self.curves.places[term.spot, channel_of(name)]
            found += (variance[:, place] * scale**2)[:, term.counted(name)].sum(axis=1)
        return found

    def _linear(self, term: SpotTerm, correction: Correction) -> tuple[FloatArray, FloatArray]:
        """Change (n,) of a correction along its slopes at the fit, and (n_parameters, n) by each value."""

        def change(values: FloatArray) -> FloatArray:
            return correction.change_to(self.problem.inputs_at(term, values), term.materials)

        box, here = self.problem.box, change(self._fitted)
        steps = STEP * (box.upper - box.lower)
        steps = np.where(self._fitted - steps >= box.lower, -steps, steps)  # down: shares sum to less than 1
        slopes = [(change(self._fitted + step) - here) / step.sum() for step in np.diag(steps)]
        return here, np.stack(slopes)
