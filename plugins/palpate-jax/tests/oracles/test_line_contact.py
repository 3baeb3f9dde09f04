"""A lying cylinder on a half-space: Hertz's line contact in two dimensions.

By the force P per length: half-width a² = 4 P R/(π E*), largest pressure p₀ = 2 P/(π a) (Johnson, Contact
Mechanics, 1985, eqs. 4.43 and 4.45). The depth of a line contact is that of the body's size, and has no such
formula; but at two forces of one body d₁/P₁ − d₂/P₂ = ln(P₂/P₁)/(π E*), from the displacement under an
elliptic pressure. Limits: small strain, a ≪ R, and a body of 75 half-widths to each side and below.

The body is one cell thick and of ν = 0, so that its free sides change nothing: plane strain is plane stress.
"""

import numpy as np
import pytest

from palpate.domain import Limb, Mesh, Spot
from palpate.mesh.specimens import spacing
from palpate.mesh.topology import HEX_CORNERS
from palpate_indentation import Capsule, CapsuleSettings
from palpate_jax.contact import ContactLaw
from palpate_jax.load_stepping import LoadStepping, Stop
from palpate_jax.model import Model
from palpate_jax.schedule import Schedule
from palpate_materials.neo_hookean import NeoHookean

RADIUS, HALF_WIDTH, MODULUS, PENALTY, THICK = 7.5, 0.075, 2.0, 1e4, 10.0
DEPTHS = np.array([0.6, 0.75, 0.9, 1.05, 1.2]) * 0.0032
"""With half-widths of 0.9 to 1.4 times ``HALF_WIDTH``, about which the mesh is fine."""


def slab(n_cells):
    """A slab with so many cells in a half-width, held at its base, its spot in the middle of the top."""
    z = -spacing(1.25 * HALF_WIDTH, round(1.25 * n_cells), 120.0 * HALF_WIDTH, growth=1.25)[::-1]
    y = np.concatenate([z, -z[-2::-1]])
    points = np.stack(np.meshgrid([-THICK / 2, THICK / 2], y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    corners = np.indices((1, y.size - 1, z.size - 1)).reshape(3, -1).T[:, None] + (HEX_CORNERS > 0.0)
    cells = np.ravel_multi_index(tuple(corners.transpose(2, 0, 1)), (2, y.size, z.size))
    mesh = Mesh(
        points_mm=points,
        cells={"hex8": cells},
        cell_regions={"hex8": np.zeros(len(cells), dtype=np.int64)},
        regions=("soft_tissue",),
        node_sets={
            "fixed": np.flatnonzero(points[:, 2] == z[0]),
            "contact": np.flatnonzero(points[:, 2] == 0.0),
        },
    )
    return Limb(spot=Spot(name="line"), mesh=mesh)


@pytest.fixture(scope="module")
def pressed():
    """Force per length, half-width, largest pressure and penetration at each depth."""

    def of(n_cells):
        model = Model(slab(n_cells), {"soft_tissue": NeoHookean()}, mean_dilatation=True)
        law = ContactLaw(Capsule(CapsuleSettings(radius=f"{RADIUS} mm", length="20 mm")), PENALTY, 0.0)
        stepping = LoadStepping(model, {"soft_tissue": np.array([MODULUS, 0.0])}, law, 1e-6)
        rows = []
        for step in stepping.along(Schedule.through(np.pad(DEPTHS[:, None], [(0, 0), (0, 5)]))):
            assert not isinstance(step, Stop)
            touched = model.contact.touched(step.displacements, step.load)
            loads, y = model.contact.areas[touched.where] * touched.points.pressure, touched.points.positions
            # Of an ellipse of pressure, the mean of y² is a quarter of the square of its half-width.
            half_width = 2.0 * np.sqrt((loads * y[:, 1] ** 2).sum() / loads.sum())
            peak = touched.points.pressure.max()
            rows.append((step.answer.force_N[2] / THICK, half_width, peak, step.answer.penetration_mm))
        return np.array(rows).T

    return of


def half_width_error(found):
    """Root of the mean square, over the depths, of the half-width's relative error."""
    force, half_width, *_ = found
    return np.sqrt(np.mean((half_width / np.sqrt(4.0 * force * RADIUS / (np.pi * MODULUS)) - 1.0) ** 2))


@pytest.mark.slow
def test_half_width_pressure_and_compliance_are_hertzs(pressed, observed_order):
    """Measured: half-width 1.6 and 0.23 % (3 and 9 cells), pressure and compliance within 0.6 %."""
    coarse, fine = pressed(3), pressed(9)
    errors = [half_width_error(each) for each in (coarse, fine)]
    assert observed_order("half-width of a line contact, hex8", errors, (3, 9)) > 1.0
    assert errors[1] < 0.01
    force, _, peak, penetration = fine
    np.testing.assert_allclose(peak, np.sqrt(force * MODULUS / (np.pi * RADIUS)), rtol=0.01)
    ratio = DEPTHS / force * np.pi * MODULUS
    assert (ratio[0] - ratio[-1]) / np.log(force[-1] / force[0]) == pytest.approx(1.0, rel=0.01)
    assert (penetration < 0.01 * DEPTHS).all()
