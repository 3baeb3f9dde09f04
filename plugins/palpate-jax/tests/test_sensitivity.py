"""Derivatives of force and moment in every parameter, against differences and against laws."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from palpate.domain import Indentation, Job, Status
from palpate.domain.indenter import Sphere
from palpate.mesh.specimens import block
from palpate_jax import load_stepping, sparse
from palpate_jax.newton import Balance, equilibrium
from palpate_jax.path_simulation import BETWEEN
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_materials.neo_hookean import NeoHookean
from palpate_materials.uncoupled import Ogden, Yeoh

BOUND = 1e-5
"""Largest error, relative to the largest derivative of the path."""

SHIFT = 3e-5
"""Change of the largest force or moment, relative to it, by a step of the differences."""

PATH = [(0.0, 0.0), (2.0, 0.0), (2.0, -15.0), (2.0, 15.0), (2.0, 0.0)]
SIZE = {"width_mm": 24.0, "height_mm": 10.0, "grading": 1.4}
TIGHT = {"depth_steps": 4, "rotation_step_deg": 7.5, "tolerance": 1e-11}
SOLVER = JaxSolver(JaxSettings(**TIGHT))
STRIDE = BETWEEN + 1
"""Points of a curve from one equilibrium state to the next."""

OF_CONTACT = ("friction", "contact_compliance", "depth_mm")
YEOH = {"c1": 0.0141, "c2": -0.0011, "c3": 1.05e-4, "kappa": 0.4}


@dataclass(frozen=True)
class Case:
    """A limb with a material and values for each region; its path ends at one depth."""

    limb: object
    materials: dict
    values: dict
    friction: float = 0.6
    path: tuple = tuple(PATH)

    @property
    def depth_mm(self):
        return max(depth for depth, _ in self.path)

    def job(self, slopes=False, **changes):
        """The job with some of ``region.parameter`` and of :data:`OF_CONTACT` changed."""
        thetas = {
            region: np.array([changes.get(f"{region}.{name}", v) for name, v in own.items()])
            for region, own in self.values.items()
        }
        friction = changes.get("friction", self.friction)
        protocol = Indentation(
            indenter=Sphere(radius_mm=7.5),
            path=np.array(self.path) * (changes.get("depth_mm", self.depth_mm) / self.depth_mm, 1.0),
            friction=friction,
            contact_penalty=1.0 / changes.get("contact_compliance", 1.0),
        )
        given = {"materials": self.materials, "thetas": thetas, "protocol": protocol}
        return Job(spot="block", set_id=0, **given, slopes=slopes)

    def value(self, name):
        region, _, parameter = name.rpartition(".")
        of_contact = {"friction": self.friction, "contact_compliance": 1.0, "depth_mm": self.depth_mm}
        return self.values[region][parameter] if region else of_contact[name]


def run(case, solver=SOLVER, **changes):
    simulation = solver.simulate(case.job(**changes), case.limb)
    assert simulation.status is Status.OK, simulation.message
    assert simulation.diagnostics["n_cuts"] == 0
    return simulation


def sloped(case, solver=SOLVER, **changes):
    """Curves by channel, with slopes."""
    return run(case, solver, slopes=True, **changes).response.curves


def yeoh_on_hexahedra(n_down=2, **changes):
    limb = block("hex8", n_across=8, n_down=n_down, **SIZE)
    return Case(limb, {"soft_tissue": Yeoh()}, {"soft_tissue": YEOH}, **changes)


def glued(limb):
    x = limb.mesh.points_mm
    disc = np.flatnonzero((x[:, 2] == 0.0) & (np.hypot(x[:, 0], x[:, 1]) < 4.0))
    return replace(limb, mesh=replace(limb.mesh, node_sets={**limb.mesh.node_sets, "bonded": disc}))


def check(case, names, found=None):
    """Compare with central differences whose step changes force or torque by the same share."""
    found = found or sloped(case)
    for name in names:
        step = SHIFT * min(np.abs(c.ordinate).max() / np.abs(c.slopes[name]).max() for c in found.values())
        ahead, behind = (
            run(case, **{name: case.value(name) + sign * step}).response.curves for sign in (1, -1)
        )
        for channel, curve in found.items():
            difference = (ahead[channel].ordinate - behind[channel].ordinate) / (2.0 * step)
            error = np.abs(curve.slopes[name] - difference).max()
            rounding = TIGHT["tolerance"] * np.abs(curve.ordinate).max() / step
            assert error < BOUND * np.abs(difference).max() + rounding, (name, channel)


@pytest.mark.slow
def test_press_twist_and_reversal_with_sliding():
    case = yeoh_on_hexahedra(path=PATH[:4])
    simulation = run(case, slopes=True)
    sticking = np.array(simulation.diagnostics["sticking"])[-4:]
    assert ((sticking > 0.0) & (sticking < 1.0)).any()
    names = [f"soft_tissue.{name}" for name in YEOH]
    check(case, [*names, *OF_CONTACT], simulation.response.curves)


@pytest.mark.slow
def test_two_regions_of_tetrahedra():
    """The skin sets the penalty; its material is coupled and one of its parameters no modulus."""
    limb = block("tet10", n_across=4, n_down=2, layers_mm={"skin": 4.0}, **SIZE)
    materials = {"skin": NeoHookean(), "soft_tissue": Yeoh()}
    case = Case(limb, materials, {"skin": {"E": 0.08, "nu": 0.45}, "soft_tissue": YEOH}, path=PATH[:3])
    check(case, ["skin.E", "skin.nu", "soft_tissue.c1", "soft_tissue.kappa", *OF_CONTACT])


@pytest.mark.slow
def test_a_bonded_indenter_pulls():
    case = yeoh_on_hexahedra(path=PATH[:3])
    case = replace(case, limb=glued(case.limb))
    assert not any(np.abs(curve.slopes["friction"]).max() for curve in sloped(case).values())
    check(case, ["soft_tissue.c1", "soft_tissue.c3"])


@pytest.mark.slow
def test_the_sphere_leaves_and_returns():
    case = yeoh_on_hexahedra(path=[*PATH[:3], (0.0, -15.0), (2.0, 0.0)])
    check(case, ["soft_tissue.c1", "friction"])


def test_cuts_are_followed(monkeypatch):
    """The states between load steps count: every twist cut in two is a path of twice the steps."""
    case = yeoh_on_hexahedra(path=PATH[:3])
    expected = sloped(case, JaxSolver(JaxSettings(**TIGHT | {"rotation_step_deg": 3.75})))["torque"].slopes
    tried = set()

    def fail_first(model, thetas, load, *rest):
        angle = round(float(load.pose.rotation[0, 1]), 6)
        start = rest[0]
        if angle in {round(float(np.sin(np.deg2rad(a))), 6) for a in (7.5, 15.0)} - tried:
            tried.add(angle)
            return Balance(start.displacements, 0, "made to fail")
        return equilibrium(model, thetas, load, *rest)

    monkeypatch.setattr(load_stepping, "equilibrium", fail_first)
    simulation = SOLVER.simulate(case.job(slopes=True), case.limb)
    assert simulation.diagnostics["n_cuts"] == 2
    for name, slopes in simulation.response["torque"].slopes.items():
        a, b = slopes[::STRIDE], expected[name][::STRIDE]
        np.testing.assert_allclose(a[-2:], b[[-3, -1]], atol=1e-6 * np.abs(b).max())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("material", "values", "shape"),
    [(Yeoh(), YEOH, ()), (Ogden(), {"c1": 0.03, "m1": 3.0, "kappa": 0.4}, ("m1",))],
    ids=["yeoh", "ogden"],
)
def test_moduli_are_homogeneous(material, values, shape):
    """Ordinates are of first degree in all moduli together: Σ θ ∂F/∂θ = F (Euler), at every point."""
    case = replace(yeoh_on_hexahedra(), materials={"soft_tissue": material}, values={"soft_tissue": values})
    for curve in sloped(case).values():
        assert curve.slopes.keys() == {*(f"soft_tissue.{name}" for name in values), *OF_CONTACT}
        moduli = {name: v for name, v in values.items() if name not in shape}
        total = sum(v * curve.slopes[f"soft_tissue.{name}"] for name, v in moduli.items())
        np.testing.assert_allclose(total, curve.ordinate, atol=1e-6 * np.abs(curve.ordinate).max())


def test_they_err_by_a_thousandth():
    """At a tolerance of 1e-4; small derivatives, such as the force's in the friction, err by more."""
    case = yeoh_on_hexahedra(n_down=3, path=PATH[:3])
    coarse = sloped(case, JaxSolver(JaxSettings(**TIGHT | {"tolerance": 1e-4})))
    for channel, curve in sloped(case).items():
        for name, expected in curve.slopes.items():
            error = np.abs(coarse[channel].slopes[name] - expected).max() / np.abs(expected).max()
            assert error < (1e-3 if name.startswith("soft_tissue") else 2e-2), (name, channel)


