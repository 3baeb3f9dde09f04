"""How force and torque of a forearm spot depend on the mesh: ``python tests/benchmarks/study_mesh_size.py``.

The phantom's spot p2, Yeoh's material, a sphere of 7.5 mm, 10 mm deep, twisted by ±22.5°. Every
mesh is fTetWild's own, so each row is another mesh and not a refinement of the last: the
differences are of the size and of chance. Richardson's extrapolation fits y(h) = y₀ + c hᵖ.
"""

import sys
import time

import numpy as np
from scipy.optimize import least_squares

from palpate.domain import Indentation, Job, Limb, Sphere
from palpate_forearm import Phantom
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_limb.meshing import SizeField
from palpate_limb.quality import assess
from palpate_limb.resting import rested
from palpate_limb.segment import Segment, cut, limb_axis
from palpate_limb.surfaces import Surface
from palpate_limb.volume import MeshPlan, mesh_segment
from palpate_materials.yeoh import Yeoh

RADIUS_MM = 7.5
THETA = np.array([0.0141, -0.0011, 1.05e-4, 0.8])
PATH = np.array([(0.0, 0.0), (10.0, 0.0), (10.0, -22.5), (10.0, 22.5), (10.0, 0.0)])
SIZES_MM = (3.6, 2.7, 2.0, 1.5)


def exact_segment(phantom: Phantom, k: int) -> Segment:
    """The segment of a spot from the phantom's own surfaces."""
    skin = phantom.skin_surface(1.2)
    bones = [(b.name, phantom.bone_surface(b.name)) for b in phantom.bones]
    scan = Surface(name="phantom", points_mm=skin.points_mm, faces=skin.faces)
    surfaces = [Surface(name=n, points_mm=b.points_mm, faces=b.faces) for n, b in bones]
    return cut(scan, surfaces, phantom.spots[k], limb_axis(scan))


def peaks(limb: Limb) -> tuple[float, float]:
    """Largest force [N], and half the width [N·mm] of the torque's loop."""
    protocol = Indentation(indenter=Sphere(radius_mm=RADIUS_MM), path=PATH, friction=1.0)
    job = Job(
        spot="p2",
        set_id=0,
        materials={"soft_tissue": Yeoh()},
        thetas={"soft_tissue": THETA},
        protocol=protocol,
    )
    made = JaxSolver(JaxSettings()).simulate(job, limb)
    if made.response is None or made.status != "ok":
        raise RuntimeError(f"{made.status}: {made.message}")
    torque = made.response["torque"].ordinate
    return float(made.response["force"].ordinate.max()), float(0.5 * np.ptp(torque))


def extrapolated(sizes: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """y₀ and p of y(h) = y₀ + c hᵖ, with p between 0.5 and 4."""
    fit = least_squares(
        lambda q: q[0] + q[1] * sizes ** q[2] - values,
        (values[-1], 0.01 * values[-1], 2.0),
        bounds=((-np.inf, -np.inf, 0.5), (np.inf, np.inf, 4.0)),
    )
    return float(fit.x[0]), float(fit.x[2])


def main() -> None:
    """Print a row for each size, and the extrapolated values."""
    segment = exact_segment(Phantom(), 1)
    rows = []
    sys.stdout.write("fine mm   nodes  force N  torque N·mm  least scaled Jacobian  meshing s  solving s\n")
    for fine in SIZES_MM:
        start = time.perf_counter()
        size = SizeField(fine_mm=fine, coarse_mm=18.0, radius_mm=9.0)
        limb, _ = rested(mesh_segment(segment, MeshPlan(size=size)), RADIUS_MM)
        meshed, cpu = time.perf_counter(), time.process_time()
        force, torque = peaks(limb)
        quality = assess(limb, segment, 9.0)
        rows.append((fine, force, torque))
        sys.stdout.write(
            f"{fine:>7}{quality.n_nodes:>8}{force:>9.4f}{torque:>13.4f}{quality.least_scaled_jacobian:>15.3f}"
            f"{meshed - start:>18.1f}{time.process_time() - cpu:>11.1f}\n"
        )
        sys.stdout.flush()
    sizes, forces, torques = np.array(rows).T
    for name, values in (("force", forces), ("torque", torques)):
        limit, order = extrapolated(sizes, values)
        errors = ", ".join(f"{100 * (v / limit - 1):+.2f} %" for v in values)
        sys.stdout.write(f"{name}: {limit:.4f} at h = 0 (order {order:.2f}); rows are off by {errors}\n")


if __name__ == "__main__":
    main()
