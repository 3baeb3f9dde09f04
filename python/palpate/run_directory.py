"""A run on disk: what every number depended on lies beside it.

::

    study.toml              as run
    manifest.json           versions, hashes of the inputs, units, normaliser, conventions, seed
    measured/<spot>.parquet  measured/<spot>.json  measured/plots/<spot>/
    design.parquet
    ledger.sqlite  curves/  simulations: states, attempts, timings, reasons, and their curves
    scores.parquet  selection.parquet  generalisation.parquet
    refinement.parquet  refined/<spot>/<scenario>.parquet
    rays.parquet  proofs.parquet
    report/

Files are written whole or not at all, and the folder moves freely.
"""

import contextlib
import hashlib
import importlib.metadata
import json
import os
import platform
import shutil
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import polars as pl

from palpate.domain import Channel, Design, HomogeneousTests, Indentation, Parameter, Protocol, Response
from palpate.errors import StudyError
from palpate.interfaces import Component
from palpate.limb import mesh_note
from palpate.locking import locked
from palpate.plugins import answering_for
from palpate.refinement import Refined
from palpate.results import frame_of, plain, response_of, write_atomically, write_frame
from palpate.study import Study, StudySpot, relative
from palpate.trust import IN_KEYS, fingerprints, recorded, trusting

UNITS = "mm, N, MPa, N·mm, degrees"
"""Units of every number in a run directory."""

_LIBRARIES = ("palpate", "numpy", "scipy", "jax", "polars", "matplotlib")


