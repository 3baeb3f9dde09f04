"""What a solver declares to provide: false declarations are refused, and what a job lacks is named."""

from dataclasses import replace

import numpy as np
import pytest

from palpate import AnisotropicMaterial, Parameter, Sphere
from palpate.domain import HomogeneousTests, Indentation, Job, Waypoints
from palpate.domain.channels import FORCE, LATERAL_FORCE
from palpate.domain.waypoints import MOVES
from palpate.errors import PluginError
from palpate.plugins.provides import Provides
from palpate.testing import LinearMaterial


class Fibred(AnisotropicMaterial):
    name, summary = "fibred", "fibres"
    parameters = (
        Parameter(name="mu", unit="MPa", lower=0.1, upper=1.0, kind="modulus", description="stiffness"),
    )

    def energy_from_F(self, F, theta, fields=None):  # noqa: N802
        return theta[0] * (F[0] @ F[0] - 1.0) ** 2


class Flat(Sphere):
    name = "flat"


class FromMesh(Fibred):
    fields = ("fibre",)


SHORT = Provides(motions=("depth",))
MOVED = np.array([[0.0] * 6, [2.0, 0.5, 0.0, 1.0, 0.0, 5.0]])
PULLED = HomogeneousTests(paths={"uniaxial": [1.0, 2.0]})
LOADS = np.array([[np.nan] * 6, [3.0, *[np.nan] * 5]])


def job(protocol, *materials):
    return Job(
        spot="p1",
        set_id=0,
        materials={f"r{k}": material for k, material in enumerate(materials)},
        thetas={f"r{k}": np.array([0.5]) for k in range(len(materials))},
        protocol=protocol,
    )


def press(indenter=None, waypoints=None):
    if waypoints is not None:
        return Indentation.along(waypoints, indenter=Sphere(radius_mm=5.0), friction=0.0)
    return Indentation(indenter=indenter or Sphere(radius_mm=5.0), path=[(0, 0), (2, 0)], friction=0.0)


def test_a_body_or_a_part_of_a_motion_that_does_not_exist_is_refused():
    with pytest.raises(PluginError, match=r"provides no body 'limb' \(known: mesh, layers, specimen\)"):
        Provides(body="limb")
    with pytest.raises(PluginError, match=r"a motion has no part 'twist' .*depth, rotation, shift, tilt"):
        Provides(motions=("depth", "twist"))


@pytest.mark.parametrize("accuracy", [0.0, float("nan"), 1.0])
def test_an_accuracy_that_no_solver_has_is_refused(accuracy):
    with pytest.raises(PluginError, match="accuracy is between 0 and 1"):
        Provides(accuracy=accuracy)


def test_every_part_of_a_motion_has_its_name():
    assert press(waypoints=Waypoints(pose=MOVED, loads=LOADS)).moves == MOVES


@pytest.mark.parametrize(
    ("provides", "asked", "lacks"),
    [
        (SHORT, job(press(), LinearMaterial()), ()),
        (SHORT, job(press(Flat(radius_mm=5.0)), LinearMaterial()), ("indenter 'flat'",)),
        (replace(SHORT, indenters=None), job(press(Flat(radius_mm=5.0)), LinearMaterial()), ()),
        (
            SHORT,
            job(press(waypoints=Waypoints(pose=MOVED, loads=LOADS)), LinearMaterial()),
            ("motions with rotation", "motions with shift", "motions with tilt", "motions with load"),
        ),
        (replace(SHORT, max_regions=1), job(press(), LinearMaterial(), LinearMaterial()), ("2 regions",)),
        (SHORT, job(press(), Fibred()), ("anisotropic materials such as 'fibred'",)),
        (replace(SHORT, anisotropic=True), job(press(), Fibred()), ()),
        (
            replace(SHORT, anisotropic=True),
            job(press(), FromMesh()),
            ("cell data fibre, which material 'fibred' takes",),
        ),
        (replace(SHORT, anisotropic=True, fields=True), job(press(), FromMesh()), ()),
        (SHORT, job(PULLED, LinearMaterial()), ("homogeneous tests",)),
        (Provides(body="specimen"), job(press(), LinearMaterial()), ("indentations",)),
    ],
)  # fmt: skip
def test_what_a_job_needs_and_a_solver_lacks_is_named(provides, asked, lacks):
    assert provides.lacks(asked) == lacks


def test_a_channel_is_computed_by_its_name_or_from_its_columns():
    assert Provides().computes(FORCE)
    assert not Provides().computes(LATERAL_FORCE)
    assert Provides(columns=("slide_mm", "lateral_force_N")).computes(LATERAL_FORCE)
