"""Further presses that reduce the expected error most, chosen one after the other."""

import functools
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.api import (
    FORCE,
    PRESS_AND_TWIST,
    FloatArray,
    Limb,
    Parameter,
    ParameterName,
    ParameterSpace,
    Protocol,
    Response,
    Status,
    StudyError,
)
from palpate.api.fit import LEVEL, Parametrisation, SpotInputs, pieces
from palpate.api.runs import Study, Tool
from palpate_certainty.api import FLAT_SD, N_DRAWS, RANGE_SD, Density, Laplace, wider
from palpate_planning.information import ErrorSizes, ExpectedError, FisherInformation
from palpate_planning.presses import DesignProblem, SimulatedPress, job_of, observed, point_in, slopes_of
from palpate_prediction.api import is_by_force, refined_limbs


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ToolForce:
    """Largest force of a tool at one spot, with the values of a fit.

    Parameters
    ----------
    name : str
        Of the tool and the spot.
    force_N : float
    gradient : (n_parameters,) array
        Change of the force over the force, per unit of each parameter that all presses share.
    """

    name: str
    force_N: float
    gradient: FloatArray


class UnderTool(Parametrisation):
    """Materials as a study's parametrisation has them; everything else is the tool's own."""

    name, summary = "under_tool", "a study's materials under a tool"

    def __init__(self, base: Parametrisation, spot: str) -> None:
        super().__init__()
        self.base, self.spot = base, spot

    def parameters(self, space: ParameterSpace, spots: tuple[str, ...]) -> tuple[Parameter, ...]:  # type: ignore[override]
        """Parameters of the study at a spot of the run."""
        return self.base.parameters(space, [self.spot])

    def inputs(
        self, space: ParameterSpace, spot: str, protocol: Protocol, values: Mapping[str, float]
    ) -> SpotInputs:
        """The study's materials, pressed by the tool."""
        found = self.base.inputs(space, self.spot, protocol, values)
        return SpotInputs(thetas=found.thetas, protocol=protocol, observe=found.observe)


def tool_limbs(study: Study, tool: Tool | None) -> dict[str, Limb]:
    """Limbs that a tool presses, by the names of its jobs."""
    if tool is None:
        return {}
    return {_at(tool, spot): limb for spot, limb in refined_limbs(tool.study(study), tool).items()}


def check_tool(design: DesignProblem, tool: Tool) -> None:
    """Refuse a tool whose force is known, or that no press tells of.

    Raises
    ------
    StudyError
        It is pressed by force, or a material is not the same at all spots.
    """
    if is_by_force(tool.protocol):
        raise StudyError(
            f"tool '{tool.name}' is pressed by force, so its force is known; give it a depth instead"
        )
    materials = {name.shared for name in map(ParameterName.parse, design.problem.names) if name.spot}
    if own := sorted(materials & set(design.study.space.names)):
        raise StudyError(
            f"{', '.join(own)} is fitted for each spot by itself, so presses tell nothing of a tool at "
            "another place; fit one value for all spots, or name another goal"
        )


def tool_forces(design: DesignProblem, tool: Tool, point: FloatArray) -> tuple[ToolForce, ...]:
    """Force of a tool at each of its spots, at a point (n_parameters,) of the box; one simulation each.

    Raises
    ------
    StudyError
        The tool cannot be pressed.
    """
    return tuple(_force(design, tool, spot.spot.name, point) for spot in tool.spots)


