"""Error by the mesh on real limbs: ``study_real_mesh.py ANATOMY arm:p2 mean:popliteal``.

As ``study_mesh_size.py``, with the limbs and places of ``bench_limbs.py``: all lengths of a mesh are in
proportion to the edge under the sphere, and Richardson's extrapolation gives the limit. ``--skin 1.5``
adds a layer of a neo-Hookean skin (E 0.15 MPa, ν 0.45) over the tissue. ``--depth`` is that of the press.
``--bisect 0.28`` takes the default mesh in place of those of ``--sizes``, as it is and with edges above this
share of the radius bisected at the edge of the contact, as a fit's ``fine_edge`` does; with two of them
also errors against no edge, of the curves that a fit corrects by the first, too.
All meshes have the same few load steps, to save time.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from bench_limbs import SIZE, VIRTUAL, arm, cpu_s, leg
from study_mesh_size import PATH, RADIUS_MM, THETA, extrapolated, peaks, plan

from palpate.domain import Indentation, Job, Limb, Refinement, Response
from palpate.domain.channels import PRESS_AND_TWIST
from palpate.domain.indenter import Sphere
from palpate.mesh.refinement import refined
from palpate.mesh.spot_frame import NEAR, RIM, contact_edge_mm
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_limb.from_scan import ReadScan, sound_mesh
from palpate_limb.options import ScanOptions
from palpate_limb.quality import assess
from palpate_limb.segment import Segment, cut
from palpate_limb.volume import MeshPlan, moved_to_contact
from palpate_materials.neo_hookean import NeoHookean
from palpate_materials.uncoupled import Yeoh

SKIN = np.array([0.15, 0.45])


def read(anatomy: Path, limb: str) -> tuple[ReadScan, ScanOptions]:
    """A limb of ``bench_limbs.py`` with its options."""
    residual = anatomy / "residual_limb"
    if limb == "arm":
        return arm(anatomy / "arm", {})
    if limb == "mean":
        return leg(residual / "Mean_Skin_Shape.stl", residual / "Mean_Bones_Shape.stl", {})
    if limb not in VIRTUAL:
        raise SystemExit(f"no limb '{limb}': arm, mean, {', '.join(VIRTUAL)}")
    return leg(residual / f"{limb}.stl", residual / f"{limb}.stl", {})


def segment_of(anatomy: Path, limb: str, spot: str) -> Segment:
    """The segment of a spot, 80 mm long."""
    scan, options = read(anatomy, limb)
    return cut(scan.surface, scan.bones, scan.spots[spot].spot, scan.axis, stump=options.stump)


def pressed(limb: Limb, depth_mm: float) -> Response:
    """Curves of the press and the twist, at the phantom's material and SKIN."""
    materials, thetas = {"soft_tissue": Yeoh(), "skin": NeoHookean()}, {"soft_tissue": THETA, "skin": SKIN}
    path = PATH[:-1] * np.array([depth_mm / PATH[:, 0].max(), 1.0])
    job = Job(
        spot=limb.spot.name,
        set_id=0,
        materials={name: materials[name] for name in limb.mesh.regions},
        thetas={name: thetas[name] for name in limb.mesh.regions},
        protocol=Indentation(indenter=Sphere(radius_mm=RADIUS_MM), path=path, friction=1.0),
    )
    made = JaxSolver(JaxSettings(depth_steps=5, rotation_step_deg=11.25)).simulate(job, limb)
    if made.response is None or made.status != "ok":
        raise RuntimeError(f"{made.status}: {made.message}")
    return made.response


def row(segment: Segment, ratio: float, layers_mm: dict[str, float], depth_mm: float) -> tuple[float, float]:
    """Force and torque of one mesh, in one line."""
    start = cpu_s()
    made = replace(plan(ratio), layers_mm=layers_mm)
    limb, _ = moved_to_contact(sound_mesh(segment, made), RADIUS_MM)
    quality = assess(limb, segment, 1.2 * RADIUS_MM)
    force, torque = peaks(pressed(limb, depth_mm))
    sys.stdout.write(
        f"{segment.name:>16}{ratio:>7.3f}{quality.contact_edge_mm:>9.2f}{quality.n_nodes:>8}{force:>9.4f}"
        f"{torque:>13.4f}{quality.least_scaled_jacobian:>9.3f}{cpu_s() - start:>8.0f}\n"
    )
    sys.stdout.flush()
    return force, torque


def bisected(segment: Segment, shares: list[float], depth_mm: float) -> None:
    """Force and torque of the default mesh, and of that with shorter edges under the sphere."""
    limb, _ = moved_to_contact(sound_mesh(segment, MeshPlan(size=SIZE)), RADIUS_MM)
    near_mm, edges, found = NEAR * RADIUS_MM, [], []
    for share in (None, *shares):
        start = cpu_s()
        finer = (
            limb
            if share is None
            else refined(limb, RIM[1] * RADIUS_MM, share * RADIUS_MM, RIM[0] * RADIUS_MM)
        )
        force, torque = peaks(pressed(finer, depth_mm))
        edge_mm, n_nodes = contact_edge_mm(finer, near_mm), finer.mesh.n_nodes
        sys.stdout.write(
            f"{segment.name:>16}{share or 0:>7.3f}{edge_mm:>9.2f}{n_nodes:>8}"
            f"{force:>9.4f}{torque:>13.4f}{'':>9}{cpu_s() - start:>8.0f}\n"
        )
        sys.stdout.flush()
        edges.append(edge_mm)
        found.append((force, torque))
    if len(shares) < 2:
        return
    for channel, values in zip(PRESS_AND_TWIST, np.array(found).T, strict=True):
        between = (Refinement(ratio=edges[k] / edges[k + 1], at_rim=True) for k in (0, len(shares) - 1))
        shown = ((values[0], values[1]), (values[-2], values[-1]))
        fitted, limit = (
            fine + each.left_over(channel.mesh) * (fine - coarse)
            for each, (coarse, fine) in zip(between, shown, strict=True)
        )
        errors = ", ".join(f"{100 * (v / limit - 1):+.2f} %" for v in (*values, fitted))
        sys.stdout.write(
            f"{channel.name}: {limit:.4f} at no edge; rows, and the corrected, are off by {errors}\n"
        )


def main() -> None:
    """Print a row for each size of each spot, the limits and the errors."""
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    asked.add_argument("anatomy", type=Path)
    asked.add_argument("spots", nargs="+", metavar="LIMB:SPOT")
    asked.add_argument("--sizes", type=float, nargs="+", default=[0.4, 0.3, 0.225])
    asked.add_argument("--skin", type=float, default=0.0)
    asked.add_argument("--depth", type=float, default=10.0)
    asked.add_argument("--bisect", type=float, nargs="+", default=[])
    options = asked.parse_args()
    layers = {"skin": options.skin} if options.skin else {}
    sys.stdout.write("            spot    h/R  edge mm   nodes  force N  torque N·mm  Jacobian   cpu-s\n")
    for limb, _, spot in (text.partition(":") for text in options.spots):
        segment = segment_of(options.anatomy, limb, spot)
        if options.bisect:
            bisected(segment, options.bisect, options.depth)
            continue
        values = np.array([row(segment, ratio, layers, options.depth) for ratio in options.sizes])
        for name, found in zip(("force", "torque"), values.T, strict=True):
            limit, order = extrapolated(np.array(options.sizes), found)
            errors = ", ".join(f"{100 * (v / limit - 1):+.2f} %" for v in found)
            sys.stdout.write(f"{name}: {limit:.4f} at h = 0 (order {order:.2f}); rows are off by {errors}\n")


if __name__ == "__main__":
    main()
