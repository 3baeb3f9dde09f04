"""From a scan with noise against the limb itself: ``python benchmarks/study_scan_path.py FOLDER p2``.

The direct path meshes the phantom's exact surfaces at its exact spot. The other one goes through files, as
a laboratory does: a coloured scan (1.2 mm between points, noise, light from one side), its marks found by
hue, bones from STL, ``palpate limb``. Both limbs are pressed and twisted with one material. Then the
direct limb's curves stand for the experiment, and the stiffness is identified with the scan's limb: with all
moduli multiplied by s both curves are, so s = Σ y ŷ / Σ ŷ² over the points, each curve over its mean square.
"""

import sys
from pathlib import Path

import numpy as np
from study_mesh_size import RADIUS_MM, exact_segment, meshed, peaks, pressed

from palpate.cli.app import main as palpate
from palpate.domain import Response, Spot
from palpate_forearm import Phantom, write_phantom
from palpate_indentation import MeshioSettings, MeshioSource
from palpate_limb.options import DEFAULT_SIZE


def scale(measured: Response, simulated: Response) -> float:
    """Factor on all moduli that fits the simulated curves to the measured ones best."""
    pairs = [(measured[c].ordinate, simulated[c].ordinate) for c in ("force", "torque")]
    weights = [1.0 / np.mean(y**2) for y, _ in pairs]
    return sum(w * float(y @ z) for w, (y, z) in zip(weights, pairs, strict=True)) / sum(
        w * float(z @ z) for w, (_, z) in zip(weights, pairs, strict=True)
    )


def main(folder: Path, names: list[str]) -> None:
    """Print force, torque and stiffness of both paths for each spot."""
    phantom = Phantom()
    write_phantom(folder)
    bones = [word for bone in phantom.bones for word in ("--bones", str(folder / f"{bone.name}.stl"))]
    (folder / "limb.toml").write_text(f'radius = "{RADIUS_MM} mm"\nsize = "{DEFAULT_SIZE * RADIUS_MM} mm"\n')
    options = ["--options", str(folder / "limb.toml")]
    if palpate(["limb", str(folder / "scan.ply"), *bones, *options, "--into", str(folder / "meshes")]):
        raise SystemExit("palpate limb failed")
    for spot in (s for s in phantom.spots if s.name in names):
        direct = pressed(meshed(exact_segment(phantom, spot), DEFAULT_SIZE)[0])
        source = MeshioSource(MeshioSettings())
        scanned = pressed(source.load(folder / "meshes" / f"{spot.name}.vtu", Spot(name=spot.name)))
        shares = [100.0 * (b / a - 1.0) for a, b in zip(peaks(direct), peaks(scanned), strict=True)]
        sys.stdout.write(
            f"{spot.name}: direct {peaks(direct)[0]:.4f} N, {peaks(direct)[1]:.4f} N·mm; from the scan force "
            f"{shares[0]:+.2f} %, torque {shares[1]:+.2f} %; identified stiffness "
            f"{100.0 * (scale(direct, scanned) - 1.0):+.2f} %\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:] or ["p2"])
