"""study.toml → Study: every name, unit and range checked, with the line in the message."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from palpate.domain import Normaliser, ParameterSpace, Protocol, Scenario, Spot
from palpate.interfaces import ExperimentLoader, LimbSource, Sampler, SetFilter, Solver


@dataclass(frozen=True, slots=True, kw_only=True)
class StudySpot:
    """One spot with its files.

    Parameters
    ----------
    spot : Spot
    measured : mapping of channel name, or None for a file that holds several channels, to path
    mesh : Path or None
        None for a specimen in homogeneous tests.
    """

    spot: Spot
    measured: Mapping[str | None, Path]
    mesh: Path | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """A checked study, with its components built from their settings.

    Parameters
    ----------
    folder : Path
        Where study.toml lies; paths inside it are relative to it.
    data : {"measured", "simulated"}
        Whether the experiment is real; shown wherever results are.
    protocol : Protocol or None
        None: homogeneous tests along the measured abscissae.
    minimum_coverage : float
        Smallest share of measured points that a simulated curve must reach to be ranked.
    generalise_by : str
        Name of the scenario whose mean over the spots decides the generalised set.
    refine : bool
        Whether a local search follows the sweep.
    truth : mapping of full parameter name to value
        Known answer of a simulated experiment, in the region's convention; empty otherwise.
    n_workers : int
        Local worker processes; 0 means one per core.
    time_limit_s : float
        Longest time that one simulation may take.
    """

    name: str
    description: str
    folder: Path
    data: Literal["measured", "simulated"]
    spots: tuple[StudySpot, ...]
    loader: ExperimentLoader
    limb_source: LimbSource | None
    protocol: Protocol | None
    space: ParameterSpace
    sampler: Sampler
    n_sets: int
    seed: int
    filters: tuple[SetFilter, ...]
    solver: Solver
    normaliser: Normaliser
    minimum_coverage: float
    scenarios: tuple[Scenario, ...]
    generalise_by: str
    refine: bool
    truth: Mapping[str, float]
    n_workers: int
    time_limit_s: float
    plugin_files: tuple[Path, ...]
