"""Searches that use no slopes: the best set of the sweep as it is, and one that covers the whole box."""

import numpy as np
import scipy
from pydantic import Field

from palpate.domain.component import Settings
from palpate.plugins.search import Asking, Search, SearchSpace, Trial


class BestSet(Search):
    """The paper's way: the set of the sweep that fits best, and no step from there."""

    name = "sweep"
    summary = "the best set of the sweep as it is, as in the paper"

    def search(self, space: SearchSpace) -> Asking:
        """Ask for the start alone."""
        yield [Trial(point=space.start)]
        return "the best set of the sweep"


class DifferentialEvolutionSettings(Settings):
    """Size of a population, and its number of generations."""

    population: int = Field(10, ge=4, description="points for each parameter")
    max_generations: int = Field(100, ge=1, description="most generations")
    tolerance: float = Field(
        0.01, gt=0.0, description="spread of the population's Fopt over its mean at which it has settled"
    )


class DifferentialEvolution(Search[DifferentialEvolutionSettings]):
    """Differential evolution (Storn & Price 1997, best/1/bin), a whole generation side by side."""

    name = "differential_evolution"
    local = False
    summary = "a population that covers the whole box and needs no slopes; hundreds of simulations"

    def search(self, space: SearchSpace) -> Asking:
        """Replace each point by one that is made of others, where that fits better."""
        rng = np.random.default_rng(space.seed)
        n = space.start.size
        size = max(5, self.settings.population * n)
        points = scipy.stats.qmc.LatinHypercube(n, rng=rng).random(size)
        points[0] = space.start
        found = yield [Trial(point=point) for point in points]
        objectives = np.array([each.objective for each in found])
        for _ in range(self.settings.max_generations):
            finite = objectives[np.isfinite(objectives)]
            if finite.size == size and np.ptp(finite) <= self.settings.tolerance * abs(finite.mean()):
                return "converged"
            factor = rng.uniform(0.5, 1.0)
            best = points[np.argmin(objectives)]
            made = np.empty_like(points)
            for i in range(size):
                a, b = rng.choice([j for j in range(size) if j != i], 2, replace=False)
                mutant = best + factor * (points[a] - points[b])
                outside = np.asarray((mutant < 0.0) | (mutant > 1.0))
                mutant[outside] = rng.random(int(outside.sum()))
                crossed = np.less(rng.random(n), 0.7)
                crossed[rng.integers(n)] = True
                made[i] = np.where(crossed, mutant, points[i])
            found = yield [Trial(point=point) for point in made]
            new = np.array([each.objective for each in found])
            better = new <= objectives
            points[better], objectives[better] = made[better], new[better]
        return f"stopped after {self.settings.max_generations} generations"
