"""Two verifications that a torque is the material's and not the solver's.

Friction that remembers gives the same torque however finely the twist is cut,
and keeps it while the indenter is held. One more run verifies both: every step in
two halves up to the first turn of the rotation, and then a hold.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from palpate.api import Status
from palpate_febio.steps import Steps, halved, up_to_first_turn, with_hold
from palpate_febio.verdict import Verdict

N_HELD = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Verification:
    """What the two checks found: changes relative to the verified torque, None if unknown."""

    tolerance: float
    halving: float | None = None
    hold: float | None = None
    message: str = ""

    @property
    def passed(self) -> bool:
        """Whether the torque is one to rely on."""
        changes = (self.halving, self.hold)
        return all(change is not None and abs(change) <= self.tolerance for change in changes)

    def row(self) -> dict[str, Any]:
        """For the diagnostics and the run's table of verifications."""
        return {
            "passed": self.passed,
            "message": str(self),
            "halving": self.halving,
            "hold": self.hold,
            "tolerance": self.tolerance,
        }

    def __str__(self) -> str:
        if self.halving is None or self.hold is None:
            found = "" if self.halving is None else f"halved steps change it by {self.halving:+.1%}, and "
            return f"torque not verified: {found}{self.message}"
        verdict = "torque verified" if self.passed else "torque NOT to be relied on"
        return (
            f"{verdict}: halved steps change it by {self.halving:+.1%}, a hold by {self.hold:+.1%} "
            f"({self.tolerance:.1%} allowed)"
        )


def check_torque(
    steps: Steps, torque_Nmm: float, run: Callable[[Steps], Verdict], tolerance: float
) -> Verification:
    """Run once more, finer and with a hold, and compare.

    Parameters
    ----------
    steps : Steps
        Of the run to be verified.
    torque_Nmm : float
        Its answer where the rotation first turns.
    run : callable
        Simulates other steps.
    tolerance : float
        Largest relative change.
    """
    if not torque_Nmm:
        return Verification(tolerance=tolerance, message="there is no torque where the rotation first turns")
    fine = halved(up_to_first_turn(steps))
    verdict = run(with_hold(fine, N_HELD))
    turned = verdict.status in (Status.OK, Status.DIVERGED) and verdict.n_steps >= fine.n
    before = float(verdict.torque_Nmm[fine.n]) if turned else None
    held = (
        None if before is None or verdict.status is not Status.OK else float(verdict.torque_Nmm[-1]) - before
    )
    return Verification(
        tolerance=tolerance,
        halving=None if before is None else (before - torque_Nmm) / torque_Nmm,
        hold=None if held is None else held / torque_Nmm,
        message="" if held is not None else f"the finer run did not end well ({verdict.message})",
    )
