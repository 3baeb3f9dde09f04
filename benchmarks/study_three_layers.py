"""What one press shows of skin, fat and muscle: ``python benchmarks/study_three_layers.py FOLDER``.

A flat block, 48 mm wide, of 1.1 mm of skin and 4.4 mm of fat over 18.5 mm of muscle on bone (2,025 nodes,
hex8, neo-Hookean), pressed 6 mm deep by a sphere of 7.5 mm and twisted by ±22.5°. The curves are the
truth's on the same mesh with noise of 0.5 % of the peak, and the middle of the ranges is the truth, so a fit
ends near its start: what counts is palpate's 95 % interval around it, for force and torque (I), torque (II)
and force (III), by the default budget but for Poisson's ratios, which are known within 1 % and not 10 %.
Three cases: all three moduli searched, the skin's known within 10 %, and fat's tied to muscle's. What is in
FOLDER is not made again.

``--presses`` plans before anything is measured: ``palpate next`` chooses among presses of two spheres, two
depths, with a twist and without, where each thickness is known to a tenth.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
from skin_over_tissue import call

from palpate.mesh.specimens import block
from palpate_indentation import CsvLoader
from palpate_limb.limb_files import write_limb

LAYERS = {"skin": 1.06, "fat": 4.43}
"""Thickness [mm] of whole rows of elements, of which nodes crowd at the spot."""
SEARCHED = {
    "skin": '{ lower = "0.02 MPa", upper = "1.125 MPa" }',
    "fat": '{ lower = "1 kPa", upper = "36 kPa" }',
    "muscle": '{ lower = "2.5 kPa", upper = "90 kPa" }',
}
TRUTH = {"skin": "150 kPa", "fat": "6 kPa", "muscle": "15 kPa"}
"""The geometric middle of the ranges."""
NOISE = 0.005
POISSON = {"skin": 0.45, "fat": 0.48, "muscle": 0.48}
KNOWN: dict[str, dict[str, str]] = {
    "all": {},
    "skin known": {"skin": '"150 kPa"'},
    "fat tied": {"fat": '"0.4 * muscle.E"'},
}
KNOWN_TO = 0.1
"""Standard deviation of a thickness over the thickness, for ``--presses``."""
ALLOWED = """
places = 1

[protocol]
indenter = [{ shape = "sphere", radius = "7.5 mm" }, { shape = "sphere", radius = "15 mm" }]
depth = ["3 mm", "6 mm"]
twist = [[], ["-22.5 deg", "22.5 deg", "0 deg"]]
"""
HEAD = """
[study]
name = "three-layers"
description = "skin, fat and muscle of a flat block"
data = "simulated"

[[spot]]
name = "p1"
measured = "p1.csv"
mesh = "p1.vtu"

[experiment]
loader = "csv"

[limb]
source = "meshio"

[limb.settings]
regions = { skin = 0, fat = 1, muscle = 2 }

[protocol]
indenter = { shape = "sphere", radius = "7.5 mm" }
depth = "6 mm"
twist = ["-22.5 deg", "22.5 deg", "0 deg"]
friction = 1.0

[sampling]
n_sets = 0
seed = 1

[solver]
name = "jax"

[fit]

[budget]
parameters = NU

[selection]
scenarios = ["I", "II", "III"]
generalise_by = "I"
"""


def study(known: dict[str, str]) -> str:
    """The study, with these moduli fixed or tied."""
    regions = [
        f'[region.{name}]\nmaterial = "neo_hookean"\n\n[region.{name}.parameters]\n'
        f"E = {known.get(name, searched)}\nnu = {POISSON[name]}\n"
        for name, searched in SEARCHED.items()
    ]
    values = [f'{name}.E = "{value}"' for name, value in TRUTH.items() if name not in known]
    nu = ", ".join(f'"{name}.nu" = "1 %"' for name in POISSON)
    return "\n".join([HEAD.replace("NU", f"{{ {nu} }}"), *regions, "[truth]", *values, ""])


def add_noise(file: Path) -> None:
    """Add noise to measured curves."""
    random, loader = np.random.default_rng(1), CsvLoader()
    clean = loader.load(file)
    noisy = {
        name: replace(
            curve,
            ordinate=curve.ordinate
            + NOISE * np.abs(curve.ordinate).max() * random.normal(size=len(curve.ordinate)),
        )
        for name, curve in clean.curves.items()
    }
    loader.save(file, replace(clean, curves=noisy))


def write_mesh(folder: Path) -> None:
    """Write the block as the mesh of the spot."""
    folder.mkdir(parents=True, exist_ok=True)
    limb = block("hex8", width_mm=48.0, height_mm=24.0, n_across=14, n_down=8, grading=1.5, layers_mm=LAYERS)
    mesh = replace(limb.mesh, regions=(*LAYERS, "muscle"))
    write_limb(folder / "p1.vtu", replace(limb, mesh=mesh))


def plan(folder: Path) -> None:
    """Print the presses that tell most, and the intervals expected after them."""
    write_mesh(folder)
    known = [f'{name} = "{mm} mm ± {KNOWN_TO * mm:g} mm"' for name, mm in LAYERS.items()]
    layers = "\n".join(["", "[spot.layers]", *known, "", "[experiment]"])
    (folder / "study.toml").write_text(study({}).replace("\n[experiment]", layers, 1))
    (folder / "allowed.toml").write_text(ALLOWED)
    call("next", str(folder), "--allowed", str(folder / "allowed.toml"), "--presses", "4")


def main(folder: Path) -> None:
    """Print the intervals of each case."""
    write_mesh(folder)
    for case, known in KNOWN.items():
        run = folder / f"run {case}"
        (folder / "study.toml").write_text(study(known))
        if not (folder / "p1.csv").exists():
            call("synthesise", str(folder))
            add_noise(folder / "p1.csv")
        if not (run / "intervals.parquet").exists():
            call("run", str(folder), "--out", str(run))
        found = pl.read_parquet(run / "intervals.parquet")
        with pl.Config(tbl_rows=30, tbl_cols=20, tbl_width_chars=170):
            sys.stdout.write(f"{case}\n{found}\n{pl.read_parquet(run / 'budget.parquet')}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("folder", type=Path)
    asked.add_argument("--presses", action="store_true", help="plan presses before anything is measured")
    given = asked.parse_args()
    (plan if given.presses else main)(given.folder)
