"""Each law of channels fails on what breaks it, with the reason; those of palpate keep them all."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.domain.channels import EQUILIBRIUM_CHANNELS, FORCE, TORQUE
from palpate.errors import CurveError
from palpate.testing import ChannelContract

CONTRACT = ChannelContract()
STATES = ChannelContract.states.__wrapped__(CONTRACT)


@pytest.mark.parametrize("given", EQUILIBRIUM_CHANNELS, ids=lambda channel: channel.name)
class TestBalanced(ChannelContract):
    @pytest.fixture
    def channel(self, given):
        return given


def lever(columns):
    return columns["torque_Nmm"] / columns["force_N"]


def constant(columns):
    return 0.0 * columns["force_N"] + 1.0


def by_numpy(columns):
    return np.gradient(np.asarray(columns["force_N"]))


LEVER = replace(
    TORQUE, name="lever", ordinate="lever_mm", degree=0, needs=("torque_Nmm", "force_N"), observe=lever
)


class TestLever(ChannelContract):
    @pytest.fixture
    def channel(self):
        return replace(LEVER, zero_at_start=False)


@pytest.mark.parametrize(
    ("law", "faulty", "reason"),
    [
        ("its_columns_end_in_their_units", replace(FORCE, ordinate="force_kN"), "does not end in its unit"),
        ("it_has_labels", replace(FORCE, ordinate_label=" "), "ordinate_label is empty"),
        ("it_can_be_sent_to_a_worker", replace(LEVER, observe=lambda c: c["force_N"]), "top of a module"),
        ("it_is_finite", replace(LEVER, needs=("force_N", "torque_Nm")), "which no equilibrium states have"),
        ("its_degree_is_that_in_the_moduli", replace(FORCE, degree=0), "not 1 times itself"),
        ("its_degree_is_that_in_the_moduli", replace(LEVER, degree=1), "not 2 times itself"),
        ("its_sign_follows_the_motion", replace(TORQUE, mirrored=1), "not 1 times itself"),
        ("it_is_zero_where_nothing_acts", replace(LEVER, observe=constant), "not zero without a load"),
    ],
)
def test_a_faulty_channel_is_caught(law, faulty, reason):
    method = getattr(CONTRACT, f"test_{law}")
    given = {"channel": faulty, "states": STATES}
    names = method.__code__.co_varnames[1 : method.__code__.co_argcount]
    with pytest.raises((AssertionError, pytest.fail.Exception), match=reason):
        method(**{name: given[name] for name in names})


def test_a_quotient_that_has_no_value_at_rest_is_caught():
    with pytest.raises(CurveError, match="finite"), np.errstate(invalid="ignore"):
        CONTRACT.test_it_is_finite(replace(LEVER, abscissa="depth_mm"), STATES)


def test_slopes_by_numpy_are_caught():
    faulty = replace(LEVER, needs=("force_N",), observe=by_numpy)
    with pytest.raises(Exception, match="numpy"):
        CONTRACT.test_its_slopes_are_those_of_central_differences(faulty, STATES)
