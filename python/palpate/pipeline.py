"""The stages composed: what the paper's method section says, in its order.

Each verb reads what the verbs before it left in the run directory and leaves
its own result there, so any of them can run alone; :func:`run_study` is all of
them in a row. Whatever can be checked is checked before the first file is
written.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import polars as pl

from palpate.domain import Design, Limb, Response, Simulation
from palpate.plugins import Plugins
from palpate.progress import SILENT, Progress
from palpate.study import Study


@dataclass(frozen=True, slots=True, kw_only=True)
class Checked:
    """A study whose files have been read and found usable.

    Parameters
    ----------
    measured, limbs : mapping of spot name to Response, Limb
        ``limbs`` is empty where the solver needs none.
    design : Design
    """

    measured: Mapping[str, Response]
    limbs: Mapping[str, Limb]
    design: Design


@dataclass(frozen=True, slots=True, kw_only=True)
class Selected:
    """What identification chose.

    Parameters
    ----------
    selection : DataFrame
        One row per spot and scenario: spot, scenario, set_id, fopt, nmse_<channel>,
        r2_<channel>, <region.parameter>.
    generalisation : DataFrame
        One row per spot for the one set with the least mean Fopt over the spots; empty
        when no set succeeded at every spot.
    refinement : DataFrame
        Rows of the local search that started from each selected set; empty without one.
    """

    selection: pl.DataFrame
    generalisation: pl.DataFrame
    refinement: pl.DataFrame


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """What the report shows, and where it lies.

    Parameters
    ----------
    tables : mapping of name to DataFrame
    files : tuple of Path
        Everything that was written.
    """

    tables: Mapping[str, pl.DataFrame]
    files: tuple[Path, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RunResult:
    """Everything a run found."""

    folder: Path
    measured: Mapping[str, Response]
    design: Design
    simulations: tuple[Simulation, ...]
    scores: pl.DataFrame
    selected: Selected
    report: Report


def check(study: Study, plugins: Plugins) -> Checked:
    """Read and check every input of the study without writing or simulating anything."""
    raise NotImplementedError


def measure(
    study: Study, run_folder: Path, plugins: Plugins, progress: Progress = SILENT
) -> Mapping[str, Response]:
    """Read the measured curves into ``measured/<spot>.parquet``."""
    raise NotImplementedError


def sample(study: Study, run_folder: Path, plugins: Plugins, progress: Progress = SILENT) -> Design:
    """Draw the parameter sets into ``design.parquet``."""
    raise NotImplementedError


def simulate(
    study: Study, run_folder: Path, plugins: Plugins, progress: Progress = SILENT
) -> tuple[Simulation, ...]:
    """Simulate every set at every spot, keeping each result as it comes."""
    raise NotImplementedError


def score(study: Study, run_folder: Path, plugins: Plugins, progress: Progress = SILENT) -> pl.DataFrame:
    """Compare simulated with measured curves into ``scores.parquet``."""
    raise NotImplementedError


def select(study: Study, run_folder: Path, plugins: Plugins, progress: Progress = SILENT) -> Selected:
    """Choose the best set by scenario and over all spots, and refine if the study says so."""
    raise NotImplementedError


def report(study: Study, run_folder: Path, plugins: Plugins, progress: Progress = SILENT) -> Report:
    """Lay the results out as tables and figures under ``report/``; recomputes nothing."""
    raise NotImplementedError


def run_study(study: Study, run_folder: Path, plugins: Plugins, progress: Progress = SILENT) -> RunResult:
    """From measured curves to identified parameters.

    Raises
    ------
    PalpateError
        Something in the input is wrong; nothing has been written.
    NothingSelectable
        Every simulation failed.
    """
    raise NotImplementedError
