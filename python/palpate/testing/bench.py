"""A plugin of small parts that work at once: what a plugin under test is run together with.

Channels ``force`` and ``torque``, loader ``points``, limb source ``small_block``, material ``linear``,
solvers ``half_space`` and ``half_space_on_mesh``, and scenario ``both``.
"""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from palpate import hookimpl, mechanics
from palpate.domain import (
    Channel,
    Curve,
    FloatArray,
    Indentation,
    Job,
    Limb,
    Response,
    Scenario,
    Simulation,
    Spot,
    Status,
)
from palpate.domain.channels import PRESS_AND_TWIST
from palpate.domain.equilibrium_states import STATE_COLUMNS, EquilibriumStates
from palpate.domain.material import Material
from palpate.errors import CurveError
from palpate.mesh.specimens import block
from palpate.mesh.spot_frame import pose_of
from palpate.plugins.interfaces import ExperimentLoader, LimbSource, Solver
from palpate.plugins.provides import Provides
from palpate.testing.executors import LinearMaterial


class Points(ExperimentLoader):
    """Rows of channel, abscissa and ordinate."""

    name = "points"
    summary = "rows of channel, abscissa and ordinate, for tests of plugins"

    def load(self, path: Path, channel: str | None = None) -> Response:
        """Read one file."""
        rows = [line.split() for line in path.read_text(encoding="utf-8").splitlines()]
        names = [channel] if channel else list(dict.fromkeys(row[0] for row in rows))
        points = {name: np.array([row[1:] for row in rows if row[0] == name], dtype=float) for name in names}
        curves = {n: Curve(channel=n, abscissa=p[:, 0], ordinate=p[:, 1]) for n, p in points.items()}
        return Response(curves=curves)

    def save(self, path: Path, response: Response, channel: str | None = None) -> None:
        """Write curves in the form that :meth:`load` reads."""
        rows = [
            f"{name} {float(x)!r} {float(y)!r}\n"
            for name in ([channel] if channel else response)
            for x, y in zip(response[name].abscissa, response[name].ordinate, strict=True)
        ]
        path.write_text("".join(rows), encoding="utf-8")


class SmallBlock(LimbSource):
    """A block of 50 nodes, whatever the file holds."""

    name = "small_block"
    summary = "a block of 50 nodes and one region, for tests of plugins"

    def load(self, path: Path, spot: Spot) -> Limb:
        """Make the limb of one spot."""
        return Limb(spot=spot, mesh=replace(block(n_across=4, n_down=1).mesh, regions=("tissue",)))


class HalfSpace(Solver):
    """Hertz's force and Reissner and Sagoci's torque, of the mean initial moduli of all regions."""

    name = "half_space"
    summary = "an indenter on a half-space in closed form, for tests of plugins"
    provides = Provides(body="layers", indenters=None, columns=STATE_COLUMNS)

    def simulate(self, job: Job, limb: Limb | None) -> Simulation:
        """Simulate one job."""
        if not isinstance(job.protocol, Indentation):
            raise CurveError(f"spot '{job.spot}': '{self.name}' only indents; give the study a [protocol]")
        moduli = [mechanics.initial_moduli(job.materials[r], job.thetas[r]) for r in job.materials]
        mu, kappa = np.mean(moduli, axis=0)
        thickness_mm = np.inf if limb is None else float(np.ptp(limb.mesh.points_mm[:, 2]))
        states = _states(float(mu), float(kappa), job.protocol, thickness_mm)
        return Simulation(job=job, status=Status.OK, response=states.observed(job.channels))


class HalfSpaceOnMesh(HalfSpace):
    """The same on a body of the mesh's thickness, which stiffens it."""

    name = "half_space_on_mesh"
    summary = "an indenter on a body of the mesh's thickness in closed form, for tests of plugins"
    provides = replace(HalfSpace.provides, body="mesh")


def _states(mu: float, kappa: float, press: Indentation, thickness_mm: float) -> EquilibriumStates:
    # Points along each way of the path.
    steps = np.linspace(0.0, 1.0, 11)[1:, None]
    path = np.column_stack([press.path, np.zeros(len(press.path)) if press.time_s is None else press.time_s])
    walk: FloatArray = np.concatenate([path[:1], *(a + steps * (b - a) for a, b in pairwise(path))])
    depth, rotation, time = walk.T
    contact = np.array([press.indenter.contact_radius_mm(float(d)) for d in depth])
    plane = 4.0 * mu * (3.0 * kappa + mu) / (3.0 * kappa + 4.0 * mu)  # E / (1 - ν²)
    force = 4.0 / 3.0 * plane * contact * depth * (1.0 + contact / thickness_mm)
    grip = 0.9 + 0.1 * press.friction / (1.0 + press.friction)
    torque = 16.0 / 3.0 * mu * contact**3 * grip * np.radians(rotation)
    return EquilibriumStates(
        pose=pose_of(depth, rotation),
        wrench=pose_of(force, torque),
        time_s=None if press.time_s is None else time,
    )


@hookimpl
def palpate_channels() -> list[Channel]:
    """Provide force over depth and torque over rotation."""
    return list(PRESS_AND_TWIST)


@hookimpl
def palpate_experiment_loaders() -> list[type[ExperimentLoader]]:
    """Provide the loader."""
    return [Points]


@hookimpl
def palpate_limb_sources() -> list[type[LimbSource]]:
    """Provide the limb source."""
    return [SmallBlock]


@hookimpl
def palpate_materials() -> list[type[Material]]:
    """Provide the material."""
    return [LinearMaterial]


@hookimpl
def palpate_solvers() -> list[type[Solver]]:
    """Provide the solvers."""
    return [HalfSpace, HalfSpaceOnMesh]


@hookimpl
def palpate_scenarios() -> list[Scenario]:
    """Provide the scenario."""
    return [Scenario(name="both", weights={"force": 1.0, "torque": 1.0}, description="force and torque")]
