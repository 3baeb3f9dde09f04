"""Derivatives of force and moment in every parameter, against differences and against laws."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from palpate.domain import Indentation, Job, Sphere, Status
from palpate.errors import StudyError
from palpate.specimens import block
from palpate_jax import load_stepping
from palpate_jax.newton import Balance, equilibrium
from palpate_jax.sensitivity import curve_slopes
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_materials.neo_hookean import NeoHookean
from palpate_materials.ogden import Ogden
from palpate_materials.yeoh import Yeoh

BOUND = 1e-5
"""Largest error, relative to the largest derivative of the path."""

SHIFT = 3e-5
"""Change of the largest force or moment, relative to it, by a step of the differences."""

PATH = [(0.0, 0.0), (2.0, 0.0), (2.0, -15.0), (2.0, 15.0), (2.0, 0.0)]
SIZE = {"width_mm": 24.0, "height_mm": 10.0, "grading": 1.4}
TIGHT = {"depth_steps": 4, "rotation_step_deg": 7.5, "tolerance": 1e-11}
PLAIN, SENSITIVE = JaxSolver(JaxSettings(**TIGHT)), JaxSolver(JaxSettings(**TIGHT, sensitivities=True))
YEOH = {"c1": 0.0141, "c2": -0.0011, "c3": 1.05e-4, "kappa": 0.4}


@dataclass(frozen=True)
class Case:
    """A limb with a material and values for each region."""

    limb: object
    materials: dict
    values: dict
    friction: float = 0.6
    path: tuple = tuple(PATH)

    def job(self, **changes):
        """The job with some of ``region.parameter`` and ``friction`` changed."""
        thetas = {
            region: np.array([changes.get(f"{region}.{name}", v) for name, v in own.items()])
            for region, own in self.values.items()
        }
        friction = changes.get("friction", self.friction)
        protocol = Indentation(indenter=Sphere(radius_mm=7.5), path=np.array(self.path), friction=friction)
        return Job(spot="block", set_id=0, materials=self.materials, thetas=thetas, protocol=protocol)

    def value(self, name):
        region, _, parameter = name.rpartition(".")
        return self.values[region][parameter] if region else self.friction


def run(solver, case, **changes):
    simulation = solver.simulate(case.job(**changes), case.limb)
    assert simulation.status is Status.OK, simulation.message
    assert simulation.diagnostics["n_cuts"] == 0
    return simulation.diagnostics


def yeoh_on_hexahedra(**changes):
    limb = block("hex8", n_across=8, n_down=3, **SIZE)
    return Case(limb, {"soft_tissue": Yeoh()}, {"soft_tissue": YEOH}, **changes)


def glued(limb):
    x = limb.mesh.points_mm
    disc = np.flatnonzero((x[:, 2] == 0.0) & (np.hypot(x[:, 0], x[:, 1]) < 4.0))
    return replace(limb, mesh=replace(limb.mesh, node_sets={**limb.mesh.node_sets, "bonded": disc}))


def check(case, names, components):
    """Compare with central differences whose step changes force or moment by the same share."""
    found = run(SENSITIVE, case)
    for name in names:
        sizes = [
            np.abs(found[what]).max() / np.abs(found[f"d_{what}"][name]).max()
            for what in ("force_N", "moment_Nmm")
        ]
        step = SHIFT * min(sizes)
        ahead, behind = (run(PLAIN, case, **{name: case.value(name) + sign * step}) for sign in (1, -1))
        for what in ("force_N", "moment_Nmm"):
            difference = (np.array(ahead[what]) - np.array(behind[what])) / (2.0 * step)
            error = np.abs(np.array(found[f"d_{what}"][name]) - difference)[:, components].max()
            assert error < BOUND * np.abs(difference).max(), (name, what)


def test_press_twist_and_reversal_with_sliding():
    case = yeoh_on_hexahedra()
    sticking = np.array(run(SENSITIVE, case)["sticking"])[-6:]
    assert ((sticking > 0.0) & (sticking < 1.0)).any()
    check(case, [*(f"soft_tissue.{name}" for name in YEOH), "friction"], [0, 1, 2])


def test_two_regions_of_tetrahedra():
    """The skin sets the penalty; its material is coupled and one of its parameters no modulus."""
    limb = block("tet10", n_across=4, n_down=2, layers_mm={"skin": 4.0}, **SIZE)
    materials = {"skin": NeoHookean(), "soft_tissue": Yeoh()}
    case = Case(limb, materials, {"skin": {"E": 0.08, "nu": 0.45}, "soft_tissue": YEOH}, path=PATH[:3])
    check(case, ["skin.E", "skin.nu", "soft_tissue.c1", "soft_tissue.kappa", "friction"], [0, 1, 2])


def test_a_bonded_indenter_pulls():
    case = yeoh_on_hexahedra(path=PATH[:3])
    case = replace(case, limb=glued(case.limb))
    assert np.abs(run(SENSITIVE, case)["d_force_N"]["friction"]).max() == 0.0
    check(case, ["soft_tissue.c1", "soft_tissue.c3"], [0, 1, 2])


def test_the_sphere_leaves_and_returns():
    case = yeoh_on_hexahedra(path=[*PATH[:3], (0.0, -15.0), (2.0, 0.0)])
    check(case, ["soft_tissue.c1", "friction"], [2])


def test_cuts_are_followed(monkeypatch):
    """The states between load steps count: every twist cut in two is a path of twice the steps."""
    case = yeoh_on_hexahedra(path=PATH[:3])
    finer = JaxSolver(JaxSettings(**TIGHT | {"rotation_step_deg": 3.75}, sensitivities=True))
    expected = run(finer, case)["d_moment_Nmm"]
    tried = set()

    def fail_first(model, thetas, load, *rest):
        angle = round(float(load.pose.rotation[0, 1]), 6)
        start = rest[0]
        if angle in {round(float(np.sin(np.deg2rad(a))), 6) for a in (7.5, 15.0)} - tried:
            tried.add(angle)
            return Balance(start, 0, "made to fail")
        return equilibrium(model, thetas, load, *rest)

    monkeypatch.setattr(load_stepping, "equilibrium", fail_first)
    simulation = SENSITIVE.simulate(case.job(), case.limb)
    assert simulation.diagnostics["n_cuts"] == 2
    for name, slopes in simulation.diagnostics["d_moment_Nmm"].items():
        a, b = (np.array(rows)[:, 2] for rows in (slopes, expected[name]))
        np.testing.assert_allclose(a[-2:], b[[-3, -1]], atol=1e-6 * np.abs(b).max())


@pytest.mark.parametrize(
    ("material", "values", "shape"),
    [(Yeoh(), YEOH, ()), (Ogden(), {"c1": 0.03, "m1": 3.0, "kappa": 0.4}, ("m1",))],
    ids=["yeoh", "ogden"],
)
def test_moduli_are_homogeneous(material, values, shape):
    """Forces are of first degree in all moduli together: Σ θ ∂F/∂θ = F (Euler)."""
    case = replace(yeoh_on_hexahedra(), materials={"soft_tissue": material}, values={"soft_tissue": values})
    found = run(SENSITIVE, case)
    for what in ("force_N", "moment_Nmm"):
        rates = found[f"d_{what}"]
        total = sum(
            v * np.array(rates[f"soft_tissue.{name}"]) for name, v in values.items() if name not in shape
        )
        expected = np.array(found[what])
        np.testing.assert_allclose(total, expected, atol=1e-6 * np.abs(expected).max())


def test_without_friction_no_modulus_twists():
    found = run(SENSITIVE, yeoh_on_hexahedra(friction=0.0))
    for name in YEOH:
        slopes = np.array(found["d_moment_Nmm"][f"soft_tissue.{name}"])[:, 2]
        force = np.abs(found["d_force_N"][f"soft_tissue.{name}"]).max()
        assert np.abs(slopes).max() < 1e-7 * 7.5 * force
    assert np.array(found["d_moment_Nmm"]["friction"])[-3, 2] > 1.0


def test_they_change_no_answer():
    case = yeoh_on_hexahedra(path=PATH[:3])
    plain, sensitive = run(PLAIN, case), run(SENSITIVE, case)
    assert "d_force_N" not in plain
    np.testing.assert_allclose(sensitive["force_N"], plain["force_N"], atol=1e-8)


def test_slopes_of_the_curves():
    """One slope for each point of each curve, so that least squares can use them as they are."""
    case = yeoh_on_hexahedra(path=PATH[:3])
    simulation = SENSITIVE.simulate(case.job(), case.limb)
    slopes = curve_slopes(simulation)
    names = {*(f"soft_tissue.{name}" for name in YEOH), "friction"}
    for channel, curve in simulation.response.curves.items():
        assert slopes[channel].keys() == names
        total = sum(v * slopes[channel][f"soft_tissue.{name}"] for name, v in YEOH.items())
        np.testing.assert_allclose(total, curve.ordinate, atol=1e-6 * np.abs(curve.ordinate).max())


def test_a_plain_run_has_no_slopes():
    case = yeoh_on_hexahedra(path=PATH[:2])
    with pytest.raises(StudyError, match="sensitivities = true"):
        curve_slopes(PLAIN.simulate(case.job(), case.limb))


def test_a_scaled_set_has_its_own():
    """A set that is a multiple of a finished one is not scaled from it, for slopes scale differently."""
    case = yeoh_on_hexahedra(path=PATH[:3])
    double = {f"soft_tissue.{name}": 2.0 * v for name, v in YEOH.items()}
    warm = JaxSolver(JaxSettings(**TIGHT, sensitivities=True, warm_start=True))
    first, second = warm.simulate_many([case.job(), case.job(**double)], case.limb)
    for name, factor in (("soft_tissue.c1", 1.0), ("friction", 2.0)):
        a, b = (np.array(s.diagnostics["d_force_N"][name])[:, 2] for s in (first, second))
        np.testing.assert_allclose(b, factor * a, atol=1e-6 * np.abs(a).max())