def _force(design: DesignProblem, tool: Tool, spot: str, point: FloatArray) -> ToolForce:
    like, name = design.term(spot), _at(tool, spot)
    bare = replace(
        like,
        spot=name,
        protocol=tool.protocol,
        measured=Response(curves={}),
        weights={},
        corrections={},
        channels=PRESS_AND_TWIST,
    )
    problem = design.problem.restated([bare], UnderTool(design.problem.parametrisation, like.spot))
    (simulation,) = problem.simulate([job_of(design, problem, point)])
    simulation = observed(problem, point_in(design, problem, point), simulation)
    curves = {} if simulation.response is None else simulation.response.curves
    if FORCE.name not in curves or simulation.status is not Status.OK:
        why = simulation.message or simulation.status.remedy
        raise StudyError(f"{name} cannot be predicted: {simulation.status}: {why}")
    # Its own curve as the measured one: the slope of a residual is that of the force, times its scale.
    measured = Response(curves={FORCE.name: curves[FORCE.name]})
    stated = problem.restated([replace(bare, measured=measured, weights={}).of_channels([FORCE.name])])
    (found,) = slopes_of([(stated, point_in(design, stated, point))])
    if found.jacobian is None:
        raise StudyError(f"{name} cannot be predicted: {found.failure}")
    force, ((_, _, at, scale),) = curves[FORCE.name].ordinate, pieces(stated.terms)
    largest = int(np.argmax(force))
    slopes = found.jacobian[at][largest] / scale[largest] / stated.box.rates(found.point)
    by_name = dict(zip(stated.names, slopes.tolist(), strict=True))
    names = (design.problem.names[i] for i in design.shared)
    return ToolForce(
        name=name,
        force_N=float(force[largest]),
        gradient=np.array([by_name[each] for each in names]) / force[largest],
    )


def _at(tool: Tool, spot: str) -> str:
    return f"{tool.name} at {spot}"


