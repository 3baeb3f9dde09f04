"""Limits of every verdict on a model and its values, each with its evidence."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Thresholds:
    """Limits of verdicts. Those without evidence are conventions.

    Parameters
    ----------
    well, roughly, poorly : float
        Widest interval with each of these words, over the value or the range: ``docs/identifiability.md``.
    end : float
        Share of a range within which a value is at its end.
    no_fit_r2, good_r2 : float
        R² in a fitted channel below which a set is called no fit, and a poor one.
    close_difference, close_r2 : float
        Largest difference over the peak, and least R² of a spot, of a model that approximates a channel. The
        second presses that such models predict are in ``benchmarks/evidence.md#other-laws-and-spots``.
    allowed : float
        Difference of a model that does not describe the data, over the standard deviation of a good one's:
        four of these happen to 1 good model in 16,000.
    unusual : float
        Probability of residuals under which a model does not describe the data, by a test for another law.
        Chosen on even seeds of ``bench_laws.py --laws``: 1 of 90 right laws is called wrong.
    outside : float
        Probability of a fit as far outside of the ranges, under which its model does not describe the data.
    spots : float
        Probability of spots that differ so much, under which each has parameters of its own.
    held_out : float
        Probability of the farthest held-out curve under which its press does not belong to the others. By
        ``bench_held_out.py`` 1 of 40 sound studies has such a press.
    misfit : float
        Probability of the largest misfit under which the data show more model error than the study states.
    relaxed : float
        Standard deviations of a channel's calibration by which it may fall in a rest.
    correlated : float
        Correlation of two parameters from which on a sentence names it.
    narrowed : float
        Width after a planned press over the width before, above which the press does not narrow an interval.
    """

    well: float = 0.1
    roughly: float = 0.3
    poorly: float = 0.8
    end: float = 0.01
    no_fit_r2: float = 0.5
    good_r2: float = 0.95
    close_difference: float = 0.2
    close_r2: float = 0.9
    allowed: float = 4.0
    unusual: float = 0.02
    outside: float = 1e-3
    spots: float = 0.05
    held_out: float = 0.05
    misfit: float = 0.05
    relaxed: float = 2.0
    correlated: float = 0.9
    narrowed: float = 0.95


THRESHOLDS = Thresholds()
