"""Force and torque against FEBio's, on the same meshes and with its formulation.

Its uncoupled materials are three-field on hex8; coupled ones, tet10 and tet4 are plain. The indenter is
glued to the skin (bulk mechanics alone), or presses without friction: there FEBio's sphere is faceted, which
costs up to about 0.5 % of its force. Yeoh's material is compared by the tests of ``benchmarks/certify.py``.
"""

import json
from pathlib import Path

import meshio
import numpy as np
import polars as pl
import pytest

from palpate.api import relaxing
from palpate.domain import Indentation, Job, Limb, Mesh, Spot, Status
from palpate.domain.indenter import Sphere
from palpate.mesh.topology import CELLS
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_materials.neo_hookean import NeoHookean
from palpate_materials.relaxation import FORCE_OVER_TIME, TORQUE_OVER_TIME
from palpate_materials.uncoupled import Ogden, Yeoh

DATA = Path(__file__).parents[1] / "data" / "febio_reference"
MATERIALS = {"ogden": Ogden, "neo_hookean": NeoHookean}
OUR_NAMES = {"k": "kappa", "v": "nu"}
KINDS = {cell.meshio: kind for kind, cell in CELLS.items()}
BONDED_RADIUS_MM = 5.0


def mesh_of(case):
    for name in ("arm_tet10", "arm_tet4", "layered"):
        if case.endswith(name):
            return DATA / f"{'block_' if name == 'layered' else ''}{name}.vtu"
    return DATA / "block.vtu"


def limb_of(case, regions):
    read = meshio.read(mesh_of(case))
    ((kind, cells),) = read.cells_dict.items()
    sets = {name: np.flatnonzero(read.point_data[name]) for name in ("fixed", "contact")}
    if case.startswith("bonded"):
        x, y, z = read.points[sets["contact"]].T
        # The axis leaves the forearm on its other side, which is free.
        sets["bonded"] = sets["contact"][(np.hypot(x, y) <= BONDED_RADIUS_MM + 1e-9) & (z > -5.0)]
    mesh = Mesh(
        points_mm=read.points,
        cells={KINDS[kind]: cells},
        cell_regions={KINDS[kind]: read.cell_data["region"][0]},
        regions=regions,
        node_sets=sets,
    )
    return Limb(spot=Spot(name="febio"), mesh=mesh)


def compared(case, times, **settings):
    """Largest difference at these of FEBio's rows, relative to its peaks; signed: at the last row."""
    about = json.loads((DATA / f"{case}.json").read_text())
    rows = pl.read_csv(DATA / f"{case}.csv").filter(pl.col("time").is_in(times))
    assert len(rows) == len(times)
    path = rows.select("depth_mm", "angle_deg").to_numpy()
    materials = {region: MATERIALS[name]() for region, (name, _) in about["materials"].items()}
    values = {
        region: {OUR_NAMES.get(k, k): v for k, v in numbers.items()}
        for region, (_, numbers) in about["materials"].items()
    }
    job = Job(
        spot="febio",
        set_id=0,
        materials=materials,
        thetas={r: np.array([values[r][p.name] for p in m.parameters]) for r, m in materials.items()},
        protocol=Indentation(
            indenter=Sphere(radius_mm=7.5), path=np.vstack([np.zeros((1, 2)), path]), friction=0.0
        ),
    )
    solver = JaxSolver(JaxSettings(depth_steps=2, rotation_step_deg=22.5, **settings))
    simulation = solver.simulate(job, limb_of(case, tuple(materials)))
    assert simulation.status is Status.OK, simulation.message
    found = simulation.diagnostics
    steps = np.stack([found["depth_mm"], found["rotation_deg"]], axis=1)
    places = [int(np.flatnonzero((steps == row).all(axis=1))[0]) for row in path]
    force = np.array(found["force_N"])[places, 2] - rows["force_N"].to_numpy()
    torque = np.array(found["moment_Nmm"])[places, 2] - rows["torque_Nmm"].to_numpy()
    return {
        "force": np.abs(force).max() / about["peak_force"],
        "torque": np.abs(torque).max() / np.abs(about["torque"]).max(),
        "signed force": force[-1] / about["peak_force"],
    }


