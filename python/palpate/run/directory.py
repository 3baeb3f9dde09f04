"""A run on disk, with everything that its numbers depended on.

::

    study.toml              as run
    inputs/                 the study and the files that it names, so that the folder can be moved
    manifest.json           versions, hashes of the inputs, units, normaliser, conventions, seed
    measured/<spot>.parquet  measured/<spot>.json  measured/plots/<spot>/  measured/curves.html
    design.parquet  design.json
    ledger.sqlite           simulations: states, attempts, timings, reasons, curves, states of the skin
    TABLE.parquet           tables that the stages declare
    fit.json                how far the fit is, while it goes on
    first_answer/           tables of the first fit, until the whole fit has ended
    processor_time.json     processor time of all commands, by stage and work
    next.json               which presses to make next
    stages.json             checksums of these files, and what each stage was made from
    report/

Files are written whole or not at all, and the folder moves freely.
"""

import contextlib
import io
import json
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import polars as pl

from palpate.domain import Channel, Design, Parameter, Relaxation, Response
from palpate.errors import StudyError, typed
from palpate.executors.answers import plain
from palpate.run.atomic_files import write_atomically
from palpate.run.fit_state import remove_fit_state
from palpate.run.kept_inputs import is_kept, keep_inputs, kept_plugin
from palpate.run.lock import locked
from palpate.run.manifest import (
    IN_KEYS,
    checked_manifest,
    fingerprints,
    finite,
    infinite,
    manifest,
    recorded,
    with_trusted_code,
)
from palpate.run.ownership import check_claimable, claim, refuse_other, tidy, writing_in
from palpate.run.provenance import StageRecords
from palpate.run.result import FitResult
from palpate.run.result_files import Files, frame_of, parquet, response_of, responses_of
from palpate.run.tables import ASSESSED, DECLARED, OF_A_FIT
from palpate.study.reading import Study

RESULT = "result.json"
"""File in the folder of the report with the lines that a run ended with, by their label."""

RELAXATIONS = "relaxations"
"""Key of what relaxed, in the record of measured curves."""


