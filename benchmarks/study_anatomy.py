"""What wrong anatomy costs in each parameter: ``python benchmarks/study_anatomy.py ANATOMY FOLDER``.

The truth is a limb with 2.2 mm of skin on a finer mesh, pressed and twisted. Its curves are then fitted on
other limbs: its own, with bones 5 mm deeper, with 1 mm less or more skin, and an ellipse with its section
and straight bones; or the mean limb in place of a virtual one. Skin's E and the tissue's c1 are searched from
the truth on, at each spot alone, by force and torque (I), torque (II) and force (III). FOLDER keeps meshes,
simulations and answers; a second call computes what is missing. Errors are in per cent.
"""

import argparse
import json
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from bench_limbs import cpu_s
from scipy.optimize import lsq_linear
from skin_over_tissue import TRUTH, study
from study_mesh_size import RADIUS_MM, exact_segment, plan
from study_real_mesh import read

import palpate
from palpate.cli.app import main as command
from palpate_forearm import CrossSection, InkMark, Phantom, PhantomBone
from palpate_limb.from_scan import sound_mesh
from palpate_limb.limb_files import write_limb
from palpate_limb.segment import Segment, cut
from palpate_limb.surfaces import solid, surface_of
from palpate_limb.volume import moved_to_contact

SKIN_MM = 2.2
FINER, COARSE = 0.33, 0.4
"""Edges under the sphere over its radius, of the truth and of the fits."""
DEPTH = {"arm": "6 mm"}
OF_LEGS = "4 mm"
RANGES = '{ lower = "0.01 MPa", upper = "1 MPa" }', '{ lower = "1 kPa", upper = "60 kPa" }'
TABLES = """
[solver]
name = "jax"
settings = { depth_steps = 5, rotation_step_deg = 11.25 }

[fit]
"""


def segments(anatomy: Path, limb: str, spot: str) -> Mapping[str, tuple[Segment, float]]:
    """Each limb that is fitted, the true one first, and the thickness [mm] of its skin."""
    own = segment_on(anatomy, limb, spot)
    if limb != "arm":
        return {"own": (own, SKIN_MM), "mean": (segment_on(anatomy, "mean", spot), SKIN_MM)}
    return {
        "own": (own, SKIN_MM),
        "bones": (segment_on(anatomy, limb, spot, bones_deeper_mm=5.0), SKIN_MM),
        "thin": (own, SKIN_MM - 1.0),
        "thick": (own, SKIN_MM + 1.0),
        "ellipse": (elliptic(own), SKIN_MM),
    }


def segment_on(anatomy: Path, limb: str, spot: str, bones_deeper_mm: float = 0.0) -> Segment:
    """The segment of a spot, its bones moved inwards along the normal."""
    scan, options = read(anatomy, limb)
    place = scan.spots[spot].spot
    motion = np.eye(4)
    motion[:3, 3] = -bones_deeper_mm * place.normal
    return cut(scan.surface, [b.moved(motion) for b in scan.bones], place, scan.axis, stump=options.stump)


def elliptic(of: Segment) -> Segment:
    """An elliptic limb with the section of another one at its spot, and round straight bones."""
    at_spot = of.skin.trimesh.section(plane_origin=np.zeros(3), plane_normal=of.axis).vertices
    width, height = (0.5 * float(np.ptp(at_spot[:, i])) for i in (1, 2))
    bones = []
    for bone in of.bones:
        piece = solid(bone).trim_by_plane(of.axis.tolist(), -10.0).trim_by_plane((-of.axis).tolist(), -10.0)
        middle = surface_of(piece, bone.name).points_mm.mean(axis=0)
        y, z, radius = (
            float(middle[1]),
            float(middle[2]) + height,
            float(np.sqrt(piece.volume() / 20.0 / np.pi)),
        )
        ends = [(x, y, z) for x in (-5.0, 125.0)]
        bones.append(
            PhantomBone(
                name=bone.name, start_mm=ends[0], end_mm=ends[1], start_radius_mm=radius, end_radius_mm=radius
            )
        )
    mark = InkMark(name="spot", station_mm=60.0, angle_deg=90.0, colour=(0.0, 0.5, 0.0))
    section = CrossSection(station_mm=0.0, half_width_mm=width, half_height_mm=height)
    phantom = Phantom(
        sections=(section, replace(section, station_mm=120.0)), bones=tuple(bones), marks=(mark,)
    )
    return exact_segment(phantom, phantom.spots[0])


