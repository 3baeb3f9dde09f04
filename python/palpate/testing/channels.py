"""Laws of channels."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from palpate.domain.curves import Channel, Curve, FloatArray
from palpate.domain.equilibrium_states import EquilibriumStates
from palpate.testing.components import missing

UNITS = ("mm", "mm2", "mm3", "deg", "s", "N", "Nmm", "MPa", "1")
"""Units of palpate at the ends of columns."""

UNITLESS = frozenset({"stretch", "shear"})
"""Abscissae of homogeneous tests."""

MIRRORED = np.array([1.0, -1.0, -1.0, -1.0, -1.0, -1.0])
"""Signs of pose and wrench where shifts, tilts and rotation have the other sign."""

STEP = 1e-6
"""Of the central differences that slopes are compared with, relative to the wrench."""


class ChannelContract:
    """Laws of a channel; override ``channel``, and ``states`` where it needs more columns of a solver."""

    tolerance = 1e-9
    """Largest relative deviation from its degree and its sign."""

    @pytest.fixture
    def channel(self) -> Channel:
        """Provide the channel under test."""
        missing("channel", type(self).__name__)

    @pytest.fixture
    def states(self) -> EquilibriumStates:
        """Provide states, from rest on, in which every column moves; with ``others``, those of its solver.

        The second is pressed only: a channel over a shift, tilt or rotation starts there.
        """
        random = np.random.default_rng(1)
        way = np.linspace(0.0, 1.0, 9)[:, None]
        pose = way * [2.0, 1.0, 0.5, 3.0, -2.0, 10.0]
        wrench = way * [4.0, 1.0, 0.7, 5.0, -3.0, 20.0] * random.uniform(0.8, 1.2, (9, 6))
        pose[1, 1:] = wrench[1, 1:] = 0.0
        slopes = {"tissue.c1": way * random.standard_normal((9, 6))}
        return EquilibriumStates(pose=pose, wrench=wrench, time_s=np.arange(9.0), slopes=slopes)

    def test_its_columns_end_in_their_units(self, channel: Channel) -> None:
        for column, unit in zip((channel.abscissa, channel.ordinate), channel.units, strict=True):
            assert unit in UNITS or column in UNITLESS, (
                f"column '{column}' does not end in its unit, one of {', '.join(UNITS)}: depth_mm, force_N, "
                "ratio_1"
            )

    def test_it_has_labels(self, channel: Channel) -> None:
        assert channel.abscissa_label.strip(), "abscissa_label is empty: figures need it"
        assert channel.ordinate_label.strip(), "ordinate_label is empty: figures need it"

    def test_it_can_be_sent_to_a_worker(self, channel: Channel) -> None:
        try:
            sent = pickle.loads(pickle.dumps(channel))
        except (pickle.PicklingError, AttributeError) as error:
            pytest.fail(f"`observe` cannot be sent to a worker ({error}); define it at the top of a module")
        assert sent == channel

    def test_it_is_finite(self, channel: Channel, states: EquilibriumStates) -> None:
        curve = self.curve(channel, states)
        assert curve.ordinate.shape == curve.abscissa.shape

    def test_its_degree_is_that_in_the_moduli(self, channel: Channel, states: EquilibriumStates) -> None:
        doubled = replace(states, wrench=2.0 * states.wrench, slopes={})
        factor = 2.0**channel.degree
        found, one = self.curve(channel, doubled).ordinate, self.curve(channel, states).ordinate
        assert self.alike(found, factor * one), (
            f"degree {channel.degree}: with all moduli doubled the ordinate is not {factor:g} times itself"
        )

    def test_its_sign_follows_the_motion(self, channel: Channel, states: EquilibriumStates) -> None:
        if channel.mirrored is None:
            return
        other = replace(states, pose=states.pose * MIRRORED, wrench=states.wrench * MIRRORED, slopes={})
        found, one = self.curve(channel, other).ordinate, self.curve(channel, states).ordinate
        assert self.alike(found, channel.mirrored * one), (
            f"mirrored {channel.mirrored}: with the other sign of shifts, tilts and rotation the ordinate "
            f"is not {channel.mirrored} times itself"
        )

    def test_it_is_zero_where_nothing_acts(self, channel: Channel, states: EquilibriumStates) -> None:
        if not channel.zero_at_start:
            return
        released = replace(states, wrench=np.zeros_like(states.wrench), slopes={})
        assert not self.curve(channel, released).ordinate.any(), "zero_at_start, and not zero without a load"

    def test_its_slopes_are_those_of_central_differences(
        self, channel: Channel, states: EquilibriumStates
    ) -> None:
        for name, slope in states.slopes.items() if not channel.columns & states.others.keys() else ():
            step = STEP * float(np.abs(states.wrench).max())
            ahead, behind = (
                self.curve(channel, replace(states, wrench=states.wrench + sign * step * slope)).ordinate
                for sign in (1.0, -1.0)
            )
            found, expected = self.curve(channel, states).slopes[name], (ahead - behind) / (2.0 * step)
            scale = float(np.abs(expected).max()) + float(np.abs(ahead).max())
            assert np.abs(found - expected).max() <= 1e-6 * scale, (
                "slopes differ from central differences; write `observe` with operators and the arrays' own "
                "namespace, without numpy"
            )

    def curve(self, channel: Channel, states: EquilibriumStates) -> Curve:
        """Observe the channel, or skip the law where a solver makes its curve itself."""
        lacking = channel.columns - states.columns.keys()
        if lacking and not channel.needs:
            pytest.skip(f"its solver makes {', '.join(sorted(lacking))}: no law of states holds")
        assert not lacking, f"`needs` names {', '.join(sorted(lacking))}, which no equilibrium states have"
        return states.observed([channel])[channel.name]

    def alike(self, found: FloatArray, expected: FloatArray) -> bool:
        """Whether two ordinates are equal to rounding."""
        return bool(np.abs(found - expected).max() <= self.tolerance * np.abs(expected).max())
