"""The values of a study: frozen, and passed from stage to stage.

Units are mm, N, MPa, N·mm and degrees. Arrays are copied, checked once and made read-only, so every
value is valid.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.domain.channels import PRESS_AND_TWIST
from palpate.domain.curves import (
    PHASES as PHASES,
    BoolArray as BoolArray,
    Channel as Channel,
    Curve as Curve,
    FloatArray as FloatArray,
    IntArray as IntArray,
    Relaxation as Relaxation,
    Response as Response,
    channel_of as channel_of,
    frozen_floats,
    moving_span as moving_span,
)
from palpate.domain.equilibrium_states import EquilibriumStates as EquilibriumStates, pose_columns
from palpate.domain.indenter import Indenter
from palpate.domain.material import Material
from palpate.domain.mesh_convergence import MeshConvergence as MeshConvergence, Refinement as Refinement
from palpate.domain.parameter import Parameter as Parameter, ParameterName as ParameterName, Prior as Prior
from palpate.domain.parameters import (
    ParameterSpace as ParameterSpace,
    RegionMaterial as RegionMaterial,
    Tie as Tie,
)
from palpate.domain.scenarios import (
    Normaliser as Normaliser,
    PointWeighting as PointWeighting,
    Scenario as Scenario,
    weighed_channels as weighed_channels,
    weighed_phases as weighed_phases,
)
from palpate.domain.surface import SurfaceStates as SurfaceStates
from palpate.domain.waypoints import (
    DEPTH as DEPTH,
    MOST_TILT_DEG as MOST_TILT_DEG,
    MOVES as MOVES,
    ROTATION as ROTATION,
    Waypoints as Waypoints,
)
from palpate.errors import MeshError, SamplingError, StudyError


def _frozen_ints(values: ArrayLike) -> IntArray:
    array = np.array(values, dtype=np.int64, copy=True)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spot:
    """A marked place on the limb: position [mm] and unit outward normal, in the frame of its mesh.

    ``along`` is the direction (3,) of the x axis of the spot's frame, as far as it is tangential; by default
    the axis of :func:`palpate.mesh.spot_frame.spot_axes`.
    """

    name: str
    position_mm: FloatArray = field(default_factory=lambda: np.zeros(3))
    normal: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    along: FloatArray | None = field(default=None, metadata={"in_key": "unless default"})

    def __post_init__(self) -> None:
        object.__setattr__(self, "position_mm", frozen_floats(self.position_mm))
        normal = np.asarray(self.normal, dtype=np.float64)
        length = float(np.linalg.norm(normal))
        if self.position_mm.shape != (3,) or normal.shape != (3,) or not length > 0.0:
            raise MeshError(f"spot '{self.name}': position and normal must be three numbers, normal not zero")
        object.__setattr__(self, "normal", frozen_floats(normal / length))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mesh:
    """A limb's volume in elements, with named regions and named node sets.

    Parameters
    ----------
    points_mm : (n_nodes, 3) array
    cells : mapping of kind to (n_cells, n_nodes_of_kind) integer array
        Kinds are the keys of :data:`palpate.mesh.topology.CELLS`, which numbers their nodes.
    cell_regions : mapping of kind to (n_cells,) integer array
        Index into ``regions``.
    node_sets : mapping of name to (n,) integer array
        At least ``fixed`` (no displacement) and ``contact`` (the outer surface).
    cell_fields : mapping of name and kind to (n_cells,) or (n_cells, 3) array
        Data of each element for materials, such as the direction of its fibres. Vectors are in the
        frame of the mesh.
    """

    points_mm: FloatArray
    cells: Mapping[str, IntArray]
    cell_regions: Mapping[str, IntArray]
    regions: tuple[str, ...]
    node_sets: Mapping[str, IntArray]
    cell_fields: Mapping[str, Mapping[str, FloatArray]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "points_mm", frozen_floats(self.points_mm))
        object.__setattr__(self, "regions", tuple(self.regions))
        fields = {
            name: MappingProxyType({kind: frozen_floats(values) for kind, values in by_kind.items()})
            for name, by_kind in self.cell_fields.items()
        }
        object.__setattr__(self, "cell_fields", MappingProxyType(fields))
        for name in ("cells", "cell_regions", "node_sets"):
            frozen = {key: _frozen_ints(values) for key, values in getattr(self, name).items()}
            object.__setattr__(self, name, MappingProxyType(frozen))

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return int(self.points_mm.shape[0])

    @property
    def n_cells(self) -> int:
        """Number of elements of all kinds."""
        return sum(int(cells.shape[0]) for cells in self.cells.values())

    @property
    def used_regions(self) -> frozenset[str]:
        """Regions that have elements."""
        return frozenset(self.regions[i] for ids in self.cell_regions.values() for i in np.unique(ids))


@dataclass(frozen=True, slots=True, kw_only=True)
class Limb:
    """One spot and the mesh of the limb segment around it.

    Parameters
    ----------
    remarks : tuple of str
        Sentences on parts that were read, left out or changed.
    warnings : tuple of str
        Sentences on possible mistakes of the limb.
    absent : tuple of str
        Names of the source's setting ``leave_out`` that its mesh does not have.
    """

    spot: Spot
    mesh: Mesh
    remarks: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    absent: tuple[str, ...] = ()


FINE = "/fine"
"""End of the name of a limb with a finer mesh."""

FRICTION, COMPLIANCE, DEEPER = "friction", "contact_compliance", "depth_mm"
"""Names of a contact's friction coefficient and compliance, and of the depth, among slopes of a curve.

