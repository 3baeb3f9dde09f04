"""Meshes and curves of ready studies: ``make_curves.py forearm-layered``, ``-fibres`` or ``-real``.

The truth of the study is simulated on a mesh that is finer than the study's and made independently of it, by
half the usual steps. Each point of the curves has noise. The files replace those of the study.
"""

import argparse
import functools
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from independent_meshes import layered_limb, true_limb

from palpate import Limb, Plugins
from palpate.api.runs import read_options
from palpate.domain import FloatArray
from palpate.limb.loading import load_limbs
from palpate.simulation.synthesis import NOTE, synthesise
from palpate.study.reading import read_study
from palpate_forearm import Phantom
from palpate_limb.from_scan import ReadScan, read_scan, sound_mesh
from palpate_limb.limb_files import write_limb
from palpate_limb.options import ScanOptions
from palpate_limb.segment import cut
from palpate_limb.volume import moved_to_contact

NOISE, SEED = 0.005, 1
"""Standard deviation of each point, of the curve's largest value."""
STEPS = "depth_steps = 20, rotation_step_deg = 2.25"
SKIN = {"skin": 2.5}
"""Thickness [mm] of the layer of ``forearm-layered``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Meshes:
    """Meshes of a study by spot: of its truth, and of its fit.

    Parameters
    ----------
    penalty : float
        Stiffness of the contact; the solver's default is 1500.
    """

    truth: Callable[[str], Limb]
    fit: Callable[[str], Limb]
    spots: tuple[str, ...]
    penalty: float = 1500.0


def axis_at(spot: str) -> FloatArray:
    """Unit vector of the phantom's axis in the frame of a spot, whose x is along the limb."""
    (normal,) = (each.normal for each in Phantom().spots if each.name == spot)
    rise = float(np.asarray(normal)[0])
    return np.array([np.sqrt(1.0 - rise**2), 0.0, rise])


def with_axis(limb: Limb, spot: str) -> Limb:
    """The limb with the direction of its axis in each element."""
    axis = {kind: np.tile(axis_at(spot), (len(cells), 1)) for kind, cells in limb.mesh.cells.items()}
    return replace(limb, mesh=replace(limb.mesh, cell_fields={"axis": axis}))


def of_demo(spot: str) -> Limb:
    """Mesh of a spot of ``forearm-demo``."""
    plugins = Plugins.load()
    return load_limbs(read_study(Path(plugins.studies["forearm-demo"].directory), plugins))[spot]


@functools.cache
def real_scan() -> tuple[ReadScan, ScanOptions]:
    """The scan of ``forearm-real``, and its options."""
    folder = Path(Plugins.load().studies["forearm-real"].directory)
    options = read_options(folder / "limb.toml", ScanOptions, {})
    return read_scan(folder / "skin.ply", options), options


def real_limb(spot: str, size_mm: float, tolerance_mm: float) -> Limb:
    """Mesh of a spot of ``forearm-real`` with edges as long as asked for at the edge of the contact."""
    scan, options = real_scan()
    segment = cut(scan.surface, scan.bones, scan.spots[spot].spot, scan.axis, options.length_mm)
    wanted = options.model_copy(update={"size": size_mm}).mesh_at(spot)
    return moved_to_contact(sound_mesh(segment, replace(wanted, tolerance_mm=tolerance_mm)), options.radius)[
        0
    ]


STUDIES = {
    "forearm-fibres": Meshes(
        truth=lambda spot: with_axis(true_limb(spot), spot),
        fit=lambda spot: with_axis(of_demo(spot), spot),
        spots=("p1",),
    ),
    "forearm-layered": Meshes(
        truth=lambda spot: true_limb(spot, layers_mm=SKIN),
        fit=lambda spot: layered_limb(spot, SKIN),
        spots=("p2",),
        penalty=12_000.0,
    ),
    "forearm-real": Meshes(
        truth=lambda spot: real_limb(spot, 1.0, 0.5),
        fit=lambda spot: real_limb(spot, 3.0, 0.6),
        spots=("p1", "p2", "p3", "p4"),
        penalty=12_000.0,
    ),
}


def main() -> None:
    """Write the meshes of the study, and the curves of finer ones."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("study", choices=STUDIES)
    parser.add_argument("--into", type=Path, help="folder of meshes and curves; default: the study's folder")
    given, plugins = parser.parse_args(), Plugins.load()
    folder, meshes = Path(plugins.studies[given.study].directory), STUDIES[given.study]
    into = given.into or folder
    for path in (into / "meshes", into / "measured"):
        path.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        truth = Path(name)
        settings = f"settings = {{ {STEPS}, penalty = {meshes.penalty} }}"
        text = (folder / "study.toml").read_text().replace('name = "jax"', f'name = "jax"\n{settings}')
        own = "" if "\n[fit]\n" in text else "\n[fit]\n"
        text = (text + own).replace("\n[fit]\n", '\n[fit]\nfine_edge = "0 mm"\n')
        (truth / "study.toml").write_text(text)
        (truth / "meshes").mkdir()
        for spot in meshes.spots:
            write_limb(into / "meshes" / f"{spot}.vtu", meshes.fit(spot))
            write_limb(truth / "meshes" / f"{spot}.vtu", fine := meshes.truth(spot))
            sys.stdout.write(f"{spot}: {fine.mesh.n_nodes} nodes\n")
        study = read_study(truth, plugins, need_measured=False)
        made = synthesise(study, plugins.channels, noise=NOISE, seed=SEED)
        for file in made.files:
            if file.name != NOTE:
                shutil.copy(file, into / "measured")
    for spot, response in made.responses.items():
        for curve in response.curves.values():
            largest = np.abs(curve.ordinate).max()
            sys.stdout.write(
                f"{spot}: {curve.channel}, {curve.abscissa.size} points, largest {largest:.3g}\n"
            )


if __name__ == "__main__":
    main()
