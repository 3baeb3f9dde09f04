"""What each stage's files were made from, and their checksums: ``stages.json``.

::

    {"scores": {"made_from": {"normaliser": "4f…", "measured curves": "a0…"},
                "files": {"scores.parquet": "<SHA-256>"}}}

A stage reads the files of earlier stages only as they were written, and only where they were made from
what the study has now.
"""

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import polars as pl

from palpate.domain import RegionMaterial, weighed_phases
from palpate.errors import StudyError
from palpate.executors.answers import plain
from palpate.plugins.interfaces import Component
from palpate.run.atomic_files import write_atomically
from palpate.run.keys import identity
from palpate.study.reading import Study

COMMANDS = MappingProxyType(
    {
        "measured": "experiment",
        "design": "sample",
        "scores": "score",
        "selection": "select",
        "verification": "select",
        "fit": "fit",
        "posterior": "certainty",
        "surface": "surface",
    }
)
"""The command that makes the files of a stage."""

_T = TypeVar("_T")


class StageRecords:
    """Records of the stages of one run directory."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.path = folder / "stages.json"

    def write(self, stage: str, files: Iterable[Path], made_from: Mapping[str, str]) -> None:
        """Record the files of a stage, as they are now, and what they were made from."""
        sums = {path.relative_to(self.folder).as_posix(): _sha256(path.read_bytes()) for path in files}
        every = self._read() | {stage: {"made_from": dict(made_from), "files": sums}}
        write_atomically(self.path, json.dumps(every, indent=1).encode() + b"\n")

    def holds(self, stage: str, path: Path) -> bool:
        """Whether a file is one that a stage wrote last."""
        return self._name(path) in self._files(stage)

    def read(self, stage: str, path: Path, parse: Callable[[bytes], _T]) -> _T:
        """Read a file of a stage; a StudyError where it is missing, or not as the stage wrote it."""
        again = f"run `palpate {COMMANDS[stage]}` again"
        if not path.exists():
            raise StudyError(f"{path}: not there yet; run `palpate {COMMANDS[stage]}` first")
        try:
            content = path.read_bytes()
            if self._files(stage).get(self._name(path)) != _sha256(content):
                raise StudyError(f"{path}: damaged or replaced, it is not as {self.path} records it; {again}")
            return parse(content)
        except StudyError:
            raise
        except (OSError, ValueError, TypeError, KeyError, RecursionError, pl.exceptions.PolarsError) as error:
            raise StudyError(f"{path}: cannot be read ({error}); {again}") from error

    def check(self, stage: str, made_from: Mapping[str, str]) -> None:
        """Refuse the files of a stage that were made from something else; an empty value is not compared."""
        recorded = self._entry(stage).get("made_from", {})
        other = [name for name, value in made_from.items() if value and recorded.get(name) != value]
        other += [name for name in recorded if name not in made_from]
        if other:
            raise StudyError(
                f"{self.folder}: its {_NOUNS[stage]} made from other {', '.join(other)} than the study has "
                f"now; run `palpate {COMMANDS[stage]}` and the stages after it again"
            )

    def is_made_from(self, stage: str, made_from: Mapping[str, str]) -> bool:
        """Whether the files of a stage were made from these."""
        return bool(self._entry(stage).get("made_from") == dict(made_from))

    def fingerprint(self, stage: str) -> str:
        """Hash of the files that a stage wrote."""
        return fingerprint(self._files(stage))

    def _files(self, stage: str) -> dict[str, Any]:
        return _table(self._entry(stage).get("files"))

    def _entry(self, stage: str) -> dict[str, Any]:
        return _table(self._read().get(stage))

    def _read(self) -> dict[str, Any]:
        """Every record; none where the file is damaged, so that each stage has to be run again."""
        try:
            return _table(json.loads(self.path.read_bytes()))
        except (OSError, ValueError, RecursionError):
            return {}

    def _name(self, path: Path) -> str:
        return path.relative_to(self.folder).as_posix()


def _table(content: Any) -> dict[str, Any]:  # noqa: ANN401 - whatever the file holds
    return content if isinstance(content, dict) else {}


_NOUNS = MappingProxyType(
    {
        "measured": "measured curves were",
        "design": "design was",
        "scores": "scores were",
        "selection": "selection was",
        "fit": "fit was",
    }
)


# ------------------------------------------------------ what decides each stage


def measured_from(study: Study) -> dict[str, str]:
    """What decides the measured curves; no value for files that are not there any more."""
    found = {}
    for spot in study.spots:
        files = {
            channel or "": [_sha256(path.read_bytes()) if path.is_file() else "" for path in paths]
            for channel, paths in spot.measured.items()
        }
        is_whole = all(each for sums in files.values() for each in sums)
        found[f"files of spot '{spot.spot.name}'"] = fingerprint(files) if is_whole else ""
        found[f"loader of spot '{spot.spot.name}'"] = fingerprint(_described(study.loader_at(spot.spot.name)))
    return found


def design_from(study: Study) -> dict[str, str]:
    """What decides the first ``n_sets`` sets of the design."""
    regions = study.space.regions
    return {
        "ranges": fingerprint(
            [asdict(replace(p, prior=None, by_spot=False)) for p in study.space.parameters]
        ),
        "materials": fingerprint(
            [(r.region, _described(r.material, study), r.convention, _not_searched(r)) for r in regions]
        ),
        "sampler": fingerprint(_described(study.sampler)),
        "filters": fingerprint([_described(keep) for keep in study.filters]),
        "n_sets, max_draws or seed": fingerprint([study.n_sets, study.max_draws, study.seed]),
    }


def _not_searched(region: RegionMaterial) -> dict[str, object]:
    return {**region.fixed, **{name: tie.plain for name, tie in region.tied.items()}}


def scores_from(study: Study, records: StageRecords, simulations: str) -> dict[str, str]:
    """What decides the scores; ``simulations`` is their own fingerprint."""
    rules = study.scoring
    return {
        "measured curves": records.fingerprint("measured"),
        "design": records.fingerprint("design"),
        "simulations": simulations,
        "normaliser": fingerprint(rules.normaliser.value),
        "point weighting": fingerprint(rules.point_weighting.value),
        "coverage or partial": fingerprint([rules.minimum_coverage, rules.rank_partial]),
        "phases": fingerprint(weighed_phases(study.scenarios)),
    }


def selection_from(study: Study, records: StageRecords) -> dict[str, str]:
    """What decides the selection, and what follows from it."""
    scenarios = {scenario.name: dict(scenario.weights) for scenario in study.scenarios}
    return {
        "scores": records.fingerprint("scores"),
        "scenarios": fingerprint(scenarios),
        "generalise_by or stiffness_scaling": fingerprint([study.generalise_by, study.stiffness_scaling]),
    }


def fit_from(study: Study, records: StageRecords) -> dict[str, str]:
    """What decides the fit besides its simulations."""
    return {
        "selection": records.fingerprint("selection"),
        "search": fingerprint(_described(study.search)),
        "parametrisation": fingerprint(_described(study.parametrisation)),
        "priors or values by spot": fingerprint([asdict(p) for p in study.space.parameters]),
        "noise, fine_runs or fine_edge": fingerprint(
            [study.noise, study.fine_runs, [spot.fine_edge_mm for spot in study.spots]]
        ),
        "budget": fingerprint(study.budget.model_dump(mode="json")),
    }


def fingerprint(value: object) -> str:
    """Short hash of plain values."""
    return hashlib.sha256(json.dumps(plain(value), sort_keys=True).encode()).hexdigest()[:16]


def _described(component: Component, study: Study | None = None) -> tuple[str, object, str]:
    """Name, settings and code; of a material whose earlier results the study accepts, the earlier code."""
    earlier = study.trusted.get(f"material:{component.name}") if study else None
    return component.name, component.settings.model_dump(mode="json"), earlier or identity(component)


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