The slope in the depth is the change of each state when the press ends deeper. Depths on an abscissa grow
in proportion.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Indentation:
    """Press a rigid indenter into the limb and move it: by itself along the normal, then about it.

    Parameters
    ----------
    indenter : Indenter
        Touches the spot at depth 0.
    path : (n_waypoints, 2) array
        Depth [mm] and rotation [degrees], in the order travelled, from rest at (0, 0).
        Between waypoints both change linearly.
    friction : float
        Coulomb coefficient, ≥ 0.
    tilt_deg : pair of float
        Rotation vector of the axis of press and twist from the normal, along x and y of the spot's frame.
    lateral : (n_waypoints, 4) array, optional
        Shifts and tilts, and ``loads`` (n_waypoints, 6) and ``time_s`` (n_waypoints,), as in
        :class:`Waypoints`; where a load moves a component, its value is the farthest that it may move to.
    contact_penalty : float
        Contact penalty over the solver's usual one, > 0.
    depth_step_parts : int
        Number of steps of depth in place of each of the solver's, >= 1; a solver without steps ignores it.
    """

    indenter: Indenter
    path: FloatArray
    friction: float
    tilt_deg: tuple[float, float] = field(default=(0.0, 0.0), metadata={"in_key": "unless default"})
    lateral: FloatArray | None = field(default=None, metadata={"in_key": "unless default"})
    loads: FloatArray | None = field(default=None, metadata={"in_key": "unless default"})
    time_s: FloatArray | None = field(default=None, metadata={"in_key": "unless default"})
    contact_penalty: float = field(default=1.0, metadata={"in_key": "unless default"})
    depth_step_parts: int = field(default=1, metadata={"in_key": "unless default"})

    def __post_init__(self) -> None:
        object.__setattr__(self, "path", frozen_floats(self.path))
        path = self.path
        if path.ndim != 2 or path.shape[1] != 2 or path.shape[0] < 2 or not np.isfinite(path).all():
            raise StudyError("protocol: the path needs at least two finite rows of (depth_mm, rotation_deg)")
        if path[0].any():
            raise StudyError(f"protocol: the path starts at {tuple(path[0])}; start it at (0, 0)")
        if (path[:, 0] < 0.0).any() and not path[:, 0].max() > 0.0:
            raise StudyError(
                f"protocol: depth {path[:, 0].min()} mm is outside the limb; press by depths > 0"
            )
        if not (np.isfinite(self.friction) and self.friction >= 0.0):
            raise StudyError(f"protocol: friction {self.friction}; give a coefficient >= 0")
        if not (np.isfinite(self.contact_penalty) and self.contact_penalty > 0.0):
            raise StudyError(f"protocol: contact penalty {self.contact_penalty}; give a factor > 0")
        if self.depth_step_parts < 1:
            raise StudyError(f"protocol: {self.depth_step_parts} parts of a step of depth; give 1 or more")
        tilt_deg = tuple(map(float, self.tilt_deg))
        if len(tilt_deg) != 2 or not np.hypot(*tilt_deg) < MOST_TILT_DEG:
            raise StudyError(f"protocol: tilt {tilt_deg}; give two angles below {MOST_TILT_DEG:g}°")
        object.__setattr__(self, "tilt_deg", tilt_deg)
        if self.lateral is not None and np.shape(self.lateral) != (len(path), 4):
            raise StudyError(f"protocol: shifts and tilts of shape {np.shape(self.lateral)}; give four a row")
        checked = self.waypoints
        for name in ("lateral", "loads", "time_s"):
            if getattr(self, name) is not None:
                values = checked.pose[:, 1:5] if name == "lateral" else getattr(checked, name)
                object.__setattr__(self, name, values)

    @classmethod
    def along(cls, waypoints: Waypoints, *, indenter: Indenter, friction: float) -> "Indentation":
        """Build the indentation that moves an indenter along waypoints."""
        pose, loads = waypoints.pose, waypoints.loads
        return cls(
            indenter=indenter,
            path=pose[:, [DEPTH, ROTATION]],
            friction=friction,
            lateral=pose[:, 1:5] if pose[:, 1:5].any() else None,
            loads=None if loads is None or np.isnan(loads).all() else loads,
            time_s=waypoints.time_s,
        )

    @property
    def waypoints(self) -> Waypoints:
        """The whole motion."""
        lateral = np.zeros((len(self.path), 4)) if self.lateral is None else self.lateral
        pose = np.column_stack([self.path[:, 0], lateral, self.path[:, 1]])
        return Waypoints(pose=pose, loads=self.loads, time_s=self.time_s)

    @property
    def contact_compliance(self) -> float:
        """Reciprocal of the contact penalty, in which curves are nearly linear; 0 for a rigid contact."""
        return 1.0 / self.contact_penalty

    def as_deep_as(self, other: "Indentation") -> "Indentation":
        """The press to the one depth of another, where both have one; else itself."""
        if self.only_depth_mm is None or other.only_depth_mm is None:
            return self
        depth = np.where(self.path[:, 0] > 0.0, other.only_depth_mm, 0.0)
        return replace(self, path=np.column_stack([depth, self.path[:, 1]]))

    @property
    def only_depth_mm(self) -> float | None:
        """Depth of every waypoint that is not at the surface; None where they differ, or loads move any."""
        deep = self.path[self.path[:, 0] > 0.0, 0]
        return float(deep[0]) if self.loads is None and deep.size and not np.ptp(deep) else None

    @property
    def press_s(self) -> float:
        """Time of the deepest state [s]; 0 where the motion has no times."""
        return 0.0 if self.time_s is None else float(self.time_s[self.path[:, 0].argmax()])

    @property
    def reach_mm(self) -> float:
        """Distance from the spot up to which it touches, at its deepest."""
        return self.indenter.reach_mm(float(self.path[:, 0].max()))

    @property
    def moves(self) -> tuple[str, ...]:
        """Parts of its motion, of :data:`palpate.domain.waypoints.MOVES`."""
        pose = self.waypoints.pose
        parts = (pose[:, DEPTH], pose[:, ROTATION], pose[:, 1:3], pose[:, 3:5])
        are_moved = (*(values.any() for values in parts), self.loads is not None)
        return tuple(name for name, is_moved in zip(MOVES, are_moved, strict=True) if is_moved)

    @property
    def columns(self) -> dict[str, FloatArray]:
        """Prescribed values (n_waypoints,) of the motion, by the column of equilibrium states."""
        moved = self.waypoints
        loaded = None if moved.loads is None else np.asarray(~np.isnan(moved.loads).all(axis=0))
        return pose_columns(moved.pose, moved.time_s, loaded)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HomogeneousTests:
    """Homogeneous deformations of one specimen: stretch paths by channel name.

    The channel name selects the mode: ``uniaxial``, ``equibiaxial``,
    ``pure_shear``, ``simple_shear`` (abscissa is the amount of shear) and
    ``confined_compression``.
    """

    paths: Mapping[str, FloatArray]

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "paths", MappingProxyType({k: frozen_floats(v) for k, v in self.paths.items()})
        )


