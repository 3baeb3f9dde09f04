"""Moved nodes against another mesh: ``python benchmarks/study_moved_nodes.py ANATOMY FOLDER``.

The limb of `study_anatomy.py` at the arm's p3, pressed and twisted with the true moduli. Its bones are 2 mm
deeper, or its skin 0.5 mm thinner or thicker: by a mesh of its own, and by moved nodes of the first mesh, as
an error budget has them. Printed is by how much each changes the largest force and torque, in per cent, and
the same by moved nodes for one standard deviation: 1 mm of bone, a tenth of the skin, 1 mm along it.
"""

import argparse
from pathlib import Path

import numpy as np
from bench_inadequate import say
from skin_over_tissue import TRUTH, study
from study_anatomy import COARSE, DEPTH, RANGES, SKIN_MM, TABLES, segment_on, write_mesh

import palpate
from palpate import Job, Limb
from palpate.limb.loading import load_limbs
from palpate_certainty.anatomy import changed_limb

OTHERS = {"bones": ("bone", "", -2.0), "thin": ("layers", "skin", -0.5), "thick": ("layers", "skin", 0.5)}
ONE_SD = [
    ("bone", "", 1.0),
    ("layers", "skin", 0.1 * SKIN_MM),
    ("position", "x", 1.0),
    ("position", "y", 1.0),
]


def moved(limb: Limb, kind: str, of: str, by_mm: float) -> Limb:
    """Limb changed by so many millimetres."""
    return changed_limb(limb, kind, of, by_mm / SKIN_MM if kind == "layers" else by_mm)


def main() -> None:
    """Print a row for each change."""
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    asked.add_argument("anatomy", type=Path)
    asked.add_argument("folder", type=Path)
    options = asked.parse_args()
    press, limbs = ("7.5 mm", DEPTH["arm"], "22.5 deg"), {}
    for name in ("own", *OTHERS):
        kind, _, by_mm = OTHERS.get(name, ("", "", 0.0))
        segment = segment_on(options.anatomy, "arm", "p3", bones_deeper_mm=-by_mm if kind == "bone" else 0.0)
        home = options.folder / name
        write_mesh(home / "spot.vtu", segment, SKIN_MM + by_mm if kind == "layers" else SKIN_MM, COARSE)
        (home / "study.toml").write_text(study({"spot": ("spot.csv", "spot.vtu")}, press, RANGES, TABLES))
        (home / "spot.csv").write_text("depth_mm,force_N,rotation_deg,torque_Nmm\n")
        read = palpate.read_study(home)
        limbs[name] = load_limbs(read)["spot"]
    row = np.array([TRUTH[parameter.name] for parameter in read.space.parameters])
    job = Job(
        spot="spot",
        set_id=0,
        materials={region.region: region.material for region in read.space.regions},
        thetas=read.space.thetas(row),
        protocol=read.protocol_at("spot"),
    )

    def peaks(limb: Limb) -> np.ndarray:
        found = read.solver.simulate(job, limb)
        assert found.response is not None, found.message
        return np.array([np.abs(found.response[name].ordinate).max() for name in ("force", "torque")])

    own = peaks(limbs["own"])
    say(f"own: {own[0]:.3f} N, {own[1]:.1f} N·mm, {limbs['own'].mesh.n_nodes} nodes")
    for name, change in OTHERS.items():
        meshed, morphed = (
            100.0 * (peaks(each) / own - 1.0) for each in (limbs[name], moved(limbs["own"], *change))
        )
        say(f"{name}: force, torque {meshed.round(1)} % by a mesh, {morphed.round(1)} % by moved nodes")
    for kind, of, by_mm in ONE_SD:
        ends = [peaks(moved(limbs["own"], kind, of, sign * by_mm)) for sign in (1.0, -1.0)]
        change = 100.0 * (ends[0] - ends[1]) / (2.0 * own)
        say(f"{kind} {of} {by_mm:.2f} mm: force, torque {change.round(2)} %")


if __name__ == "__main__":
    main()
