"""The mesh and the curves of the study ``forearm-fibres``: ``make_fibre_curves.py``.

The mesh is that of ``forearm-demo`` with the direction of the phantom's axis in each element. The tissue
under ``[truth]`` is simulated on a mesh that is finer and made independently of it, by half its steps; each
point of the curves has noise. Both replace those of the study. About 6 cpu-minutes.
"""

import argparse
import shutil
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from independent_meshes import true_limb

from palpate import Limb, Plugins
from palpate.domain import FloatArray
from palpate.limb.loading import load_limbs
from palpate.simulation.synthesis import synthesise
from palpate.study.reading import read_study
from palpate_forearm import Phantom
from palpate_limb.limb_files import write_limb

NAME = "forearm-fibres"
NOISE, SEED = 0.005, 1
"""Standard deviation of each point, of the curve's largest value."""
STEPS = "settings = { depth_steps = 20, rotation_step_deg = 2.25 }"


def axis_at(spot: str) -> FloatArray:
    """Unit vector of the phantom's axis in the frame of a spot, whose x is along the limb."""
    (normal,) = (each.normal for each in Phantom().spots if each.name == spot)
    rise = float(np.asarray(normal)[0])
    return np.array([np.sqrt(1.0 - rise**2), 0.0, rise])


def with_axis(limb: Limb, spot: str) -> Limb:
    """The limb with the direction of its axis in each element."""
    axis = {kind: np.tile(axis_at(spot), (len(cells), 1)) for kind, cells in limb.mesh.cells.items()}
    return replace(limb, mesh=replace(limb.mesh, cell_fields={"axis": axis}))


def main() -> None:
    """Write the mesh of the study, and the curves of a finer one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--into", type=Path, help="folder of mesh and curves; default: that of the study")
    plugins = Plugins.load()
    folder = Path(plugins.studies[NAME].directory)
    into = parser.parse_args().into or folder
    coarse = load_limbs(read_study(Path(plugins.studies["forearm-demo"].directory), plugins))["p1"]
    for path in (into / "meshes", into / "measured"):
        path.mkdir(parents=True, exist_ok=True)
    write_limb(into / "meshes" / "p1.vtu", with_axis(coarse, "p1"))
    with tempfile.TemporaryDirectory() as name:
        truth = Path(name)
        text = (folder / "study.toml").read_text().replace('name = "jax"', f'name = "jax"\n{STEPS}')
        (truth / "study.toml").write_text(text + '\n[fit]\nfine_edge = "0 mm"\n')
        (truth / "meshes").mkdir()
        write_limb(truth / "meshes" / "p1.vtu", with_axis(fine := true_limb("p1"), "p1"))
        study = read_study(truth, plugins, need_measured=False)
        made = synthesise(study, plugins.channels, noise=NOISE, seed=SEED)
        for file in made.files:
            if file.suffix == ".csv":
                shutil.copy(file, into / "measured")
        sys.stdout.write(f"{fine.mesh.n_nodes} nodes\n")
    for spot, response in made.responses.items():
        for curve in response.curves.values():
            largest = np.abs(curve.ordinate).max()
            sys.stdout.write(
                f"{spot}: {curve.channel}, {curve.abscissa.size} points, largest {largest:.3g}\n"
            )


if __name__ == "__main__":
    main()
