"""A held-out press is inside its band as often as the band says, and one that does not belong is found."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest

from palpate.domain import Response
from palpate_certainty import held_out as module
from palpate_certainty.assessment import Assessment
from palpate_certainty.held_out import BAND, held_out, is_apart, sentence
from palpate_certainty.laplace import PRIORS
from palpate_certainty.linear_problem import LinearProblem, ResidualErrors, errors_without
from palpate_certainty.noise_model import ErrorScale, NoiseModel, ResidualLayout, grouped, groups_of
from palpate_materials.uncoupled import Ogden

SPOTS, POINTS = ("p1", "p2", "p3"), 12
KNOWN_SCALE = ErrorScale(factor=1.0, freedom=1e9)


def layout():
    """Two channels at each spot."""
    n = len(SPOTS) * 2 * POINTS
    spot, channel = np.repeat([0, 1, 2], 2 * POINTS), np.tile(np.repeat([0, 1], POINTS), len(SPOTS))
    point = np.tile(np.arange(POINTS, dtype=float), 2 * len(SPOTS))
    path = (point + 1.0) / POINTS
    return ResidualLayout(
        spot=spot, site=spot, channel=channel, point=point, path=path, scale=np.ones(n), envelope=path
    )


def test_curves_that_belong_are_inside_as_often_as_the_band_says(monkeypatch):
    rng, rows = np.random.default_rng(5), layout()
    errors = NoiseModel(
        of_lengths={(0.0, 0.35): ({0: 1e-4, 1: 2e-4}, {0: 4e-4, 1: 1e-4}, {0: 4e-4, 1: 1e-4})},
        correlations={(0.0, 0.35): 1.0},
    )
    jacobian = rng.normal(size=(rows.spot.size, 3)) * rows.envelope[:, None] + np.array([1.0, 0.0, 0.5])
    gains = 0.02 * np.stack([rows.channel == 0, rows.channel == 1], axis=1) * rows.envelope[:, None]
    known = {"gain": gains, PRIORS: np.zeros((rows.spot.size, rows.spot.size))}
    root = np.linalg.cholesky(sum(errors.covariances(rows)) + gains @ gains.T)
    known_errors = ResidualErrors(noise=errors, scale=KNOWN_SCALE)
    monkeypatch.setattr(module, "errors_without", lambda *_: known_errors)
    inside = []
    for _ in range(100):
        moved = 0.05 * rng.normal(size=3)
        residuals = root @ rng.normal(size=rows.spot.size) + jacobian @ moved
        linear = LinearProblem(
            point=0.5 + moved,
            residuals=residuals,
            jacobian=jacobian,
            rows=rows,
            known=known,
            channels=("force", "torque"),
            groups=np.eye(rows.spot.size),
            expected={0: 0.01, 1: 0.01},
        )
        terms = [SimpleNamespace(spot=spot) for spot in SPOTS]
        end = SimpleNamespace(problem=SimpleNamespace(terms=terms))
        assessed = SimpleNamespace(linear=linear, end=end, errors=known_errors)
        inside += held_out(assessed)["inside"].to_list()
    assert np.mean(inside) == pytest.approx(BAND, abs=0.05)


@pytest.mark.parametrize(("n_kept", "is_known"), [(1, True), (2, False)])
def test_presses_of_one_site_do_not_tell_the_model_error(n_kept, is_known):
    """Parameters absorb most of what a wrong law misses at one site; from two on the others tell."""
    rng, rows = np.random.default_rng(6), layout()
    sizes = {0: 0.02**2, 1: 0.02**2}
    noise = NoiseModel(of_lengths={(0.0, 0.35): (sizes,) * 3}, correlations={(0.0, 0.35): 1.0})
    known = ResidualErrors(noise=noise, scale=KNOWN_SCALE)
    linear = LinearProblem(
        point=np.full(1, 0.5),
        residuals=1e-3 * rng.normal(size=rows.spot.size),
        jacobian=rows.envelope[:, None],
        rows=rows,
        known={"gain": 1e-3 * rows.envelope[:, None]},
        channels=("force", "torque"),
        groups=np.eye(rows.spot.size),
        expected={0: 0.001, 1: 0.001},
    )
    found = errors_without(linear, rows.spot < n_kept, known).noise.discrepancy
    assert (found == noise.discrepancy) == is_known
    assert max(found.values()) < 0.01 or is_known


@pytest.mark.parametrize("n", [40, 64, 200, 640])
def test_a_difference_is_the_share_that_it_is_however_many_points_there_are(n):
    first, ones = np.zeros(n, dtype=int), np.ones(n)
    rows = ResidualLayout(
        spot=first,
        site=first,
        channel=first,
        point=np.arange(n, dtype=float),
        path=np.linspace(0.0, 1.0, n),
        scale=ones,
        envelope=ones,
    )
    groups = groups_of(rows)
    share = groups @ (0.02 * ones) / grouped(rows, groups).scale
    found = module._compared(share, 1e-4 * np.eye(share.size), int((groups > 0.0).sum()), 1e9)
    assert found["difference"] == pytest.approx(0.02)


@pytest.fixture
def assessed_of(pressed, stage_of):
    """Assess the joint fit of as many spots, whose curves at p1 are multiplied."""

    def made(spots, times=1.0):
        study = pressed.study_of(Ogden(), ("c1",), spots=spots)
        truth = np.array([0.08])
        measured = {spot: pressed.measured_at(study, truth, 0.004, i) for i, spot in enumerate(spots)}
        curves = measured["p1"].curves.items()
        scaled = {name: replace(curve, ordinate=times * curve.ordinate) for name, curve in curves}
        measured["p1"] = Response(curves=scaled)
        cases = stage_of(study, measured).run()
        joint = max(cases, key=lambda case: len(case.spots))
        (found,) = Assessment(study=study, measured=measured).assessed([joint], joint_only=True)
        return held_out(found)

    return made


def test_a_press_of_a_stiffer_place_does_not_belong_to_the_others(assessed_of):
    table = assessed_of(SPOTS, times=1.4)
    worst = table.sort("probability").row(0, named=True)
    assert (worst["spot"], worst["inside"]) == ("p1", False)
    assert is_apart(table)
    assert "at p1" in sentence(table)
    assert sentence(table).endswith("it does not belong to the others")


@pytest.mark.slow
def test_presses_of_one_tissue_belong_together(assessed_of):
    table = assessed_of(SPOTS)
    assert table.select("spot", "channel").rows() == [(s, c) for s in SPOTS for c in ("force", "torque")]
    assert not is_apart(table)
    assert sentence(table).startswith(f"{table['inside'].sum()} of 6 curves of held-out presses are inside")


def test_of_one_press_each_channel_is_predicted_by_the_other(assessed_of):
    table = assessed_of(("p1",))
    assert table["channel"].to_list() == ["force", "torque"]
    text = sentence(table)
    assert text.startswith("each curve of the only press (p1) was predicted from its other channels: ")
    assert "held-out presses" not in text
    assert (table["difference"] < 3.0 * table["band"]).all()


@pytest.mark.parametrize(
    ("spots", "expected"),
    [
        (("p1", "p2"), "1 of 2 curves of held-out presses is inside its 90 % band; farthest off is "),
        (
            ("p1", "p1"),
            "each curve of the only press (p1) was predicted from its other channels: 1 of 2 is inside its ",
        ),
    ],
)
def test_one_press_and_several_are_told_apart(spots, expected):
    rows = zip(spots, (0.5, 0.04), (True, False), strict=True)
    assert sentence(table_of(rows)).startswith(expected)


def table_of(rows):
    return pl.DataFrame(
        [
            {
                "spot": spot,
                "channel": "torque",
                "difference": 0.041,
                "band": 0.019,
                "probability": p,
                "inside": ok,
            }
            for spot, p, ok in rows
        ]
    )


def test_the_sentence_names_the_curve_that_is_farthest_off():
    table = table_of([("p1", 0.5, True), ("p2", 0.04, False), ("p3", 0.6, True)])
    assert sentence(table) == (
        "2 of 3 curves of held-out presses are inside their 90 % bands; farthest off is torque at p2, "
        "by 4.1 % of its peak (band 1.9 %)"
    )