class RunDirectory:
    """The files of one run; the folder is made on the first write."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.records = StageRecords(folder)

    @property
    def report(self) -> Path:
        """Folder of tables, figures and the page."""
        return self.folder / "report"

    def result(self) -> dict[str, str]:
        """Lines that the run ended with, by label, with the place of its page; empty before its end."""
        try:
            lines = json.loads((self.report / RESULT).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        if not isinstance(lines, dict):
            return {}
        page = self.report / "index.html"
        return lines | ({"Page": page.resolve().as_uri()} if page.is_file() else {})

    # ------------------------------------------------------------------ beginning

    def initialise(
        self,
        study: Study,
        channels: Mapping[str, Channel],
        *,
        simulating: bool = False,
        fit_start: Mapping[str, float] | None = None,
    ) -> None:
        """Write ``manifest.json`` and the study as run.

        Unless ``simulating``, simulations of earlier code stay on record as such; otherwise the lines that
        the run ended with before are removed. Where the fit starts stays as it was unless ``fit_start`` is
        given.
        """
        before = self.manifest() if self.exists else {}
        now, earlier = fingerprints(study), before.get("fingerprints", {})
        plugins = before.get("plugin_files", ())
        remove_fit_state(self.folder)
        if simulating:
            (self.report / RESULT).unlink(missing_ok=True)
        else:
            now |= {name: earlier[name] for name in now if name.startswith(IN_KEYS) and name in earlier}
        content = manifest(study, channels) | {
            "measured": self._records(study),
            "study_file": self._origin(study.file, [before.get("study_file", "")]),
            "kept_study": keep_inputs(self.folder, study),
            "plugin_files": [self._origin(file, plugins) for file in study.plugin_files],
            "fingerprints": now,
            "trusted": recorded(study, before),
            "fit_start": dict(fit_start or before.get("fit_start", {})),
        }
        text = _json(content)
        as_run = self.folder / "study.toml"
        if study.file.is_file() and study.file.resolve() != as_run.resolve():
            write_atomically(as_run, study.file.read_bytes())
        write_atomically(self.folder / "manifest.json", text)

    @property
    def fit_start(self) -> Mapping[str, float]:
        """Values by name where the fit starts besides its other starts; empty unless a run was extended."""
        return dict(self.manifest().get("fit_start", {}))

    def with_trusted_code(self, study: Study, names: Collection[str] = ()) -> Study:
        """The study with the results of earlier code that this run accepts, or that ``names`` lists."""
        return with_trusted_code(study, self.manifest() if self.exists else {}, names)

    @contextlib.contextmanager
    def locked(
        self, study: Study, channels: Mapping[str, Channel], *, adopt: bool = False
    ) -> Iterator[Callable[[], None]]:
        """Keep every other process out of the folder; yields what raises where the lock is lost.

        With ``adopt`` the run of another study file may be continued with this one.

        Raises
        ------
        StudyError
            The folder cannot be made, is not a run directory, or belongs to another study file.
        LedgerError
            Another process is at work in the folder, or it cannot be written.
        """
        manifest(study, channels)  # what cannot be described is refused before there is a folder
        with writing_in(self.folder):
            self.refuse_other(study, adopt=adopt)
            claim(self.folder)
            with locked(self.folder) as check:
                tidy(self.folder)
                yield check

    def refuse_other(self, study: Study, *, adopt: bool) -> None:
        """Refuse a folder with something else, or the run of another study file that is still there."""
        check_claimable(self.folder)
        if not adopt and self.exists and not is_kept(self.folder, study.file):
            refuse_other(self.folder, self.folder / self.manifest()["study_file"], study.file, study.name)

    def _origin(self, file: Path, before: Iterable[str]) -> str:
        """Path of a file, or of the original of a kept copy, from this folder, with which it may move."""
        if not is_kept(self.folder, file):
            return _from(self.folder, file)
        for number, place in enumerate(before):
            if file.resolve() == kept_plugin(self.folder, number, Path(place)).resolve():
                return place
        originals = {Path(place).name: place for place in before}
        return originals.get(file.name) or _from(self.folder, file)

    @property
    def exists(self) -> bool:
        """Whether a study was run here, or began to be."""
        return (self.folder / "manifest.json").exists()

    def manifest(self) -> dict[str, Any]:
        """Content of ``manifest.json``."""
        path = self.folder / "manifest.json"
        if not self.folder.is_dir():
            raise StudyError(f"{self.folder}: no such folder; name a run directory")
        if not path.exists():
            raise StudyError(f"{path}: not there yet; run `palpate run` first")
        try:
            return checked_manifest(path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise StudyError(
                f"{path}: damaged ({error}); restore a copy, or delete it: "
                f"`palpate run STUDY --out {typed(self.folder)}` writes it again and keeps the simulations"
            ) from error

    # ------------------------------------------------------------------ the stages

    def write_stage(self, stage: str, files: Files, made_from: Mapping[str, str]) -> None:
        """Write and record what a stage has found; a table without columns is removed."""
        written = []
        for name, content in files.items():
            path = self.folder / (name if "." in name else f"{name}.parquet")
            match content:
                case pl.DataFrame() if not content.width:
                    path.unlink(missing_ok=True)
                    continue
                case _:
                    path.parent.mkdir(parents=True, exist_ok=True)
                    data = parquet(content) if isinstance(content, pl.DataFrame) else _json(content)
                    write_atomically(path, data)
            written.append(path)
        before = self.records.fingerprint(stage)
        self.records.write(stage, written, made_from)
        if stage == "experiment" and self.records.fingerprint(stage) != before:
            self.curves_page.unlink(missing_ok=True)  # it shows other curves

    def table(self, name: str, stage: str = "") -> pl.DataFrame:
        """Table of any stage; empty where there is none, unless ``stage`` names one that must have made it.

        A StudyError where it is damaged, or missing and must be there.
        """
        path = self.folder / f"{name}.parquet"
        if not (stage or (stage := self.records.writer(path))):
            return pl.DataFrame()
        return self.records.read(stage, path, _parquet)

    def measured(self, spots: tuple[str, ...]) -> dict[str, Response]:
        """Measured responses of these spots."""
        found = {}
        for spot in spots:
            curves, record = (
                self.records.read(
                    "experiment", self._measured(spot), lambda content: response_of(_parquet(content))
                ),
                self._recorded(spot),
            )
            relaxations = [Relaxation(**item) for item in record.pop(RELAXATIONS, [])]
            found[spot] = replace(curves, relaxations=relaxations, record=record)
        return found

    def plots(self, spot: str) -> Path:
        """Folder of the pictures of a spot's presses."""
        return self.folder / "measured" / "plots" / file_name(spot)

    @property
    def curves_page(self) -> Path:
        """Page of all measured curves."""
        return self.folder / "measured" / "curves.html"

    def design(self) -> Design:
        """Read the design with its parameters."""
        frame = self.table("design", "sample")
        return self.records.read(
            "sample", self.folder / "design.json", lambda content: _design(frame, json.loads(content))
        )

    def write_measured_to_manifest(self, study: Study) -> None:
        """Repeat in ``manifest.json`` how the measured curves came about."""
        content = self.manifest() | {"measured": self._records(study)}
        write_atomically(self.folder / "manifest.json", _json(content))

    def write_proposal(self, proposal: Mapping[str, Any]) -> None:
        """Write ``next.json``: which presses to make next."""
        write_atomically(self.folder / "next.json", _json(proposal))

    def proposal(self) -> dict[str, Any]:
        """Read ``next.json``; a StudyError where it is missing or damaged."""
        path = self.folder / "next.json"
        try:
            found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise StudyError(f"{path}: {error}; run `palpate next {typed(self.folder)}` first") from None
        return found

    def fit(self, *, is_first: bool = False) -> FitResult:
        """Read the fit, or the first answer, with its known intervals; empty where there is none."""
        declared = {**DECLARED["fit"], **{name: ASSESSED[name] for name in OF_A_FIT}}
        folder = "first_answer/" if is_first else ""
        found = {name: self.table(f"{folder}{name}") for name in declared}
        found = {name: frame if frame.width else declared[name].empty() for name, frame in found.items()}
        return FitResult(
            table=found["fit"],
            trace=found["fit_trace"],
            mesh=found["fit_mesh"],
            responses=responses_of(found["fit_curves"]),
            intervals=found["intervals"],
            adequacy=found["adequacy"],
            reported=found["reported"],
            reported_curves=found["reported_curves"],
        )

    # ----------------------------------------------------------------------- files

    def _measured(self, spot: str) -> Path:
        return self.folder / "measured" / f"{file_name(spot)}.parquet"

    def _recorded(self, spot: str) -> dict[str, Any]:
        """Processing of the curves of a spot."""
        file = self._measured(spot).with_suffix(".json")
        return self.records.read("experiment", file, json.loads)

    def _records(self, study: Study) -> dict[str, Any]:
        """Processing of the curves of each spot, as far as it is known."""
        known = {}
        for spot in study.spots:
            with contextlib.suppress(StudyError):
                known[spot.spot.name] = self._recorded(spot.spot.name)
        return known


