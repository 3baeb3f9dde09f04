"""Two proofs that a torque is the material's and not the solver's.

Friction that remembers gives the same torque however finely the twist is cut,
and keeps it while the indenter is held. One more run proves both: every step in
two halves up to the first turn of the rotation, and then a hold.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.domain import FloatArray, Status
from palpate_febio.steps import Steps, halved, up_to_first_turn, with_hold
from palpate_febio.verdict import Verdict

N_HELD = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Gates:
    """What the two gates found; changes are relative to the torque of the run that is proved."""

    halving: float
    hold: float
    tolerance: float
    message: str = ""

    @property
    def passed(self) -> bool:
        """Whether the torque is one to rely on."""
        return not self.message and max(abs(self.halving), abs(self.hold)) <= self.tolerance

    def row(self) -> dict[str, Any]:
        """For the diagnostics."""
        return {
            "passed": self.passed,
            "halving": self.halving,
            "hold": self.hold,
            "tolerance": self.tolerance,
            "message": self.message,
        }

    def __str__(self) -> str:
        if self.message:
            return f"torque not proved: {self.message}"
        verdict = "torque proved" if self.passed else "torque NOT to be relied on"
        return (
            f"{verdict}: halved steps change it by {self.halving:+.1%}, a hold by {self.hold:+.1%} "
            f"({self.tolerance:.1%} allowed)"
        )


def check_torque(steps: Steps, rows: FloatArray, run: Callable[[Steps], Verdict], tolerance: float) -> Gates:
    """Run once more, finer and with a hold, and compare.

    Parameters
    ----------
    steps : Steps
        Of the run to be proved.
    rows : (n + 1, 4) array
        Its answer; the last column is the torque.
    run : callable
        Simulates other steps.
    tolerance : float
        Largest relative change.
    """
    first = up_to_first_turn(steps)
    fine = halved(first)
    verdict = run(with_hold(fine, N_HELD))
    nothing = {"halving": np.nan, "hold": np.nan, "tolerance": tolerance}
    if verdict.status is not Status.OK:
        return Gates(**nothing, message=f"the finer run did not end well ({verdict.message})")
    coarse, before, after = rows[first.n, 3], verdict.rows[fine.n, 3], verdict.rows[-1, 3]
    if not coarse:
        return Gates(**nothing, message="there is no torque where the rotation first turns")
    return Gates(
        halving=float((before - coarse) / abs(coarse) * np.sign(coarse)),
        hold=float((after - before) / abs(coarse) * np.sign(coarse)),
        tolerance=tolerance,
    )