PRESS_AND_END_OF_TWIST = (1.0, 2.0)
ALL_THE_WAY = (0.6, *PRESS_AND_END_OF_TWIST, 4.0)
"""Rows to compare at: half way down, at the bottom, and at both ends of the twist."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "rows", "mean_dilatation"),
    [
        ("ogden", ALL_THE_WAY, True),
        ("ogden_m5", PRESS_AND_END_OF_TWIST, True),
        ("neo_hookean", ALL_THE_WAY, False),
        ("layered", PRESS_AND_END_OF_TWIST, ("skin",)),
    ],
)
def test_bonded_block_pressed_and_twisted(case, rows, mean_dilatation):
    errors = compared(f"bonded_{case}", rows, mean_dilatation=mean_dilatation)
    assert errors["force"] < 1e-3
    assert errors["torque"] < 1e-3


@pytest.mark.slow
def test_bonded_forearm_of_tet10_pressed_and_twisted():
    """Straight to the end of the twist: elastic, so the way there does not matter."""
    errors = compared("bonded_arm_tet10", (2.0,), mean_dilatation=False)
    assert errors["force"] < 1e-3
    assert errors["torque"] < 1e-3


@pytest.mark.parametrize(
    ("case", "mean_dilatation"),
    [("ogden", True), ("neo_hookean", False), ("layered", ("skin",))],
)
def test_block_pressed_without_friction(case, mean_dilatation):
    errors = compared(f"frictionless_{case}", (0.75, 1.0), mean_dilatation=mean_dilatation)
    assert errors["force"] < 0.01


@pytest.mark.slow
def test_forearm_of_plain_tet4_pressed_deep():
    """10 mm, beyond the sphere's radius; the default penalty sinks in 0.1 mm, 1.4 % of the force here."""
    rows = (0.2, 0.4, 0.6, 0.8, 1.0)
    errors = compared("frictionless_arm_tet4", rows, mean_dilatation=False, penalty=10000.0)
    assert errors["force"] < 0.01


@pytest.mark.slow
def test_patches_take_the_locking_out_of_that_forearm():
    """What FEBio's linear tetrahedra lock at ν = 0.44 on this mesh shows as the excess of its force."""
    excess = -compared("frictionless_arm_tet4", (0.4, 1.0), mean_dilatation=True)["signed force"]
    assert 0.1 < excess < 0.2


# ------------------------------------------------------------------------------ relaxation

RELAXING = Path(__file__).parents[3] / "palpate-materials" / "tests" / "data" / "relaxing_febio"
LONG_TERM, TIMES_S, OVER_LONG_TERM = 1.4, (0.5, 5.0), (0.25, 0.15)
"""Modulus at once over that of the long term, time constants, and what relaxes over that of the long term."""


def relaxed_against_febio(case, tissue, every):
    """Largest differences of force and torque over their peaks: press, rest, twist and rest.

    ``tissue`` has each region's material, its values at once, and whether only its isochoric stress relaxes.
    """
    rows = pl.read_csv(RELAXING / f"relaxing_bonded_{case}.csv")
    corners = np.isin(rows["time_s"].to_numpy(), [0.0, 1.0, 5.0, 6.0, 10.0])
    rows = rows.filter(corners | (np.arange(len(rows)) % every == 0))
    shares = [g / LONG_TERM for g in OVER_LONG_TERM]
    job = Job(
        spot="febio",
        set_id=0,
        materials={region: relaxing(m, TIMES_S, isochoric) for region, (m, _, isochoric) in tissue.items()},
        thetas={region: np.array([*at_once, *shares]) for region, (_, at_once, _) in tissue.items()},
        protocol=Indentation(
            indenter=Sphere(radius_mm=7.5),
            path=rows.select("depth_mm", "angle_deg").to_numpy(),
            friction=0.0,
            time_s=rows["time_s"].to_numpy(),
        ),
        channels=(FORCE_OVER_TIME, TORQUE_OVER_TIME),
    )
    uncoupled = tuple(region for region, (*_, isochoric) in tissue.items() if isochoric)
    solver = JaxSolver(JaxSettings(depth_steps=2, rotation_step_deg=22.5, mean_dilatation=uncoupled))
    simulation = solver.simulate(job, limb_of(f"bonded_{case}", tuple(tissue)))
    assert simulation.status is Status.OK, simulation.message
    errors = []
    for channel, column in (("force_over_time", "force_N"), ("torque_over_time", "torque_Nmm")):
        curve, expected = simulation.response[channel], rows[column].to_numpy()
        at = np.searchsorted(curve.time_s, rows["time_s"].to_numpy() - 1e-9)
        errors.append(np.abs(curve.ordinate[at] - expected).max() / np.abs(expected).max())
    print(f"{case}: force {errors[0]:.1e}, torque {errors[1]:.1e}")  # noqa: T201
    return errors


# Bulk moduli of FEBio's uncoupled materials do not relax: they are those of the long term.
COUPLED = NeoHookean(), (LONG_TERM * 0.0735, 0.4434), False
UNCOUPLED = Yeoh(), (*(LONG_TERM * c for c in (0.0129, -1e-3, 9.2e-5)), 0.6), True
SKIN = Ogden(), (LONG_TERM * 0.16, 6.0, 2.0), True


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "tissue", "every"),
    [
        ("neo_hookean", {"soft_tissue": COUPLED}, 2),
        ("yeoh", {"soft_tissue": UNCOUPLED}, 3),
        ("layered", {"skin": SKIN, "soft_tissue": COUPLED}, 2),
    ],
)
def test_force_and_torque_of_a_block_that_relaxes(case, tissue, every):
    """With some of FEBio's time steps 0.03 to 0.1 % off, where the convolution is 15, 8 and 4 % in torque."""
    force, torque = relaxed_against_febio(case, tissue, every)
    assert force < 2e-3
    assert torque < 2e-3
