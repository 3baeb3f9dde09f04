"""What a plan of presses is asked for."""

from dataclasses import dataclass

from palpate.errors import StudyError
from palpate.study.tool import Tool
from palpate_planning.candidates import Allowed
from palpate_planning.narrowing import ALL, PREDICTION


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanOptions:
    """Options of :func:`~palpate_planning.propose.propose` and :func:`~palpate_planning.propose.plan`.

    Parameters
    ----------
    goal : str, optional
        What to narrow: ``all``, ``worst``, one parameter, or ``prediction``; by default the prediction where
        a tool is given, else all.
    tool : Tool, optional
        Whose force is predicted.
    allowed : Allowed, optional
        Candidates; by default shares of the study's own presses.
    n_presses : int
        Presses to choose, one after the other.
    n_points : int
        Likely parameters at which each candidate is simulated.
    """

    goal: str | None = None
    tool: Tool | None = None
    allowed: Allowed | None = None
    n_presses: int = 1
    n_points: int = 6

    def __post_init__(self) -> None:
        if self.goal == PREDICTION and self.tool is None:
            raise StudyError(f"goal '{PREDICTION}' needs a tool whose force is predicted: --tool FILE")
        if self.tool is not None and self.goal not in (None, PREDICTION):
            raise StudyError(
                f"goal '{self.goal}' needs no tool; leave the tool out, or ask for '{PREDICTION}'"
            )

    @property
    def narrowed(self) -> str:
        """Name of the goal."""
        return self.goal or (ALL if self.tool is None else PREDICTION)
