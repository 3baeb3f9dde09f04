"""Contracts of what presses: indenters, motions, channels and scenarios."""

import pickle
from collections.abc import Collection
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from palpate.domain import FloatArray, Scenario, channel_of
from palpate.domain.curves import Channel, Curve
from palpate.domain.equilibrium_states import EquilibriumStates
from palpate.domain.indenter import Indenter
from palpate.domain.waypoints import DEPTH, MOST_WAYPOINTS, Waypoints
from palpate.plugins.motion import Motion
from palpate.testing.components import ComponentContract, overridden


class ScenarioContract:
    """Laws of a scenario; override ``scenario``, and ``channels`` where they are your own."""

    scenario = overridden("the scenario under test")

    @pytest.fixture
    def channels(self) -> Collection[str]:
        """Provide the names of the channels of every installed plugin."""
        from palpate.plugins.catalogue import Plugins

        return set(Plugins.load().channels)

    def test_says_what_it_is(self, scenario: Scenario) -> None:
        assert scenario.name.strip(), "a scenario needs a name"
        assert scenario.description.strip(), f"scenario '{scenario.name}' needs a description"

    def test_weighs_channels_that_exist(self, scenario: Scenario, channels: Collection[str]) -> None:
        unknown = sorted(set(map(channel_of, scenario.weights)) - set(channels))
        assert not unknown, (
            f"scenario '{scenario.name}' weighs {', '.join(unknown)}, which no plugin declares "
            f"(known: {', '.join(sorted(channels))}); correct the name, or declare the channel"
        )


UNITS = ("mm", "mm2", "mm3", "deg", "s", "N", "Nmm", "MPa", "1")
"""Units of palpate at the ends of columns."""

MIRRORED = np.array([1.0, -1.0, -1.0, -1.0, -1.0, -1.0])
"""Signs of pose and wrench where shifts, tilts and rotation have the other sign."""

STEP = 1e-6
"""Of the central differences that slopes are compared with, relative to the wrench."""