def test_the_slope_leads_towards_a_rigid_contact():
    """A tenth of the compliance is foreseen better by the slope than by the force as it is."""
    case = yeoh_on_hexahedra(path=PATH[:2])
    usual = sloped(case)["force"]
    stiffer = run(case, contact_compliance=0.1).response["force"].ordinate[-1]
    found = usual.ordinate[-1] - 0.9 * usual.slopes["contact_compliance"][-1]
    assert usual.ordinate[-1] < stiffer
    assert abs(found - stiffer) < 0.5 * (stiffer - usual.ordinate[-1])


def test_without_friction_no_modulus_twists():
    found = sloped(yeoh_on_hexahedra(friction=0.0))
    for name in YEOH:
        force = np.abs(found["force"].slopes[f"soft_tissue.{name}"]).max()
        assert np.abs(found["torque"].slopes[f"soft_tissue.{name}"]).max() < 1e-7 * 7.5 * force
    assert found["torque"].slopes["friction"][::STRIDE][-3] > 1.0


def test_they_change_no_result():
    case = yeoh_on_hexahedra(path=PATH[:3])
    plain = run(case).response
    for channel, curve in sloped(case).items():
        assert not plain[channel].slopes
        np.testing.assert_allclose(curve.ordinate, plain[channel].ordinate, atol=1e-8)


def test_a_singular_tangent_leaves_the_curves(monkeypatch):
    def singular_late(self, *given):
        singular_late.n_calls += 1
        if singular_late.n_calls > 2:
            raise np.linalg.LinAlgError("singular")
        return solve_all(self, *given)

    solve_all, singular_late.n_calls = sparse.LinearSolver.solve_all, 0
    monkeypatch.setattr(sparse.LinearSolver, "solve_all", singular_late)
    simulation = run(yeoh_on_hexahedra(path=PATH[:3]), slopes=True)
    assert singular_late.n_calls == 3  # not tried again
    assert simulation.diagnostics["slopes"] == "none: the tangent is singular at depth 1.5 mm, rotation 0°"
    assert not any(curve.slopes for curve in simulation.response.curves.values())
