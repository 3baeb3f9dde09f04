"""Real anatomy into meshes, unaided: ``python benchmarks/bench_limbs.py ANATOMY [--interpolated N]``.

ANATOMY has ``arm/`` (skin, radius, ulna) and ``residual_limb/`` (a mean shape and four virtual limbs,
coordinates in lengths of the intact tibia). Each is meshed at four spots by one set of options; printed are
nodes, worst elements and processor seconds of each spot. With ``--interpolated`` the four virtual
limbs are mixed at random, one spot each in turn.
"""

import argparse
import resource
import sys
import tempfile
import traceback
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh

from palpate.errors import MeshError
from palpate_limb.from_scan import ReadScan, limbs_of, read_scan
from palpate_limb.meshing import SizeField
from palpate_limb.options import BoneFile, ScanOptions
from palpate_limb.quality import Quality

RADIUS_MM = 7.5
SIZE = SizeField(fine_mm=0.28 * RADIUS_MM, coarse_mm=2.4 * RADIUS_MM, radius_mm=1.2 * RADIUS_MM)
FOREARM = {"p1": "ulna:70%,0deg", "p2": "ulna:50%,90deg", "p3": "ulna:40%,180deg", "p4": "ulna:60%,270deg"}
LEG = {
    "fibula_head": "fibula:90%",
    "distal_tibia": "tibia:5%",
    "popliteal": "tibia:95%,90deg",
    "patellar_tendon": "tibia:95%,270deg",
}
BONES = ("femur", "patella", "tibia", "fibula")
VIRTUAL = ("102m", "102p", "1m20", "1p20")


def plan(places: dict[str, str], layers_mm: dict[str, float], bones: list[BoneFile]) -> ScanOptions:
    """The options of all limbs."""
    shared = ScanOptions(spot=places, repair=True, cover="1.5 mm", smoothing=0)
    return shared.model_copy(update={"layer": layers_mm, "bones": bones})


def arm(folder: Path, layers_mm: dict[str, float]) -> tuple[ReadScan, ScanOptions]:
    """The arm with radius and ulna, along the ulna."""
    bones = [BoneFile(folder / f"{bone}.stl") for bone in ("radius", "ulna")]
    options = plan(FOREARM, layers_mm, bones).model_copy(update={"axis": "ulna"})
    return read_scan(folder / "skin.stl", options), options


def leg(skin: Path, bones: Path, layers_mm: dict[str, float]) -> tuple[ReadScan, ScanOptions]:
    """A residual limb, its tibia once 365 mm long."""
    update = {"axis": [0.0, 0.0, 1.0], "stump": True, "unit": "365 mm"}
    options = plan(LEG, layers_mm, [BoneFile(bones, BONES)]).model_copy(update=update)
    return read_scan(skin, options), options


def cpu_s() -> float:
    """Processor seconds of this process and of those that it waited for."""
    each = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(used.ru_utime + used.ru_stime for used in each)


def meshed(limb: str, read: ReadScan, options: ScanOptions) -> Iterator[tuple[str, Quality | str]]:
    """Quality of each spot's mesh, or why there is none; prints a row each."""
    for name, found in read.spots.items():
        start = cpu_s()
        try:
            (made,) = limbs_of(replace(read, spots={name: found}), options)
        except MeshError as error:
            sys.stdout.write(f"{limb} {name}: REFUSED {error}\n")
            yield name, str(error)
            continue
        q, used = made.quality, cpu_s() - start
        sys.stdout.write(
            f"{limb} {name}: {q.n_nodes} nodes, least scaled Jacobian {q.least_scaled_jacobian:.3f}, "
            f"dihedral angles {q.least_dihedral_deg:.1f} to {q.largest_dihedral_deg:.1f} degrees, "
            f"volume {100 * q.volume_error:+.2f} %, {used:.0f} cpu-s"
            f"{''.join(f'; {remark}' for remark in made.segment.remarks)}\n"
        )
        sys.stdout.flush()
        yield name, q


def table(anatomy: Path, only: list[str], layers_mm: dict[str, float]) -> None:
    """The arm, the mean residual limb and the virtual ones."""
    residual = anatomy / "residual_limb"
    for limb in only:
        if limb == "arm":
            made = arm(anatomy / "arm", layers_mm)
        elif limb == "mean":
            made = leg(residual / "Mean_Skin_Shape.stl", residual / "Mean_Bones_Shape.stl", layers_mm)
        else:
            made = leg(residual / f"{limb}.stl", residual / f"{limb}.stl", layers_mm)
        list(meshed(limb, *made))


def interpolated(anatomy: Path, n: int, seed: int, layers_mm: dict[str, float], first: int = 0) -> None:
    """Random limbs between the virtual ones, one spot each in turn; those before the first are left out."""
    corners = {name: _triangles(anatomy / "residual_limb" / f"{name}.stl") for name in VIRTUAL}
    middle = sum(corners.values()) / 4.0
    modes = [(corners["102p"] - corners["102m"]) / 2.0, (corners["1p20"] - corners["1m20"]) / 2.0]
    random, counts = np.random.default_rng(seed), {"meshed": 0, "refused": 0, "crashed": 0}
    for i in range(n):
        shares = random.uniform(-1.0, 1.0, 2)
        if i < first:
            continue
        points = (middle + shares[0] * modes[0] + shares[1] * modes[1]).reshape(-1, 3)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "limb.stl"
            trimesh.Trimesh(points, np.arange(len(points)).reshape(-1, 3), process=False).export(file)
            try:
                read, options = leg(file, file, layers_mm)
                spot = list(read.spots)[i % len(read.spots)]
                ((_, outcome),) = meshed(
                    f"{i} ({shares[0]:+.2f}, {shares[1]:+.2f})",
                    replace(read, spots={spot: read.spots[spot]}),
                    options,
                )
                counts["refused" if isinstance(outcome, str) else "meshed"] += 1
            except MeshError as error:
                sys.stdout.write(f"{i}: REFUSED {error}\n")
                counts["refused"] += 1
            except Exception:
                sys.stdout.write(f"{i}: CRASHED\n{traceback.format_exc()}")
                counts["crashed"] += 1
    sys.stdout.write(f"interpolated limbs {first} to {n - 1}: {counts}\n")


def _triangles(path: Path) -> np.ndarray:
    """Corners (n, 3, 3) in the order of a binary STL."""
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    return np.frombuffer(path.read_bytes()[84:], record)["corners"].astype(np.float64)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("anatomy", type=Path)
    parser.add_argument("--limbs", nargs="*", default=["arm", "mean", *VIRTUAL])
    parser.add_argument("--interpolated", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="the first of the interpolated limbs to mesh")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--skin", type=float, default=0.0, help="thickness of a skin layer [mm]")
    parser.add_argument("--fat", type=float, default=0.0, help="thickness of a layer of fat below it [mm]")
    given = parser.parse_args()
    layers = {name: mm for name, mm in (("skin", given.skin), ("fat", given.fat)) if mm}
    if given.interpolated:
        interpolated(given.anatomy, given.interpolated, given.seed, layers, given.first)
    else:
        table(given.anatomy, given.limbs, layers)
