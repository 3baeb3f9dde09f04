"""Each law of searches fails on what breaks it, with the reason."""

import numpy as np
import pytest

from palpate.fit.least_squares import LeastSquares
from palpate.plugins.search import Search, Trial
from palpate.testing import SearchContract


class OutOfTheBox(Search):
    name, summary = "out_of_the_box", "steps without bounds"

    def search(self, space):
        yield [Trial(point=space.start - 1.0)]
        return "ended"


class OfAnotherShape(OutOfTheBox):
    def search(self, space):
        yield [Trial(point=np.array([0.5]))]
        return "ended"


class Idle(OutOfTheBox):
    def search(self, space):
        yield []
        return "ended"


class Endless(OutOfTheBox):
    def search(self, space):
        while True:
            yield [Trial(point=space.start)]


class Mute(OutOfTheBox):
    def search(self, space):
        yield [Trial(point=space.start)]


class OfNoWord(OutOfTheBox):
    def search(self, space):
        yield [Trial(point=space.start)]
        return " "


class Content(OutOfTheBox):
    def search(self, space):
        yield [Trial(point=space.start)]
        return "good enough"


class Unseeded(OutOfTheBox):
    def search(self, space):
        yield [Trial(point=np.random.default_rng().random(space.start.size))]
        return "ended"


class Remembering(LeastSquares):
    """Keeps in the object where it is."""

    def search(self, space):
        self.best = np.inf
        for share in (0.3, 0.5, 0.7):
            (found,) = yield [Trial(point=np.full(space.start.size, share))]
            self.best = min(self.best, found.objective)
        yield [Trial(point=np.full(space.start.size, 1.0 / (1.0 + self.best)))]
        return "ended"


class Blind(OutOfTheBox):
    """Takes slopes for granted."""

    def search(self, space):
        (found,) = yield [Trial(point=space.start, slopes=True)]
        return f"ended at a slope of {found.jacobian.sum()}"


class Corner(LeastSquares):
    """Cuts steps at the bounds, and ends there."""

    def search(self, space):
        (found,) = yield [Trial(point=space.start, slopes=True)]
        step = np.linalg.lstsq(found.jacobian, -found.residuals)[0]
        yield [Trial(point=np.clip(space.start + step, 0.0, 1.0))]
        return "ended"


def never(number, point):
    return False


@pytest.mark.parametrize(
    ("test", "search", "more", "message"),
    [
        (
            "finds_the_least_of_a_bowl",
            OutOfTheBox,
            {"left": 1.0, "exact_slopes": True},
            "outside the unit box",
        ),
        (
            "finds_the_least_of_a_bowl",
            OfAnotherShape,
            {"left": 1.0, "exact_slopes": True},
            r"of shape \(1,\)",
        ),
        ("finds_the_least_of_a_bowl", Idle, {"left": 1.0, "exact_slopes": True}, "asks for no trial"),
        (
            "finds_the_least_of_a_bowl",
            Content,
            {"left": 0.01, "exact_slopes": True},
            "1e.02 % of what there was",
        ),
        ("finds_a_least_at_a_bound", Corner, {"left": 0.01}, "% of what there was"),
        ("follows_a_valley", Content, {"left": 0.01}, "% of what there was"),
        ("leaves_a_bound", Content, {"left": 0.01}, "% of what there was"),
        ("the_same_answers_bring_the_same_questions", Unseeded, {}, "take every number from space.seed"),
        ("searches_side_by_side_do_not_meet", Remembering, {}, "keep what changes in variables of `search`"),
        ("survives_failed_trials", Endless, {"fails": never}, "has not ended after"),
        ("survives_failed_trials", Mute, {"fails": never}, "ends with None, not with a text"),
        ("survives_failed_trials", OfNoWord, {"fails": never}, "ends with an empty text"),
    ],
)
def test_a_searchs_fault_is_reported(test, search, more, message):
    method = getattr(SearchContract(), f"test_{test}")
    method(LeastSquares(), **more)
    with pytest.raises(AssertionError, match=message):
        method(search(), **more)


def test_a_search_that_takes_slopes_for_granted_is_reported():
    with pytest.raises(AttributeError):
        SearchContract().test_survives_without_slopes(Blind())
    with pytest.raises(AttributeError):
        SearchContract().test_survives_failed_trials(Blind(), lambda number, point: True)
