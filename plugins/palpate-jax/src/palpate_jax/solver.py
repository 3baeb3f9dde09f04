"""The embedded finite element solver, as a plugin sees it."""

import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import BaseModel, Field

from palpate.domain import (
    Curve,
    FloatArray,
    Indentation,
    Job,
    Limb,
    Response,
    Simulation,
    Status,
    moving_span,
)
from palpate.errors import MeshError, StudyError
from palpate.interfaces import Material, Settings, Solver
from palpate.mechanics import check_reference_state, initial_moduli
from palpate_jax import __version__
from palpate_jax.contact import Law
from palpate_jax.march import March, Station, Stop, stations
from palpate_jax.model import Model, in_spot_frame

TOUCH_TOLERANCE_MM = 0.3
"""How far the surface may lie from the sphere at depth 0."""


class JaxSettings(Settings):
    """How finely and how strictly to solve."""

    depth_step_mm: float = Field(
        1.0, gt=0.0, description="largest step of depth between balanced states [mm]"
    )
    rotation_step_deg: float = Field(
        4.5, gt=0.0, description="largest step of rotation between balanced states [degrees]"
    )
    tolerance: float = Field(
        1e-5,
        gt=0.0,
        lt=1e-2,
        description="imbalance, relative to the forces, at which a state counts as balanced",
    )
    penalty: float = Field(
        1000.0,
        gt=0.0,
        description="contact penalty in units of the initial shear modulus over the sphere's radius; "
        "1000 keeps the penetration below 1 % of a 10 mm press",
    )
    mean_dilatation: bool = Field(
        True,
        description="one volume change per element, which keeps nearly incompressible tissue from locking",
    )


class JaxSolver(Solver):
    """Quasi-static finite elements of a limb under a rigid sphere with friction that remembers."""

    name = "jax"
    summary = "finite elements (tet10, hex8) under a rigid sphere, friction with memory; embedded"
    Settings = JaxSettings

    def __init__(self, settings: BaseModel | None = None) -> None:
        super().__init__(settings)
        self._materials: dict[tuple[type[Material], BaseModel], Material] = {}
        self._last: tuple[Limb, dict[str, Material], Model] | None = None

    def version(self) -> str:
        """Version of this plugin."""
        return __version__

    def check(self, job: Job, limb: Limb | None) -> None:
        """Refuse what cannot be simulated, before the first step.

        Raises
        ------
        StudyError
            No limb, or another protocol than an indentation.
        MeshError
            Linear tetrahedra, a region without material, or a surface that does
            not touch the sphere at depth 0.
        MaterialError
            Parameters out of their physical range or without a stable rest.
        """
        protocol = _indentation(job)
        limb = _limb(limb, job)
        _check_elements(limb)
        _check_touch(limb, protocol.indenter.radius_mm)
        for region in limb.mesh.regions:
            if region not in job.materials:
                raise MeshError(
                    f"spot '{job.spot}': region '{region}' has no material; give it one in the study"
                )
            check_reference_state(job.materials[region], job.thetas[region])

    def simulate(self, job: Job, limb: Limb | None) -> Simulation:
        """Walk the protocol's path; a path that cannot be finished is ``diverged`` and keeps its start."""
        started = time.perf_counter()
        protocol = _indentation(job)
        model = self._model(_limb(limb, job), job.materials)
        march = March(model, job.thetas, self._law(model, job, protocol), self.settings.tolerance)
        points = stations(protocol, self.settings.depth_step_mm, self.settings.rotation_step_deg)
        reached: list[Station] = []
        stop: Stop | None = None
        for state in march.along(points):
            if isinstance(state, Stop):
                stop = state
            else:
                reached.append(state)
        return Simulation(
            job=job,
            status=Status.OK if stop is None else Status.DIVERGED,
            response=_response(reached),
            message="" if stop is None else _complaint(stop),
            seconds=time.perf_counter() - started,
            diagnostics=_diagnostics(reached, march),
        )

    def _model(self, limb: Limb, materials: Mapping[str, Material]) -> Model:
        """The model of this limb, kept for the next job on it."""
        own = {region: self._own(material) for region, material in materials.items()}
        if self._last is None or not _same(self._last[0], limb) or self._last[1] != own:
            self._last = (limb, own, Model(limb, own, self.settings.mean_dilatation))
        return self._last[2]

    def _own(self, material: Material) -> Material:
        """One instance for equal materials: compiled kernels are cached by identity."""
        return self._materials.setdefault((type(material), material.settings), material)

    def _law(self, model: Model, job: Job, protocol: Indentation) -> Law:
        region = model.touched_region
        modulus, _ = initial_moduli(job.materials[region], job.thetas[region])
        radius = protocol.indenter.radius_mm
        return Law(radius, self.settings.penalty * modulus / radius, protocol.friction)


