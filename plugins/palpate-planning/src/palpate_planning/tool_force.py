"""The force of a tool that is predicted, and how it changes with the parameters.

As `palpate predict` has it: the material is that of the fit, friction and path are the tool's own, and the
pressure changes like the force.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from palpate.api import (
    PRESS_AND_TWIST,
    FloatArray,
    Limb,
    Parameter,
    ParameterSpace,
    Protocol,
    Response,
    Status,
    StudyError,
)
from palpate.api.fit import Parametrisation, SpotInputs, pieces
from palpate.api.runs import Study, Tool
from palpate_planning.presses import DesignProblem, job_of, point_in, slopes_of
from palpate_prediction.predict import refined_limbs
from palpate_prediction.summary import is_by_force

FORCE = "force"
"""Channel that is predicted."""


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
        """Those of the study at a spot of the run."""
        return self.base.parameters(space, [self.spot])

    def inputs(
        self, space: ParameterSpace, spot: str, protocol: Protocol, values: Mapping[str, float]
    ) -> SpotInputs:
        """The study's materials, pressed by the tool."""
        return SpotInputs(
            thetas=self.base.inputs(space, self.spot, protocol, values).thetas, protocol=protocol
        )


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
    materials = {name.partition("@")[0] for name in design.problem.names if "@" in name}
    if own := sorted(materials & set(design.study.space.names)):
        raise StudyError(
            f"{', '.join(own)} is fitted for each spot by itself, so presses do not share what a tool at "
            "another place feels; fit one value for all spots, or name another goal"
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
    curves = {} if simulation.response is None else simulation.response.curves
    if FORCE not in curves or simulation.status is not Status.OK:
        why = simulation.message or simulation.status.remedy
        raise StudyError(f"{name} cannot be predicted: {simulation.status}: {why}")
    # Its own curve as the measured one: the slope of a residual is that of the force, times its scale.
    stated = problem.restated(
        [replace(bare, measured=Response(curves={FORCE: curves[FORCE]}), weights={}).of_channels([FORCE])]
    )
    (found,) = slopes_of([(stated, point_in(design, stated, point))])
    if found.jacobian is None:
        raise StudyError(f"{name} cannot be predicted: {found.failure}")
    force, ((_, _, at, scale),) = curves[FORCE].ordinate, pieces(stated.terms)
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
