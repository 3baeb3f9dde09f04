"""Simulations on disk: one line and one file of curves each, by the key of the job.

``simulations.jsonl`` gets a line, flushed to the disk, once the curves of a
simulation lie complete in ``curves/<key>.parquet``; a run that is killed at any
moment loses at most the simulation that it was storing.
"""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import polars as pl

from palpate.domain import Curve, FloatArray, Job, Response, Simulation, Status


def frame_of(response: Response) -> pl.DataFrame:
    """Curves as rows of channel, point, abscissa, ordinate and, where any curve has it, std."""
    frame = pl.concat(
        [_rows_of(name, curve) for name, curve in response.curves.items()] or [pl.DataFrame(schema=_CURVES)]
    )
    if all(curve.std is None for curve in response.curves.values()):
        return frame.drop("std")
    return frame


def _rows_of(name: str, curve: Curve) -> pl.DataFrame:
    return pl.DataFrame(
        {
            "channel": [name] * curve.abscissa.size,
            "point": range(curve.abscissa.size),
            "abscissa": curve.abscissa,
            "ordinate": curve.ordinate,
            "std": [None] * curve.abscissa.size if curve.std is None else curve.std,
        },
        schema=_CURVES,
    )


def response_of(frame: pl.DataFrame) -> Response:
    """Make curves of rows: the inverse of :func:`frame_of`."""
    return Response(
        curves={
            str(name): Curve(
                channel=str(name),
                abscissa=rows["abscissa"].to_numpy(),
                ordinate=rows["ordinate"].to_numpy(),
                std=_std(rows),
            )
            for (name,), rows in frame.group_by("channel", maintain_order=True)
        }
    )


def _std(rows: pl.DataFrame) -> FloatArray | None:
    if "std" not in rows.columns or rows["std"].null_count() == rows.height:
        return None
    return rows["std"].to_numpy()


_CURVES = pl.Schema(
    {
        "channel": pl.String,
        "point": pl.Int64,
        "abscissa": pl.Float64,
        "ordinate": pl.Float64,
        "std": pl.Float64,
    }
)


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file that is either absent or complete, whatever happens meanwhile."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    with part.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)


def write_frame(path: Path, frame: pl.DataFrame) -> None:
    """Write a Parquet file atomically."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    frame.write_parquet(part)
    part.replace(path)


class Results:
    """The simulations in a run directory.

    Parameters
    ----------
    folder : Path
        The run directory; written to on the first :meth:`store`.
    """

    def __init__(self, folder: Path) -> None:
        self._lines = folder / "simulations.jsonl"
        self._curves = folder / "curves"
        self._known = _read_lines(self._lines)

    def load(self, key: str, job: Job) -> Simulation | None:
        """Read the simulation of ``job``; None if it is not there or not readable."""
        line = self._known.get(key)
        if line is None:
            return None
        response = None
        if line["curves"]:
            try:
                response = response_of(pl.read_parquet(self._path(key)))
            except (OSError, ValueError, pl.exceptions.PolarsError):
                return None
        return Simulation(
            job=job,
            status=Status(line["status"]),
            response=response,
            message=line["message"],
            seconds=line["seconds"],
            diagnostics=line["diagnostics"],
        )

    def store(self, key: str, simulation: Simulation) -> None:
        """Keep a simulation; a later one of the same key takes its place."""
        response = simulation.response
        if response is not None:
            write_frame(self._path(key), frame_of(response))
        line = {
            "key": key,
            "spot": simulation.job.spot,
            "set_id": simulation.job.set_id,
            "status": simulation.status.value,
            "message": simulation.message,
            "seconds": simulation.seconds,
            "curves": response is not None,
            "diagnostics": plain(simulation.diagnostics),
        }
        _append_line(self._lines, json.dumps(line, allow_nan=False))
        self._known[key] = line

    def _path(self, key: str) -> Path:
        return self._curves / f"{key}.parquet"


def _read_lines(path: Path) -> dict[str, dict[str, Any]]:
    """Lines by key, the last of each; a line that a kill cut short is passed over."""
    known: dict[str, dict[str, Any]] = {}
    if not path.exists():
        return known
    for text in path.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            line = json.loads(text)
            known[line["key"]] = line
        except (ValueError, KeyError, TypeError):
            continue
    return known


def _append_line(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("ab+") as file:
        if file.tell() > 0:
            file.seek(-1, os.SEEK_END)
            if file.read(1) != b"\n":
                file.write(b"\n")
        file.write(text.encode() + b"\n")
        file.flush()
        os.fsync(file.fileno())


def plain(value: Any) -> Any:  # noqa: ANN401 - whatever a solver reports
    """Turn a solver's diagnostics into JSON: numbers, text, lists, tables; anything else as its text."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float) and not (abs(value) < float("inf")):
        return str(value)
    return value if value is None or isinstance(value, (str, bool, int, float)) else repr(value)
