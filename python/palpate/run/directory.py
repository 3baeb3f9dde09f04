"""A run on disk, with everything that its numbers depended on.

::

    study.toml              as run
    manifest.json           versions, hashes of the inputs, units, normaliser, conventions, seed
    measured/<spot>.parquet  measured/<spot>.json  measured/plots/<spot>/
    design.parquet  design.json
    ledger.sqlite  curves/  simulations: states, attempts, timings, reasons, and their curves
    scores.parquet  selection.parquet  generalisation.parquet
    fit.parquet  fit_trace.parquet  fit_mesh.parquet  fit_curves.parquet
    intervals.parquet  budget.parquet  directions.parquet  adequacy.parquet  draws.parquet
    posterior.parquet  posterior_draws.parquet  profiles.parquet  profile_ends.parquet
    ribbons.parquet  volumes.parquet  emulator.parquet
    fit.json                how far the fit is, while it goes on
    next.json               which presses to make next
    stiffness_scaling.parquet  verification.parquet
    surface.parquet  surface/<key>.npz  states of the skin at each spot
    stages.json             checksums of these files, and what each stage was made from
    report/

Files are written whole or not at all, and the folder moves freely.
"""

import contextlib
import io
import json
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import polars as pl

from palpate.domain import Channel, Design, Parameter, Relaxation, Response
from palpate.errors import StudyError
from palpate.executors.answers import plain
from palpate.run.atomic_files import write_atomically
from palpate.run.fit_state import remove_fit_state
from palpate.run.lock import locked
from palpate.run.manifest import checked_manifest, finite, infinite, manifest
from palpate.run.ownership import check_claimable, claim, refuse_other, tidy, writing_in
from palpate.run.result import CertaintyResult, FitResult, PosteriorResult
from palpate.run.result_files import frame_of, response_of, write_frame
from palpate.run.stage_records import COMMANDS, StageRecords
from palpate.run.trust import IN_KEYS, fingerprints, recorded, trusting
from palpate.study.reading import Study

_CERTAINTY = tuple(each.name for each in fields(CertaintyResult))
_POSTERIOR = tuple(each.name for each in fields(PosteriorResult))
_OF_FIT = ("fit", "fit_trace", "fit_mesh", "fit_curves", *_CERTAINTY)
_OPTIONAL = ("stiffness_scaling", "verification", "surface", *_OF_FIT, *_POSTERIOR)

RELAXATIONS = "relaxations"
"""Key of what relaxed, in the record of measured curves."""


