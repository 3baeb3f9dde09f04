"""The force of a frictionless press against FEBio's, on the same mesh."""

from pathlib import Path

import meshio
import numpy as np
import polars as pl
import pytest

from palpate.domain import Indentation, Job, Limb, Mesh, Sphere, Spot, Status
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_materials.yeoh import Yeoh

DATA = Path(__file__).parents[1] / "data" / "febio_reference"
FACET_MM = 0.0107
"""How far FEBio's sphere, of facets with 0.8 mm edges, lies inside the true one on average: e²/8R."""
THETA = np.array([0.0129, -1e-3, 9.2e-5, 0.6])


@pytest.fixture(scope="module")
def limb():
    read = meshio.read(DATA / "frictionless_yeoh.vtu")
    hexes = read.cells_dict["hexahedron"]
    mesh = Mesh(
        points_mm=read.points,
        cells={"hex8": hexes},
        cell_regions={"hex8": np.zeros(len(hexes), dtype=int)},
        regions=("soft_tissue",),
        node_sets={name: np.flatnonzero(read.point_data[name]) for name in ("fixed", "contact")},
    )
    return Limb(spot=Spot(name="block"), mesh=mesh)


def test_force_is_febios_within_its_facets(limb):
    reference = pl.read_csv(DATA / "frictionless_yeoh.csv")
    job = Job(
        spot="block",
        set_id=0,
        materials={"soft_tissue": Yeoh()},
        thetas={"soft_tissue": THETA},
        protocol=Indentation(
            indenter=Sphere(radius_mm=7.5), path=np.array([(0, 0), (2, 0), (4, 0)]), friction=0.0
        ),
    )
    simulation = JaxSolver(JaxSettings(depth_steps=4)).simulate(job, limb)
    assert simulation.status is Status.OK, simulation.message
    curve = simulation.response["force"]
    depths = np.array([2.0, 4.0])
    ours = np.interp(depths - FACET_MM, curve.abscissa, curve.ordinate)
    febio = np.interp(depths, reference["depth_mm"], reference["force_N"])
    np.testing.assert_allclose(ours, febio, atol=0.01 * febio[-1])
