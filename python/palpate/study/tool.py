"""The shape of a tool file: what ``palpate predict`` presses with, where, and what it reports."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from palpate.domain import Indentation, Spot
from palpate.errors import StudyError
from palpate.plugins.catalogue import Plugins
from palpate.study.build import Context
from palpate.study.model import Length, Name, ProtocolTable, Table
from palpate.study.problems import Problems, require
from palpate.study.reading import Study, parse_toml
from palpate.study.solver_checks import check_protocols, check_times, relaxing_parts
from palpate.study.source_positions import KeyLines
from palpate.study.spots import StudySpot, build_protocol
from palpate.units import Quantity, unit_of

Pressure = Annotated[float, Quantity("MPa")]


class ToolSpotTable(Table):
    """Place of the tool besides the spots of the run."""

    name: Name = Field(description="Name of the spot; one of the run's may get another mesh.")
    mesh: str | None = Field(default=None, description="Mesh of the limb; default: as in the run.")
    position: list[Length] | None = Field(
        default=None, min_length=3, max_length=3, description="Where the tool first touches."
    )
    normal: list[float] | None = Field(
        default=None, min_length=3, max_length=3, description="Outward normal there."
    )


class ToolTable(Table):
    """A tool file."""

    protocol: ProtocolTable = Field(description="Tool, motion and friction, as in a study.")
    spots: list[Name] = Field(default=[], description="Spots of the run; default: all, or [[spot]].")
    spot: list[ToolSpotTable] = Field(default=[], description="Spots with another mesh or place.")
    fine_edge: Literal["auto"] | Annotated[Length, Field(ge=0.0)] = Field(
        default="auto",
        description="Longest edge under the tool, to which meshes are refined; 0: as they are; auto: a third "
        "of the distance from the spot that the tool touches, or the mesh's mean edge there, for tetrahedra.",
    )
    fine_reach: Length = Field(
        default=0.0, ge=0.0, description="How far from the spot; default: as far as the tool touches."
    )
    threshold: Pressure | None = Field(
        default=None, gt=0.0, description="Pressure above which the area is reported."
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Tool:
    """A tool file that has been read.

    Parameters
    ----------
    name : str
        Of its file.
    pressure_unit : str
        Unit of reported pressures: the threshold's, else the unit of the study's first modulus.
    fine_edge_mm : float or None
        Longest edge under the tool, to which meshes are refined; 0: as they are; None: chosen by the mesh.
    fine_reach_mm : float
        Distance from the spot up to which they are; 0: as far as the tool touches.
    """

    name: str
    protocol: Indentation
    spots: tuple[StudySpot, ...]
    threshold_MPa: float | None
    pressure_unit: str = "MPa"
    fine_edge_mm: float | None = None
    fine_reach_mm: float = 0.0

    @property
    def refined_mm(self) -> float:
        """Distance from the spot up to which meshes are refined, as of the deepest it may go."""
        # Distance from the spot up to which a mesh is refined, over the reach of the tool.
        return self.fine_reach_mm or 1.1 * self.protocol.reach_mm

    def contact_mm(self, depth_mm: float) -> float:
        """Distance from the spot up to which it touches at a depth, where meshes are refined."""
        return min(self.protocol.indenter.reach_mm(depth_mm), self.refined_mm)

    def study(self, study: Study) -> Study:
        """The study with the tool's protocol and spots."""
        return replace(study, spots=self.spots, protocol=self.protocol, fine_runs=0)


def read_tool(path: Path, study: Study, plugins: Plugins) -> Tool:
    """Read a tool file, whose paths are relative to it.

    Raises
    ------
    StudyError
        Everything that is wrong, with line, key and what to do.
    """
    if not path.is_file():
        raise StudyError(f"{path}: no such tool file; check the path")
    text, raw = parse_toml(path)
    problems = Problems(path, KeyLines(text), raw)
    context = Context(path.resolve(), plugins, problems)
    table = problems.validated(ToolTable, raw)
    protocol = build_protocol(context, table.protocol)
    spots = _spots(path, table, study, problems)
    named = [(("protocol",), protocol)]
    check_protocols(context, study.solver, named)
    check_times(context, relaxing_parts(study.space, study.parametrisation), named)
    problems.raise_if_any()
    return Tool(
        name=path.stem,
        protocol=require(protocol),
        spots=spots,
        threshold_MPa=table.threshold,
        pressure_unit=unit_of(raw["threshold"]) if "threshold" in raw else study.modulus_unit,
        fine_edge_mm=None if table.fine_edge == "auto" else table.fine_edge,
        fine_reach_mm=table.fine_reach,
    )


def _spots(path: Path, table: ToolTable, study: Study, problems: Problems) -> tuple[StudySpot, ...]:
    known = {spot.spot.name: spot for spot in study.spots}
    found: dict[str, StudySpot] = {}
    for i, name in enumerate(table.spots or ([] if table.spot else known)):
        if name in known:
            found[name] = replace(known[name], fine_mesh=None, fine_edge_mm=0.0, protocol=None)
        else:
            problems.add(("spots", i), f"the run has no spot '{name}' (it has {', '.join(known)})")
    for i, own in enumerate(table.spot):
        if own.name in (*table.spots, *(other.name for other in table.spot[:i])):
            problems.add(("spot", i, "name"), f"'{own.name}' is listed twice; list each spot once")
        base = known.get(own.name)
        mesh = path.parent / own.mesh if own.mesh else None if base is None else base.mesh
        if mesh is None or not mesh.is_file():
            problems.add(("spot", i, "mesh"), f"no such file: {mesh}; name the mesh of the limb there")
        was = Spot(name=own.name) if base is None else base.spot
        position = was.position_mm if own.position is None else np.array(own.position)
        normal = was.normal if own.normal is None else np.array(own.normal)
        with problems.at("spot", i, "normal"):
            spot = Spot(name=own.name, position_mm=position, normal=normal)
            measured = {} if base is None else base.measured
            found[own.name] = StudySpot(spot=spot, measured=measured, mesh=mesh)
    return tuple(found.values())
