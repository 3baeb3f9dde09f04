"""The default search: least squares within the box, in trust regions."""

from dataclasses import replace

import numpy as np
import scipy
from pydantic import Field

from palpate.domain import BoolArray, FloatArray
from palpate.domain.component import Settings
from palpate.fit.bounded import linear_least
from palpate.plugins.search import Asking, Evaluation, Search, SearchSpace, Trial


class LeastSquaresSettings(Settings):
    """Length of steps, and limits at which to stop."""

    max_steps: int = Field(100, ge=1, description="most trial steps from one start")
    first_step: float = Field(0.3, gt=0.0, le=1.0, description="largest first step, as a share of each range")
    tolerance: float | None = Field(
        None,
        gt=0.0,
        lt=1.0,
        description="relative gain of Fopt below which a step is not worth its simulations; "
        "by default 100 times the solver's accuracy",
    )


class LeastSquares(Search[LeastSquaresSettings]):
    """Gauss-Newton steps within the box and a trust region; a step is kept if it gains."""

    name = "least_squares"
    summary = "bounded Gauss-Newton steps with exact slopes where the solver gives them"
    usual_trials = 5

    def search(self, space: SearchSpace) -> Asking:
        """Step from the start for as long as a step gains enough."""
        (here,) = yield [Trial(point=space.start, slopes=True)]
        if here.residuals is None:
            return f"the start cannot be simulated ({here.failure})"
        if here.jacobian is None:
            return f"stopped at the start: {here.failure}"
        radius: float = self.settings.first_step
        floor = (0.1 * space.accuracy) ** 2
        tolerance = self.settings.tolerance or min(100.0 * space.accuracy, 0.1)
        model = _Model(space, here)
        for _ in range(self.settings.max_steps):
            step, expected = model.step(radius)
            if expected < max(tolerance * here.objective, floor):
                return "converged"
            (trial,) = yield [Trial(point=np.clip(here.point + step, 0.0, 1.0), slopes=space.exact_slopes)]
            is_bent = model.bends_towards(trial)
            gain = here.objective - trial.objective
            length = float(np.abs(step).max())
            if gain < 0.25 * expected:
                radius = 0.25 * length if gain <= 0.0 else 0.5 * length
            elif gain > 0.75 * expected and length > 0.99 * radius:
                radius = min(1.0, 2.0 * radius)
            if gain > 0.0:
                if trial.jacobian is None and not trial.failure:
                    (trial,) = yield [Trial(point=trial.point, slopes=True)]
                here = trial if trial.jacobian is not None else _secant(here, trial)
            elif radius < 1e-5:  # a share of each range
                return "no step gains any more"
            model = _Model(space, here, is_bent=is_bent)
        return f"stopped after {self.settings.max_steps} steps"


def _secant(before: Evaluation, after: Evaluation) -> Evaluation:
    """Slopes for an evaluation that has none: those before it, changed along the step (Broyden 1965)."""
    assert before.residuals is not None
    assert before.jacobian is not None
    assert after.residuals is not None
    step = after.point - before.point
    missed = after.residuals - before.residuals - before.jacobian @ step
    return replace(after, jacobian=before.jacobian + np.outer(missed, step) / (step @ step))


class _Model:
    """Residuals near an evaluation: linear in the values of moduli, as curves nearly are, or in coordinates.

    Steps of the former are bent: in proportion to steps of the values, and as long as steps in coordinates
    where short. The latter hold along a valley of moduli and exponents, where a modulus goes with a power.
    """

    def __init__(self, space: SearchSpace, here: Evaluation, *, is_bent: bool = True) -> None:
        assert here.residuals is not None
        assert here.jacobian is not None
        self.space, self.point = space, here.point
        self.residuals, self.jacobian = here.residuals, here.jacobian
        # Logarithms of upper over lower bound, by which moduli in logarithms are bent.
        pairs = zip(space.parameters, space.log, strict=True)
        bent = [np.log(p.upper / p.lower) if log and p.kind == "modulus" else 0.0 for p, log in pairs]
        self.bent, self.straight = np.maximum(bent, 1e-9), np.full(here.point.size, 1e-9)
        self.is_bent, self.powers = is_bent, self.bent if is_bent else self.straight

    def bends_towards(self, trial: Evaluation) -> bool:
        """True if the values of moduli have predicted a trial better than their coordinates have."""
        if trial.residuals is None:
            return self.is_bent
        there, step = trial.residuals - self.residuals, trial.point - self.point
        missed = [
            float(np.linalg.norm(there - self.jacobian @ (np.expm1(powers * step) / powers)))
            for powers in (self.bent, self.straight)
        ]
        return missed[0] <= missed[1]

    def step(self, radius: float) -> tuple[FloatArray, float]:
        """Step in coordinates of least Σ r² in the box and the trust region, and what it would gain."""
        lower = np.expm1(self.powers * np.maximum(-self.point, -radius)) / self.powers
        upper = np.expm1(self.powers * np.minimum(1.0 - self.point, radius)) / self.powers
        # What no residual sees stays where it is.
        weak = 1e-6 * max(float(np.linalg.norm(self.jacobian, ord=2)), 1e-300)
        n = self.point.size
        q, r = np.linalg.qr(np.concatenate([self.jacobian, weak * np.eye(n)]))
        target = -q[: len(self.residuals)].T @ self.residuals
        bent = linear_least(r, target, lower, upper)
        gain = float(self._gains(bent[None])[0])
        if not self._accepts(bent[None])[0]:
            bent, gain = self._accepted(np.linalg.inv(r) * np.sqrt(max(gain, 0.0)), lower, upper)
        return np.log1p(self.powers * bent) / self.powers, gain

    def _accepted(self, axes: FloatArray, lower: FloatArray, upper: FloatArray) -> tuple[FloatArray, float]:
        """Step that gains most of many that filters accept, along axes that are as long as they matter."""
        spread = 2.0 * scipy.stats.qmc.Sobol(len(axes), scramble=False).random(256) - 1.0
        best, gain = np.zeros(len(axes)), 0.0
        for width in 0.5 ** np.arange(8):
            steps = np.clip(best + width * spread @ axes.T, lower, upper)
            gains = np.where(self._accepts(steps), self._gains(steps), 0.0)
            if gains.max() > gain:
                best, gain = steps[np.argmax(gains)], float(gains.max())
        return best, gain

    def _accepts(self, bent: FloatArray) -> BoolArray:
        points = self.point + np.log1p(self.powers * bent) / self.powers
        return self.space.accepts(np.clip(points, 0.0, 1.0))

    def _gains(self, bent: FloatArray) -> FloatArray:
        """Gains of steps (n, n_parameters)."""
        left = self.residuals + bent @ self.jacobian.T
        return self.residuals @ self.residuals - (left**2).sum(axis=1)
