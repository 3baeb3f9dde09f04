"""Forecast of a run: simulations that are to come, and their time by those that have ended."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from palpate.domain import Limb


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """Simulations of one stage.

    Parameters
    ----------
    counts : mapping of limb name to int, or None
        Usual number on each mesh; None where nobody knows.
    side_by_side : int
        Most of them that can run at a time; 0: all.
    """

    stage: str
    counts: Mapping[str, int] | None
    side_by_side: int = 0

    @property
    def n(self) -> int:
        """Number of simulations; 0 where it is not known."""
        return sum((self.counts or {}).values())


def work_of(limb_name: str, limbs: Mapping[str, Limb]) -> float:
    """Time of a simulation on a mesh over the mean of the spots' own meshes, by the numbers of nodes."""
    coarse = [limb.mesh.n_nodes for name, limb in limbs.items() if "/" not in name]
    if limb_name not in limbs or not coarse:
        return 1.0
    # Power of the number of nodes with which the time of a simulation grows.
    return float((limbs[limb_name].mesh.n_nodes / np.mean(coarse)) ** 1.4)


@dataclass(slots=True, kw_only=True, eq=False)
class Forecast:
    """Simulations of a command that are to come.

    Parameters
    ----------
    n_workers : int
        Simulations that run at a time; 0 where only the executor knows.

    Attributes
    ----------
    parts : list of Part
        Simulations to come by stage, in order.
    is_whole : bool
        True if the simulations of every stage to come are known.
    """

    n_workers: int = 0
    parts: list[Part] = field(default_factory=list)
    is_whole: bool = False
    _limbs: Mapping[str, Limb] = field(default_factory=dict)
    _left: list[Counter[str]] = field(default_factory=list)
    _seconds: float = 0.0
    _work: float = 0.0

    def expect(self, parts: Sequence[Part], limbs: Mapping[str, Limb]) -> None:
        """Forecast the stages that are to come."""
        self.parts, self._limbs = list(parts), limbs
        self._left = [Counter(part.counts) for part in parts]
        self.is_whole = bool(parts) and all(part.counts is not None for part in parts)

    def correct(self, stage: str, counts: Mapping[str, int]) -> None:
        """Put the number of simulations that a stage is about to make in place of the usual one."""
        for i, part in enumerate(self.parts):
            if part.stage == stage:
                self._left[i] = Counter(counts)

    def ended(self, limb_name: str, seconds: float) -> None:
        """Count a simulation that has ended, wherever it is from."""
        self._seconds += seconds
        self._work += work_of(limb_name, self._limbs)
        left = next((each for each in self._left if each[limb_name] > 0), None)
        if left is not None:
            left[limb_name] -= 1

    @property
    def n_left(self) -> int:
        """Simulations to come."""
        return sum(left.total() for left in self._left)

    def usual_s(self, limb_name: str) -> float | None:
        """Usual time of a simulation on a mesh; None before any has ended."""
        return work_of(limb_name, self._limbs) * self._seconds / self._work if self._work else None

    @property
    def seconds_left(self) -> float | None:
        """Time to come; None where it is not known."""
        if not (self.is_whole and self._work and self.n_workers):
            return None
        return sum(
            count * (self.usual_s(name) or 0.0) / min(self.n_workers, part.side_by_side or left.total())
            for part, left in zip(self.parts, self._left, strict=True)
            for name, count in left.items()
            if count
        )
