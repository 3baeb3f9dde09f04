"""State of a fit that goes on, kept in the run directory for whoever looks."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from palpate.errors import LedgerError
from palpate.run.atomic_files import write_whole
from palpate.run.ownership import KEPT, reason


@dataclass(frozen=True, slots=True, kw_only=True)
class FitState:
    """Progress of a fit.

    Parameters
    ----------
    fit, scenario : str
        The search that has taken a step last: "all spots" or a spot, and its scenario.
    step : int
        Its evaluations so far.
    fopt : float or None
        Least Fopt of that search so far; None where every evaluation failed.
    n_simulations : int
        Simulations so far, without the sweep.
    n_left : int or None
        Simulations that the run has still to make, about; None where that is not known.
    seconds_left : float or None
        Their time.
    """

    fit: str
    scenario: str
    step: int
    fopt: float | None
    n_simulations: int
    n_left: int | None = None
    seconds_left: float | None = None

    def __str__(self) -> str:
        fopt = "no evaluation succeeded" if self.fopt is None else f"Fopt {self.fopt:.3g}"
        return f"{self.fit}, scenario {self.scenario}: step {self.step}, {fopt}"


def write_fit_state(folder: Path, state: FitState) -> None:
    """Keep how far the fit is in a run directory; not worth waiting for a disk."""
    path = folder / "fit.json"
    try:
        write_whole(path, json.dumps(asdict(state)).encode(), durable=False)
    except OSError as error:
        raise LedgerError(f"{path}: {reason(error)}; {KEPT}") from error


def read_fit_state(folder: Path) -> FitState | None:
    """Progress of the fit; None before it starts and after it has ended."""
    try:
        return FitState(**json.loads((folder / "fit.json").read_bytes()))
    except (OSError, ValueError, TypeError, RecursionError):
        return None


def remove_fit_state(folder: Path) -> None:
    """Forget how far a fit was: it has ended, or a new run begins."""
    (folder / "fit.json").unlink(missing_ok=True)
