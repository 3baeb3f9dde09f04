"""How long a segment has to be: ``python benchmarks/study_length.py SCAN OPTIONS NAME=PLACE LENGTH …``.

Meshes one spot of a limb (a scan, its options and a place, as for ``palpate limb``) at several lengths [mm]
with edges of a third of the radius, presses and twists it as ``study_mesh_size.py`` does, and prints
force and torque against those of the last length. The cuts are fixed: a short segment is too stiff.
"""

import json
import resource
import sys
import tempfile
from pathlib import Path

from study_mesh_size import RADIUS_MM, peaks, pressed

from palpate.cli.app import main as palpate
from palpate.domain import Spot
from palpate_indentation import MeshioSettings, MeshioSource


def main(scan: str, options: str, place: str, lengths: list[float]) -> None:
    """Print a row for each length."""
    spot, found = place.partition("=")[0], {}
    for length in lengths:
        with tempfile.TemporaryDirectory() as folder:
            # Next to the file of options, whose paths are relative to it.
            changed = Path(options).with_name("length.toml")
            changed.write_text(f'length = "{length} mm"\n' + Path(options).read_text())
            sizes = ["--size", f"{0.33 * RADIUS_MM} mm", "--into", folder, "--spot", place]
            if palpate(["limb", scan, "--options", str(changed), *sizes]):
                raise SystemExit("palpate limb failed")
            limb = MeshioSource(MeshioSettings()).load(Path(folder) / f"{spot}.vtu", Spot(name=spot))
            note = json.loads((Path(folder) / f"{spot}.json").read_text())
        used = resource.getrusage(resource.RUSAGE_SELF).ru_utime
        found[length] = peaks(pressed(limb))
        used = resource.getrusage(resource.RUSAGE_SELF).ru_utime - used
        sys.stdout.write(f"{length:g} mm: {note['quality']['n_nodes']} nodes, {used:.0f} cpu-s\n")
        sys.stdout.flush()
    last = found[lengths[-1]]
    for length, values in found.items():
        shares = [100.0 * (a / b - 1.0) for a, b in zip(values, last, strict=True)]
        sys.stdout.write(
            f"{spot}, {length:g} mm: {values[0]:.3f} N ({shares[0]:+.1f} %), {values[1]:.2f} N·mm "
            f"({shares[1]:+.1f} %)\n"
        )


if __name__ == "__main__":
    main(*sys.argv[1:4], [float(length) for length in sys.argv[4:]])