class RunDirectory:
    """The files of one run.

    Parameters
    ----------
    folder : Path
        Made on the first write.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @property
    def report(self) -> Path:
        """Where tables, figures and the page go."""
        return self.folder / "report"

    # ------------------------------------------------------------------ beginning

    def begin(self, study: Study, channels: Mapping[str, Channel], *, simulating: bool = False) -> None:
        """Write ``manifest.json`` and the study as run.

        ``simulating`` says that simulations follow; otherwise those of earlier code stay on record
        as such.

        Raises
        ------
        StudyError
            The folder cannot be made.
        """
        told = manifest(study, channels) | {"measured": self._records(study)} | self._origin(study)
        told |= self._trusted(study, simulating=simulating)
        text = _json(told)
        self._make_folder()
        as_run = self.folder / "study.toml"
        if study.file.is_file() and study.file.resolve() != as_run.resolve():
            write_atomically(as_run, study.file.read_bytes())
        write_atomically(self.folder / "manifest.json", text)

    def trusting(self, study: Study, names: Collection[str] = ()) -> Study:
        """The study with the results of earlier code that this run accepts, and those of ``names``."""
        return trusting(study, self.manifest() if self.is_begun else {}, names)

    def _trusted(self, study: Study, *, simulating: bool) -> dict[str, Any]:
        """Which code the simulations are of, and which is accepted as the same."""
        before = self.manifest() if self.is_begun else {}
        now, earlier = fingerprints(study), before.get("fingerprints", {})
        if not simulating:
            now |= {name: earlier[name] for name in now if name.startswith(IN_KEYS) and name in earlier}
        return {"fingerprints": now, "trusted": recorded(study, before)}

    def _origin(self, study: Study) -> dict[str, Any]:
        """Where `palpate resume` finds the study: from this folder, so that both move together."""
        return {
            "study_file": _from(self.folder, study.file),
            "plugin_files": [_from(self.folder, file) for file in study.plugin_files],
        }

    def _make_folder(self) -> None:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StudyError(
                f"{self.folder}: cannot be a run directory ({error.strerror}); name another folder"
            ) from None

    @contextlib.contextmanager
    def begun(self, study: Study, channels: Mapping[str, Channel]) -> Iterator[Callable[[], None]]:
        """Begin, and keep every other runner out; yields what raises where the lock is lost.

        Raises
        ------
        StudyError
            The folder cannot be made.
        LedgerError
            Another runner is at work in the folder.
        """
        manifest(study, channels)  # what cannot be told is refused before there is a folder
        self._make_folder()
        with locked(self.folder) as check:
            self._tidy()
            self.begin(study, channels, simulating=True)
            yield check

    def _tidy(self) -> None:
        """Remove what a killed runner was writing."""
        for part in self.folder.rglob(".*.part"):
            part.unlink(missing_ok=True)

    @property
    def is_begun(self) -> bool:
        """Whether a study was run here, or began to be."""
        return (self.folder / "manifest.json").exists()

    def manifest(self) -> dict[str, Any]:
        """Content of ``manifest.json``."""
        path = self._existing("manifest.json", "run")
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return content

    # ------------------------------------------------------------------ the stages

    def write_measured(self, measured: Mapping[str, Response]) -> None:
        """Write ``measured/<spot>.parquet``, and to the manifest how the curves came about."""
        for spot, response in measured.items():
            write_frame(self._measured(spot), frame_of(response))
            write_atomically(self._record(spot), _json(plain(response.record)))
        told = self.manifest()
        told["measured"] = {spot: plain(response.record) for spot, response in measured.items()}
        write_atomically(self.folder / "manifest.json", _json(told))

    def measured(self, spots: tuple[str, ...]) -> dict[str, Response]:
        """Measured responses of these spots."""
        return {
            spot: replace(
                response_of(
                    pl.read_parquet(
                        self._existing(str(self._measured(spot).relative_to(self.folder)), "experiment")
                    )
                ),
                record=self._recorded(spot),
            )
            for spot in spots
        }

    def plots(self, spot: str, *, empty: bool = False) -> Path:
        """Folder for the pictures of a spot's presses; ``empty`` removes those of an earlier reading.

        Raises
        ------
        StudyError
            The folder cannot be made.
        """
        folder = self.folder / "measured" / "plots" / file_name(spot)
        if empty and folder.exists():
            shutil.rmtree(folder)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StudyError(f"{folder}: cannot be made ({error.strerror}); name another folder") from None
        return folder

    def write_design(self, design: Design) -> None:
        """Write ``design.parquet``: set_id and a column per parameter."""
        columns = {p.name: design.values[:, i] for i, p in enumerate(design.parameters)}
        frame = pl.DataFrame({"set_id": np.arange(design.n_sets), **columns})
        write_frame(self.folder / "design.parquet", frame)
        about = {
            "seed": design.seed,
            "n_drawn": design.n_drawn,
            "n_kept": design.n_kept,
            "parameters": [_finite(asdict(p)) for p in design.parameters],
        }
        write_atomically(self.folder / "design.json", _json(about))

    def design(self) -> Design:
        """Read the design with its parameters."""
        frame = self._frame("design.parquet", "sample")
        about = json.loads(self._existing("design.json", "sample").read_text(encoding="utf-8"))
        parameters = tuple(Parameter(**_infinite(p)) for p in about["parameters"])
        values = frame.select(p.name for p in parameters).to_numpy()
        counts = {name: about[name] for name in ("seed", "n_drawn", "n_kept") if name in about}
        return Design(parameters=parameters, values=values, **counts)

    def write_scores(self, scores: pl.DataFrame) -> None:
        """Write ``scores.parquet``."""
        write_frame(self.folder / "scores.parquet", scores)

    def scores(self) -> pl.DataFrame:
        """Scores of every set, as :func:`palpate.scoring.score` returns them."""
        return self._frame("scores.parquet", "score")

    def write_selection(self, selection: pl.DataFrame, generalisation: pl.DataFrame) -> None:
        """Write ``selection.parquet`` and ``generalisation.parquet``."""
        write_frame(self.folder / "selection.parquet", selection)
        write_frame(self.folder / "generalisation.parquet", generalisation)

    def selection(self) -> pl.DataFrame:
        """Least Fopt by spot and scenario."""
        return self._frame("selection.parquet", "select")

    def generalisation(self) -> pl.DataFrame:
        """Read the set for all spots."""
        return self._frame("generalisation.parquet", "select")

    def write_refinement(self, refined: Refined) -> None:
        """Write ``refinement.parquet`` and ``refined/<spot>/<scenario>.parquet``."""
        for (spot, scenario), response in refined.responses.items():
            write_frame(self._refined(spot, scenario), frame_of(response))
        write_frame(self.folder / "refinement.parquet", refined.table)

    def drop_refinement(self) -> None:
        """Remove the refinement of an earlier selection."""
        (self.folder / "refinement.parquet").unlink(missing_ok=True)

    def refinement(self) -> Refined:
        """Where the local searches ended; empty when there were none."""
        path = self.folder / "refinement.parquet"
        if not path.exists():
            return Refined(table=pl.DataFrame(), responses={})
        table = pl.read_parquet(path)
        keys = [(row["spot"], row["scenario"]) for row in table.iter_rows(named=True)]
        found = {key: self._refined(*key) for key in keys if self._refined(*key).exists()}
        return Refined(
            table=table,
            responses={key: response_of(pl.read_parquet(file)) for key, file in found.items()},
        )

    def write_rays(self, rays: pl.DataFrame) -> None:
        """Write ``rays.parquet``, or remove that of an earlier selection where there are none."""
        path = self.folder / "rays.parquet"
        if rays.is_empty():
            path.unlink(missing_ok=True)
        else:
            write_frame(path, rays)

    def rays(self) -> pl.DataFrame:
        """Best multiple by spot and scenario; empty when none was looked for."""
        path = self.folder / "rays.parquet"
        return pl.read_parquet(path) if path.exists() else pl.DataFrame()

    def write_proofs(self, proofs: pl.DataFrame) -> None:
        """Write ``proofs.parquet``, or remove that of an earlier selection where there are none."""
        path = self.folder / "proofs.parquet"
        if proofs.is_empty():
            path.unlink(missing_ok=True)
        else:
            write_frame(path, proofs)

    def proofs(self) -> pl.DataFrame:
        """What the solver proved of the chosen sets; empty where it proves nothing."""
        path = self.folder / "proofs.parquet"
        return pl.read_parquet(path) if path.exists() else pl.DataFrame()

    def certificates(self) -> dict[str, Any]:
        """Read what was kept here as ``certificate*.json``, by file name; not JSON is its error."""
        found: dict[str, Any] = {}
        for path in sorted(self.folder.glob("certificate*.json")):
            try:
                found[path.name] = json.loads(path.read_text(encoding="utf-8"))
            except ValueError as error:
                found[path.name] = {"missing": [f"{path.name} cannot be read: {error}"]}
        return found

    # ----------------------------------------------------------------------- paths

    def _measured(self, spot: str) -> Path:
        return self.folder / "measured" / f"{file_name(spot)}.parquet"

    def _record(self, spot: str) -> Path:
        return self._measured(spot).with_suffix(".json")

    def _recorded(self, spot: str) -> dict[str, Any]:
        """How the curves of a spot came about; empty where nobody has said."""
        path = self._record(spot)
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        return found

    def _records(self, study: Study) -> dict[str, Any]:
        return {spot.spot.name: self._recorded(spot.spot.name) for spot in study.spots}

    def _refined(self, spot: str, scenario: str) -> Path:
        return self.folder / "refined" / file_name(spot) / f"{file_name(scenario)}.parquet"

    def _frame(self, name: str, command: str) -> pl.DataFrame:
        return pl.read_parquet(self._existing(name, command))

    def _existing(self, name: str, command: str) -> Path:
        path = self.folder / name
        if not path.exists():
            raise StudyError(f"{path}: not there yet; run `palpate {command}` first")
        return path


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


def manifest(study: Study, channels: Mapping[str, Channel]) -> dict[str, Any]:
    """Tell what the numbers of a run depended on."""
    weighted = {channel for scenario in study.scenarios for channel in scenario.weights}
    return {
        "study": study.name,
        "description": study.description,
        "data": study.data,
        "units": UNITS,
        "versions": versions(study),
        "inputs": _hashes(study),
        "fingerprints": fingerprints(study),
        "loader": _component(study.loader),
        "limb_source": _component(study.limb_source) if study.limb_source else None,
        "solver": _component(study.solver),
        "protocol": _protocol(study.protocol),
        "spots": {spot.spot.name: _spot(study, spot) for spot in study.spots},
        "materials": [
            {
                "region": region.region,
                **_component(region.material),
                "convention": region.convention,
                "searched": [_finite(asdict(p)) for p in region.searched],
                "fixed": plain(region.fixed),
            }
            for region in study.space.regions
        ],
        "sampler": _component(study.sampler),
        "n_sets": study.n_sets,
        "n_total": study.n_total,
        "refill": study.refill,
        "seed": study.seed,
        "filters": [_component(keep) for keep in study.filters],
        "normaliser": study.normaliser.value,
        "point_weights": study.weights.value,
        "minimum_coverage": study.minimum_coverage,
        "rank_partial": study.rank_partial,
        "scenarios": {scenario.name: dict(scenario.weights) for scenario in study.scenarios},
        "generalise_by": study.generalise_by,
        "refine": study.refine,
        "rays": study.rays,
        "truth": plain(study.truth),
        "channels": {name: asdict(channel) for name, channel in channels.items() if name in weighted},
    }


def versions(study: Study) -> dict[str, str]:
    """Versions of everything that took part."""
    with answering_for(study.solver, "asking for its version"):
        solver = study.solver.version()
    found = {"python": platform.python_version(), f"solver {study.solver.name}": solver}
    plugins = {
        point.dist.name
        for point in importlib.metadata.entry_points(group="palpate")
        if point.dist is not None
    }
    for name in (*_LIBRARIES, *sorted(plugins)):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def _hashes(study: Study) -> dict[str, str]:
    files = [study.file, *study.plugin_files]
    for spot in study.spots:
        files += [*spot.files, *([spot.mesh] if spot.mesh else [])]
    return {
        relative(file, study.folder): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in files
        if file.is_file()
    }


def _component(component: Component) -> dict[str, Any]:
    return {"name": component.name, "settings": component.settings.model_dump(mode="json")}


def _spot(study: Study, spot: StudySpot) -> dict[str, Any]:
    """Files of a spot by channel, and what is done and read there otherwise than elsewhere."""
    files = {
        channel or "": [relative(path, study.folder) for path in paths]
        for channel, paths in spot.measured.items()
    }
    told: dict[str, Any] = {"measured": files}
    if spot.protocol is not None:
        told["protocol"] = _protocol(spot.protocol)
    if spot.loader is not None:
        told["loader"] = _component(spot.loader)
    if spot.mesh is not None and (note := mesh_note(spot.mesh)) is not None:
        told["mesh"] = note
    return told


def _protocol(protocol: Protocol | None) -> dict[str, Any]:
    if isinstance(protocol, Indentation):
        return {
            "kind": "indentation",
            "indenter": type(protocol.indenter).__name__,
            **plain(_fields(protocol.indenter)),
            "path_depth_mm_rotation_deg": protocol.path.tolist(),
            **plain(_fields(protocol, ("indenter", "path"))),
        }
    if protocol is None or type(protocol) is HomogeneousTests:
        return {"kind": "homogeneous tests"}
    return {"kind": type(protocol).__qualname__, **plain(_fields(protocol))}


def _fields(value: Any, left_out: tuple[str, ...] = ()) -> dict[str, Any]:  # noqa: ANN401 - any dataclass
    return {field.name: getattr(value, field.name) for field in fields(value) if field.name not in left_out}


_LIMITS = ("physical_lower", "physical_upper")


def _finite(parameter: dict[str, Any]) -> dict[str, Any]:
    """Make a parameter fit for JSON, which has no infinity: no limit is null."""
    return parameter | {k: None for k in _LIMITS if not np.isfinite(parameter[k])}


def _infinite(parameter: dict[str, Any]) -> dict[str, Any]:
    missing = {"physical_lower": -np.inf, "physical_upper": np.inf}
    return parameter | {k: v for k, v in missing.items() if parameter[k] is None}