def write_mesh(file: Path, segment: Segment, skin_mm: float, ratio: float) -> None:
    """Mesh a limb, unless that was done before."""
    if file.exists():
        return
    file.parent.mkdir(parents=True, exist_ok=True)
    made = sound_mesh(segment, replace(plan(ratio), layers_mm={"skin": skin_mm}))
    write_limb(file, moved_to_contact(made, RADIUS_MM)[0])


def errors(case: Path) -> dict[str, list[float]]:
    """Errors [%] of both moduli by scenario: two Gauss-Newton steps from the truth, each by up to twice."""
    case_study, truth, found = palpate.read_study(case), np.array(list(TRUTH.values())), {}
    for scenario in ("I", "II", "III"):
        with palpate.open_problem(case_study, scenario=scenario, folder=case / "run") as problem:
            assert list(problem.names) == list(TRUTH)
            shares = [np.ones(2)]
            for _ in range(2):
                values = shares[-1] * truth
                near = (
                    np.maximum(problem.bounds[0] / values, 0.5),
                    np.minimum(problem.bounds[1] / values, 2.0),
                )
                step = lsq_linear(
                    problem.jacobian(values) * truth,
                    -problem.residuals(values),
                    [shares[-1] * (bound - 1.0) for bound in near],
                )
                shares.append(shares[-1] + step.x)
        last = float(np.abs(shares[2] / shares[1] - 1.0).max())
        found[scenario] = [*(100.0 * (shares[-1] - 1.0)), 100.0 * last]
    return found


def main() -> None:
    """Print a row for each limb that is fitted."""
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    asked.add_argument("anatomy", type=Path)
    asked.add_argument("folder", type=Path)
    asked.add_argument(
        "--spots", nargs="+", default=["arm:p3", "1p20:distal_tibia", "arm:p2"], metavar="LIMB:SPOT"
    )
    options = asked.parse_args()
    answers = options.folder / "answers.json"
    known = json.loads(answers.read_text()) if answers.exists() else {}
    for limb, _, spot in (text.partition(":") for text in options.spots):
        home = options.folder / f"{limb}-{spot}"
        press = ("7.5 mm", DEPTH.get(limb, OF_LEGS), "22.5 deg")
        text = study({"spot": ("spot.csv", "spot.vtu")}, press, RANGES, TABLES)
        limbs = segments(options.anatomy, limb, spot)
        write_mesh(home / "truth" / "spot.vtu", *limbs["own"], FINER)
        if not (home / "truth" / "spot.csv").exists():
            (home / "truth" / "study.toml").write_text(text)
            if command(["synthesise", str(home / "truth")]):
                raise SystemExit("palpate synthesise failed")
        for name, (segment, skin_mm) in limbs.items():
            start, key = cpu_s(), f"{limb} {spot} {name}"
            if key not in known:
                case = home / name
                write_mesh(case / "spot.vtu", segment, skin_mm, COARSE)
                (case / "study.toml").write_text(text)
                (case / "spot.csv").write_bytes((home / "truth" / "spot.csv").read_bytes())
                known[key] = errors(case)
                answers.write_text(json.dumps(known, indent=1) + "\n")
            row = "; ".join(
                f"{s}: E {e:+.1f}, c1 {c:+.1f} (last step {d:.1f})" for s, (e, c, d) in known[key].items()
            )
            sys.stdout.write(f"{key}: {row} ({cpu_s() - start:.0f} cpu-s)\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
