"""The best set of the sweep, and differential evolution."""

from dataclasses import replace
from itertools import chain

import numpy as np

from palpate.fit.searches import BestSet, DifferentialEvolution, DifferentialEvolutionSettings
from palpate.plugins.search import Evaluation
from palpate.testing import Rehearsal
from palpate.testing.fits import toy_space


def two_basins(point):
    """Least at (0.85, 0.2), and almost as good at (0.2, 0.8)."""
    deep = 1.0 - np.exp(-40.0 * ((point - [0.85, 0.2]) ** 2).sum())
    return min(deep, 0.3 + ((point - [0.2, 0.8]) ** 2).sum())


def evolve(objective, seed=1, **settings):
    """Generations of points, and why they ended."""
    space = replace(toy_space(np.array([0.2, 0.8]), exact_slopes=False), seed=seed)
    asking, answers, generations = (
        DifferentialEvolution(DifferentialEvolutionSettings(**settings)).search(space),
        None,
        [],
    )
    while True:
        try:
            trials = asking.send(answers)
        except StopIteration as end:
            return generations, end.value
        points = [trial.point.copy() for trial in trials]
        generations.append((points, [objective(point) for point in points]))
        answers = [
            Evaluation(point=point, objective=value, fopt=value)
            for point, value in zip(*generations[-1], strict=True)
        ]


def test_the_best_set_is_asked_for_alone():
    run = Rehearsal(BestSet()).run()
    assert (len(run.points), run.message) == (1, "the best set of the sweep")


def test_evolution_leaves_the_basin_that_it_starts_in():
    generations, message = evolve(two_basins)
    points, objectives = (list(chain(*each)) for each in zip(*generations, strict=True))
    np.testing.assert_allclose(points[int(np.argmin(objectives))], [0.85, 0.2], atol=0.02)
    assert message == "converged"


def test_a_generation_has_its_size_begins_at_the_start_and_uses_no_slopes():
    generations, message = evolve(two_basins, population=6, max_generations=3, tolerance=1e-9)
    assert [len(points) for points, _ in generations] == [12] * 4
    assert generations[0][0][0].tolist() == [0.2, 0.8]
    assert message == "stopped after 3 generations"


def test_its_seed_decides_it():
    first, again, other = (evolve(two_basins, seed=seed, max_generations=3)[0] for seed in (1, 1, 2))
    assert np.array_equal([p for p, _ in first], [p for p, _ in again])
    assert not np.array_equal([p for p, _ in first], [p for p, _ in other])


def test_failed_points_are_replaced_and_end_nothing():
    generations, message = evolve(lambda p: np.inf if p[0] > 0.5 else ((p - [0.3, 0.6]) ** 2).sum() + 0.1)
    objectives = [value for _, values in generations for value in values]
    assert min(objectives) < 0.101
    assert message == "converged"
