"""The paper's study, end to end: three materials, four spots, one design for all spots.

The folder of a reproduction holds what it needs and what it found::

    study/measured/  study/meshes/  study/<material>.toml     the three studies
    <material>/                                               a run directory each
    tables/*.csv  comparison.md                               the paper's figures beside these

so that it moves freely, any of the studies can be changed, and a run that was stopped goes on.
"""

import math
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from string import Template
from types import MappingProxyType
from typing import Any

import numpy as np

from palpate import pipeline, simulation
from palpate.domain import Design
from palpate.errors import StudyError
from palpate.plugins import Plugins
from palpate.progress import SILENT, Progress
from palpate.study import Study, read_study

PAPER_SETS = 250
"""Sets that the paper draws for each material."""

FEWEST_SETS = 8
"""Fewest sets that a size is proposed for."""

PHANTOMS = MappingProxyType({"coarse": "forearm-demo", "fine": "forearm"})
"""Ready study whose curves and meshes are taken: 1,500 or 3,600 nodes a spot."""

REGIONS: Mapping[str, str] = MappingProxyType(
    {
        "ogden": """
[region.soft_tissue]
material = "ogden"

[region.soft_tissue.parameters]
c1 = { lower = "0.03 MPa", upper = "0.2 MPa" }
m1 = { lower = 1.0, upper = 8.0 }
kappa = { lower = "0.25 MPa", upper = "2.5 MPa" }
""",
        "yeoh": """
[region.soft_tissue]
material = "yeoh"
# The paper's coefficients are those of FEBio 4, which takes 2 c2 and 3 c3 of the textbook for c2 and c3.
convention = "febio4"

[region.soft_tissue.parameters]
c1 = { lower = "1.4e-3 MPa", upper = "3e-2 MPa" }
# Printed in the other order in the paper.
c2 = { lower = "-3e-3 MPa", upper = "-4.14e-5 MPa" }
c3 = { lower = "3e-6 MPa", upper = "3e-4 MPa" }
# The paper gives no range for the bulk modulus of this material.
kappa = "0.8 MPa"

[sampling.filters.drucker]

# What the curves were made with; its c3 lies just above the paper's range.
[truth.soft_tissue]
c1 = "1.41e-2 MPa"
c2 = "-2.2e-3 MPa"
c3 = "3.15e-4 MPa"
""",
        "neo_hookean": """
[region.soft_tissue]
material = "neo_hookean"

[region.soft_tissue.parameters]
E = { lower = "1e-3 MPa", upper = "1 MPa" }
nu = { lower = 0.40, upper = 0.49 }
""",
    }
)
"""What the paper's three studies differ in, in its order."""

SPOTS = ("p1", "p2", "p3", "p4")

STUDY = """# The paper's study with the $material material, on a forearm phantom.
#
# The experiment is SIMULATED, with another solver than palpate's; the limb and the sensor of the
# paper are not published.

[study]
name = "reproduce-$material"
description = "The paper's study of the $material material on a simulated phantom"
data = "simulated"
$spots
[experiment]
loader = "csv"

[limb]
source = "meshio"

[protocol]
indenter = { shape = "sphere", radius = "7.5 mm" }
depth = "10 mm"
twist = ["-22.5 deg", "22.5 deg", "0 deg"]
friction = 1.0

[sampling]
n_sets = $n_sets
seed = 1

[solver]
name = "jax"
time_limit = "30 min"

[selection]
scenarios = ["I", "II", "III"]
generalise_by = "I"
$region"""


def study_text(material: str, n_sets: int) -> str:
    """Text of the study file of one of the paper's materials."""
    spots = "".join(
        f'\n[[spot]]\nname = "{name}"\nmeasured = "measured/{name}.csv"\nmesh = "meshes/{name}.vtu"\n'
        for name in SPOTS
    )
    return Template(STUDY).substitute(material=material, n_sets=n_sets, spots=spots, region=REGIONS[material])


@dataclass(frozen=True, slots=True, kw_only=True)
class Reproduction:
    """The paper's study in a folder.

    Parameters
    ----------
    folder : Path
    studies : mapping of material name to Study
    """

    folder: Path
    studies: Mapping[str, Study]

    def run_folder(self, material: str) -> Path:
        """Run directory of a material."""
        return self.folder / material

    def extended(self, n_sets: int) -> "Reproduction":
        """Draw this many sets of each material, beginning with those it has.

        Raises
        ------
        StudyError
            It has more already.
        """
        for material, study in self.studies.items():
            if n_sets < study.n_sets:
                raise StudyError(
                    f"{study.file}: has {study.n_sets} sets already, which cannot become {n_sets}; ask for "
                    f"{study.n_sets} or more sets of '{material}', or name another folder"
                )
        grown = {name: replace(study, n_total=n_sets) for name, study in self.studies.items()}
        return replace(self, studies=grown)


