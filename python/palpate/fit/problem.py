"""A problem: residuals of some spots in a scenario, and their slopes, as functions of searched values.

Σ r² is the scenario's Fopt, averaged over the spots, under the same rules as a sweep's:
see :mod:`palpate.fit.spot_term`. A prior adds one residual, ``noise · (value − mean)/sd``.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from palpate.domain import BoolArray, FloatArray, Job, Parameter, ParameterName, Simulation, channel_of
from palpate.errors import PalpateError, ParameterError
from palpate.fit.bounded import slope_of
from palpate.fit.box import Box
from palpate.fit.spot_term import NotRankedError, SpotTerm, along_slopes, is_along_slopes, is_same_job
from palpate.plugins.guard import answering_for
from palpate.plugins.parametrisation import Parametrisation, SpotInputs
from palpate.plugins.search import Evaluation, Trial
from palpate.sampling.drawing import accepted_by_all
from palpate.study.reading import Study

Simulate = Callable[[Sequence[Job]], Sequence[Simulation]]
"""Simulations of jobs, in their order."""

Finish = Callable[[Sequence[Simulation]], list[Evaluation]]
"""From the simulations of all jobs of a round to the evaluations of a problem's trials."""

ROUNDING = 1e-9
"""Share of a range by which values may leave it, as those of optimisers do."""

SMALL_STEP = 1e-6
"""Step in the box for what the slopes of a simulation, or no simulation, answer."""


@dataclass(slots=True, eq=False)
class _Shift:
    """Inputs of a spot some steps along a coordinate, with the number of the job that answers them.

    Without a job it is the simulation at the point itself that answers, along its slopes.
    """

    step: float
    inputs: SpotInputs
    job: int | None


@dataclass(slots=True, eq=False)
class _Plan:
    """Simulations of a trial: by spot, its inputs, its job, and shifts by coordinate.

    A coordinate that cannot be shifted is among the failures.
    """

    trial: Trial
    inputs: dict[str, SpotInputs]
    jobs: dict[str, int]
    shifts: dict[tuple[str, int], list[_Shift]]
    failures: dict[int, str]
    failure: str = ""


