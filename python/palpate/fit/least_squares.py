"""The default search: least squares within the box, in trust regions."""

import numpy as np
from pydantic import Field
from scipy.optimize import lsq_linear

from palpate.domain import FloatArray
from palpate.plugins.interfaces import Settings
from palpate.plugins.search import Asking, Evaluation, Search, SearchSpace, Trial


class LeastSquaresSettings(Settings):
    """How far to step, and when to stop."""

    max_steps: int = Field(30, ge=1, description="most trial steps from one start")
    first_step: float = Field(0.3, gt=0.0, le=1.0, description="largest first step, as a share of each range")
    tolerance: float = Field(
        1e-3,
        gt=0.0,
        lt=1.0,
        description="relative gain of Fopt below which a step is not worth its simulations",
    )


class LeastSquares(Search[LeastSquaresSettings]):
    """Gauss-Newton steps within the box and a trust region; a step is kept if it gains."""

    name = "least_squares"
    summary = "bounded Gauss-Newton steps with exact slopes where the solver gives them"

    def search(self, space: SearchSpace) -> Asking:
        """Step from the start for as long as a step gains enough."""
        (here,) = yield [Trial(point=space.start, slopes=True)]
        if here.residuals is None:
            return f"the start cannot be simulated ({here.failure})"
        radius: float = self.settings.first_step
        floor = (0.1 * space.accuracy) ** 2
        for _ in range(self.settings.max_steps):
            if here.jacobian is None:
                return f"stopped: {here.failure}"
            step, expected = _step(here, radius)
            if expected < max(self.settings.tolerance * here.objective, floor):
                return "converged"
            (trial,) = yield [Trial(point=np.clip(here.point + step, 0.0, 1.0), slopes=space.exact_slopes)]
            gain = here.objective - trial.objective
            length = float(np.abs(step).max())
            if gain < 0.25 * expected:
                radius = 0.25 * length if gain <= 0.0 else 0.5 * length
            elif gain > 0.75 * expected and length > 0.99 * radius:
                radius = min(1.0, 2.0 * radius)
            if gain > 0.0:
                here = trial
                if here.jacobian is None and not here.failure:
                    (here,) = yield [Trial(point=here.point, slopes=True)]
            elif radius < SHORTEST:
                return "no step gains any more"
        return f"stopped after {self.settings.max_steps} steps"


SHORTEST = 1e-5
"""Trust region, as a share of each range, at which a search gives up."""


def _step(here: Evaluation, radius: float) -> tuple[FloatArray, float]:
    """Step of least linearised Σ r² in the box and the trust region, and what it would gain."""
    assert here.residuals is not None
    assert here.jacobian is not None
    jacobian, residuals = here.jacobian, here.residuals
    lower = np.maximum(-here.point, -radius)
    upper = np.minimum(1.0 - here.point, radius)
    # What no residual sees stays where it is.
    weak = 1e-6 * max(float(np.linalg.norm(jacobian, ord=2)), 1e-300)
    n = here.point.size
    q, r = np.linalg.qr(np.concatenate([jacobian, weak * np.eye(n)]))
    target = -q[: len(residuals)].T @ residuals
    free = upper > lower
    step = np.zeros(n)
    if free.any():
        found = lsq_linear(r[:, free], target, bounds=(lower[free], upper[free]), method="bvls")
        step[free] = np.clip(found.x, lower[free], upper[free])
    left = residuals + jacobian @ step
    return step, float(residuals @ residuals - left @ left)
