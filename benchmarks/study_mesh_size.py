"""How force and torque of forearm spots depend on the mesh: ``python benchmarks/study_mesh_size.py``.

The phantom's spots, Yeoh's material, a sphere of 7.5 mm, 10 mm deep, twisted by ±22.5°. All lengths
of a mesh are in proportion to the edge at the contact's edge: far edges, and how far flat faces may leave
the surfaces goes with its square. Richardson's extrapolation fits y(h) = y₀ + c hᵖ. Every mesh is
made again, so a value has an error of chance too: ``--again N`` moves the spot by a tenth of a mm
along the limb N times and prints the spread.

    python benchmarks/study_mesh_size.py --spot p2 --sizes 0.24 0.18 0.135
"""

import argparse
import sys
import time
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from palpate.domain import Indentation, Job, Limb, Response, Spot
from palpate.domain.indenter import Sphere
from palpate_forearm import Phantom
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_limb.options import DEFAULT_SIZE, ScanOptions
from palpate_limb.quality import Quality, assess
from palpate_limb.segment import Segment, cut, limb_axis
from palpate_limb.surfaces import Surface
from palpate_limb.volume import MeshPlan, mesh_segment, moved_to_contact
from palpate_materials.uncoupled import Yeoh

RADIUS_MM = 7.5
THETA = np.array([0.0141, -0.0011, 1.05e-4, 0.8])
PATH = np.array([(0.0, 0.0), (10.0, 0.0), (10.0, -22.5), (10.0, 22.5), (10.0, 0.0)])


def exact_segment(phantom: Phantom, spot: Spot) -> Segment:
    """The segment of a spot from the phantom's own surfaces."""
    skin = phantom.skin_surface(1.2)
    bones = [(b.name, phantom.bone_surface(b.name)) for b in phantom.bones]
    scan = Surface(name="phantom", points_mm=skin.points_mm, faces=skin.faces)
    surfaces = [Surface(name=n, points_mm=b.points_mm, faces=b.faces) for n, b in bones]
    return cut(scan, surfaces, spot, limb_axis(scan))


def plan(ratio: float) -> MeshPlan:
    """Plan of a mesh with edges of this share of the radius at the edge of the contact."""
    made, share = ScanOptions(size=f"{ratio * RADIUS_MM} mm").mesh, ratio / DEFAULT_SIZE
    size = replace(made.size, coarse_mm=share * made.size.coarse_mm)
    return replace(made, size=size, tolerance_mm=min(share, 1.0) ** 2 * made.tolerance_mm)


def meshed(segment: Segment, ratio: float) -> tuple[Limb, Quality]:
    """The segment's mesh, with the sphere at rest on it."""
    limb, _ = moved_to_contact(mesh_segment(segment, plan(ratio)), RADIUS_MM)
    return limb, assess(limb, segment, 1.2 * RADIUS_MM)


def pressed(limb: Limb) -> Response:
    """Curves of the press and the twist."""
    protocol = Indentation(indenter=Sphere(radius_mm=RADIUS_MM), path=PATH, friction=1.0)
    job = Job(
        spot=limb.spot.name,
        set_id=0,
        materials={"soft_tissue": Yeoh()},
        thetas={"soft_tissue": THETA},
        protocol=protocol,
    )
    made = JaxSolver(JaxSettings()).simulate(job, limb)
    if made.response is None or made.status != "ok":
        raise RuntimeError(f"{made.status}: {made.message}")
    return made.response


def peaks(response: Response) -> tuple[float, float]:
    """Largest force [N], and half the width [N·mm] of the torque's loop."""
    return peak("force", response["force"].ordinate), peak("torque", response["torque"].ordinate)


def peak(channel: str, ordinate: np.ndarray) -> float:
    """Largest force [N], or half the width [N·mm] of the torque's loop."""
    return float(ordinate.max() if channel == "force" else 0.5 * np.ptp(ordinate))


def extrapolated(sizes: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """y₀ and p of y(h) = y₀ + c hᵖ: p by all sizes, y₀ by the two finest.

    p is held between 1 and 2, since a steeper fall is luck and would flatter (Roache 1994).
    """
    fit = least_squares(
        lambda q: q[0] + q[1] * sizes ** q[2] - values,
        (values[-1], 0.01 * values[-1], 1.5),
        bounds=((-np.inf, -np.inf, 1.0), (np.inf, np.inf, 2.0)),
    )
    order = float(fit.x[2])
    middle, fine = values[np.argsort(sizes)[1::-1]]
    h_fine, h_middle = np.sort(sizes)[:2]
    return float(fine + (fine - middle) / ((h_middle / h_fine) ** order - 1.0)), order


def row(segment: Segment, ratio: float) -> tuple[float, float]:
    """Force and torque of one mesh, in one line."""
    start = time.perf_counter()
    limb, quality = meshed(segment, ratio)
    done, cpu = time.perf_counter(), time.process_time()
    force, torque = peaks(pressed(limb))
    sys.stdout.write(
        f"{segment.name:>6}{ratio:>7.3f}{quality.contact_edge_mm:>9.2f}{quality.n_nodes:>8}{force:>9.4f}"
        f"{torque:>13.4f}{quality.least_scaled_jacobian:>9.3f}{done - start:>11.1f}"
        f"{time.process_time() - cpu:>15.1f}\n"
    )
    sys.stdout.flush()
    return force, torque


def main() -> None:
    """Print a row for each size, and the extrapolated values."""
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    asked.add_argument("--spot", default="p2")
    asked.add_argument("--sizes", type=float, nargs="+", default=[0.24, 0.18, 0.135])
    asked.add_argument("--again", type=int, default=0)
    options = asked.parse_args()
    phantom = Phantom()
    spot = next(s for s in phantom.spots if s.name == options.spot)
    sys.stdout.write(
        "  spot    h/R  edge mm   nodes  force N  torque N·mm  Jacobian  meshing s  solving cpu-s\n"
    )
    values = np.array([row(exact_segment(phantom, spot), ratio) for ratio in options.sizes])
    sizes = np.array(options.sizes)
    for name, found in zip(("force", "torque"), values.T, strict=True):
        if len(sizes) < 3:
            continue
        limit, order = extrapolated(sizes, found)
        errors = ", ".join(f"{100 * (v / limit - 1):+.2f} %" for v in found)
        sys.stdout.write(f"{name}: {limit:.4f} at h = 0 (order {order:.2f}); rows are off by {errors}\n")
    for k in range(options.again):
        moved = replace(spot, position_mm=spot.position_mm + np.array([0.1 * (k + 1), 0.0, 0.0]))
        row(exact_segment(phantom, moved), DEFAULT_SIZE)


if __name__ == "__main__":
    main()
