"""What a run returns: everything it found, and where its report is."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import polars as pl

from palpate.domain import Design, Response, Simulation
from palpate.run.result import FitResult, SelectionResult
from palpate_report.verdict import Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """What the report shows, and where it is.

    Parameters
    ----------
    tables : mapping of name to DataFrame
    files : tuple of Path
        Everything that was written.
    verdict : Verdict
        What the run amounts to, and its warnings.
    """

    tables: Mapping[str, pl.DataFrame]
    files: tuple[Path, ...]
    verdict: Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class RunResult:
    """Everything a run found."""

    folder: Path
    measured: Mapping[str, Response]
    design: Design
    simulations: tuple[Simulation, ...]
    scores: pl.DataFrame
    selected: SelectionResult
    fit: FitResult
    report: Report

    def __repr__(self) -> str:
        chosen = self.selected.selection.height
        return f"RunResult({self.folder}: {len(self.simulations)} simulations, {chosen} chosen sets)"
