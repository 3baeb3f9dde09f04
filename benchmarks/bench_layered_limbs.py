"""Limbs of three layers from sixteen scans: ``python benchmarks/bench_layered_limbs.py FOLDER [NUMBER ...]``.

Each scan has triangles of another size (1.5 to 4 mm), another limb, with two bones or without, and other
layers: skin of 1.2 to 2 mm, fat of 3 to 8 mm. Printed are cpu-seconds and the quality of each mesh.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from palpate_forearm import CrossSection, InkMark, Phantom, PhantomBone, Scanner, write_phantom

N_SCANS = 16
LONG_MM = 240.0


def limb(rng: np.random.Generator, *, bones: bool, last_mm: float) -> Phantom:
    """A tapered limb, wider or higher here and there; a bone is ``last_mm`` below the skin in places."""
    wide = rng.uniform(28.0, 50.0)
    high = wide * rng.uniform(0.7, 1.0)
    stations = np.linspace(0.0, LONG_MM, 6)
    taper = np.linspace(rng.uniform(0.65, 1.0), 1.0, 6) * rng.uniform(0.95, 1.05, 6)
    sections = tuple(
        CrossSection(station_mm=float(s), half_width_mm=float(wide * k), half_height_mm=float(high * k))
        for s, k in zip(stations, taper, strict=True)
    )
    radius = 0.22 * high
    up = float(taper.min() * high - radius - last_mm)
    placed = {"one": (-0.35 * wide, up), "two": (0.35 * wide, -0.2 * high)} if bones else {}
    return Phantom(
        sections=sections,
        bones=tuple(
            PhantomBone(
                name=name,
                start_mm=(-5.0, y, z),
                end_mm=(LONG_MM + 5.0, y, z),
                start_radius_mm=radius,
                end_radius_mm=radius,
            )
            for name, (y, z) in placed.items()
        ),
        marks=(
            InkMark(
                name="p1",
                station_mm=float(rng.uniform(80.0, 160.0)),
                angle_deg=float(rng.uniform(0.0, 360.0)),
                colour=(0.05, 0.55, 0.15),
            ),
        ),
    )


def main(folder: Path, numbers: list[int]) -> None:
    """A line of a table for each scan."""
    sys.stdout.write("| edges | skin, fat | bones | cpu-s | nodes | Jacobian | angles | volume | made |\n")
    for number in numbers or range(N_SCANS):
        rng = np.random.default_rng(number)
        edge, skin, fat = 1.5 + 2.5 * number / (N_SCANS - 1), rng.uniform(1.2, 2.0), rng.uniform(3.0, 8.0)
        bones, where = bool(number % 2), folder / f"{number:02d}"
        write_phantom(where, limb(rng, bones=bones, last_mm=rng.uniform(4.0, 12.0)), Scanner(spacing_mm=edge))
        files = [f"{where}/one.stl", f"{where}/two.stl"] if bones else []
        (where / "limb.toml").write_text(
            f'unit = "mm"\nbones = {json.dumps(files)}\nmark.p1 = "green"\n'
            f'layer = {{ skin = "{skin:.3g} mm", fat = "{fat:.3g} mm" }}\ncore = "muscle"\n'
        )
        before = os.times()
        made = subprocess.run(
            [
                *(Path(sys.executable).with_name("palpate"), "limb", where / "scan.ply", "--json"),
                *("--options", where / "limb.toml", "--into", where / "meshes"),
            ],
            capture_output=True,
            text=True,
            check=False,
        )
        after = os.times()
        spent = sum(after[2:4]) - sum(before[2:4])
        line = f"| {edge:.1f} mm | {skin:.2f}, {fat:.1f} mm | {len(files)} | {spent:.0f} "
        if made.returncode:
            sys.stdout.write(f"{line}| refused: {made.stderr.strip().splitlines()[-1]} |\n")
            continue
        (note,) = json.loads(made.stdout)
        q = note["quality"]
        layers = ", ".join(f"{mean:.2f} ± {sd:.2f}" for mean, sd in q["layers_mm"].values())
        sys.stdout.write(
            f"{line}| {q['n_nodes']:,} | {q['least_scaled_jacobian']:.3f}, {q['near_scaled_jacobian']:.2f} "
            f"| {q['least_dihedral_deg']:.1f}° to {q['largest_dihedral_deg']:.0f}° "
            f"| {100 * q['volume_error']:+.2f} % | {layers} mm |\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main(Path(sys.argv[1]), [int(number) for number in sys.argv[2:]])
