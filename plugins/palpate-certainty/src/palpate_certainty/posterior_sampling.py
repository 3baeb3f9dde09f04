"""Posterior, profiles, Sobol indices and volumes of a study's joint fits, by an emulator of the curves.

The emulator is made from the runs of the fit and the sweep, and from some more over the ranges. It is
checked where it matters: at draws of each posterior that are simulated as well. Where it misses them by
too much these join its runs, and the posteriors are drawn again.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from palpate.api import SILENT, Design, FloatArray, Progress, Simulation, StudyError
from palpate.api.fit import RISE, Box, Case, channel_of
from palpate.api.runs import Study
from palpate_certainty.bounded import least_near
from palpate_certainty.emulated_curves import (
    EmulatedCurves,
    EmulatedProblem,
    SimulatedCurves,
    runs_of_fits,
    runs_of_sets,
)
from palpate_certainty.emulator import Runs
from palpate_certainty.posterior import Draws, draw
from palpate_certainty.profiles import Profile, profile, refitted
from palpate_certainty.tables import Assessed

PRECISE = 0.002
"""Largest error of an emulated curve, over its measured peak, that needs no more runs."""

MOST_ROUNDS = 4
"""How often the emulator is made at most."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Posterior:
    """The posterior of one scenario, with a check of the emulator it was drawn by.

    Parameters
    ----------
    assessed : Assessed
    density : EmulatedProblem
    draws : Draws
    checked : Runs
        Draws that were simulated.
    """

    assessed: Assessed
    density: EmulatedProblem
    draws: Draws
    checked: Runs

    @property
    def values(self) -> FloatArray:
        """Values (n, n_parameters) of the draws."""
        return self.density.problem.box.values(self.draws.points)

    @property
    def missed(self) -> FloatArray:
        """Errors (n, n_ordinates) of the emulator at the simulated draws, over the measured peaks."""
        assert self.density.emulated is not None
        emulated = self.density.emulated(self.checked.values)
        return np.abs(emulated - self.checked.ordinates) / self.density.curves.peak

    @property
    def shift(self) -> FloatArray:
        """About how far the real solver moves the means (n_parameters,).

        The misfit's difference at the simulated draws, linear in the values, tilts the density.
        """
        values = self.checked.values
        real, emulated = (self.density.misfit(values, y) for y in (self.checked.ordinates, None))
        mean, sd = self.values.mean(axis=0), np.maximum(self.values.std(axis=0), 1e-300)
        columns = np.column_stack([np.ones(len(values)), (values - mean) / sd])
        tilt = np.linalg.lstsq(columns, -0.5 * (real - emulated), rcond=None)[0][1:]
        return np.cov(self.values / sd, rowvar=False).reshape(tilt.size, -1) @ tilt * sd

    @property
    def volume(self) -> float:
        """Root of the determinant of the covariance in the box, over its value for all of the box."""
        covariance = np.cov(self.draws.points, rowvar=False).reshape([self.draws.points.shape[1]] * 2)
        return float(np.sqrt(max(np.linalg.det(12.0 * covariance), 0.0)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProfileEnd:
    """An end of a profile, by the emulator and by the real solver.

    Parameters
    ----------
    value, solved : float
        ``solved`` is NaN where the simulation failed.
    is_open : bool
        Whether it is at the bound, where the profile has not risen enough.
    """

    value: float
    solved: float
    is_open: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sampled:
    """Result of the stage; all profiles are of the first posterior, of the main scenario if it has one.

    Parameters
    ----------
    posteriors : list of Posterior
    profiles : list of Profile
    ends : list of pairs of ProfileEnd
    curves : EmulatedCurves
    """

    posteriors: list[Posterior]
    profiles: list[Profile]
    ends: list[tuple[ProfileEnd, ...]]
    curves: EmulatedCurves


@dataclass(frozen=True, slots=True, kw_only=True)
class PosteriorSampling:
    """Draws the posteriors of the joint fits of a study.

    Parameters
    ----------
    study : Study
    design : Design
        Of the sweep; may be empty.
    swept : sequence of Simulation
        Of its sets.
    progress : Progress
    """

    study: Study
    design: Design
    swept: Sequence[Simulation]
    progress: Progress = SILENT

    def run(self, cases: Sequence[Case], assessed: Sequence[Assessed]) -> Sampled | None:
        """Sample every scenario of the joint fit whose spots are alike; None where that has no intervals."""
        main = next((a for a in assessed if a.case.scenario.name == self.study.generalise_by), None)
        if main is None:
            return None
        every = [main, *(a for a in assessed if a is not main and a.case.label == main.case.label)]
        if not (joint := [each for each in every if each.errors.between is None]):
            why = "no posterior of one value for all: the spots differ in every scenario"
            raise StudyError(f"{why}; read the values of each with `palpate intervals`")
        weighed = {channel_of(name) for each in self.study.scenarios for name in each.weighed}
        simulated = SimulatedCurves(main.end.problem, sorted(weighed))
        runs = self._first_runs(simulated, [case for case in cases if case.label == main.case.label])
        self.progress.begin("certainty", 0)
        for i in range(MOST_ROUNDS):
            curves = EmulatedCurves(simulated, runs)
            posteriors = [self._sampled(each, curves) for each in joint]
            error = max(float(each.missed.max(initial=0.0)) for each in posteriors)
            if error <= PRECISE or i == MOST_ROUNDS - 1:
                break
            for each in posteriors:
                runs = runs.and_others(each.checked)
        if error > PRECISE:
            self.progress.note(
                f"warning: emulated curves differ from simulated ones by up to "
                f"{100.0 * error:.2g} % of their peak"
            )
        posteriors = [self._converged(each) for each in posteriors]
        profiles, ends = self._profiles(posteriors[0])
        return Sampled(posteriors=posteriors, profiles=profiles, ends=ends, curves=curves)

    def _first_runs(self, simulated: SimulatedCurves, cases: Sequence[Case]) -> Runs:
        problem, runs = simulated.problem, runs_of_fits(simulated, cases)
        # Runs with slopes for each parameter that the first emulator has.
        n = 4 * len(problem.parameters)
        spread = scipy.stats.qmc.Halton(len(problem.parameters), rng=self.study.seed).random(64 * n)
        accepted = spread[problem.accepts(spread)][: max(n - len(runs.values), n // 2)]
        runs = runs.and_others(simulated.runs(accepted, slopes=self.study.solver.provides.slopes).ended)
        swept = runs_of_sets(simulated, self.design, self.swept)
        return runs if swept is None else runs.and_others(swept)

    def _sampled(self, assessed: Assessed, curves: EmulatedCurves) -> Posterior:
        """A short sample of a posterior, some of it simulated."""
        assert assessed.end.best is not None
        problem, simulated = assessed.end.problem, curves.simulated
        box, normal = problem.box, assessed.density
        fitted = box.values(assessed.end.best.point)
        density = EmulatedProblem(problem, simulated, fitted, assessed.white, curves)
        likely = normal.points[normal.weights > 1e-3 * normal.weights.max()]
        start = box.point(box.linear(likely))
        draws = self._drawn(density, start, to_convergence=False)
        known = np.stack([box.point(row) for row in curves.runs.values])
        chosen = _farthest(draws.points, known, len(box.names) + 2)
        checked = simulated.runs(chosen, slopes=self.study.solver.provides.slopes).ended
        return Posterior(assessed=assessed, density=density, draws=draws, checked=checked)

    def _converged(self, found: Posterior) -> Posterior:
        """The same posterior, sampled until its draws have converged."""
        draws = self._drawn(found.density, found.draws.points, to_convergence=True)
        return replace(found, draws=draws)

    def _drawn(self, density: EmulatedProblem, start: FloatArray, *, to_convergence: bool) -> Draws:
        def misfit(points: FloatArray) -> FloatArray:
            return density.misfit(density.problem.box.values(points))

        accepts = density.problem.accepts
        return draw(misfit, accepts, start, self.study.seed, to_convergence=to_convergence)

    def _profiles(self, found: Posterior) -> tuple[list[Profile], list[tuple[ProfileEnd, ...]]]:
        """Profiles of all parameters, both ends of each fitted again with the real solver."""
        box, density, end = found.density.problem.box, found.density, found.assessed.end

        def white(points: FloatArray) -> FloatArray:
            return density.white(box.values(points))

        def solved(points: FloatArray) -> FloatArray:
            runs = density.curves.runs(points, slopes=self.study.solver.provides.slopes)
            return density.white(runs.values, runs.ordinates)

        assert end.best is not None
        start = end.best.point
        best, least = least_near(white, start, np.ones(start.size, dtype=bool))
        sds = found.draws.points.std(axis=0)
        profiles = [profile(white, best, least, i, float(sds[i])) for i in range(best.size)]
        points = np.stack([best, *(at for each in profiles for at in each.ends)])
        fixed = [None, *np.repeat(np.arange(best.size), 2).tolist()]
        first, *others = refitted(white, solved, points, fixed).tolist()
        rises = np.reshape(others, (-1, 2)) - first
        ends = [
            tuple(
                _end(box, best, i, each.ends[k], float(rises[i, k]), is_open=each.is_open[k]) for k in (0, 1)
            )
            for i, each in enumerate(profiles)
        ]
        return profiles, ends


def _end(box: Box, best: FloatArray, i: int, at: FloatArray, rise: float, *, is_open: bool) -> ProfileEnd:
    """End of the real solver's profile, which has risen by so much where the emulator's ends."""
    moved = at.copy()
    if not is_open:  # nearly a square around the best point
        moved[i] = np.clip(best[i] + (at[i] - best[i]) * np.sqrt(RISE / max(rise, 1e-3)), 0.0, 1.0)
    solved = float(box.values(moved)[i]) if np.isfinite(rise) else np.nan
    return ProfileEnd(value=float(box.values(at)[i]), solved=solved, is_open=is_open)


def _farthest(points: FloatArray, others: FloatArray, n: int) -> FloatArray:
    """Points (n, n_parameters) far from the others and from each other, by their own spread."""
    width = np.maximum(points.std(axis=0), 1e-9)
    apart = np.full(len(points), np.inf)
    chosen: list[int] = []
    for other in others:
        apart = np.minimum(apart, (((points - other) / width) ** 2).sum(axis=1))
    while len(chosen) < min(n, len(points)):
        chosen.append(int(np.argmax(apart)))
        apart = np.minimum(apart, (((points - points[chosen[-1]]) / width) ** 2).sum(axis=1))
    return points[chosen]
