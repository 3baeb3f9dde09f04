"""The paper's study, end to end: three materials, four spots, one design for all spots.

The folder of a reproduction holds what it needs and what it found::

    study/measured/  study/meshes/  study/<material>.toml     the three studies
    study/phantom.txt                                         coarse or fine
    <material>/                                               a run directory each
    tables/*.csv  comparison.md                               the paper's figures and these

so that it moves freely, any of the studies can be changed, and a run that was stopped goes on.
"""

import shlex
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from string import Template
from types import MappingProxyType
from typing import Any

from palpate.api import SILENT, Progress, StudyError
from palpate.api.executors import StoppedError
from palpate.api.runs import (
    NothingSelectableError,
    Plugins,
    RunDirectory,
    RunResult,
    Study,
    read_study,
    run_study,
)

COMMAND = str(Path(__file__).parents[1] / "reproduce.py")
"""One-file plugin that has the command."""

PAPER_SETS = 250
"""Sets that the paper draws for each material."""

_PARTIAL = ".study"
"""Folder that becomes ``study/`` once it is whole."""

PHANTOMS = MappingProxyType({"coarse": "forearm-demo", "fine": "forearm"})
"""Ready study whose curves and meshes are taken: 1,500 or 3,600 nodes a spot."""

REGIONS = ("ogden", "yeoh", "neo_hookean")
"""Materials of the paper's three studies, in its order; ``printed/<material>.toml`` is what differs."""


def study_text(material: str, n_sets: int) -> str:
    """Text of the study file of one of the paper's materials."""
    paper = files("papers_study") / "printed"
    template = Template((paper / "study.toml.template").read_text(encoding="utf-8"))
    region = (paper / f"{material}.toml").read_text(encoding="utf-8")
    return template.substitute(material=material, n_sets=n_sets, region=region.strip())


@dataclass(frozen=True, slots=True, kw_only=True)
class Reproduction:
    """The paper's study in a folder."""

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
        New, empty, or the folder of an earlier reproduction, whose studies stay as they are.
    materials : sequence of str
        Of "ogden", "yeoh", "neo_hookean".
    n_sets : int
        Sets to draw of each material, written into new study files.

    Raises
    ------
    StudyError
        Another material or phantom, the folder holds something else, or cannot be written.
    """
    _refuse(folder, materials, phantom)
    within = folder / "study"
    try:
        _copy_data(within, phantom)
        for material in materials:
            file = within / f"{material}.toml"
            if not file.exists():
                file.write_text(study_text(material, n_sets), encoding="utf-8")
    except OSError as error:
        raise StudyError(f"{folder}: cannot be written ({error.strerror}); name another folder") from error
    studies = {name: read_study(within / f"{name}.toml", plugins) for name in materials}
    return Reproduction(folder=folder, studies=studies)


def _refuse(folder: Path, materials: Sequence[str], phantom: str) -> None:
    """Raise where :func:`prepare` could not begin or go on, before anything is written."""
    unknown = [name for name in materials if name not in REGIONS]
    if unknown:
        raise StudyError(f"material '{unknown[0]}' is not in the paper; it has {', '.join(REGIONS)}")
    existing = _phantom_of(folder)
    if existing is None:
        if folder.is_file() or (folder.is_dir() and {each.name for each in folder.iterdir()} - {_PARTIAL}):
            raise StudyError(f"{folder}: holds no reproduction; name a new or an empty folder")
    elif existing != phantom:
        flag = "leave out --fine" if phantom == "fine" else "add --fine"
        raise StudyError(f"{folder}: was made with the {existing} phantom; {flag}, or name another folder")


def sets_of(folder: Path, materials: Sequence[str], plugins: Plugins) -> int:
    """Most sets that the reproduction in a folder has of one of these materials; 0 before there is one.

    Raises
    ------
    StudyError
        A study in the folder cannot be read.
    """
    most = 0
    for material in materials:
        file, run_folder = folder / "study" / f"{material}.toml", RunDirectory(folder / material)
        if file.exists():
            most = max(most, read_study(file, plugins).n_sets)
        if run_folder.exists:
            most = max(most, run_folder.manifest()["n_total"])
    return most


def _phantom_of(folder: Path) -> str | None:
    marker = folder / "study" / "phantom.txt"
    return marker.read_text(encoding="utf-8").strip() if marker.is_file() else None


def _copy_data(within: Path, phantom: str) -> None:
    """Copy curves and meshes once, whole or not at all."""
    if within.exists():
        return
    source = Path(str(files("palpate_forearm") / "studies" / PHANTOMS[phantom]))
    partial = within.with_name(_PARTIAL)
    for part in ("measured", "meshes"):
        shutil.copytree(source / part, partial / part, dirs_exist_ok=True)
    (partial / "phantom.txt").write_text(f"{phantom}\n", encoding="utf-8")
    partial.rename(within)


# ------------------------------------------------------------------------ run


@dataclass(frozen=True, slots=True, kw_only=True)
class ReproductionResult:
    """Results of each material.

    Parameters
    ----------
    failed : mapping of material name to str
        Why nothing could be selected.
    """

    results: Mapping[str, RunResult]
    failed: Mapping[str, str]


def run(
    reproduction: Reproduction,
    plugins: Plugins,
    progress: Progress = SILENT,
    *,
    announce: Callable[[str], Any] = lambda text: None,
) -> ReproductionResult:
    """Run each material's study; simulations that are finished are kept.

    Parameters
    ----------
    announce : callable
        Called with the material that is next, and with each that failed.

    Raises
    ------
    NothingSelectableError
        Every simulation of every material failed; one material alone does not stop the others.
    StoppedError
        The user asked to stop.
    PalpateError
        Something in a study or the folder is wrong.
    """
    results, failed = {}, {}
    for material, study in reproduction.studies.items():
        announce(f"{material} …")
        try:
            results[material] = run_study(study, reproduction.run_folder(material), plugins, progress)
        except NothingSelectableError as error:
            failed[material] = str(error)
            announce(f"{material}: {error}")
        except StoppedError as error:
            raise StoppedError(
                f"stopped in {material}; simulations are kept, and `palpate --plugin {shlex.quote(COMMAND)} "
                f"reproduce {shlex.quote(str(reproduction.folder))}` goes on"
            ) from error
    if not results:
        raise NothingSelectableError("; ".join(f"{name}: {why}" for name, why in failed.items()))
    return ReproductionResult(results=results, failed=failed)
