"""Stated against true error by the mesh: ``python benchmarks/study_stated_mesh.py FOLDER``.

The demo's forearm at its four spots, with five random Yeoh materials of the ranges at each. What a fit
makes of its two meshes, the study's and that refined at the edge of the contact, is compared with curves on
meshes that were made independently (those of ``robot-log``), bisected to 1.3 mm there. Printed are, in
percent, the error of the force's peak and of half the torque's range; that of the whole curve, by norms; one
standard deviation of it as the budget states it; and the ratio of the last two. What is in FOLDER is not
simulated again.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from bench_inadequate import REGION, ready, ready_with_fine, say
from study_mesh_size import peak
from study_prediction import accepted, on_grid

from palpate import Job, Limb, Status
from palpate.fit.mesh_correction import FineRun
from palpate.limb.loading import RIM, load_limbs, refinement
from palpate.mesh.refinement import refined
from palpate.plugins.catalogue import Plugins
from palpate.simulation.sweep import Simulations
from palpate.study.reading import Study
from palpate_certainty.mesh_error import SpotMesh

TRUE_EDGE_MM = 1.3
N_MATERIALS = 5


def limbs_with_truth(study: Study, plugins: Plugins) -> dict[str, Limb]:
    """The study's limbs by spot and ``spot/fine``, and those of the truth by ``spot true``."""
    limbs = load_limbs(study)
    independent = load_limbs(ready_with_fine("robot-log", plugins))
    for name in study.spot_names:
        reach_mm = study.protocol_at(name).reach_mm
        limb = independent[f"{name}/fine"]
        limbs[f"{name} true"] = refined(limb, RIM[1] * reach_mm, TRUE_EDGE_MM, RIM[0] * reach_mm)
    return limbs


def main() -> None:
    """Print a row for each curve, and how often the true error is within twice the stated."""
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    asked.add_argument("folder", type=Path)
    asked.add_argument("--seed", type=int, default=0)
    options = asked.parse_args()
    plugins = Plugins.load()
    parallel = ready_with_fine("forearm-demo", plugins).executor
    study = replace(ready("forearm-demo", plugins), executor=parallel, time_limit_s=3600.0)
    limbs, (region,) = limbs_with_truth(study, plugins), study.space.regions
    rows = accepted(study, N_MATERIALS, np.random.default_rng(options.seed))
    jobs = [
        Job(
            spot=limb,
            set_id=number,
            materials={REGION: region.material},
            thetas={REGION: study.space.thetas(row)[REGION]},
            protocol=study.protocol_at(spot),
        )
        for number, row in enumerate(rows)
        for spot in study.spot_names
        for limb in (spot, f"{spot}/fine", f"{spot} true")
    ]
    with Simulations(study, options.folder, limbs) as simulations:
        simulations.plan(jobs)
        found = simulations.of(jobs)
    for each in found:
        if each.status is not Status.OK:
            say(f"{each.job.spot} {each.job.set_id}: {each.message}")
    say(f"{'spot':>6}{'c1, c2, c3':>28}{'channel':>9}{'peak':>9}{'curve':>9}{'stated':>9}{'ratio':>8}")
    ratios: dict[str, list[float]] = {"force": [], "torque": []}
    for k in range(0, len(found), 3):
        if any(each.status is not Status.OK for each in found[k : k + 3]):
            continue
        coarse, fine, true = (each.response for each in found[k : k + 3])
        spot, row = jobs[k].spot, rows[k // (3 * len(study.spots))]
        mesh = SpotMesh(refinement=refinement(study, limbs)[spot])
        for name, of_channel in ratios.items():
            x = coarse[name].abscissa
            ordinates = [on_grid(each[name], x) for each in (coarse, fine, true)]
            of = study.mesh_convergence(name)
            left_over = {name: mesh.refinement.left_over(of)}
            pair = FineRun(coarse={name: ordinates[0]}, fine={name: ordinates[1]}, left_over=left_over)
            added = pair.corrections[name].added
            corrected, truth = ordinates[0] + added, ordinates[2]
            scatter = of.scatter * np.maximum.accumulate(np.abs(corrected))
            error = np.hypot(mesh.of_extrapolation(of, added), scatter)
            stated = np.linalg.norm(error) / np.linalg.norm(corrected)
            off = np.linalg.norm(corrected - truth) / np.linalg.norm(truth)
            at_peak = peak(name, corrected) / peak(name, truth) - 1.0
            of_channel.append(off / stated)
            values = ", ".join(f"{value:.5f}" for value in row)
            say(
                f"{spot:>6}{values:>28}{name:>9}{100 * at_peak:>+8.2f}%{100 * off:>8.2f}%"
                f"{100 * stated:>8.2f}%{off / stated:>8.2f}"
            )
    for name, of_channel in ratios.items():
        within = sum(each <= 2.0 for each in of_channel)
        say(f"{name}: true within twice the stated in {within} of {len(of_channel)}")


if __name__ == "__main__":
    main()
