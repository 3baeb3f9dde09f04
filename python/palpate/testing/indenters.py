"""Laws of indenters."""

from itertools import pairwise

import numpy as np
import pytest

from palpate.domain import FloatArray
from palpate.domain.component import Component
from palpate.domain.indenter import Indenter
from palpate.testing.components import ComponentContract, missing

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

    @pytest.fixture
    def indenter(self) -> Indenter:
        """Provide the indenter under test."""
        missing("indenter", type(self).__name__)

    @pytest.fixture
    def component(self, indenter: Indenter) -> Component:
        """Provide the indenter."""
        return indenter

    @pytest.fixture
    def near(self, indenter: Indenter) -> FloatArray:
        """Provide points (n, 3) within a fifth of ``edge_mm`` of the surface, and in its bounds."""
        rng, (lower, upper) = np.random.default_rng(0), indenter.bounds_mm
        margin = 0.2 * indenter.edge_mm
        found = np.zeros((0, 3))
        for _ in range(1000):
            points = rng.uniform(lower - margin, upper + margin, (4000, 3))
            gaps = indenter.distance(points)
            # What is above the bounds need not be inside, so that the upper end says nothing.
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
        points = points[((points < lower) | (points > upper))[:, :2].any(axis=1) | (points[:, 2] < lower[2])]
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
