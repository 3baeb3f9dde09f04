"""Held-out presses of every person, by the statistics of the study of one person on emulated blocks.

    python benchmarks/study_people.py

Each person's presses have the curves and the error budget of ``palpate init --study multis``. Blocks are not
simulated: the emulator gives their force, which bends like the force of a neo-Hookean column as high. A press
is predicted from the person's others, as `palpate validate` does.
"""

import argparse
import sys
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import polars as pl
from bench_coverage import Here

from palpate import Curve, Job, Limb, Response, Settings, Simulation, Solver, Status, read_study
from palpate.api import FloatArray
from palpate.domain import Design, Spot
from palpate.fit.stage import FitStage
from palpate.plugins.catalogue import Plugins
from palpate.plugins.provides import Provides
from palpate.study.reading import Study, StudySpot
from palpate_certainty.assessment import Assessment
from palpate_certainty.held_out import held_out
from palpate_multis import Presses, read_presses
from palpate_multis.emulator import LOWER, UPPER, emulator
from palpate_multis.layered_block import LENGTH_MM
from palpate_multis.person_study import N_POINTS

STEP = 1e-3
"""Relative step of a modulus for slopes."""


class Blocks(Solver[Settings]):
    """Layers under a probe, by the site of the press."""

    name, summary = "blocks", "emulated blocks"
    provides = Provides(body="layers", slopes=True)

    def __init__(self, presses: Presses) -> None:
        super().__init__(Settings())
        self.rows = {site: number for number, site in enumerate(presses.site.tolist())}
        self.presses = presses

    def simulate(self, job: Job, limb: Limb | None) -> Simulation:
        depths = np.linspace(0.0, job.protocol.path[:, 0].max(), 5)
        moduli = {region: float(theta[0]) for region, theta in job.thetas.items()}
        force, slopes = self._force(job.spot, depths, moduli), {"friction": np.zeros(depths.size)}
        for region, material in job.materials.items():
            slopes |= {f"{region}.{p.name}": np.zeros(depths.size) for p in material.parameters}
            ends = [
                self._force(job.spot, depths, moduli | {region: moduli[region] * (1.0 + step)})
                for step in (-STEP, STEP)
            ]
            slopes[f"{region}.E"] = (ends[1] - ends[0]) / (2.0 * STEP * moduli[region])
        curve = Curve(channel="force", abscissa=depths, ordinate=force, slopes=slopes)
        return Simulation(job=job, status=Status.OK, response=Response(curves={"force": curve}), seconds=1e-3)

    def _force(self, site: str, depths: FloatArray, moduli: dict[str, float]) -> FloatArray:
        row = self.rows[site]
        layers, width = self.presses.layers_mm[row], float(self.presses.width_mm[row])
        ratios = [moduli["skin"] / moduli["muscle"], moduli["fat"] / moduli["muscle"]]
        softness = emulator(width)(np.clip([[*layers, *ratios]], LOWER, UPPER))[0][0]
        stretch = 1.0 - np.maximum(depths, 1e-9) / layers.sum()
        bent = (stretch**-2 - stretch) / (3.0 * (1.0 - stretch))
        force: FloatArray = bent * depths * moduli["muscle"] / softness * LENGTH_MM * width
        return force


def predicted(base: Study, presses: Presses) -> pl.DataFrame:
    """Table of the held-out presses of one person, each at a site of its own."""
    spots, measured, rise = [], {}, np.linspace(0.0, 1.0, N_POINTS)
    for row, site in enumerate(presses.site.tolist()):
        area = LENGTH_MM * float(presses.width_mm[row])
        depth = float(presses.force_N[row] * presses.compliance[row] / area)
        protocol = replace(base.spots[0].protocol, path=[(0.0, 0.0), (depth, 0.0)])
        spots.append(StudySpot(spot=Spot(name=site), measured={}, mesh=None, protocol=protocol))
        curve = Curve(channel="force", abscissa=rise * depth, ordinate=rise * presses.force_N[row])
        measured[site] = Response(curves={"force": curve})
    study = replace(base, spots=tuple(spots), solver=Blocks(presses), n_sets=0)
    searched = study.space.parameters
    stage = FitStage(
        study=study,
        design=Design(parameters=searched, values=np.zeros((0, len(searched))), seed=1, n_drawn=0),
        measured=measured,
        scores=pl.DataFrame(),
        simulations=Here(study.solver, {}),
        abscissae={"force": "depth_mm"},
    )
    case, *others = stage.run()
    certainty = Assessment(study=study, measured=measured)
    return held_out(certainty.assess(case, *certainty.columns(case), cases=others))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--people", type=int, default=1000, help="people of the table, from the first on")
    n_people = parser.parse_args().people
    plugins, presses, tables = Plugins.load(), read_presses(), []
    base = read_study(Path(str(files("palpate_multis") / "studies" / "multis" / "study.toml")), plugins)
    is_within = ((presses.layers_mm >= LOWER[:3]) & (presses.layers_mm <= UPPER[:3])).all(axis=1)
    for number in range(min(n_people, presses.n_people)):
        rows = np.flatnonzero((presses.person == number) & is_within)
        if rows.size >= 3:
            tables.append(predicted(base, presses[rows]))
            found = pl.concat(tables)
            inside, difference = (
                int(found["inside"].sum()),
                100.0 * float(found["difference"].median() or 0.0),
            )
            sys.stdout.write(
                f"{len(tables)} people: {inside} of {found.height} presses are inside of their 90 % bands; "
                f"median difference {difference:.1f} % of the peak\n"
            )
            sys.stdout.flush()


if __name__ == "__main__":
    main()
