"""The certainty of a study's fits: intervals, their causes, and whether the model describes the data."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Self

import numpy as np
import polars as pl

from palpate.api import (
    SILENT,
    FloatArray,
    Limb,
    PalpateError,
    ParameterName,
    Progress,
    Response,
    ScoringError,
)
from palpate.api.executors import StoppedError
from palpate.api.fit import (
    THRESHOLDS,
    Adequacy,
    Case,
    Evaluation,
    Fit,
    Problem,
    Trial,
    channel_of,
    linear_least,
)
from palpate.api.runs import Study, relaxation_of
from palpate_certainty.adequacy import Check, checks, closeness_of, is_beyond, misfits, shape_of
from palpate_certainty.error_sources import (
    MESH,
    Columns,
    ErrorSource,
    columns_of,
    error_budget,
    error_sources_of,
    mesh_errors,
)
from palpate_certainty.laplace import PRIORS
from palpate_certainty.likeliest import likeliest, straightened
from palpate_certainty.linear_problem import LinearProblem, errors_of, linearised
from palpate_certainty.mesh_error import SpotMesh, is_stated
from palpate_certainty.noise_model import ResidualLayout, layout_of
from palpate_certainty.tables import Assessed, certainty_tables, coordinates_of, most_likely


@dataclass(frozen=True, slots=True, kw_only=True)
class Assessment:
    """Assesses the fits of a study.

    Parameters
    ----------
    study : Study
    measured : mapping of spot name to Response
    meshes : mapping of spot name to SpotMesh
        Of the spots whose meshes are known.
    limbs : dict of limb name to Limb
        On which jobs are simulated; those that a cause changes are added.
    progress : Progress
    powers : dict of name to float
        Powers of moduli in which curves are linear; those that are found are added.
    """

    study: Study
    measured: Mapping[str, Response]
    meshes: Mapping[str, SpotMesh] = field(default_factory=dict)
    limbs: dict[str, Limb] = field(default_factory=dict)
    progress: Progress = SILENT
    powers: dict[str, float] = field(default_factory=dict)

    def run(self, cases: Sequence[Case]) -> dict[str, pl.DataFrame]:
        """Intervals of every case that has a result, and what they are made of."""
        return certainty_tables(self.assessed(cases), self.study)

    def assessed(self, cases: Sequence[Case], *, joint_only: bool = False) -> list[Assessed]:
        """Assess every case that has a result, or the joint fit of the scenario that generalises alone.

        The derivatives of causes are taken at the latter.
        """
        ended = [case for case in cases if case.end is not None and case.end.best is not None]
        found: list[Assessed] = []
        by = next((c for c in ended if c.scenario.name == self.study.generalise_by), None)
        if by is None:
            return found
        with self.noting("intervals"):
            self._check_score(by)
            columns, failures = self.columns(by)
            found.append(straightened(self.assess(by, columns, failures, cases=ended), self.powers))
        for case in ended if found and not joint_only else ():
            if case is not by:
                with self.noting(f"intervals for {case.label}, scenario {case.scenario.name}"):
                    assessed = self.assess(case, columns, failures, found[0], ended)
                    found.append(straightened(assessed, self.powers))
        return sorted(found, key=lambda each: ended.index(each.case))

    @contextmanager
    def noting(self, what: str) -> Iterator[Self]:
        """Warn that there is no ``what`` where it cannot be made."""
        try:
            yield self
        except StoppedError:
            raise
        except (PalpateError, np.linalg.LinAlgError) as error:
            self.progress.note(f"warning: no {what}: {error}")

    def columns(self, case: Case) -> tuple[Columns, dict[ErrorSource, str]]:
        """Change of each curve by one standard deviation of each cause, and why some have no derivative."""
        assert case.end is not None
        causes = error_sources_of(self.study, self.measured, [p.name for p in case.end.problem.parameters])
        weighed = {channel_of(name) for each in self.study.scenarios for name in each.weighed}
        found = dict.fromkeys(name for response in self.measured.values() for name in response)
        names = [name for name in found if name in weighed]
        columns, failures = columns_of(case.end, causes, names, self.limbs)
        for cause, why in failures.items():
            self.progress.note(f"warning: intervals are without the cause '{cause.name}': {why}")
        return columns, failures

    def assess(
        self,
        case: Case,
        columns: Columns,
        failures: Mapping[ErrorSource, str] = MappingProxyType({}),
        first: Assessed | None = None,
        cases: Sequence[Case] = (),
    ) -> Assessed:
        """Assess a case, with curves that are linear around the end of its fit, or around likelier values.

        Without a mesh, simulations cost little, and the most likely values are found on simulated curves;
        where Fopt weighs the curves, the fit has ended there. With a mesh, curves of a tissue that relaxes,
        which go with products of moduli and shares, are linear once more around the most likely values.
        Where spots differ, curves of each are linear around the end of its own fit, one of ``cases``.
        """
        assert case.end is not None
        points = self._points(case.end, columns, first, None)
        found = self._weighed(case, points, failures, first)
        if found.errors.between is not None and (own := self._own(case, cases, points, columns)):
            found = self._weighed(case, replace(points, own=own), failures, first)
        if found.linear.is_like_fopt or found.errors.between is not None:
            return found
        if not self.study.solver.provides.mesh:
            likely = likeliest(found)
            there = self._points(case.end, columns, found, likely)
            found = self._weighed(case, there, failures, found, likely, is_likeliest=True)
        elif self.study.relaxes:
            there = self._points(case.end, columns, first, found)
            found = self._weighed(case, there, failures, first, found)
        return found

    def _weighed(
        self,
        case: Case,
        points: LinearProblem,
        failures: Mapping[ErrorSource, str],
        first: Assessed | None,
        again: Assessed | None = None,
        *,
        is_likeliest: bool = False,
    ) -> Assessed:
        """Assess a case: its covariance, and whether the model describes its data.

        Noise and discrepancy of ``first`` serve here too if it has all channels: errors of some curves are no
        smaller because others are left out. Curves may be linear around the values of the same case assessed
        before (``again``), whose misfits count; ``is_likeliest``: these are the most likely.
        """
        end = case.end
        assert end is not None
        linear = points.averaged()
        errors = errors_of(linear, first.errors if first else None)
        there, averaged = points, linear
        if errors.between is not None:  # each spot is at values of its own
            there, averaged = points.by_spot, linear.by_spot
            changes = errors.between.changes(there.jacobian, there.rows)
            there = replace(there, residuals=there.residuals + changes)
        missed = again.misfits if again else misfits(there, averaged, errors)
        shape = again.shape if again else shape_of(averaged, errors)
        if shape[0] < THRESHOLDS.unusual or any(is_beyond(m, linear.expected[i]) for i, m in missed.items()):
            linear, errors = linear.like_fopt(errors)
        of_all = linear.density(errors, is_likeliest=is_likeliest)
        along = coordinates_of(linear, errors)
        density, point = most_likely(of_all, linear, errors, along, end.problem)
        if errors.between is None:
            there = replace(points, residuals=points.residuals + points.jacobian @ (point - points.point))
        close = closeness_of(there.residuals, end.problem.terms, points.channels)
        made = checks(missed, linear.expected, close, shape, errors.alike, of_all.in_ranges)
        return Assessed(
            case=case,
            end=end,
            linear=linear,
            errors=errors,
            point=point,
            laplace=of_all,
            along=along,
            density=density,
            misfits=missed,
            shape=shape,
            checks=(*made, *self._relaxation(case)),
            mesh_errors=tuple(self._mesh_errors(end, points)),
            has_usual_mesh_error=self._has_usual_mesh_error(end),
            left_out=_left_out(case, failures) | self._of_score,
        )

    def _points(
        self, end: Fit, columns: Columns, first: Assessed | None, around: Assessed | None
    ) -> LinearProblem:
        """Problem of every measured point, with a named column for one standard deviation of each cause."""
        box, found = end.problem.box, end.at_end()
        if around is not None:
            (there,) = end.problem.evaluate([Trial(point=box.point(around.values), slopes=True)])
            found = found if there.jacobian is None else there
        residuals, jacobian, point = linearised(box, found)
        rows, channels = layout_of(end.problem.terms, residuals.size, first.linear.channels if first else ())
        return LinearProblem(
            point=point,
            residuals=residuals,
            jacobian=jacobian,
            rows=rows,
            known=self._known(end, residuals, rows, columns),
            channels=channels,
            box=box,
            expected={i: self.study.budget.discrepancy_of(name) for i, name in enumerate(channels)},
        )

    def _own(
        self, case: Case, cases: Sequence[Case], points: LinearProblem, columns: Columns
    ) -> LinearProblem | None:
        """Problem where each spot's curves are linear around its own fit; None if a spot has none.

        Presses at one place are linear around values where their squares together are nearly least.
        """
        assert case.end is not None
        whole, states = case.end.problem, self.study.space.states
        ends = {c.label: c.values() for c in cases if c.scenario is case.scenario and c is not case}
        if len(case.spots) < 2 or states or not ends.keys() >= set(case.spots):
            return None
        residuals, jacobian, scaled = points.residuals.copy(), points.jacobian.copy(), dict(columns)
        nothing = whole.residuals_of_nothing()
        point, n_spots = np.tile(points.point, (len(case.spots), 1)), len(case.spots)
        sites, parsed = [term.site for term in whole.terms], [*map(ParameterName.parse, whole.names)]
        for site in dict.fromkeys(sites):
            numbers = np.flatnonzero([at == site for at in sites])
            there = [whole.terms[number] for number in numbers]
            alone, rows = whole.restated(there), np.isin(points.rows.spot, numbers)
            found = _nearly_least(alone, [alone.point_of(ends[t.spot]) for t in there])
            if found is None:
                return None
            here = np.flatnonzero([any(name.counts_at(t.spot) for t in there) for name in parsed])
            own, slopes, point[np.ix_(numbers, here)] = linearised(alone.box, found)
            weight, n = (len(there) / n_spots) ** 0.5, int(rows.sum())
            residuals[rows], jacobian[np.ix_(rows, here)] = weight * own[:n], weight * slopes[:n]
        for number, term in enumerate(whole.terms):
            inside = np.flatnonzero(points.rows.spot == number)
            for channel in np.unique(points.rows.channel[inside]):
                at = inside[points.rows.channel[inside] == channel]
                old, new = (np.linalg.norm((of - nothing)[at]) for of in (points.residuals, residuals))
                curve = term.spot, points.channels[channel]
                # What is simulated of an error is in proportion to the curve.
                scaled[curve] = {cause: new / old * part for cause, part in columns.get(curve, {}).items()}
        known = self._known(case.end, residuals, points.rows, scaled)
        return replace(points, point=point, residuals=residuals, jacobian=jacobian, known=known)

    def _mesh_errors(self, end: Fit, points: LinearProblem) -> Iterator[dict[str, Any]]:
        if (errors := points.known.get(MESH)) is not None:
            yield from mesh_errors(self.study, end.problem.terms, points.residuals, errors, self.meshes)

    def _check_score(self, case: Case) -> None:
        """Warn of a score whose residuals are linear in the curves only to first order.

        Raises
        ------
        ScoringError
            Its residuals depend on other points of the curve as well.
        """
        assert case.end is not None
        score = self.study.scoring.score
        if score.linear:
            return
        for term in case.end.problem.terms:
            for name in term.weights:
                if not score.is_pointwise(term.measured[channel_of(name)], term.counted(name)):
                    raise ScoringError(
                        f"residuals of score '{score.name}' depend on other points of the curve as well"
                    )
        self.progress.note(
            f"warning: intervals and posteriors are of first order, since score '{score.name}' is not "
            "linear in the curves; how well parameters are identified is unclear"
        )

    @property
    def _of_score(self) -> dict[str, str]:
        """Part of ``left_out`` of an assessment: the score, where intervals are not exact for it."""
        score = self.study.scoring.score
        return {} if score.linear else {"score": f"'{score.name}' is not linear in the curves: first order"}

    def _has_usual_mesh_error(self, end: Fit) -> bool:
        """True if the mesh's error of a fitted channel is neither shown by a finer mesh nor stated."""
        return self.study.solver.provides.mesh and any(
            channel not in term.corrections and not is_stated(channel, self.study.budget.mesh)
            for term in end.problem.terms
            for channel in map(channel_of, term.weights)
        )

    def _relaxation(self, case: Case) -> Iterator[Check]:
        """Check the rests of the case's spots, where any were measured; nothing where the model has them."""
        if self.study.models_relaxation(case.scenario):
            return
        if found := relaxation_of({s: self.measured[s] for s in case.spots}, self.study.budget.gain):
            yield Check(
                name="relaxation",
                channel=-1,
                probability=found.probability,
                verdict=Adequacy.FAILS if found.is_beyond else Adequacy.DESCRIBES,
                message=found.sentence,
            )

    def _known(
        self, end: Fit, residuals: FloatArray, rows: ResidualLayout, columns: Columns
    ) -> dict[str, FloatArray]:
        """Change of the residuals (n, m) by one standard deviation of each known cause."""
        assert end.best is not None
        terms = end.problem.terms
        inputs = {term.spot: end.problem.inputs(term.spot, end.best.point) for term in terms}
        found = error_budget(self.study, self.measured, terms, residuals, columns, self.meshes, inputs)
        known = {
            label: np.stack(list(columns.values()), axis=1)
            for label, columns in found.items()
            if any(np.any(each) for each in columns.values())
        }
        of_priors = np.flatnonzero(rows.channel < 0)
        priors = np.zeros((len(residuals), len(of_priors)))
        priors[of_priors, np.arange(len(of_priors))] = end.problem.noise
        return known | {PRIORS: priors}


def _nearly_least(problem: Problem, starts: Sequence[FloatArray]) -> Evaluation | None:
    """Evaluation of the best start, or of one step from it where there are several; None if all fail."""
    found = problem.evaluate([Trial(point=start, slopes=True) for start in starts])
    if len(starts) > 1 and (best := _least(found)) is not None:
        residuals, slopes, shares = linearised(problem.box, best)
        width = problem.box.upper - problem.box.lower
        values = problem.box.lower + width * linear_least(slopes, slopes @ shares - residuals)
        found = [best, *problem.evaluate([Trial(point=problem.box.point(values), slopes=True)])]
    return _least(found)


def _least(found: Iterable[Evaluation]) -> Evaluation | None:
    has_slopes = [each for each in found if each.jacobian is not None]
    return min(has_slopes, key=lambda each: each.objective, default=None)


def _left_out(case: Case, failures: Mapping[ErrorSource, str]) -> dict[str, str]:
    """Reasons why causes that may be wrong at the spots of a case are in no interval."""
    return {
        (cause.of if cause.kind == "fixed" else cause.name): why
        for cause, why in failures.items()
        if any(map(cause.is_at, case.spots))
    }
