"""Each law of indenters fails on what breaks it, with the reason; the sphere keeps them all."""

import numpy as np
import pytest

from palpate.domain.indenter import Indenter, Sphere, SphereSettings
from palpate.testing import IndenterContract


class TestSphere(IndenterContract):
    @pytest.fixture
    def indenter(self):
        return Sphere(radius_mm=7.5)


class Steep(Sphere):
    def distance(self, points):
        return 2.0 * super().distance(points)


class Sunk(Sphere):
    def distance(self, points):
        return super().distance(points - np.array([0.0, 0.0, -1.0]))


class High(Sphere):
    def distance(self, points):
        return super().distance(points - np.array([0.0, 0.0, 1.0]))


class Unbounded(Sphere):
    def __init__(self, settings=None):
        super().__init__(settings)
        self.bounds_mm = 0.8 * self.bounds_mm


class Flaring(Sphere):
    """A cone, rounded at its tip, that goes on above its bounds."""

    normals = Indenter.normals

    def distance(self, points):
        xp = points.__array_namespace__()
        radial = xp.sqrt(points[..., 0] ** 2 + points[..., 1] ** 2 + 1.0)
        return (radial - 1.0 - points[..., 2]) / 2**0.5

    def __init__(self, settings=None):
        super().__init__(settings)
        self.bounds_mm = np.array([[-21.0, -21.0, 0.0], [21.0, 21.0, 20.0]])


class Pointed(Flaring):
    def distance(self, points):
        xp = points.__array_namespace__()
        return (xp.sqrt(points[..., 0] ** 2 + points[..., 1] ** 2) - points[..., 2]) / 2**0.5


class Empty(Sphere):
    def __init__(self, settings=None):
        super().__init__(settings)
        self.bounds_mm = self.bounds_mm + 50.0


class Blunt(Sphere):
    def __init__(self, settings=None):
        super().__init__(settings)
        self.edge_mm = 10.0


class Unsized(Sphere):
    def __init__(self, settings=None):
        super().__init__(settings)
        self.radius_mm = 0.0


class Inward(Sphere):
    def normals(self, points):
        n, curvature = super().normals(points)
        return -n, curvature


class Long(Sphere):
    def normals(self, points):
        n, curvature = super().normals(points)
        return 1.1 * n, curvature


class Flat(Sphere):
    def normals(self, points):
        n, curvature = super().normals(points)
        return n, 0.0 * curvature


class Needle(Sphere):
    def contact_radius_mm(self, depth_mm):
        return 0.0


class Elsewhere(Sphere):
    def surface(self, n_across=32):
        points, triangles = super().surface(n_across)
        return points + 3.0, triangles


@pytest.mark.parametrize(
    ("law", "faulty", "reason"),
    [
        ("test_sizes_are_lengths", Unsized, "radius_mm of 'sphere' must be > 0"),
        ("test_it_touches_the_spot_at_depth_0", Sunk, "1 mm inside"),
        ("test_it_touches_the_spot_at_depth_0", High, "above the plane"),
        ("test_the_bounds_hold_it", Unbounded, "not in bounds_mm"),
        ("test_the_distance_is_a_distance", Steep, "it is no distance"),
        ("test_normals_have_length_1", Long, "length of normals"),
        ("test_normals_on_the_axis_are_finite", Pointed, "are NaN, where contact begins"),
        ("test_normals_are_derivatives_of_the_distance", Inward, "not the derivatives"),
        ("test_curvature_is_the_derivative_of_the_normals", Flat, "not the derivative"),
        ("test_the_edge_is_the_sharpest_curvature", Blunt, "give the smallest one"),
        ("test_deeper_contacts_are_larger", Needle, "must grow with depth"),
        ("test_its_surface_is_on_it", Elsewhere, "not where it is"),
    ],
)
def test_a_law_catches_what_breaks_it(law, faulty, reason):
    contract, indenter = IndenterContract(), faulty(SphereSettings(radius="7.5 mm"))
    test = getattr(contract, law)
    given = {"indenter": indenter}
    if "near" in test.__code__.co_varnames[: test.__code__.co_argcount]:
        given["near"] = IndenterContract.near.__wrapped__(contract, Sphere(radius_mm=7.5))
    with pytest.raises(AssertionError, match=reason):
        test(**given)


def test_a_surface_outside_the_bounds_is_not_found():
    with pytest.raises(pytest.fail.Exception, match="was not found in bounds_mm"):
        IndenterContract.near.__wrapped__(IndenterContract(), Empty(SphereSettings(radius="7.5 mm")))


def test_a_body_that_equals_itself_alone_is_caught():
    class OfItself(Sphere):
        def __eq__(self, other):
            return self is other

        __hash__ = object.__hash__

    with pytest.raises(AssertionError):
        IndenterContract().test_equal_settings_are_one_shape(OfItself(SphereSettings(radius="7.5 mm")))


def test_a_body_may_be_wider_above_its_bounds():
    flaring = Flaring(SphereSettings(radius="7.5 mm"))
    IndenterContract().test_the_bounds_hold_it(flaring)
    IndenterContract().test_normals_on_the_axis_are_finite(flaring)
