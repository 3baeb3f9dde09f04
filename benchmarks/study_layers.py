"""Two layers identified at two spots, from the scan on: ``python benchmarks/study_layers.py FOLDER``.

A small limb with a bone and 2.5 mm of skin is scanned and meshed by ``palpate limb`` twice. On the finer
meshes it is pressed by ``palpate synthesise`` with a known material in each layer; on the coarser ones,
corrected by their own refinement, both layers' moduli are fitted by ``palpate run`` without a sweep.
Printed are the fits by each scenario with their errors, and what the meshes change.
"""

import sys
from pathlib import Path

import polars as pl
from skin_over_tissue import TRUTH, call, study

from palpate_forearm import CrossSection, InkMark, Phantom, PhantomBone, Scanner, write_phantom

LIMB = Phantom(
    sections=(
        CrossSection(station_mm=0.0, half_width_mm=18.0, half_height_mm=15.0),
        CrossSection(station_mm=100.0, half_width_mm=22.0, half_height_mm=18.0),
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
PRESS = "5 mm", "4 mm", "15 deg"
RANGES = '{ lower = "0.05 MPa", upper = "0.4 MPa" }', '{ lower = "4 kPa", upper = "20 kPa" }'
TABLES = """
[sampling.filters.drucker]

[solver]
name = "jax"

[fit]
fine_edge = "2.2 mm"
fine_runs = 1
"""


def main(folder: Path) -> None:
    """From scan to both layers' moduli."""
    write_phantom(folder, LIMB, Scanner(spacing_mm=1.2))
    scan = ["limb", str(folder / "scan.ply"), "--bones", str(folder / "bone.stl")]
    marks = ["--mark", "p1=green", "--mark", "p2=red"]
    (folder / "limb.toml").write_text('length = "50 mm"\nradius = "5 mm"\nlayer.skin = "2.5 mm"\n')
    sizes = ["--options", str(folder / "limb.toml")]
    run = folder / "run"
    for meshes, size in (("finer", "2 mm"), ("meshes", "3 mm")):
        call(*scan, *marks, *sizes, "--size", size, "--into", str(folder / meshes))
        files = {name: (f"measured/{name}.csv", f"{meshes}/{name}.vtu") for name in ("p1", "p2")}
        (folder / "study.toml").write_text(study(files, PRESS, RANGES, TABLES))
        if meshes == "finer":
            call("synthesise", str(folder))
    call("run", str(folder), "--out", str(run))
    fits = pl.read_parquet(run / "fit.parquet").unique(["fit", "scenario"], maintain_order=True)
    errors = [(100.0 * (pl.col(name) / true - 1.0)).alias(f"{name} [%]") for name, true in TRUTH.items()]
    with pl.Config(tbl_rows=60, tbl_cols=20, tbl_width_chars=150):
        sys.stdout.write(f"{fits.select('fit', 'scenario', 'fopt', 'n_runs', 'n_fine', *errors)}\n")
        sys.stdout.write(f"{pl.read_parquet(run / 'fit_mesh.parquet')}\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
