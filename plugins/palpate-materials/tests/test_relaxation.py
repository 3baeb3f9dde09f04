"""Relaxation: laws of the convolution, and FEBio's relaxing blocks."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given, strategies as st

from palpate.api import relaxing
from palpate.domain import Curve, Indentation, ParameterSpace, RegionMaterial, Response
from palpate.domain.indenter import Sphere
from palpate.errors import ParameterError, StudyError
from palpate.testing import ParametrisationContract
from palpate_materials import Yeoh
from palpate_materials.relaxation import (
    Relaxed,
    Relaxing,
    RelaxingSettings,
    loss_tangent,
    reduced_relaxation,
    relaxed,
)

DATA = Path(__file__).parent / "data" / "relaxing_febio"
LONG_TERM = 1.4  # modulus at once over that of the long term
TIMES_S, SHARES = np.array([0.5, 5.0]), np.array([0.25, 0.15]) / LONG_TERM

times = st.lists(st.floats(0.05, 50.0), min_size=1, max_size=3, unique=True).map(np.array)
durations = st.lists(st.floats(0.01, 30.0), min_size=2, max_size=12).map(lambda each: np.cumsum([0.0, *each]))


def shares_of(times_s, total=0.9):
    return np.full(times_s.size, total / times_s.size)


# ------------------------------------------------------------------------------- laws


@given(times_s=times, ramp_s=st.floats(0.01, 100.0), rest_s=st.floats(0.0, 100.0), n=st.integers(1, 20))
def test_a_ramp_and_a_rest_have_their_closed_form(times_s, ramp_s, rest_s, n):
    shares = shares_of(times_s)
    time = np.r_[np.linspace(0.0, ramp_s, n + 1), ramp_s + rest_s]
    found = relaxed(time, np.minimum(time / ramp_s, 1.0), times_s, shares)
    young = times_s / ramp_s * -np.expm1(-ramp_s / times_s)
    at_the_end = 1.0 - shares @ (1.0 - young)
    after_the_rest = 1.0 - shares @ (1.0 - young * np.exp(-rest_s / times_s))
    assert np.allclose(found[-2:], [at_the_end, after_the_rest], rtol=1e-10)


@given(times_s=times, time=durations, seed=st.integers(0, 99))
def test_points_on_a_straight_line_change_nothing(times_s, time, seed):
    values = np.random.default_rng(seed).normal(size=time.size)
    between = np.sort(np.r_[time, 0.5 * (time[1:] + time[:-1])])
    fine = relaxed(between, np.interp(between, time, values), times_s, shares_of(times_s))
    assert np.allclose(fine[::2], relaxed(time, values, times_s, shares_of(times_s)), atol=1e-10)


@given(times_s=times, time=durations)
def test_what_rises_is_between_the_moduli_at_once_and_of_the_long_term(times_s, time):
    shares, rising = shares_of(times_s), np.sqrt(time)
    found = relaxed(time, rising, times_s, shares)
    assert (found <= rising + 1e-12).all()
    assert (found >= (1.0 - shares.sum()) * rising - 1e-12).all()


@given(times_s=times)
def test_a_step_falls_as_the_modulus_does(times_s):
    time, shares = np.r_[0.0, np.geomspace(0.01, 500.0, 20)], shares_of(times_s)
    left = reduced_relaxation(time, times_s, shares)
    assert np.allclose(relaxed(time, np.ones(time.size), times_s, shares), left)
    assert left[0] == 1.0
    assert (np.diff(left) <= 0.0).all()


def test_the_loss_angle_of_one_time_is_known():
    """tan δ = γωτ / (1 + ω²τ² - γ)."""
    frequency = np.geomspace(0.01, 100.0, 9)
    product = 2.0 * frequency
    found = loss_tangent(frequency, np.array([2.0]), np.array([0.3]))
    assert np.allclose(found, 0.3 * product / (1.0 + product**2 - 0.3))


def test_a_curve_over_time_has_points_where_it_falls_fast():
    held = Curve(
        channel="force_over_time",
        abscissa=np.array([0.0, 1.0, 31.0]),
        ordinate=np.array([0.0, 1.0, 1.0]),
        time_s=np.array([0.0, 1.0, 31.0]),
    )
    law = Relaxed(TIMES_S, SHARES)
    (found,) = law(Response(curves={"force_over_time": held})).curves.values()
    exact = np.linspace(0.0, 31.0, 3001)
    reference = relaxed(exact, np.interp(exact, held.abscissa, held.ordinate), TIMES_S, SHARES)
    assert np.abs(np.interp(exact, found.abscissa, found.ordinate) - reference).max() < 1e-3


def test_a_curve_without_times_is_refused():
    bare = Curve(channel="force", abscissa=np.arange(3.0), ordinate=np.arange(3.0))
    with pytest.raises(StudyError, match="'force' has no times"):
        Relaxed(TIMES_S, SHARES)(Response(curves={"force": bare}))


# ----------------------------------------------------------------------------- FEBio


def read(case):
    return pl.read_csv(DATA / f"{case}.csv")


def elastic(case, along, column):
    """Elastic curve along the first branch of a motion, from rest or from the end of the press."""
    curve = read(case)
    start = 0 if along == "depth_mm" else int(curve["depth_mm"].arg_max())
    moved = curve[along].abs().to_numpy()
    rows = slice(start, int(moved.argmax()) + 1)
    return moved[rows], LONG_TERM * curve[column].to_numpy()[rows]


@pytest.mark.parametrize(
    "case", ["bonded_neo_hookean", "bonded_yeoh", "bonded_layered", "frictionless_neo_hookean"]
)
def test_force_of_a_press_and_a_rest_is_that_of_febio(case):
    run = read(f"relaxing_{case}").filter(pl.col("angle_deg") == 0.0)
    time, depth, force = (run[name].to_numpy() for name in ("time_s", "depth_mm", "force_N"))
    at_once = np.interp(depth, *elastic(case, "depth_mm", "force_N"))
    share = (relaxed(time, at_once, TIMES_S, SHARES) - force) / force.max()
    assert np.abs(at_once - force).max() > 0.25 * force.max()
    assert np.abs(share).max() < 0.012, "with the steps of FEBio's own integration"
    assert np.abs(share[time >= 2.0]).max() < 0.0025


@pytest.mark.parametrize(
    ("case", "largest"), [("bonded_neo_hookean", 0.146), ("bonded_yeoh", 0.078), ("bonded_layered", 0.042)]
)
def test_torque_after_a_press_is_too_small_by_what_the_guide_says(case, largest):
    """Stresses of the press have relaxed when the twist turns them: its stiffness is larger than at once."""
    run = read(f"relaxing_{case}").filter(pl.col("time_s") >= 5.0)
    time, angle, torque = (run[name].to_numpy() for name in ("time_s", "angle_deg", "torque_Nmm"))
    at_once = np.interp(np.abs(angle), *elastic(case, "angle_deg", "torque_Nmm"))
    share = (relaxed(time, at_once, TIMES_S, SHARES) - torque) / np.abs(torque).max()
    assert share.max() == pytest.approx(largest, abs=0.001)
    assert share.min() > -0.001


# ------------------------------------------------------------------- parametrisation


class TestRelaxing(ParametrisationContract):
    @pytest.fixture
    def parametrisation(self):
        return Relaxing(RelaxingSettings(relaxation_times=("0.5 s", "5 s"), relaxation_upper=0.4))

    @pytest.fixture
    def space(self):
        yeoh = Yeoh()
        return ParameterSpace(
            regions=(RegionMaterial(region="tissue", material=yeoh, searched=yeoh.parameters, fixed={}),)
        )

    @pytest.fixture
    def protocol(self):
        path = np.array([(0.0, 0.0), (5.0, 0.0), (5.0, 0.0)])
        return Indentation(
            indenter=Sphere(radius_mm=7.5), path=path, friction=0.5, time_s=np.array([0.0, 1.0, 11.0])
        )

    def test_shares_that_leave_nothing_are_refused(self, space, protocol):
        law = Relaxing()
        values = {p.name: 0.3 for p in law.parameters(space, ["p1"])}
        with pytest.raises(ParameterError, match=r"add up to 1\.2"):
            law.inputs(space, "p1", protocol, values)

    def test_a_motion_without_times_is_refused(self, space, protocol):
        timeless = Indentation(indenter=protocol.indenter, path=protocol.path, friction=0.5)
        with pytest.raises(StudyError, match='motion = "moves"'):
            Relaxing().inputs(space, "p1", timeless, {})

    def test_a_region_that_relaxes_in_the_solver_is_refused(self, space, protocol):
        (region,) = space.regions
        twice = ParameterSpace(regions=(replace(region, material=relaxing(region.material, TIMES_S)),))
        with pytest.raises(StudyError, match="relaxes in the solver already; remove its relaxation_times"):
            Relaxing().inputs(twice, "p1", protocol, {})


@pytest.mark.parametrize("times", [["0 s", "1 s"], ["1 s", "1 s"], ["0.1 ms"], ["1.0001 s", "1.0002 s"]])
def test_shares_have_names_of_their_own(times):
    with pytest.raises(ValueError, match="time constants are at least 1 ms, and that far apart"):
        RelaxingSettings(relaxation_times=times)
