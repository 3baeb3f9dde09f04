"""Two layers identified at two spots, from the scan on: ``python tests/benchmarks/study_layers.py FOLDER``.

A small limb with a bone and 2.5 mm of skin is scanned, meshed by ``palpate limb``, pressed by ``palpate
synthesise`` with a known material in each layer, and identified by ``palpate run``: one design over both
layers' parameters. Printed are the report's tables on the truth and on what the data identify.
"""

import sys
from pathlib import Path

import polars as pl

from palpate.cli.app import main as palpate
from palpate_forearm import InkMark, Phantom, PhantomBone, Scanner, Section, write_phantom

LIMB = Phantom(
    sections=(
        Section(station_mm=0.0, half_width_mm=18.0, half_height_mm=15.0),
        Section(station_mm=100.0, half_width_mm=22.0, half_height_mm=18.0),
    ),
    bones=(
        PhantomBone(
            name="bone",
            start_mm=(-4.0, 2.0, -3.0),
            end_mm=(104.0, 2.0, -4.0),
            start_radius_mm=4.5,
            end_radius_mm=5.5,
        ),
    ),
    marks=(
        InkMark(name="p1", station_mm=35.0, angle_deg=90.0, colour=(0.05, 0.55, 0.15)),
        InkMark(name="p2", station_mm=65.0, angle_deg=60.0, colour=(0.80, 0.08, 0.10)),
    ),
)
STUDY = """
[study]
name = "layers"
description = "skin and soft tissue of a small simulated limb, identified together at two spots"
data = "simulated"

[[spot]]
name = "p1"
measured = "measured/p1.csv"
mesh = "meshes/p1.vtu"

[[spot]]
name = "p2"
measured = "measured/p2.csv"
mesh = "meshes/p2.vtu"

[experiment]
loader = "csv"

[limb]
source = "meshio"

[limb.settings]
regions = { skin = 0, soft_tissue = 1 }

[protocol]
indenter = { shape = "sphere", radius = "5 mm" }
depth = "4 mm"
twist = ["-15 deg", "15 deg", "0 deg"]
friction = 1.0

[region.skin]
material = "neo_hookean"

[region.skin.parameters]
E = { lower = "0.05 MPa", upper = "0.4 MPa" }
nu = 0.45

[region.soft_tissue]
material = "yeoh"

[region.soft_tissue.parameters]
c1 = { lower = "4 kPa", upper = "20 kPa" }
c2 = "-0.6 kPa"
c3 = "0.06 kPa"
kappa = "0.5 MPa"

[sampling]
n_sets = 32
max_draws = 32
seed = 1

[sampling.filters.drucker]

[solver]
name = "jax"
settings = { warm_start = true }

[selection]
scenarios = ["I", "II", "III"]
generalise_by = "I"

[truth]
skin.E = "0.15 MPa"
soft_tissue.c1 = "9 kPa"
"""


def main(folder: Path) -> None:
    """From scan to what the data identify."""
    write_phantom(folder, LIMB, Scanner(spacing_mm=1.2))
    scan = ["limb", str(folder / "scan.ply"), "--bones", str(folder / "bone.stl")]
    marks = ["--mark", "p1=green", "--mark", "p2=red"]
    sizes = ["--length", "50 mm", "--radius", "5 mm", "--size", "3 mm", "--skin", "2.5 mm"]
    run = folder / "run"
    study = folder / "study.toml"
    study.write_text(STUDY)
    for call in (
        [*scan, *marks, *sizes, "--into", str(folder / "meshes")],
        ["synthesise", str(folder)],
        ["run", str(folder), "--out", str(run)],
    ):
        if palpate(call):
            raise SystemExit(f"palpate {' '.join(call)} failed")
    tables = run / "report" / "tables"
    with pl.Config(tbl_rows=60, tbl_cols=20, tbl_width_chars=150):
        for name in ("table2_nmse", "distance_to_truth", "identifiability"):
            sys.stdout.write(f"{name}\n{pl.read_csv(tables / f'{name}.csv')}\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
