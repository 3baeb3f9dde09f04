"""Intervals on a wrong limb: ``python benchmarks/study_wrong_limb.py ANATOMY FOLDER --n 6``.

Each world is the limb of `study_anatomy.py` at the arm's p3 with bones and skin drawn for it: 1 mm of depth
and a tenth of the thickness, one standard deviation. It is meshed by itself, pressed and twisted with the
true moduli, and noise of 0.5 % is added. The fit is on one other mesh, of the limb without these errors.
Printed are values and 95 % intervals of skin's E and the tissue's c1 by I, over the truth, by a budget
without anatomy and by the default one; and how many hold the truth. Position is no error here; friction is
known to a tenth, and the mesh to 1 % (force) and 2 % (torque), as meshes of one size differ.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from bench_inadequate import say
from skin_over_tissue import TRUTH, study
from study_anatomy import COARSE, DEPTH, RANGES, SKIN_MM, TABLES, segment_on, write_mesh

import palpate
from palpate import Job, Response
from palpate.limb.loading import load_limbs
from palpate.plugins.catalogue import Plugins
from palpate.run.directory import RunDirectory
from palpate.stages import pipeline

NOISE = 0.005
ANATOMY = {"without": 'bone = "0 mm"\nlayers = 0.0\nposition = "0 mm"\n', "with": 'position = "0 mm"\n'}
BUDGET = """fine_edge = "0 mm"

[budget]
friction = 0.1
mesh = { force = "1 %", torque = "2 %" }
"""


def text_of(anatomy: str) -> str:
    """Text of the study, of measured data, by a budget."""
    press = ("7.5 mm", DEPTH["arm"], "22.5 deg")
    text = study({"spot": ("spot.csv", "spot.vtu")}, press, RANGES, TABLES + BUDGET + ANATOMY[anatomy])
    before, _, after = text.partition("[truth]")
    return before.replace('"simulated"', '"measured"') + after.partition("\n\n")[2]


def write_curves(world: Path, home: Path, rng: np.random.Generator) -> None:
    """Press the limb of a world with the true moduli, and write its curves into another folder."""
    (world / "study.toml").write_text(text_of("with"))
    (world / "spot.csv").touch()
    read = palpate.read_study(world)
    job = Job(
        spot="spot",
        set_id=0,
        materials={region.region: region.material for region in read.space.regions},
        thetas=read.space.thetas(np.array([TRUTH[p.name] for p in read.space.parameters])),
        protocol=read.protocol_at("spot"),
    )
    found = read.solver.simulate(job, load_limbs(read)["spot"])
    assert found.response is not None, found.message
    curves = {}
    for name, curve in found.response.curves.items():
        noise = NOISE * np.abs(curve.ordinate).max() * rng.normal(size=curve.ordinate.size)
        curves[name] = replace(curve, ordinate=curve.ordinate + noise)
    read.loader.save(home / "spot.csv", Response(curves=curves))


def main() -> None:
    """Print a row for each world and budget."""
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    asked.add_argument("anatomy", type=Path)
    asked.add_argument("folder", type=Path)
    asked.add_argument("--n", type=int, default=6)
    options = asked.parse_args()
    plugins, held = Plugins.load(), dict.fromkeys(((a, p) for a in ANATOMY for p in TRUTH), 0)
    fitted = options.folder / "fitted.vtu"
    write_mesh(fitted, segment_on(options.anatomy, "arm", "p3"), SKIN_MM, COARSE)
    for number in range(options.n):
        rng = np.random.default_rng(number)
        bone_mm, skin = rng.normal(), 1.0 + 0.1 * rng.normal()
        home, world = options.folder / f"{number}", options.folder / f"{number}" / "world"
        segment = segment_on(options.anatomy, "arm", "p3", bones_deeper_mm=bone_mm)
        write_mesh(world / "spot.vtu", segment, skin * SKIN_MM, COARSE)
        (home / "spot.vtu").write_bytes(fitted.read_bytes())
        write_curves(world, home, rng)
        for anatomy in ANATOMY:
            (home / "study.toml").write_text(text_of(anatomy))
            pipeline.run_study(palpate.read_study(home), home / "run", plugins)
            rows = RunDirectory(home / "run").table("intervals").filter(scenario="I").to_dicts()
            parts = []
            for row in rows:
                truth = TRUTH[row["parameter"]]
                low, value, high = (row[key] / truth for key in ("lower", "value", "upper"))
                held[anatomy, row["parameter"]] += low <= 1.0 <= high
                parts.append(f"{row['parameter']} {value:.3f} ({low:.3f} to {high:.3f})")
            say(f"{number}: bones {bone_mm:+.2f} mm, skin {skin:.2f}, {anatomy} anatomy: {', '.join(parts)}")
    for (anatomy, parameter), count in held.items():
        say(f"{anatomy} anatomy: {parameter} holds the truth in {count} of {options.n}")


if __name__ == "__main__":
    main()
