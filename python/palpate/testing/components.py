"""Laws of everything that a plugin provides."""

import pickle
import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Never

import numpy as np
import pytest

from palpate import mechanics
from palpate.domain import COMPLIANCE, DEEPER, FloatArray, Indentation, Job, ParameterName
from palpate.domain.component import Component
from palpate.domain.material import Material
from palpate.errors import MaterialError
from palpate.plugins.catalogue import Plugins
from palpate.plugins.provides import Provides
from palpate.units import Quantity

RADIUS_MM = 7.5
"""Of the sphere on the half-space."""

DEPTH_MM = 0.0025 * RADIUS_MM
"""So little that strains are small: the contact has a twentieth of the sphere's radius."""

ROTATION_DEG = 0.25
HALF_SPACE_PATH = np.array([(0.0, 0.0), (DEPTH_MM, 0.0), (DEPTH_MM, ROTATION_DEG)])
HALF_SPACE_FRICTION = 2.0
"""Enough for hardly any slip at that rotation."""

SMALL_STRAIN = 1e-3


def half_space_peaks(material: Material, theta: FloatArray) -> dict[str, float]:
    """Force [N] and torque [N·mm] at the end of ``HALF_SPACE_PATH``, by channel, for textbook values.

    Hertz: F = 4/3 E/(1 − ν²) √R d^1.5. Reissner and Sagoci: T = 16/3 μ a³ φ with a² = R d, for a disc
    that sticks.
    """
    mu, kappa = mechanics.initial_moduli(material, theta)
    young, poisson = _young_and_poisson(mu, kappa)
    contact_mm = np.sqrt(RADIUS_MM * DEPTH_MM)
    return {
        "force": 4 / 3 * young / (1 - poisson**2) * np.sqrt(RADIUS_MM) * DEPTH_MM**1.5,
        "torque": 16 / 3 * mu * contact_mm**3 * np.radians(ROTATION_DEG),
    }


def small_strain_modulus(channel: str, material: Material, theta: FloatArray) -> float | None:
    """Slope at rest [MPa] of the nominal stress of a homogeneous test; None for a channel of another name."""
    mu, kappa = mechanics.initial_moduli(material, theta)
    young, poisson = _young_and_poisson(mu, kappa)
    return {
        "uniaxial": young,
        "equibiaxial": young / (1 - poisson),
        "pure_shear": young / (1 - poisson**2),
        "simple_shear": mu,
        "confined_compression": kappa + 4 / 3 * mu,
    }.get(channel)


def _young_and_poisson(mu: float, kappa: float) -> tuple[float, float]:
    return 9 * kappa * mu / (3 * kappa + mu), (3 * kappa - 2 * mu) / (6 * kappa + 2 * mu)


def overridden(by: str) -> Any:  # noqa: ANN401 - a subclass has a fixture of its own type
    """Fixture of a contract that provides nothing: a plugin's suite has to override it."""

    @pytest.fixture
    def fixture(self: object, request: pytest.FixtureRequest) -> Never:
        pytest.fail(f"{type(self).__name__}: override the fixture '{request.fixturename}' with {by}")

    return fixture


def check_described(component: Component) -> None:
    """Assert that name, summary and every setting are described."""
    assert component.name.isidentifier(), f"name {component.name!r} must be an identifier"
    assert component.summary.strip(), f"'{component.name}' needs a summary"
    for name, field in type(component.settings).model_fields.items():
        label = f"setting '{name}' of '{component.name}'"
        assert field.description, f"{label} needs a description"
        dimensional = (
            r"time|duration|length|distance|radius|diameter|depth|height|width|thickness|angle|rotation|edge"
            r"|size|memory|_(s|mm|m|deg|rad|MB|GB)$"
        )
        if "float" in str(field.annotation) and re.search(dimensional, name):
            typed = any(isinstance(each, Quantity) for each in field.metadata)
            assert typed or "[" in field.description, (
                f"{label}: a time, length, angle or size needs its unit; write [mm] in the description, "
                'or annotate it as Annotated[float, Quantity("mm")]'
            )


class ComponentContract:
    """Laws of every component."""

    component = overridden("the component under test; each contract fills it in")

    def test_says_what_it_is(self, component: Component) -> None:
        check_described(component)

    def test_travels_to_another_process(self, component: Component) -> None:
        copy = pickle.loads(pickle.dumps(component))
        assert type(copy) is type(component)
        assert copy.settings == component.settings


def plugins_with(*plugins: object) -> Plugins:
    """Load the core and these plugins, as if nothing else were installed.

    Parameters
    ----------
    plugins : module or object
        With hooks marked ``@palpate.hookimpl``.

    Returns
    -------
    Plugins

    Raises
    ------
    AssertionError
        palpate would leave one of them out; with the reason.
    """
    loaded = Plugins.load(entry_points=False, modules=plugins)
    assert not loaded.broken, "; ".join(map(str, loaded.broken))
    return loaded


SLOPE_STEP = 1e-3
"""Step of the central differences that slopes are compared with, relative to the value."""


def moved_values(material: Material, theta: FloatArray) -> Iterator[tuple[str, FloatArray]]:
    """Each parameter by name, and the values with it moved by a tenth, inside its physical range."""
    for k, parameter in enumerate(material.parameters):
        step = 0.1 * (abs(theta[k]) or parameter.upper - parameter.lower)
        values = np.array(theta, dtype=np.float64)
        values[k] += step
        try:
            parameter.check(float(values[k]))
        except MaterialError:
            values[k] -= 2.0 * step
        yield parameter.name, values


def neighbours(job: Job, provides: Provides) -> Iterator[tuple[str, float, Job, Job]]:
    """Each slope that a solver provides: its name, the step, and the job moved up and down."""
    for region, material in job.materials.items():
        for k, parameter in enumerate(material.parameters):
            theta = np.asarray(job.thetas[region], dtype=np.float64)
            step = SLOPE_STEP * float(abs(theta[k]) or parameter.upper - parameter.lower)
            both = [theta + sign * step * (np.arange(theta.size) == k) for sign in (1.0, -1.0)]
            try:
                material.check(both[0])
                material.check(both[1])
            except MaterialError:
                continue  # next to a limit of its physical range
            ahead, behind = (replace(job, thetas={**job.thetas, region: other}) for other in both)
            yield str(ParameterName(region, parameter.name)), step, ahead, behind
    press = job.protocol
    if isinstance(press, Indentation) and press.friction > 0.0:
        step = SLOPE_STEP * press.friction
        ahead, behind = (
            replace(job, protocol=replace(press, friction=press.friction + sign * step)) for sign in (1, -1)
        )
        yield "friction", step, ahead, behind
    if isinstance(press, Indentation) and provides.contact_penalty:
        softer, stiffer = (
            replace(job, protocol=replace(press, contact_penalty=1.0 / (press.contact_compliance + step)))
            for step in (SLOPE_STEP, -SLOPE_STEP)
        )
        yield COMPLIANCE, SLOPE_STEP, softer, stiffer
    if isinstance(press, Indentation) and provides.depth_slope and (depth := press.only_depth_mm):
        step = SLOPE_STEP * depth
        paths = (press.path + sign * step * (press.path > 0.0) * (1, 0) for sign in (1, -1))
        deeper, shallower = (replace(job, protocol=replace(press, path=path)) for path in paths)
        yield DEEPER, step, deeper, shallower
