"""Laws of scoring whole responses."""

import numpy as np
from hypothesis import given, strategies as st

from palpate.domain import Curve, Job, Normaliser, Response, Scenario, Simulation, Status
from palpate.plugins.score import Nmse, NmseSettings, ScoringRules
from palpate.scoring.scores import score

SCALED = [n for n in Normaliser if n is not Normaliser.UNIT]
loops = st.lists(st.floats(1.0, 30.0), min_size=4, max_size=25).map(np.array)
factors = st.floats(0.01, 100.0)


def twist(values):
    """A path 0 → −1 → 1 → 0 with one value per point, of one sign so that no normaliser degenerates."""
    n = len(values)
    turns = np.array([0.0, -1.0, 1.0, 0.0])
    x = np.interp(np.linspace(0.0, 3.0, 3 * n + 1), np.arange(4), turns)
    return x, np.resize(values, x.size) + 0.01 * np.arange(x.size)


def scored(pairs, measured, normaliser=Normaliser.RMS, scenarios=()):
    job = {i: Job(spot="p", set_id=i, materials={}, thetas={}, protocol=None) for i in range(len(pairs))}
    simulations = [
        Simulation(
            job=job[i],
            status=Status.OK,
            response=Response(curves={"t": Curve(channel="t", abscissa=x, ordinate=y)}),
        )
        for i, (x, y) in enumerate(pairs)
    ]
    experiment = {"p": Response(curves={"t": Curve(channel="t", abscissa=measured[0], ordinate=measured[1])})}
    rules = ScoringRules(score=Nmse(NmseSettings(normaliser=normaliser)), minimum_coverage=0.9)
    return score(simulations, experiment, rules, scenarios)


@given(loops, st.sampled_from(Normaliser))
def test_the_measured_path_itself_scores_zero(values, normaliser):
    path = twist(values)
    row = scored([path], path, normaliser).row(0, named=True)
    assert (row["nmse"], row["coverage"], row["r2"]) == (0.0, 1.0, 1.0)


@given(loops, st.floats(-0.9, 0.9))
def test_a_uniform_error_scores_its_square_with_rms(values, error):
    x, y = twist(values)
    np.testing.assert_allclose(
        scored([(x, y * (1 + error))], (x, y))["nmse"][0], error**2, rtol=1e-9, atol=1e-20
    )


@given(loops, loops, factors, st.sampled_from(SCALED))
def test_one_factor_on_both_changes_nothing(values, others, factor, normaliser):
    (x, y), (_, z) = twist(values), twist(np.resize(others, values.size))
    before = scored([(x, z)], (x, y), normaliser)["nmse"][0]
    after = scored([(x, z * factor)], (x, y * factor), normaliser)["nmse"][0]
    np.testing.assert_allclose(after, before, rtol=1e-9, atol=1e-18)


@given(loops, loops)
def test_a_set_scores_the_same_alone_and_in_a_batch(values, others):
    (x, y), (_, z) = twist(values), twist(np.resize(others, values.size))
    alone = scored([(x, z)], (x, y))["nmse"][0]
    company = scored([(x, y), (x, z), (x, 2 * z)], (x, y))["nmse"].to_list()
    assert company[1] == alone


@given(loops, st.integers(2, 5))
def test_points_between_the_simulated_ones_add_nothing(values, n_between):
    """A finer simulated path through the same curve scores the same."""
    x, y = twist(values)
    at = np.arange(x.size)
    fine = np.linspace(0, x.size - 1, (x.size - 1) * n_between + 1)
    finer = (np.interp(fine, at, x), np.interp(fine, at, y))
    assert scored([finer], (x, y))["nmse"][0] < 1e-18


@given(loops, st.floats(0.05, 0.95))
def test_coverage_is_the_share_reached(values, share):
    x, y = twist(values)
    n = max(2, int(share * x.size))
    row = scored([(x[:n], y[:n])], (x, y)).row(0, named=True)
    assert abs(row["coverage"] - n / x.size) < 1e-12
    assert (row["nmse"] is None) == (n / x.size < 0.9)


def by_phase(pairs, measured):
    """NMSE of the whole of the first path and of its phases, and the measured points of each phase."""
    weights = {"t/load": 1.0, "t/unload": 1.0}
    scores = scored(pairs, measured, scenarios=(Scenario(name="both", weights=weights),))
    curve = Curve(channel="t", abscissa=measured[0], ordinate=measured[1])
    counted = {name: curve.counted(name) for name in weights}
    return dict(scores.filter(set_id=0).select("channel", "nmse").iter_rows()), counted


@given(loops, loops)
def test_phases_weighed_by_their_points_are_the_whole(values, others):
    (x, y), (_, z) = twist(values), twist(np.resize(others, values.size))
    nmse, counted = by_phase([(x, z)], (x, y))
    together = sum(mask.mean() * nmse[name] for name, mask in counted.items())
    np.testing.assert_allclose(together, nmse["t"], rtol=1e-9, atol=1e-20)


@given(loops, loops)
def test_a_phase_ignores_the_points_of_the_other(values, others):
    (x, y), (_, z) = twist(values), twist(np.resize(others, values.size))
    before, counted = by_phase([(x, z)], (x, y))
    after, _ = by_phase([(x, np.where(counted["t/load"], z, -3.0 * z))], (x, y))
    assert after["t/load"] == before["t/load"]
    assert after["t/unload"] > before["t/unload"]
