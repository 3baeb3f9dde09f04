"""Takes over the results of a version that kept no ledger: ``simulations.jsonl`` and its curves."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import polars as pl

from palpate.domain import Job, Response, Simulation, Status
from palpate.ledger.writer import Finished, Writer
from palpate.results import response_of


def take_over(folder: Path, writer: Writer) -> int:
    """Move old results into the ledger; returns how many there were.

    A line that a kill cut short, or whose curves cannot be read, is passed over: its
    simulation is done again. The old files go once everything is in the ledger.
    """
    lines = folder / "simulations.jsonl"
    if not lines.exists():
        return 0
    known = _read_lines(lines)
    for key, line in known.items():
        if (finished := _finished(folder, key, line)) is not None:
            writer.store(finished)
    writer.flush()
    lines.unlink()
    for key in known:
        _old_curves(folder, key).unlink(missing_ok=True)
    return len(known)


def _read_lines(path: Path) -> dict[str, dict[str, Any]]:
    return dict(_parsed(path.read_text(encoding="utf-8", errors="replace")))


def _parsed(text: str) -> Iterator[tuple[str, dict[str, Any]]]:
    for each in text.splitlines():
        try:
            line = json.loads(each)
            yield line["key"], line
        except (ValueError, KeyError, TypeError):
            continue


def _finished(folder: Path, key: str, line: dict[str, Any]) -> Finished | None:
    response: Response | None = None
    if line["curves"]:
        try:
            response = response_of(pl.read_parquet(_old_curves(folder, key)))
        except (OSError, ValueError, pl.exceptions.PolarsError):
            return None
    job = Job(spot=line["spot"], set_id=line["set_id"], materials={}, thetas={}, protocol=None)  # type: ignore[arg-type]
    simulation = Simulation(
        job=job,
        status=Status(line["status"]),
        response=response,
        message=line["message"],
        seconds=line["seconds"],
        diagnostics=line["diagnostics"],
    )
    return Finished(key=key, simulation=simulation)


def _old_curves(folder: Path, key: str) -> Path:
    return folder / "curves" / f"{key}.parquet"