def _parquet(content: bytes) -> pl.DataFrame:
    return pl.read_parquet(io.BytesIO(content))


def measured_files(measured: Mapping[str, Response]) -> Files:
    """Files of measured curves by spot: the points, how they came about, and what relaxed meanwhile."""
    files: dict[str, pl.DataFrame | Mapping[str, Any]] = {}
    for spot, response in measured.items():
        relaxed = [asdict(item) for item in response.relaxations]
        files[f"measured/{file_name(spot)}"] = frame_of(response)
        files[f"measured/{file_name(spot)}.json"] = {
            **plain(response.record),
            **({RELAXATIONS: relaxed} if relaxed else {}),
        }
    return files


def design_files(design: Design) -> Files:
    """Files of a design: set_id and a column per parameter, and how it was drawn."""
    about = {
        "seed": design.seed,
        "n_drawn": design.n_drawn,
        "n_kept": design.n_kept,
        "parameters": [finite(asdict(p)) for p in design.parameters],
        **({} if (first := design.earlier_first) is None else {"earlier_first": first.tolist()}),
    }
    return {"design": design_frame(design), "design.json": about}


def design_frame(design: Design) -> pl.DataFrame:
    """Sets of a design as rows: set_id and a column per parameter."""
    columns = {p.name: design.values[:, i] for i, p in enumerate(design.parameters)}
    return pl.DataFrame({"set_id": np.arange(design.n_sets), **columns})


def _design(frame: pl.DataFrame, about: Mapping[str, Any]) -> Design:
    parameters = tuple(Parameter(**infinite(p)) for p in about["parameters"])
    values = frame.select(p.name for p in parameters).to_numpy()
    counts = {name: about[name] for name in ("seed", "n_drawn", "n_kept")}
    first = np.array(about["earlier_first"]) if "earlier_first" in about else None
    return Design(parameters=parameters, values=values, earlier_first=first, **counts)


def _json(value: object) -> bytes:
    return json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False).encode() + b"\n"


def _from(folder: Path, file: Path) -> str:
    try:
        return Path(os.path.relpath(file.resolve(), folder.resolve())).as_posix()
    except ValueError:  # on another drive
        return str(file.resolve())


def file_name(name: str) -> str:
    """Make a file name of a name: whatever could lead out of a folder is escaped."""
    return quote(name, safe=" ").replace(".", "%2E")