ALL, WORST, PREDICTION = "all", "worst", "prediction"
"""Goals: the volume of the joint region, the relative width of the parameter that is known least, and the
force of a tool."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Goal:
    """Error that presses are to reduce.

    Parameters
    ----------
    name : str
        ``all``, ``worst``, ``prediction`` or the name of a parameter.
    parameters : tuple of Parameter
        Those that all presses share.
    values : (n_parameters,) array
        Where the fit has ended.
    predicted : tuple of ToolForce
        What is predicted; relative widths of several count alike.
    """

    name: str
    parameters: tuple[Parameter, ...]
    values: FloatArray
    predicted: tuple[ToolForce, ...] = ()

    def __post_init__(self) -> None:
        check_goal(self.name, self.parameters)

    @property
    def lower(self) -> FloatArray:
        """Lower ends (n_parameters,) of the ranges."""
        return np.array([p.lower for p in self.parameters])

    @property
    def ranges(self) -> FloatArray:
        """Widths (n_parameters,) of the ranges."""
        return np.array([p.upper - p.lower for p in self.parameters])

    @property
    def gradients(self) -> FloatArray:
        """Changes (n_predicted, n_parameters) of what is predicted, over it, per range."""
        gradients = [each.gradient * self.ranges for each in self.predicted]
        return np.array(gradients).reshape(-1, len(self.parameters))

    def error(self, expected: ExpectedError) -> float:
        """Error to be reduced, in some unit: of root mean square errors, with the meshes at their worst."""
        if self.name == PREDICTION:
            return float(np.sqrt(np.mean(expected.rms(self.gradients) ** 2)))
        rms = expected.rms(np.eye(len(self.parameters)))
        if self.name == ALL:
            # The volume with the correlations of the fit, each width with the bias.
            of_bias = wider(expected.freedom) * np.exp(np.log(rms / expected.sds).mean())
            return float(of_bias * np.exp(0.5 * np.linalg.slogdet(expected.covariance)[1] / len(rms)))
        if self.name == WORST:
            return float((rms * self.ranges / np.maximum(np.abs(self.values), 1e-3 * self.ranges)).max())
        return float(rms[[p.name for p in self.parameters].index(self.name)])


def check_goal(name: str, parameters: Sequence[Parameter]) -> None:
    """Refuse a goal that these parameters do not have.

    Raises
    ------
    StudyError
    """
    known = [ALL, WORST, *(p.name for p in parameters)]
    if name not in (*known, PREDICTION):
        raise StudyError(f"'{name}' is no goal; name one of {', '.join(known)}, or {PREDICTION} with a tool")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExpectedEffect:
    """Effect that is expected of a press.

    Parameters
    ----------
    goal : float
        Error of the goal over that before the press, in the mean over the points.
    widths : (n_parameters,) array
        Of the interval of each parameter, over that before, likewise.
    mesh_bias : (n_parameters,) array
        Largest change of each parameter by the meshes after it, in units of the parameters, likewise.
    error : ExpectedError
        After it, at the first point, as :attr:`Plan.error` is.
    """

    press: SimulatedPress
    goal: float
    widths: FloatArray
    mesh_bias: FloatArray
    error: ExpectedError


class Plan:
    """Presses so far, to which those that reduce the error most are added.

    Parameters
    ----------
    known : FisherInformation
        Information without a press: by the priors.
    errors : ErrorSizes
        Of which the scale's degrees of freedom grow with the number of presses.
    """

    def __init__(
        self,
        so_far: Sequence[SimulatedPress],
        goal: Goal,
        known: FisherInformation,
        n_points: int,
        errors: ErrorSizes,
    ) -> None:
        self.goal = goal
        self._errors, self._n_so_far = errors, len(so_far)
        self._times: dict[str, int] = {}
        self._information = [
            functools.reduce(operator.add, (each.at[k].information for each in so_far), known)
            for k in range(n_points)
        ]

    @property
    def error(self) -> ExpectedError:
        """Error at the first point, in shares of the ranges.

        Like the error of a fit, it knows little of the ranges: :class:`Expected` cuts it off at them.
        """
        return self._error(self._information[0], 0, RANGE_SD)

    def _error(self, known: FisherInformation, n_more: int, range_sd: float = FLAT_SD) -> ExpectedError:
        """Error after so many presses more than were added."""
        freedom = self._errors.freedom_by(n_more + sum(self._times.values()), self._n_so_far)
        return known.expected_error(range_sd, freedom)

    def ranked(self, presses: Sequence[SimulatedPress]) -> list[ExpectedEffect]:
        """Effects of each of these presses as the next one, the best first."""
        before = [self._error(information, 0) for information in self._information]
        found = [self._effect(each, before) for each in presses if each.at]
        return sorted(found, key=lambda each: each.goal)

    def add(self, press: SimulatedPress) -> None:
        """Make a press part of what is known."""
        self._information = self._with(press)
        self._times[press.press.name] = self._times.get(press.press.name, 0) + 1

    def _with(self, press: SimulatedPress) -> list[FisherInformation]:
        name = press.press.name
        times = self._times.get(name, 0)
        added = [at.information.again(name, times) if times else at.information for at in press.at]
        return [known + more for known, more in zip(self._information, added, strict=True)]

    def _effect(self, press: SimulatedPress, before: Sequence[ExpectedError]) -> ExpectedEffect:
        information, identity = self._with(press), np.eye(len(self.goal.parameters))
        after = [self._error(known, 1) for known in information]
        pairs = list(zip(before, after, strict=True))
        biases = [new.mesh_bias(identity) * self.goal.ranges for new in after]
        return ExpectedEffect(
            press=press,
            goal=float(np.mean([self.goal.error(new) / self.goal.error(old) for old, new in pairs])),
            widths=np.mean([new.sds / old.sds for old, new in pairs], axis=0),
            mesh_bias=np.mean(biases, axis=0),
            error=self._error(information[0], 1, RANGE_SD),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Expected:
    """Density of the parameters that presses share: from the fit now, as further presses narrow it.

    Parameters
    ----------
    fit : Laplace
        Of all parameters of the fit.
    within : callable
        Cuts it off at ranges and filters.
    shared : sequence of int
        Numbers of the parameters that all presses share.
    before : ExpectedError
        Of these by the presses so far, as planned: nearly the error of the fit.
    """

    fit: Laplace
    within: Callable[[Laplace], Density]
    shared: Sequence[int]
    before: ExpectedError

    def after(self, error: ExpectedError) -> Density:
        """Density after presses that change the planned error to this one.

        The fit's changes as the planned one does, so that nothing planned leaves the density of the fit. What
        belongs to one spot stays as it is, given what all share.
        """
        here = np.ix_(self.shared, self.shared)
        known = self.fit.covariance[here]
        change = np.linalg.cholesky(known) @ np.linalg.inv(np.linalg.cholesky(self.before.covariance))
        given = np.linalg.solve(known, self.fit.covariance[self.shared]).T
        full = self.fit.covariance + given @ (change @ error.covariance @ change.T - known) @ given.T
        freedom = self.fit.freedom * (error.freedom / self.before.freedom)
        after = replace(self.fit, covariance=(full + full.T) / 2.0, parts={}, freedom=freedom)
        return self.within(after).of(self.shared)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Step:
    """One more press: every candidate as this step, the best first."""

    ranked: tuple[ExpectedEffect, ...]

    @property
    def chosen(self) -> ExpectedEffect:
        """The one that is proposed: the first."""
        return self.ranked[0]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Proposal:
    """Presses to measure next.

    Parameters
    ----------
    steps : tuple of Step
        One after the other.
    refused : mapping of name to str
        Candidates that cannot be simulated or are beyond a limit, and why.
    failure : str
        Reason of the run's answer why its model does not describe the data; empty where it does.
    check : str
        Spot whose press should be repeated first in that case.
    """

    goal: Goal
    expected: Expected
    steps: tuple[Step, ...]
    refused: Mapping[str, str]
    failure: str = ""
    check: str = ""

    def intervals(self) -> list[tuple[FloatArray, FloatArray]]:
        """Ends (n_parameters,) of the 95 % intervals now, and after each step."""
        return [interval(self.goal, density) for density in self._densities()]

    def bands(self) -> list[tuple[FloatArray, FloatArray]]:
        """Ends (n_predicted,) of the 95 % bands of what is predicted now, and after each step."""
        return [bands(self.goal, density) for density in self._densities()]

    def mesh_biases(self) -> list[FloatArray]:
        """Largest change (n_parameters + n_predicted,) by the meshes now, and after each step, in units."""
        forces = np.array([each.force_N for each in self.goal.predicted])
        along = np.concatenate([np.diag(self.goal.ranges), self.goal.gradients * forces[:, None]])
        return [error.mesh_bias(along) for error in self._errors()]

    def _densities(self) -> Iterator[Density]:
        for error in self._errors():
            yield self.expected.after(error)

    def _errors(self) -> list[ExpectedError]:
        return [self.expected.before, *(step.chosen.error for step in self.steps)]


def interval(goal: Goal, density: Density) -> tuple[FloatArray, FloatArray]:
    """Ends (n_parameters,) of the 95 % intervals, with the goal's values inside."""
    ends = density.interval(shares_of(goal))
    return goal.lower + goal.ranges * ends[0], goal.lower + goal.ranges * ends[1]


def bands(goal: Goal, density: Density) -> tuple[FloatArray, FloatArray]:
    """Ends (n_predicted,) of the 95 % bands of what is predicted [N], by its gradient."""
    drawn = goal.lower + goal.ranges * density.draws(N_DRAWS) - goal.values
    forces = [each.force_N * (1.0 + drawn @ each.gradient) for each in goal.predicted]
    ends = np.quantile(np.array(forces).reshape(-1, N_DRAWS), [0.5 - LEVEL / 2.0, 0.5 + LEVEL / 2.0], axis=1)
    return ends[0], ends[1]


def shares_of(goal: Goal) -> FloatArray:
    """Goal's values (n_parameters,) as shares of the ranges."""
    return (goal.values - goal.lower) / goal.ranges