class RunDirectory:
    """The files of one run; the folder is made on the first write."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.records = StageRecords(folder)

    @property
    def report(self) -> Path:
        """Where tables, figures and the page go."""
        return self.folder / "report"

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

        Unless ``simulating``, simulations of earlier code stay on record as such. Where the fit starts stays
        as it was unless ``fit_start`` is given.
        """
        before = self.manifest() if self.exists else {}
        now, earlier = fingerprints(study), before.get("fingerprints", {})
        remove_fit_state(self.folder)
        if not simulating:
            now |= {name: earlier[name] for name in now if name.startswith(IN_KEYS) and name in earlier}
        content = manifest(study, channels) | {
            "measured": self._records(study),
            # Relative to this folder, for `palpate resume`: both may move together.
            "study_file": _from(self.folder, study.file),
            "plugin_files": [_from(self.folder, file) for file in study.plugin_files],
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

    def trusting(self, study: Study, names: Collection[str] = ()) -> Study:
        """The study with the results of earlier code that this run accepts, and those of ``names``."""
        return trusting(study, self.manifest() if self.exists else {}, names)

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
        if not adopt and self.exists:
            refuse_other(self.folder, self.folder / self.manifest()["study_file"], study.file)

    @property
    def exists(self) -> bool:
        """Whether a study was run here, or began to be."""
        return (self.folder / "manifest.json").exists()

    def manifest(self) -> dict[str, Any]:
        """Content of ``manifest.json``."""
        path = self.folder / "manifest.json"
        if not path.exists():
            raise StudyError(f"{path}: not there yet; run `palpate run` first")
        try:
            return checked_manifest(path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise StudyError(
                f"{path}: damaged ({error}); restore a copy, or delete it: "
                f"`palpate run STUDY --out {self.folder}` writes it again and keeps what is simulated"
            ) from error

    # ------------------------------------------------------------------ the stages

    def require(self, stage: str) -> None:
        """Refuse to continue where an earlier stage has not been run."""
        path = self.folder / f"{stage}.parquet"
        if not path.exists():
            raise StudyError(f"{path}: not there yet; run `palpate {COMMANDS[stage]}` first")

    def write_measured(self, measured: Mapping[str, Response], made_from: Mapping[str, str]) -> None:
        """Write ``measured/<spot>.parquet``, and to the manifest how the curves came about."""
        records = {spot: _described(response) for spot, response in measured.items()}
        for spot, response in measured.items():
            write_frame(self._measured(spot), frame_of(response))
            write_atomically(self._record(spot), _json(records[spot]))
        files = [path for spot in measured for path in (self._measured(spot), self._record(spot))]
        self.records.write("measured", files, made_from)
        write_atomically(self.folder / "manifest.json", _json(self.manifest() | {"measured": records}))

    def measured(self, spots: tuple[str, ...]) -> dict[str, Response]:
        """Measured responses of these spots."""
        found = {}
        for spot in spots:
            curves, record = (
                self.records.read("measured", self._measured(spot), _response),
                self._recorded(spot),
            )
            relaxations = [Relaxation(**item) for item in record.pop(RELAXATIONS, [])]
            found[spot] = replace(curves, relaxations=relaxations, record=record)
        return found

    def plots(self, spot: str) -> Path:
        """Folder of the pictures of a spot's presses."""
        return self.folder / "measured" / "plots" / file_name(spot)

    def write_design(self, design: Design, made_from: Mapping[str, str]) -> None:
        """Write ``design.parquet``: set_id and a column per parameter."""
        columns = {p.name: design.values[:, i] for i, p in enumerate(design.parameters)}
        frame = pl.DataFrame({"set_id": np.arange(design.n_sets), **columns})
        write_frame(self.folder / "design.parquet", frame)
        about = {
            "seed": design.seed,
            "n_drawn": design.n_drawn,
            "n_kept": design.n_kept,
            "parameters": [finite(asdict(p)) for p in design.parameters],
            **({} if (first := design.earlier_first) is None else {"earlier_first": first.tolist()}),
        }
        write_atomically(self.folder / "design.json", _json(about))
        files = (self.folder / "design.parquet", self.folder / "design.json")
        self.records.write("design", files, made_from)

    def design(self) -> Design:
        """Read the design with its parameters."""
        frame = self._frame("design", "design")
        return self.records.read(
            "design", self.folder / "design.json", lambda content: _design(frame, json.loads(content))
        )

    def write_scores(self, scores: pl.DataFrame, made_from: Mapping[str, str]) -> None:
        """Write ``scores.parquet``."""
        self._write("scores", {"scores": scores}, made_from)

    def scores(self) -> pl.DataFrame:
        """Scores of every set, as :func:`palpate.stages.scoring.score` returns them."""
        return self._frame("scores", "scores")

    def write_selection(
        self,
        selection: pl.DataFrame,
        generalisation: pl.DataFrame,
        stiffness_scaling: pl.DataFrame,
        made_from: Mapping[str, str],
    ) -> None:
        """Write the tables of the selection."""
        frames = {
            "selection": selection,
            "generalisation": generalisation,
            "stiffness_scaling": stiffness_scaling,
        }
        self._write("selection", frames, made_from)

    def selection(self) -> pl.DataFrame:
        """Least Fopt by spot and scenario."""
        return self._frame("selection", "selection")

    def generalisation(self) -> pl.DataFrame:
        """Read the set for all spots."""
        return self._frame("selection", "generalisation")

    def stiffness_scaling(self) -> pl.DataFrame:
        """Best multiple by spot and scenario; empty when none was looked for."""
        return self._optional("selection", "stiffness_scaling")

    def write_verification(self, verification: pl.DataFrame) -> None:
        """Write ``verification.parquet``."""
        self._write("verification", {"verification": verification}, {})

    def verification(self) -> pl.DataFrame:
        """Verification of the selected sets; empty where the solver has none."""
        return self._optional("verification", "verification")

    def write_proposal(self, proposal: Mapping[str, Any]) -> None:
        """Write ``next.json``: which presses to make next."""
        write_atomically(self.folder / "next.json", _json(proposal))

    def proposal(self) -> dict[str, Any]:
        """Read ``next.json``.

        Raises
        ------
        StudyError
            It is missing or damaged.
        """
        path = self.folder / "next.json"
        try:
            found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise StudyError(f"{path}: {error}; run `palpate next {self.folder}` first") from None
        return found

    def write_fit(self, fit: FitResult, made_from: Mapping[str, str]) -> None:
        """Write the tables of the fit, and the fitted curves in ``fit_curves.parquet``."""
        names = ("fit", "scenario", "spot")
        curves = [
            frame_of(response).select(
                *(pl.lit(part).alias(n) for n, part in zip(names, key, strict=True)), pl.all()
            )
            for key, response in fit.responses.items()
        ]
        frames = {
            "fit": fit.table,
            "fit_trace": fit.trace,
            "fit_mesh": fit.mesh,
            "fit_curves": pl.concat(curves) if curves else pl.DataFrame(),
            **{name: getattr(fit.certainty, name) for name in _CERTAINTY},
        }
        self._write("fit", frames, made_from)
        remove_fit_state(self.folder)

    def fit(self) -> FitResult:
        """Read the fit; empty where there is none."""
        curves = self._optional("fit", "fit_curves")
        keys = ("fit", "scenario", "spot")
        parts = {} if curves.is_empty() else curves.partition_by(*keys, as_dict=True, include_key=False)
        return FitResult(
            table=self._optional("fit", "fit"),
            trace=self._optional("fit", "fit_trace"),
            mesh=self._optional("fit", "fit_mesh"),
            responses={(str(a), str(b), str(c)): response_of(part) for (a, b, c), part in parts.items()},
            certainty=CertaintyResult(**{name: self._optional("fit", name) for name in _CERTAINTY}),
        )

    def write_posterior(self, found: PosteriorResult) -> None:
        """Write the tables of the posteriors of the fit."""
        made_from = {"fit": self.records.fingerprint("fit")}
        self._write("posterior", {name: getattr(found, name) for name in _POSTERIOR}, made_from)

    def posterior(self) -> PosteriorResult:
        """Read the posteriors; empty where there are none of this fit."""
        if not self.records.is_made_from("posterior", {"fit": self.records.fingerprint("fit")}):
            return PosteriorResult()
        return PosteriorResult(**{name: self._optional("posterior", name) for name in _POSTERIOR})

    def write_surface(self, table: pl.DataFrame, files: Iterable[Path]) -> None:
        """Write which simulations have states of the skin; ``files`` are these."""
        made_from = {name: self.records.fingerprint(name) for name in ("selection", "fit")}
        self._write("surface", {"surface": table}, made_from, files)

    def surface(self) -> pl.DataFrame:
        """Simulations with states of the skin; empty where there are none of this selection and fit."""
        made_from = {name: self.records.fingerprint(name) for name in ("selection", "fit")}
        is_current = self.records.is_made_from("surface", made_from)
        return self._optional("surface", "surface") if is_current else pl.DataFrame()

    def comparisons(self) -> dict[str, Any]:
        """Read what was kept here as ``solver-comparison*.json``, by file name; not JSON is its error."""
        found: dict[str, Any] = {}
        for path in sorted(self.folder.glob("solver-comparison*.json")):
            try:
                found[path.name] = json.loads(path.read_text(encoding="utf-8"))
            except (ValueError, OSError, RecursionError) as error:
                found[path.name] = {"missing": [f"{path.name} cannot be read: {error}"]}
        return found

    # ----------------------------------------------------------------------- files

    def _write(
        self,
        stage: str,
        frames: Mapping[str, pl.DataFrame],
        made_from: Mapping[str, str],
        others: Iterable[Path] = (),
    ) -> None:
        """Write the tables of a stage and record them; an empty one of ``_OPTIONAL`` is removed."""
        files = list(others)
        for name, frame in frames.items():
            path = self.folder / f"{name}.parquet"
            if name in _OPTIONAL and frame.is_empty():
                path.unlink(missing_ok=True)
            else:
                write_frame(path, frame)
                files.append(path)
        self.records.write(stage, files, made_from)

    def _measured(self, spot: str) -> Path:
        return self.folder / "measured" / f"{file_name(spot)}.parquet"

    def _record(self, spot: str) -> Path:
        return self._measured(spot).with_suffix(".json")

    def _recorded(self, spot: str) -> dict[str, Any]:
        """How the curves of a spot came about."""
        found: dict[str, Any] = self.records.read("measured", self._record(spot), json.loads)
        return found

    def _records(self, study: Study) -> dict[str, Any]:
        """How the curves of each spot came about, as far as that is known."""
        known = {}
        for spot in study.spots:
            with contextlib.suppress(StudyError):
                known[spot.spot.name] = self._recorded(spot.spot.name)
        return known

    def _frame(self, stage: str, name: str) -> pl.DataFrame:
        return self.records.read(stage, self.folder / f"{name}.parquet", _parquet)

    def _optional(self, stage: str, name: str) -> pl.DataFrame:
        path = self.folder / f"{name}.parquet"
        return self._frame(stage, name) if self.records.holds(stage, path) else pl.DataFrame()


def _parquet(content: bytes) -> pl.DataFrame:
    return pl.read_parquet(io.BytesIO(content))


def _described(response: Response) -> dict[str, Any]:
    """How measured curves came about, and what relaxed meanwhile."""
    relaxed = [asdict(item) for item in response.relaxations]
    return {**plain(response.record), **({RELAXATIONS: relaxed} if relaxed else {})}


def _response(content: bytes) -> Response:
    return response_of(_parquet(content))


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