class ChannelContract:
    """Laws of a channel; override ``channel``, and ``states`` where it needs more columns of a solver."""

    tolerance = 1e-9
    """Largest relative deviation from its degree and its sign."""

    channel = overridden("the channel under test")

    @pytest.fixture
    def states(self) -> EquilibriumStates:
        """Provide states, from rest on, in which every column moves; with ``others``, its solver's.

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
            # Abscissae of homogeneous tests.
            assert unit in UNITS or column in ("stretch", "shear"), (
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


class MotionContract(ComponentContract):
    """Laws of a motion; override ``motion``."""

    motion = overridden("the motion under test")

    component = pytest.fixture(lambda self, motion: motion)

    def test_it_gives_waypoints(self, motion: Motion) -> None:
        made = motion.waypoints()
        assert isinstance(made, Waypoints), f"waypoints() gives a {type(made).__name__}, not Waypoints"
        assert len(made.pose) <= MOST_WAYPOINTS + 1, f"more than {MOST_WAYPOINTS} waypoints"

    def test_it_presses(self, motion: Motion) -> None:
        depths = motion.waypoints().pose[:, DEPTH]
        assert depths.max() > 0.0, "it never goes into the limb: depths are positive there, in mm"
        assert depths.max() < 1000.0, f"a depth of {depths.max():g} mm: depths are in mm"

    def test_equal_settings_are_one_motion(self, motion: Motion) -> None:
        once, again = motion.waypoints(), type(motion)(motion.settings.model_copy()).waypoints()
        assert once.is_same(motion.waypoints()), "waypoints() differ from call to call"
        assert once.is_same(again), "equal settings give another motion"

    def test_no_row_is_there_twice(self, motion: Motion) -> None:
        made = motion.waypoints()
        if made.time_s is not None or made.loads is not None:
            return
        still = np.flatnonzero(~np.diff(made.pose, axis=0).any(axis=1))
        assert not still.size, f"row {still[0] + 1} repeats the one before it; a hold needs times"


STEP_MM = 1e-5
"""Of finite differences."""


class IndenterContract(ComponentContract):
    """Laws of an indenter; override ``indenter``."""

    n_points = 400
    """Points drawn near the surface."""

    tolerance = 1e-6
    """Of the length of normals; derivatives agree with finite differences to some multiple of it."""

    kinks = 0.05
    """Largest share of points whose curvature may jump within a step of finite differences."""

    indenter = overridden("the indenter under test")

    component = pytest.fixture(lambda self, indenter: indenter)

    @pytest.fixture
    def near(self, indenter: Indenter) -> FloatArray:
        """Provide points (n, 3) within a fifth of ``edge_mm`` of the surface, and in its bounds."""
        rng, (lower, upper) = np.random.default_rng(0), indenter.bounds_mm
        margin = 0.2 * indenter.edge_mm
        found = np.zeros((0, 3))
        for _ in range(1000):
            points = rng.uniform(lower - margin, upper + margin, (4000, 3))
            gaps = indenter.distance(points)
            # What is above the bounds need not be inside, so that the upper end tests nothing.
            near = (np.abs(gaps) < margin) & (points[:, 2] < upper[2] - indenter.edge_mm)
            found = np.concatenate([found, points[near]])
            if len(found) >= self.n_points:
                return found[: self.n_points]
        pytest.fail(
            f"'{indenter.name}': its surface was not found in bounds_mm; give the corners of a box around it"
        )

    def test_sizes_are_lengths(self, indenter: Indenter) -> None:
        for name in ("radius_mm", "edge_mm"):
            assert getattr(indenter, name) > 0.0, f"{name} of '{indenter.name}' must be > 0"
        bounds = np.asarray(indenter.bounds_mm)
        assert bounds.shape == (2, 3), "bounds_mm: give the lowest and the highest corner, (2, 3)"
        assert (bounds[0] < bounds[1]).all(), f"bounds_mm: {bounds.tolist()} is no box"

    def test_it_touches_the_spot_at_depth_0(self, indenter: Indenter) -> None:
        gap = float(indenter.distance(np.zeros((1, 3)))[0])
        assert gap > -1e-6, f"the origin is {-gap:.2g} mm inside: at depth 0 it must not be in the limb"
        lower, upper = indenter.bounds_mm[:, :2]
        x, y = np.meshgrid(*np.linspace(1.2 * lower, 1.2 * upper, 241).T)
        plane = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
        assert indenter.distance(plane).min() < 0.05 * indenter.edge_mm, (
            "it is above the plane z = 0 everywhere: at depth 0 it must touch flat skin"
        )

    def test_the_bounds_hold_it(self, indenter: Indenter) -> None:
        (lower, upper), rng = indenter.bounds_mm, np.random.default_rng(1)
        points = rng.uniform(2.0 * lower - upper, 2.0 * upper - lower, (20_000, 3))
        lateral = ((points < lower) | (points > upper))[:, :2].any(axis=1) & (points[:, 2] <= upper[2])
        points = points[lateral | (points[:, 2] < lower[2])]
        inside = points[np.asarray(indenter.distance(points)) < 0.0]
        assert not len(inside), f"{np.round(inside[0], 3)} mm is inside, and not in bounds_mm"

    def test_the_distance_is_a_distance(self, indenter: Indenter) -> None:
        (lower, upper), rng = indenter.bounds_mm, np.random.default_rng(2)
        a, b = rng.uniform(lower - 2.0, upper + 2.0, (2, 2000, 3))
        change = np.abs(indenter.distance(a) - indenter.distance(b))
        deepest = np.minimum(indenter.distance(a), indenter.distance(b))
        outside = deepest > -0.5 * indenter.edge_mm  # deeper is beyond use
        steeper = (change - (1.0 + self.tolerance) * np.linalg.norm(a - b, axis=1))[outside]
        assert steeper.max() <= self.tolerance, (
            f"the distance changes by {change[steeper.argmax()]:.4g} mm between two points that are nearer "
            "to each other; it is no distance"
        )

    def test_normals_have_length_1(self, indenter: Indenter, near: FloatArray) -> None:
        length = np.linalg.norm(indenter.normals(near)[0], axis=1)
        np.testing.assert_allclose(length, 1.0, atol=self.tolerance, err_msg="length of normals")

    def test_normals_on_the_axis_are_finite(self, indenter: Indenter) -> None:
        axis = np.array([[0.0, 0.0, z] for z in (-0.2, 0.0, 0.2)]) * indenter.edge_mm
        axis = axis[np.abs(indenter.distance(axis)) < 0.3 * indenter.edge_mm]  # a ring has none there
        for values in indenter.normals(axis) if len(axis) else ():
            assert np.isfinite(values).all(), (
                "normals or curvature at (0, 0, z) are NaN, where contact begins: √(x² + y²) has no slope "
                "at 0; use xp.where, or add a small number under the root"
            )

    def test_normals_are_derivatives_of_the_distance(self, indenter: Indenter, near: FloatArray) -> None:
        steps = STEP_MM * np.eye(3)
        slopes = [indenter.distance(near + e) - indenter.distance(near - e) for e in steps]
        difference = np.abs(indenter.normals(near)[0] - np.stack(slopes, axis=1) / (2.0 * STEP_MM))
        assert difference.max() < 10.0 * self.tolerance, "normals are not the derivatives of the distance"

    def test_curvature_is_the_derivative_of_the_normals(self, indenter: Indenter, near: FloatArray) -> None:
        curvature = indenter.normals(near)[1]
        np.testing.assert_allclose(
            curvature, curvature.transpose(0, 2, 1), atol=1e-9 / indenter.edge_mm, err_msg="symmetry"
        )
        steps = STEP_MM * np.eye(3)
        bends = [indenter.normals(near + e)[0] - indenter.normals(near - e)[0] for e in steps]
        difference = np.abs(curvature - np.stack(bends, axis=2) / (2.0 * STEP_MM)).max(axis=(1, 2))
        wrong = difference > 100.0 * self.tolerance / indenter.edge_mm
        assert wrong.mean() <= self.kinks, "curvature is not the derivative of the normals"

    def test_the_edge_is_the_sharpest_curvature(self, indenter: Indenter, near: FloatArray) -> None:
        gaps, (_, curvature) = np.asarray(indenter.distance(near)), indenter.normals(near)
        sharpest = np.linalg.eigvalsh(curvature)[:, -1]
        # At a distance d from a surface of radius r the curvature is 1 / (r + d).
        radius = 1.0 / np.maximum(sharpest, 1e-12) - gaps
        assert np.quantile(radius, self.kinks) > 0.9 * indenter.edge_mm, (
            f"a radius of curvature of {np.quantile(radius, self.kinks):.3g} mm, and edge_mm is "
            f"{indenter.edge_mm:.3g}; give the smallest one"
        )

    def test_deeper_contacts_are_larger(self, indenter: Indenter) -> None:
        beyond = 1.5 * abs(indenter.bounds_mm[1, 2])  # deeper than the body is high
        depths = [0.1 * indenter.edge_mm, 0.5 * indenter.edge_mm, beyond]
        for name in ("contact_radius_mm", "reach_mm"):
            sizes = [getattr(indenter, name)(depth) for depth in depths]
            for small, large in pairwise(sizes):
                found = f"{small:.3g}, {large:.3g} mm"
                assert 0.0 < small <= large * 1.01, f"{name} must grow with depth: {found}"

    def test_its_surface_is_on_it(self, indenter: Indenter) -> None:
        points, triangles = indenter.surface()
        size = float(np.ptp(indenter.bounds_mm, axis=0).max()) / 40.0
        below = points[:, 2] < indenter.bounds_mm[1, 2] - size
        assert np.abs(indenter.distance(points[below])).max() < size, "surface() is not where it is"
        assert triangles.max() < len(points)

    def test_equal_settings_are_one_shape(self, indenter: Indenter) -> None:
        copy = type(indenter)(indenter.settings.model_copy())
        assert copy == indenter
        assert hash(copy) == hash(indenter)
