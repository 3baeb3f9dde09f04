"""Bands of predictions: draws, slopes, and errors by the mesh."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from palpate.domain import (
    Curve,
    Indentation,
    Status,
)
from palpate.domain.indenter import Sphere
from palpate.domain.waypoints import Waypoints
from palpate.fit.fitted import Fitted
from palpate_prediction.bands import ends, linear, values_at, with_model_error
from palpate_prediction.files import _of_model
from palpate_prediction.summary import (
    QUANTITIES,
    PressStates,
    contact_of,
    curve_errors,
    ends_by_force,
    force_error,
    is_by_force,
    mesh_errors,
    spread,
    stiffer_by,
    summary_rows,
)

from .skins import skin


def test_draws_of_a_band_are_spread_over_all_that_there_are():
    rows = pl.DataFrame({"k": np.arange(1000.0)}).with_columns(
        fit=pl.lit("all spots"), scenario=pl.lit("both")
    )
    found = Fitted(source="fit", fit="all spots", scenario="both", values={"k": 0.0}, spots=("p1",))
    drawn = [
        row["k"]
        for row in values_at("p1", found, lambda name: rows if name == "draws" else pl.DataFrame()).draws
    ]
    assert (len(drawn), drawn[0], drawn[-1]) == (400, 0.0, 999.0)
    assert np.mean(drawn) == pytest.approx(499.5, abs=1.0)


def test_where_spots_differ_a_fitted_spot_has_its_own_draws_and_a_new_one_draws_of_their_differences():
    def frame(label, values):
        return pl.DataFrame({"k": values}).with_columns(fit=pl.lit(label), scenario=pl.lit("both"))

    own = pl.DataFrame([{"fit": "p1", "scenario": "both", "parameter": "k", "value": 4.0}])
    draws = pl.concat([frame("all spots", [1.0, 9.0]), frame("p1", [3.9, 4.1])])
    known = {"intervals": own, "draws": draws}
    differing = known | {"spot_draws": frame("all spots", [-20.0, 20.0])}
    found = Fitted(source="fit", fit="all spots", scenario="both", values={"k": 5.0}, spots=("p1", "p2"))
    of = {
        (spot, differ): values_at(
            spot,
            found,
            lambda name, tables=differing if differ else known: tables.get(name, pl.DataFrame()),
        )
        for spot in ("p1", "elsewhere")
        for differ in (True, False)
    }
    assert (of["p1", True].values, of["p1", True].draws) == ({"k": 4.0}, [{"k": 3.9}, {"k": 4.1}])
    assert of["elsewhere", True].draws == [{"k": -20.0}, {"k": 20.0}]
    assert of["p1", False] == of["elsewhere", False] == ({"k": 5.0}, [{"k": 1.0}, {"k": 9.0}], "")


def test_a_linear_band_follows_the_slopes(space):
    curve = Curve(channel="force", abscissa=[0, 1, 2], ordinate=[0, 2, 4],
                  slopes={"soft_tissue.stiffness": [0, 1, 2], "soft_tissue.grip": [0, 0, 1]})  # fmt: skip
    best = {"soft_tissue": np.array([2.0, 1.0])}
    drawn = [{"soft_tissue": np.array([2.0 + a, 1.0])} for a in np.linspace(-1, 1, 201)]
    lower, upper = ends(linear(curve, best, drawn, space))
    np.testing.assert_allclose(lower, [0, 1.1, 2.2], atol=1e-12)
    np.testing.assert_allclose(upper, [0, 2.9, 5.8], atol=1e-12)
    assert linear(replace(curve, slopes={}), best, drawn, space).shape == (0, 3)
    slippery = replace(curve, slopes={**curve.slopes, "friction": [0, 0, 10]})
    lower, upper = ends(linear(slippery, best, 201 * [best], space, friction_sd=0.05))
    np.testing.assert_allclose(upper - lower, [0, 0, 2 * 1.645 * 0.5], rtol=0.02)


def test_a_band_holds_new_curves_whose_law_is_wrong_by_as_much_as_the_fitted_ones():
    sizes = {0.2: 0.03, 0.8: 0.04}
    errors = pl.DataFrame([{"channel": "force", "length": n, "sd": sd} for n, sd in sizes.items()])
    depths = np.linspace(0.0, 5.0, 21)
    curve = Curve(channel="force", abscissa=depths, ordinate=depths**1.5)
    alone = np.tile(curve.ordinate, (200, 1))
    lower, upper = ends(with_model_error(alone, curve, errors))
    size = 1.645 * np.hypot(0.03, 0.04) * curve.ordinate
    np.testing.assert_allclose([curve.ordinate - lower, upper - curve.ordinate], [size, size], rtol=0.15)
    # Other laws: each differs along the path as the covariance has it.
    rng, apart = np.random.default_rng(1), np.abs(depths[:, None] - depths) / 5.0
    along = sum(sd**2 * (1.0 + 3**0.5 * apart / n) * np.exp(-(3**0.5) * apart / n)
                for n, sd in sizes.items())  # fmt: skip
    true = curve.ordinate * (1.0 + rng.multivariate_normal(np.zeros(21), along, size=2000))
    inside = ((lower <= true) & (true <= upper))[:, 1:].mean()
    assert inside == pytest.approx(0.9, abs=0.02)
    assert with_model_error(alone, curve, errors.clear()) is alone
    other = with_model_error(alone, replace(curve, channel="moment"), errors)
    np.testing.assert_array_equal(other, with_model_error(alone, curve, errors))
    # A channel that was not fitted is stated with the errors that its band has.
    assert _of_model(errors, ["force", "torque"]).endswith(": force 5 %, torque 5 %.")


def hertzian(stiffness=1.0):
    """A press to 10 N, with force and pressure of a ball on elastic tissue."""
    force = np.linspace(0.0, 10.0, 9)
    contact = contact_of(
        skin(np.outer(stiffness ** (2 / 3) * force ** (1 / 3), np.ones(4)), depths=force), None
    )
    return PressStates(depth_mm=(force / stiffness) ** (2 / 3), force_N=force, contact=contact)


def test_draws_of_a_press_to_a_force_spread_its_depth_and_not_its_force():
    softer, stiffer = hertzian(), hertzian(1.2)
    for quantity in QUANTITIES:
        found = spread(softer, quantity, np.array([1.2]), by_force=True)
        assert (found is not None) == quantity.at_force
        if found is not None:
            assert found[0] == pytest.approx(stiffer.value(quantity.attribute), rel=1e-6), quantity.name
    factors = np.linspace(0.9, 1.1, 201)
    rows = {row["quantity"]: row for row in summary_rows("p1", softer, factors, [], by_force=True)}
    ends_of_force = [rows["normal force"][f"linear_{end}"] for end in ("lower", "upper")]
    assert ends_of_force == pytest.approx([10.0, 10.0])
    assert rows["depth"]["linear_upper"] == pytest.approx(softer.value("depth_mm") * 0.91 ** (-2 / 3))
    by_depth = {row["quantity"]: row for row in summary_rows("p1", softer, factors, [], by_force=False)}
    assert "depth" not in by_depth
    assert by_depth["normal force"]["linear_upper"] == pytest.approx(10.0 * 1.09)


def test_errors_by_the_mesh_are_those_that_a_coarser_one_shows():
    fine, coarse = hertzian(), hertzian(1.1)
    errors = mesh_errors(fine, coarse, 1.0 / 3.0, 0.01)
    assert errors["peak_MPa"] == pytest.approx((1.1 ** (2 / 3) - 1.0) / 3.0, rel=1e-5)
    assert errors["force_N"] == 0.01, "no less than the study states"
    assert set(mesh_errors(fine, None, 1.0 / 3.0, 0.02).values()) == {0.02}
    assert mesh_errors(fine, coarse, 0.0, 0.02)["peak_MPa"] == 0.02, "a mesh of the same size shows nothing"
    (peak,) = (q for q in QUANTITIES if q.attribute == "peak_MPa")
    drawn = spread(fine, peak, np.ones(201), by_force=False, mesh={"peak_MPa": 0.1})
    np.testing.assert_allclose(ends(drawn / fine.value("peak_MPa")), [1 - 0.1645, 1 + 0.1645], rtol=5e-3)
    given = spread(fine, QUANTITIES[1], np.ones(201), by_force=True, mesh={"force_N": 0.1})
    assert np.ptp(given) == pytest.approx(0.0, abs=1e-9), "a force that is given has no error"


def test_a_press_that_shows_no_growth_with_the_force_has_no_band_at_a_force():
    one = hertzian()
    still = replace(one, force_N=np.where(one.force_N > 4.0, 10.0, 0.0))
    assert spread(still, QUANTITIES[0], np.array([1.2]), by_force=True) is None


def test_a_force_that_is_held_does_not_count_as_growth():
    forces = np.array([0.0, 3.0, 10.0, 10.0 * (1.0 + 1e-7)])
    pressed = replace(hertzian(), force_N=forces, depth_mm=np.array([0.0, 1.0, 2.0, 2.1]))
    assert pressed.growth("depth_mm") is None
    ramp = np.linspace(1.0, 10.0, 10)
    pressed = replace(
        pressed,
        force_N=np.concatenate([ramp, 10.0 * (1.0 + 1e-7 * np.arange(3))]),
        depth_mm=np.concatenate([ramp ** (2 / 3), [5.0, 5.5, 6.0]]),
    )
    assert pressed.growth("depth_mm") == pytest.approx(2 / 3)


def test_a_draw_is_stiffer_by_the_ratio_at_the_largest_force():
    there_and_back = Curve(channel="force", abscissa=[0, 2, 4, 2, 0], ordinate=[0, 3, 10, 2, 0])
    lines = np.array([[0.0, 3.3, 12.0, 4.0, 0.0], [0.0, 2.7, 8.0, 1.0, 0.0]])
    np.testing.assert_allclose(stiffer_by(there_and_back, lines), [1.2, 0.8])
    assert stiffer_by(replace(there_and_back, ordinate=np.zeros(5)), lines).size == 0
    assert stiffer_by(there_and_back, np.empty((0, 5))).size == 0


def test_each_curve_has_the_error_that_its_own_largest_ordinate_shows():
    def curves(force, torque):
        x = np.linspace(0.0, 1.0, 4)
        return {
            name: Curve(channel=name, abscissa=x, ordinate=most * np.array([0.0, 0.4, 1.0, 0.2]))
            for name, most in (("force", force), ("torque", torque))
        }

    left_over = {"force": 1.0 / 3.0, "torque": 1.0 / 3.0}
    errors = curve_errors(curves(10.0, -5.0), curves(10.0, -5.9), left_over, {"force": 0.01, "torque": 0.01})
    assert errors == pytest.approx({"force": 0.01, "torque": 0.06})
    assert set(
        curve_errors(curves(10.0, -5.0), None, left_over, {"force": 0.02, "torque": 0.02}).values()
    ) == {0.02}


def test_a_force_that_was_given_is_as_wrong_by_the_mesh_as_its_depth():
    fine, softer = hertzian(), hertzian(0.97)
    errors = mesh_errors(fine, softer, 1.0, 0.0)
    assert errors["force_N"] == 0.0
    assert force_error(fine, errors) == pytest.approx(0.03, rel=0.05), "that of the force at one depth"
    still = replace(fine, force_N=np.where(fine.force_N > 4.0, 10.0, 0.0))
    assert force_error(still, errors) is None


def test_a_force_to_be_reached_makes_a_press_by_force():
    pose, loads = np.zeros((3, 6)), np.full((3, 6), np.nan)
    pose[1:, 0] = 9.0
    ball = Sphere(radius_mm=20.0)
    by_depth = Indentation.along(Waypoints(pose=pose), indenter=ball, friction=0.5)
    loads[1, 0], loads[2, 0] = 3.0, np.inf  # then the depth stays where the force has left it
    by_force = Indentation.along(Waypoints(pose=pose, loads=loads), indenter=ball, friction=0.5)
    assert (is_by_force(by_depth), is_by_force(by_force)) == (False, True)
    reached = replace(hertzian(), force_N=0.3 * hertzian().force_N)
    assert ends_by_force(by_force, Status.OK, reached)
    assert not ends_by_force(by_depth, Status.OK, reached)
    assert not ends_by_force(by_force, Status.DIVERGED, reached)
    assert not ends_by_force(by_force, Status.OK, hertzian()), "it goes on to a larger one"