def prepare(
    folder: Path, plugins: Plugins, materials: Sequence[str], n_sets: int, phantom: str = "coarse"
) -> Reproduction:
    """Write the studies that are not in the folder yet, and read them.

    Parameters
    ----------
    folder : Path
        New, empty, or that of an earlier reproduction, whose studies stay as they are.
    plugins : Plugins
    materials : sequence of str
        Of "ogden", "yeoh", "neo_hookean".
    n_sets : int
        Sets to draw of each material, written into new study files.
    phantom : {"coarse", "fine"}

    Raises
    ------
    StudyError
        Another material or phantom, the folder holds something else, or cannot be written.
    """
    unknown = [name for name in materials if name not in REGIONS]
    if unknown:
        raise StudyError(f"material '{unknown[0]}' is not in the paper; it has {', '.join(REGIONS)}")
    within = folder / "study"
    if folder.exists() and not within.is_dir() and (folder.is_file() or any(folder.iterdir())):
        raise StudyError(f"{folder}: holds no reproduction; name a new or an empty folder")
    try:
        _copy_data(within, phantom)
        for material in materials:
            file = within / f"{material}.toml"
            if not file.exists():
                file.write_text(study_text(material, n_sets), encoding="utf-8")
    except OSError as error:
        raise StudyError(f"{folder}: cannot be written ({error}); name another folder") from error
    studies = {name: read_study(within / f"{name}.toml", plugins) for name in materials}
    return Reproduction(folder=folder, studies=studies)


def _copy_data(within: Path, phantom: str) -> None:
    """Copy curves and meshes once; a folder that has those of the other phantom is refused."""
    marker = within / "phantom.txt"
    if marker.exists():
        if (found := marker.read_text(encoding="utf-8").strip()) != phantom:
            raise StudyError(f"{within.parent}: was begun on the {found} phantom; name another folder")
        return
    source = Path(str(files("palpate_forearm") / "studies" / PHANTOMS[phantom]))
    for part in ("measured", "meshes"):
        shutil.copytree(source / part, within / part, dirs_exist_ok=True)
    marker.write_text(f"{phantom}\n", encoding="utf-8")  # last: it says that the copy is whole


# ------------------------------------------------------------------- how long


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """What a material's sweep takes.

    Parameters
    ----------
    n_drawn, n_kept : int
        Sets before and after the filters.
    n_spots : int
    seconds_each : float
        Of one simulation on one worker.
    """

    n_drawn: int
    n_kept: int
    n_spots: int
    seconds_each: float

    @property
    def n_simulations(self) -> int:
        """Simulations of the sweep."""
        return self.n_kept * self.n_spots

    def seconds(self, n_workers: int) -> float:
        """Time of the sweep on this many workers."""
        return self.n_simulations * self.seconds_each / n_workers


def cost(study: Study, plugins: Plugins, n_timed: int = 2) -> Cost:
    """Time a few simulations of a study, after one that warms the solver up.

    The sets that are timed are the first of the design at its first spot, in this process.
    """
    checked = pipeline.check(study, plugins)
    to_do = simulation.jobs(study, checked.design, checked.measured)[: n_timed + 1]
    spot = to_do[0].spot
    timed = [study.solver.simulate(job, checked.limbs.get(spot)).seconds for job in to_do if job.spot == spot]
    seconds = float(np.mean(timed[1:] or timed))
    return cost_of(checked.design, len(study.spots), seconds)


def cost_of(design: Design, n_spots: int, seconds_each: float) -> Cost:
    """Cost of a design of which one simulation takes ``seconds_each``."""
    return Cost(n_drawn=design.n_drawn, n_kept=design.n_sets, n_spots=n_spots, seconds_each=seconds_each)


def sets_within(minutes: float, costs: Iterable[Cost], n_workers: int) -> int:
    """Sets of each material that fit into a time, at least 8 and at most the paper's 250."""
    per_set = sum(cost.seconds(n_workers) / cost.n_drawn for cost in costs)
    return max(FEWEST_SETS, min(PAPER_SETS, math.floor(60.0 * minutes / per_set)))


# ------------------------------------------------------------------------ run


def run(
    reproduction: Reproduction,
    plugins: Plugins,
    progress: Progress = SILENT,
    *,
    announce: Callable[[str], Any] = lambda material: None,
) -> dict[str, pipeline.RunResult]:
    """Run each material's study; simulations that are finished are kept.

    Raises
    ------
    PalpateError
    """
    found = {}
    for material, study in reproduction.studies.items():
        announce(material)
        found[material] = pipeline.run_study(study, reproduction.run_folder(material), plugins, progress)
    return found