class Problem:
    """Residuals and slopes of one spot, or jointly of several, in one scenario.

    Parameters
    ----------
    terms : sequence of SpotTerm
        One for each spot.
    simulate : callable
        From jobs to their simulations.
    noise : float
        Relative misfit (root of NMSE) that one standard deviation of a prior is worth.
    fine : bool
        Whether the spots' finer meshes are simulated.
    wider : mapping of name to Parameter
        Searched parameters with wider ranges than the study's.

    Attributes
    ----------
    parameters : tuple of Parameter
        What is searched, in the order of the values.
    box : Box
        From values to coordinates and back.
    asked : list of Job
        Every job so far, those with one key among them.
    """

    def __init__(
        self,
        study: Study,
        terms: Sequence[SpotTerm],
        simulate: Simulate,
        parametrisation: Parametrisation,
        *,
        noise: float = 0.01,
        fine: bool = False,
        wider: Mapping[str, Parameter] = MappingProxyType({}),
    ) -> None:
        self.study, self.terms, self.noise, self.fine = study, tuple(terms), noise, fine
        self.wider = wider
        self.simulate, self.parametrisation = simulate, parametrisation
        with answering_for(parametrisation, "asking for its parameters"):
            searched = parametrisation.parameters(study.space, [term.spot for term in terms])
        self.parameters: tuple[Parameter, ...] = tuple(wider.get(p.name, p) for p in searched)
        self.box = Box(self.parameters)
        self.asked: list[Job] = []
        self._last: Evaluation | None = None
        self._has_slopes = False

    def restated(
        self, terms: Sequence[SpotTerm], parametrisation: Parametrisation | None = None
    ) -> "Problem":
        """State other terms, and perhaps another parametrisation, of the same study and simulations."""
        return Problem(
            self.study,
            terms,
            self.simulate,
            parametrisation or self.parametrisation,
            noise=self.noise,
            wider=self.wider,
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the searched values."""
        return tuple(p.name for p in self.parameters)

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bound of each value, (n_parameters,) each, in its unit."""
        return self.box.lower, self.box.upper

    # ------------------------------------------------------------------ in values

    @property
    def start(self) -> FloatArray:
        """Values (n_parameters,) to start from: priors, the study's own, else the middle of the ranges."""
        return self.box.values(self.point_of({}))

    @property
    def failure(self) -> str:
        """Reason why the values asked for last have no residuals, or no slopes; empty where they have."""
        return "" if self._last is None else self._last.failure

    def residuals(self, values: ArrayLike) -> FloatArray:
        """Residuals (n_points,) at values (n_parameters,); all NaN where they cannot be simulated."""
        # With slopes where they are exact, so that `jacobian` at the same values costs no other simulation.
        found = self._at(values, slopes=self.study.solver.provides.slopes)
        return np.full(self.n_points, np.nan) if found.residuals is None else found.residuals

    def jacobian(self, values: ArrayLike) -> FloatArray:
        """Slopes (n_points, n_parameters) of the residuals per unit of each value; NaN as above."""
        found = self._at(values, slopes=True)
        if found.jacobian is None:
            return np.full((self.n_points, len(self.parameters)), np.nan)
        return found.jacobian / self.box.rates(found.point)

    def fopt(self, values: ArrayLike) -> float:
        """Fopt at values (n_parameters,), priors aside; infinite where they cannot be simulated."""
        return self._at(values, slopes=False).fopt

    def _at(self, values: ArrayLike, *, slopes: bool) -> Evaluation:
        """Evaluate values, unless they are the last ones again.

        Raises
        ------
        ParameterError
            They are not one finite number for each parameter, within its range.
        """
        given = np.asarray(values, dtype=np.float64)
        point = self.box.point(self._checked(given))
        last = self._last
        if last is None or not np.array_equal(last.point, point) or (slopes and not self._has_slopes):
            (self._last,) = self.evaluate([Trial(point=point, slopes=slopes)])
            self._has_slopes, last = slopes, self._last
        return last

    def _checked(self, values: FloatArray) -> FloatArray:
        if values.shape != self.box.lower.shape:
            raise ParameterError(
                f"values of shape {values.shape}; give one for each of {', '.join(self.names)}"
            )
        slack = ROUNDING * (self.box.upper - self.box.lower)
        inside = (values >= self.box.lower - slack) & (values <= self.box.upper + slack)
        for parameter, value, is_inside in zip(self.parameters, values.tolist(), inside, strict=True):
            if not is_inside:
                raise ParameterError(
                    f"{parameter.name} = {value:g} {parameter.unit} is not within its range, "
                    f"{parameter.lower:g} to {parameter.upper:g}; give the optimiser `problem.bounds`"
                )
        return values

    def point_of(self, known: Mapping[str, float]) -> FloatArray:
        """Point of the box that has values by name to the last bit, so that their simulations are found.

        What is not known is at its prior, where the parametrisation starts, or in the middle.
        """
        usual = self._usual()
        point = np.full(len(self.parameters), 0.5)
        for i, parameter in enumerate(self.parameters):
            head = ParameterName.parse(parameter.name).shared
            prior = {} if parameter.prior is None else {parameter.name: parameter.prior.value}
            for given in (known, prior, usual):
                if parameter.name in given or head in given:
                    values = self.box.lower.copy()
                    values[i] = given.get(parameter.name, given.get(head, np.nan))
                    point[i] = self.box.exact_point(values)[i]
                    break
        return point

    def values_of(self, row: Mapping[str, float]) -> FloatArray:
        """Values (n_parameters,) of a set of the sweep, given by name; where it varies none, the usual."""
        given = {**self._usual(), **row}
        known = [given.get(name, given.get(ParameterName.parse(name).shared, np.nan)) for name in self.names]
        # To the last bit those of the sweep, which by way of the box they are not.
        return np.clip(np.where(np.isnan(known), self.start, known), self.box.lower, self.box.upper)

    def _usual(self) -> Mapping[str, float]:
        with answering_for(self.parametrisation, "asking where to start"):
            return self.parametrisation.start({term.spot: term.protocol for term in self.terms})

    def residuals_of_nothing(self) -> FloatArray:
        """Residuals (n_points,) where every simulated ordinate is zero; zero for the priors."""
        parts = [term.of_nothing() / np.sqrt(len(self.terms)) for term in self.terms]
        return np.concatenate([*parts, np.zeros(self.n_points - sum(map(len, parts)))])

    @property
    def n_points(self) -> int:
        """Number of residuals: measured points, and one for each prior."""
        return sum(term.n_points for term in self.terms) + sum(p.prior is not None for p in self.parameters)

    # --------------------------------------------------------------------- trials

    def evaluate(self, trials: Sequence[Trial]) -> list[Evaluation]:
        """Evaluate points of the box; whatever they need is simulated side by side.

        Slopes that a simulation lacks, as where its tangent is singular, come from differences.
        """
        jobs: list[Job] = []
        finish = self.begin(trials, jobs)
        return finish(self.simulate(jobs))

    def columns(self, point: FloatArray) -> tuple[FloatArray, dict[str, str]]:
        """Slopes at a point of the box, as far as each can be simulated.

        Returns
        -------
        slopes : (n_points, n_parameters) array
            NaN in the columns of values in which there is no slope.
        failures : mapping of name to str
            Why, of each of these values.

        Raises
        ------
        ParameterError
            The point itself cannot be simulated.
        """
        jobs: list[Job] = []
        plan = self._planned(Trial(point=point, slopes=True), jobs)
        try:
            if plan.failure:
                raise ParameterError(plan.failure)
            simulations = self.simulate(jobs)
            slopes, failures = self._jacobian(plan, simulations, self._parts(plan, simulations))
        except NotRankedError as error:
            raise ParameterError(str(error)) from error
        return slopes, {self.names[i]: why for i, why in failures.items()}

    def begin(self, trials: Sequence[Trial], jobs: list[Job]) -> Finish:
        """Add what the trials need to ``jobs``, perhaps next to another problem's.

        Returns
        -------
        callable
            Takes the simulations of all these jobs, and returns an evaluation for each trial.
        """
        plans = [self._planned(trial, jobs) for trial in trials]
        return lambda simulations: [self._evaluation(plan, simulations) for plan in plans]

    def inputs(self, spot: str, point: FloatArray) -> SpotInputs:
        """Inputs of the simulation at a spot at a point of the box.

        Raises
        ------
        PalpateError
            No material takes such values.
        """
        return self._inputs(self._term(spot), point)

    def accepts(self, points: FloatArray) -> BoolArray:
        """Mask of the points (n, n_parameters) that materials and filters accept at every spot."""
        accepted, values = np.ones(len(points), dtype=np.bool_), self.box.values(points)
        before = None
        for term in self.terms:
            rows = np.full((len(points), len(self.study.space.names)), np.nan)
            for i in np.flatnonzero(accepted):
                try:
                    rows[i] = self._row(self.inputs_at(term, values[i]))
                except PalpateError:
                    accepted[i] = False
            if before is None or not np.array_equal(rows[accepted], before[accepted]):
                accepted[accepted] = accepted_by_all(self.study.filters, self.study.space, rows[accepted])
            before = rows
        return accepted

    def simulated(self, term: SpotTerm, inputs: SpotInputs) -> Simulation:
        """Simulate these inputs, with slopes if the solver gives them, as a search has them."""
        slopes = self.study.solver.provides.slopes
        (simulation,) = self.simulate([term.job(inputs, -1, slopes=slopes, fine=self.fine)])
        return simulation

    def _inputs(self, term: SpotTerm, point: FloatArray) -> SpotInputs:
        return self.inputs_at(term, self.box.values(point))

    def inputs_at(self, term: SpotTerm, values: FloatArray) -> SpotInputs:
        """Inputs of the simulation at a spot at values (n_parameters,)."""
        named = dict(zip(self.names, values.tolist(), strict=True))
        with answering_for(self.parametrisation, f"its inputs at spot '{term.spot}'"):
            found = self.parametrisation.inputs(self.study.space, term.spot, term.protocol, named)
            if not isinstance(found, SpotInputs):
                raise TypeError(f"it gave {found!r:.100}, not SpotInputs")
            return found

    def _planned(self, trial: Trial, jobs: list[Job]) -> _Plan:
        plan = _Plan(trial, {}, {}, {}, {})
        try:
            for term in self.terms:
                plan.inputs[term.spot] = self._inputs(term, trial.point)
                self._check(plan.inputs[term.spot])
            exact = self.study.solver.provides.slopes and trial.slopes
            for term in self.terms:
                base = plan.inputs[term.spot]
                plan.jobs[term.spot] = self._add(jobs, term, base, slopes=exact)
                for i in range(len(self.parameters)) if trial.slopes else ():
                    self._shift(plan, term, i, jobs, exact=exact)
        except (PalpateError, NotRankedError) as error:
            plan.failure = str(error)
        return plan

    def _shift(self, plan: _Plan, term: SpotTerm, i: int, jobs: list[Job], *, exact: bool) -> None:
        """Plan the steps along a coordinate; where inputs cannot be made of one, that is its failure."""
        base, point = plan.inputs[term.spot], plan.trial.point
        try:
            plan.shifts[term.spot, i] = self._shifts(term, base, point, i, jobs, exact=exact)
        except PalpateError as error:
            plan.failures[i] = str(error)

    def _add(self, jobs: list[Job], term: SpotTerm, inputs: SpotInputs, *, slopes: bool) -> int:
        # No row of the design has a negative number, and no other job of this batch the same.
        jobs.append(term.job(inputs, -1 - len(jobs), slopes=slopes, fine=self.fine))
        self.asked.append(jobs[-1])
        return len(jobs) - 1

    def _check(self, inputs: SpotInputs) -> None:
        """Refuse what a material or a filter of the study refuses."""
        row = self._row(inputs)
        for keep in self.study.filters:
            if not accepted_by_all([keep], self.study.space, row[None])[0]:
                raise NotRankedError(f"filter '{keep.name}' refuses it: {keep.reason(self.study.space, row)}")

    def _row(self, inputs: SpotInputs) -> FloatArray:
        """Searched values (n_searched,) of the regions as filters take them, if no material refuses them."""
        space = self.study.space
        for region in space.regions:
            region.material.check(inputs.thetas[region.region])
        written = space.written(inputs.thetas)
        return np.array([written[name] for name in space.names])

    def _shifts(
        self, term: SpotTerm, base: SpotInputs, point: FloatArray, i: int, jobs: list[Job], *, exact: bool
    ) -> list[_Shift]:
        """Two steps along a coordinate: to both sides, or both inwards from a bound; one to another mesh.

        Curves are nearly linear in small changes of a limb, and each change costs a simulation.
        """
        probe = self._inputs(term, _moved(point, i, SMALL_STEP if point[i] < 0.5 else -SMALL_STEP))
        is_free = (exact and is_along_slopes(base, probe)) or is_same_job(base, probe)
        size = SMALL_STEP if is_free else self.study.solver.provides.accuracy ** (1.0 / 3.0)
        steps: tuple[float, ...]
        if probe.mesh != base.mesh:
            # Half a step, since the error by curvature is in proportion to it.
            steps = (0.5 * size if point[i] <= 0.5 else -0.5 * size,)
        elif size <= point[i] <= 1.0 - size:
            steps = (-size, size)
        else:
            steps = (size, 2.0 * size) if point[i] < 0.5 else (-size, -2.0 * size)
        # Of both before a job of one: a step that cannot be taken costs no simulation.
        moved = [(step, self._inputs(term, _moved(point, i, step))) for step in steps]
        return [
            _Shift(step, inputs, None if is_free else self._add(jobs, term, inputs, slopes=False))
            for step, inputs in moved
        ]

    # ----------------------------------------------------------------- evaluating

    def _evaluation(self, plan: _Plan, simulations: Sequence[Simulation]) -> Evaluation:
        point = plan.trial.point
        if plan.failure:
            return Evaluation(point=point, objective=np.inf, fopt=np.inf, failure=plan.failure)
        try:
            parts = self._parts(plan, simulations)
        except NotRankedError as error:
            return Evaluation(point=point, objective=np.inf, fopt=np.inf, failure=str(error))
        fitted = np.concatenate(list(parts.values()))
        residuals = np.concatenate([fitted, self._priors(point)])
        jacobian, failure = None, ""
        if plan.trial.slopes:
            jacobian, failures = self._jacobian(plan, simulations, parts)
            if failures:
                jacobian, failure = None, f"no slopes: {next(iter(failures.values()))}"
        return Evaluation(
            point=point,
            objective=float(residuals @ residuals),
            fopt=float(fitted @ fitted),
            residuals=residuals,
            jacobian=jacobian,
            failure=failure,
        )

    def _parts(self, plan: _Plan, simulations: Sequence[Simulation]) -> dict[str, FloatArray]:
        """Residuals of each spot at the point itself."""
        return {
            t.spot: self._part(t, simulations[plan.jobs[t.spot]], plan.inputs[t.spot]) for t in self.terms
        }

    def _part(self, term: SpotTerm, simulation: Simulation, inputs: SpotInputs) -> FloatArray:
        return term.residuals(simulation, inputs) / np.sqrt(len(self.terms))

    def _jacobian(
        self, plan: _Plan, simulations: Sequence[Simulation], parts: Mapping[str, FloatArray]
    ) -> tuple[FloatArray, dict[int, str]]:
        """Slopes (n_points, n_parameters), NaN where there are none, and why there are none."""
        here = {spot: simulations[job] for spot, job in plan.jobs.items()}
        columns, lacking = self._columns(plan, list(plan.shifts), here, simulations, parts)
        if again := [at for at in lacking if any(shift.job is None for shift in plan.shifts[at])]:
            jobs: list[Job] = []
            for spot, i in again:
                self._shift(plan, self._term(spot), i, jobs, exact=False)
            found, left = self._columns(plan, again, here, self.simulate(jobs), parts)
            columns |= found
            lacking = {at: why for at, why in lacking.items() if at not in again} | left
        failures = plan.failures | {i: why for (_, i), why in lacking.items()}
        rows = []
        for term in self.terms:
            nothing = np.full(parts[term.spot].size, np.nan)
            of_term = [columns.get((term.spot, i), nothing) for i in range(len(self.parameters))]
            rows.append(np.stack(of_term, axis=1))
        slopes = np.concatenate([*rows, self._prior_rows(plan.trial.point)])
        slopes[:, list(failures)] = np.nan
        return slopes, dict(sorted(failures.items()))

    def _columns(
        self,
        plan: _Plan,
        wanted: Iterable[tuple[str, int]],
        here: Mapping[str, Simulation],
        shifted: Sequence[Simulation],
        parts: Mapping[str, FloatArray],
    ) -> tuple[dict[tuple[str, int], FloatArray], dict[tuple[str, int], str]]:
        """Slopes of spots in coordinates from planned shifts, and why there are none."""
        columns, lacking = {}, {}
        for spot, i in wanted:
            term, base, points = self._term(spot), plan.inputs[spot], []
            channels = set(map(channel_of, term.weights))
            try:
                for shift in plan.shifts[spot, i]:
                    known = (
                        along_slopes(here[spot], base, shift.inputs, channels)
                        if shift.job is None
                        else shifted[shift.job]
                    )
                    points.append((shift.step, self._part(term, known, shift.inputs)))
                columns[spot, i] = slope_of(parts[spot], points)
            except NotRankedError as error:
                lacking[spot, i] = str(error)
        return columns, lacking

    def _term(self, spot: str) -> SpotTerm:
        (term,) = (term for term in self.terms if term.spot == spot)
        return term

    def _priors(self, point: FloatArray) -> FloatArray:
        priors = [(p.prior, v) for p, v in zip(self.parameters, self.box.values(point), strict=True)]
        return np.array([self.noise * (v - p.value) / p.sd for p, v in priors if p is not None])

    def _prior_rows(self, point: FloatArray) -> FloatArray:
        scales = [np.nan if p.prior is None else self.noise / p.prior.sd for p in self.parameters]
        rows = np.diag(np.array(scales) * self.box.rates(point))
        return rows[[i for i, p in enumerate(self.parameters) if p.prior is not None]]


def _moved(point: FloatArray, i: int, step: float) -> FloatArray:
    moved = point.copy()
    moved[i] += step
    return moved