def _same(one: Limb, other: Limb) -> bool:
    """Whether two limbs, perhaps copies that travelled between processes, are equal."""
    if one is other:
        return True
    a, b = one.mesh, other.mesh
    return (
        one.spot.name == other.spot.name
        and np.array_equal(a.points_mm, b.points_mm)
        and a.cells.keys() == b.cells.keys()
        and all(np.array_equal(a.cells[k], b.cells[k]) for k in a.cells)
        and all(np.array_equal(a.cell_regions[k], b.cell_regions[k]) for k in a.cells)
        and a.node_sets.keys() == b.node_sets.keys()
        and all(np.array_equal(a.node_sets[k], b.node_sets[k]) for k in a.node_sets)
    )


def _indentation(job: Job) -> Indentation:
    if not isinstance(job.protocol, Indentation):
        raise StudyError(
            f"spot '{job.spot}': solver 'jax' simulates indentations; give the study a [protocol], "
            "or use the solver 'homogeneous'"
        )
    return job.protocol


def _limb(limb: Limb | None, job: Job) -> Limb:
    if limb is None:
        raise StudyError(f"spot '{job.spot}': solver 'jax' needs a mesh; give the spot one in the study")
    return limb


def _check_elements(limb: Limb) -> None:
    if "tet4" in limb.mesh.cells and len(limb.mesh.cells["tet4"]):
        raise MeshError(
            f"spot '{limb.spot.name}': linear tetrahedra (tet4) lock in nearly incompressible tissue and "
            "overstate force by half and more; export the mesh with second-order tetrahedra (tet10) or hex8"
        )


def _check_touch(limb: Limb, radius_mm: float) -> None:
    mesh = in_spot_frame(limb)
    surface = mesh.points_mm[mesh.node_sets["contact"]]
    gaps = np.linalg.norm(surface - [0.0, 0.0, radius_mm], axis=1) - radius_mm
    nearest = int(np.argmin(gaps))
    if abs(gaps[nearest]) > TOUCH_TOLERANCE_MM:
        where = "inside" if gaps[nearest] < 0.0 else "off"
        raise MeshError(
            f"spot '{limb.spot.name}': at depth 0 the sphere is {where} the surface by "
            f"{abs(gaps[nearest]):.2f} mm near {np.round(surface[nearest], 2)} mm (spot frame); "
            "move the spot onto the surface or correct its normal"
        )


def _response(reached: list[Station]) -> Response:
    rows = np.array(
        [(0.0, 0.0, 0.0, 0.0)]
        + [(s.depth_mm, s.rotation_deg, s.answer.force_N[2], s.answer.moment_Nmm[2]) for s in reached]
    )
    curves = {}
    for channel, abscissa, ordinate in (
        ("force", rows[:, 0], rows[:, 2]),
        ("torque", rows[:, 1], rows[:, 3]),
    ):
        if np.ptp(abscissa) > 0.0:
            span = moving_span(abscissa)
            curves[channel] = Curve(channel=channel, abscissa=abscissa[span], ordinate=ordinate[span])
    return Response(curves=curves)


def _complaint(stop: Stop) -> str:
    return f"{stop.reason} beyond depth {stop.depth_mm:.2f} mm, rotation {stop.rotation_deg:.1f} degrees"


def _diagnostics(reached: list[Station], march: March) -> dict[str, Any]:
    def column(values: list[FloatArray]) -> list[list[float]]:
        return [[float(v) for v in value] for value in values]

    return {
        "n_iterations": march.n_iterations,
        "n_factorisations": march.linear.n_factorisations,
        "n_cuts": march.n_cuts,
        "depth_mm": [s.depth_mm for s in reached],
        "rotation_deg": [s.rotation_deg for s in reached],
        "force_N": column([s.answer.force_N for s in reached]),
        "moment_Nmm": column([s.answer.moment_Nmm for s in reached]),
        "contact_radius_mm": [s.answer.contact_radius_mm for s in reached],
        "penetration_mm": [s.answer.penetration_mm for s in reached],
        "sticking": [s.answer.sticking for s in reached],
    }