Protocol = Indentation | HomogeneousTests
"""Motion or deformation prescribed to the limb or specimen."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Design:
    """Parameter sets: row = ``set_id``, the same at every spot.

    Parameters
    ----------
    parameters : tuple of Parameter
        Full names, in column order.
    values : (n_sets, n_parameters) array
    n_drawn : int
        Sets drawn before the filters; ``n_sets`` of them were kept.
    n_kept : int
        Number of first sets that come from an earlier design with wider ranges.
    earlier_first : (n, n_parameters) array, optional
        First sets of that earlier design: its kept sets were simulated with these as warm starts.
    """

    parameters: tuple[Parameter, ...]
    values: FloatArray
    seed: int
    n_drawn: int
    n_kept: int = 0
    earlier_first: FloatArray | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", frozen_floats(self.values))
        if self.values.ndim != 2 or self.values.shape[1] != len(self.parameters):
            raise SamplingError(
                f"design: values of shape {self.values.shape} for {len(self.parameters)} parameters"
            )

    def __repr__(self) -> str:
        names = ", ".join(p.name for p in self.parameters)
        return f"Design({self.n_sets} sets of {names}, seed {self.seed})"

    @property
    def n_sets(self) -> int:
        """Number of sets that are simulated."""
        return int(self.values.shape[0])

    @property
    def first_values(self) -> FloatArray:
        """Sets (n, n_parameters) as first drawn, of which the warm starts are the first."""
        return self.values if self.earlier_first is None else self.earlier_first


class Status(StrEnum):
    """End of a simulation."""

    OK = "ok"
    DIVERGED = "diverged"
    TIMED_OUT = "timed_out"
    UNREADABLE = "unreadable"
    CRASHED = "crashed"

    @property
    def remedy(self) -> str:
        """Remedy that a user can try."""
        return {
            Status.OK: "nothing to do",
            Status.DIVERGED: "narrow the ranges, add a stability filter, or allow smaller steps",
            Status.TIMED_OUT: "raise the solver's time limit or coarsen the mesh",
            Status.UNREADABLE: "look at the solver's output for this job",
            Status.CRASHED: "read the message; if memory ran out, set a smaller solver.n_workers",
        }[self]


class SimulationId(NamedTuple):
    """Place of a simulation in a study: the set ``set_id`` of its design at a spot."""

    spot: str
    set_id: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Job:
    """One simulation to do: a parameter set at a spot. With only these two it is the name of one.

    Parameters
    ----------
    thetas : mapping of region to (n_parameters,) array
        Textbook values in the order of the material's parameters.
    slopes : bool
        Whether to compute each curve's derivatives in the parameters and the friction too; only for a
        solver that provides ``slopes``.
    mesh : str
        Name of another mesh of the spot, such as ``fine``; empty: the spot's own.
    channels : tuple of Channel
        What to observe of the equilibrium states, where the solver has them; by itself force and torque.
    surface : bool
        Whether the states of the skin are wanted too; only for a solver that provides ``surface``.
    warm_starts : mapping of region to (n_warm_starts, n_parameters) array, optional
        Sets that the solver may start this one from, with values as in ``thetas``.
    is_warm_start : bool
        Whether other jobs start from this one; decides nothing of its result.
    """

    spot: str
    set_id: int
    materials: Mapping[str, Material] = field(default_factory=dict)
    thetas: Mapping[str, FloatArray] = field(default_factory=dict)
    protocol: Protocol = field(default_factory=lambda: HomogeneousTests(paths={}))
    slopes: bool = False
    mesh: str = ""
    channels: tuple[Channel, ...] = PRESS_AND_TWIST
    surface: bool = False
    warm_starts: Mapping[str, FloatArray] | None = None
    is_warm_start: bool = False

    @property
    def limb_name(self) -> str:
        """Name of its limb in a batch: the spot's, or ``<spot>/<mesh>``."""
        return f"{self.spot}/{self.mesh}" if self.mesh else self.spot

    @property
    def id(self) -> SimulationId:
        """Place of this simulation in its study."""
        return SimulationId(self.spot, self.set_id)

    def on_finer_mesh(self) -> "Job":
        """Job on the finer mesh of the spot, which corrects a fit: with shorter steps of depth."""
        protocol = self.protocol
        if isinstance(protocol, Indentation):
            # Half the usual steps: whole ones add up to 0.2 % to a force with friction.
            protocol = replace(protocol, depth_step_parts=2)
        return replace(self, protocol=protocol, mesh=FINE.removeprefix("/"))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Simulation:
    """Result of a job. ``response`` and ``surface`` are partial if the status is ``diverged``.

    Parameters
    ----------
    n_crashes : int
        Workers that ended with the job before this result; with status ``crashed`` it was then given up.
    """

    job: Job
    status: Status
    response: Response | None = None
    message: str = ""
    seconds: float = 0.0
    diagnostics: Mapping[str, Any] = field(default_factory=dict)
    surface: SurfaceStates | None = None
    n_crashes: int = 0

    @property
    def id(self) -> SimulationId:
        """Place of this simulation in its study."""
        return self.job.id


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyTemplate:
    """A ready study that ``palpate init`` copies: a directory with a study.toml and its data.

    Attributes
    ----------
    first_command : str
        What to run on the copy first, after ``palpate``; ``{folder}`` is its folder.
    """

    name: str
    summary: str
    directory: str
    first_command: str = "check {folder}"
