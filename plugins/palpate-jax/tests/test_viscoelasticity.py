"""Tissue that relaxes: closed forms of one element, tangent, slopes, level 1's convolution, and FEBio."""

from dataclasses import replace

import meshio
import numpy as np
import pytest

from palpate.api import IsotropicMaterial, relaxing
from palpate.domain import Channel, Indentation, Job, Parameter, Status
from palpate.domain.indenter import Sphere
from palpate.errors import StudyError
from palpate.mesh.specimens import block
from palpate_jax import load_stepping
from palpate_jax.body import Body
from palpate_jax.fields import cell_fields
from palpate_jax.newton import Balance, equilibrium
from palpate_jax.schedule import schedule
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_materials import NeoHookean, Yeoh
from palpate_materials.relaxation import FORCE_OVER_TIME, TORQUE_OVER_TIME, relaxed

TIMES_S, SHARES = np.array([0.5, 4.0]), np.array([0.3, 0.2])
LAME, SHEAR = 0.3, 0.05


class SaintVenant(IsotropicMaterial):
    """Stress S = λ tr E + 2 μ E, straight in the strain E: closed forms in time are short."""

    name, summary = "saint_venant", "Saint Venant–Kirchhoff"
    parameters = tuple(
        Parameter(name=name, unit="MPa", lower=0.01, upper=1.0, kind="modulus", description="")
        for name in ("lame", "mu")
    )

    def energy(self, stretches, theta):
        E = 0.5 * (stretches**2 - 1.0)
        return 0.5 * theta[0] * E.sum(axis=-1) ** 2 + theta[1] * (E**2).sum(axis=-1)


CUBE = block("hex8", n_across=1, n_down=1, width_mm=1.0, height_mm=1.0).mesh
VALUES = {"soft_tissue": np.array([LAME, SHEAR, *SHARES])}


def traction_along(F_of_time, times_s, turn=None):
    """P e_z (n, 3) [MPa] of a cube that is deformed as a whole; ``turn`` follows in the second half."""
    body = Body(CUBE, {"soft_tissue": relaxing(SaintVenant(), TIMES_S)}, False)
    top = CUBE.points_mm[:, 2] > -0.5
    history, found = body.at_rest(), []
    for k in range(1, len(times_s)):
        F = F_of_time(times_s[k])
        F = F if turn is None or 2 * k < len(times_s) else turn @ F
        u = CUBE.points_mm @ (F - np.eye(3)).T
        thetas = body.in_step(VALUES, history, times_s[k] - times_s[k - 1])
        found.append(body.force(u, thetas)[0][top].sum(axis=0))
        history = body.after(u, thetas)
    return np.array(found)


def sheared(amount):
    return np.eye(3) + amount * np.outer([1.0, 0.0, 0.0], [0.0, 0.0, 1.0])


def stretched(amount):
    return np.diag([1.0, 1.0, 1.0 + amount])


def convolved(at_once, history):
    """∫ g(t - s) dSᵉ(s), given ∫ e^(-(t - s)/τ) dSᵉ(s) for each τ."""
    return at_once - sum(g * (at_once - h) for g, h in zip(SHARES, history, strict=True))


def check(found, S13, S33, amount):
    """P e_z = F S e_z of a shear in x with these stresses (n,)."""
    expected = np.stack([S13 + amount * S33, np.zeros_like(S13), S33], axis=1)
    assert np.abs(found - expected).max() < 1e-4 * np.abs(expected).max()


def test_a_step_of_shear_relaxes_as_the_modulus_does():
    time, amount = np.r_[0.0, 0.0, np.geomspace(0.01, 30.0, 12)], 0.4
    found, t = traction_along(lambda _: sheared(amount), time), time[1:, None]
    g = 1.0 - (SHARES * (1.0 - np.exp(-t / TIMES_S))).sum(axis=1)
    check(found, g * SHEAR * amount, g * (0.5 * LAME + SHEAR) * amount**2, amount)


def test_a_ramp_of_shear_has_its_closed_form():
    """The shear stress grows with time, the normal one with its square: ∫ e^(-(t-s)/τ) d(s²)."""
    time, rate = np.linspace(0.0, 2.0, 101), 0.3
    found, t = traction_along(lambda t: sheared(rate * t), time), time[1:]
    straight = [tau * -np.expm1(-t / tau) for tau in TIMES_S]
    square = [2.0 * tau * (t - tau * -np.expm1(-t / tau)) for tau in TIMES_S]
    S13 = SHEAR * rate * convolved(t, straight)
    S33 = (0.5 * LAME + SHEAR) * rate**2 * convolved(t**2, square)
    check(found, S13, S33, rate * t)


def cyclic(t, omega, tau):
    """∫ e^(-(t - s)/τ) ω cos(ωs) ds."""
    product = omega * tau
    transient = np.exp(-t / tau)
    return product / (1.0 + product**2) * (np.cos(omega * t) + product * np.sin(omega * t) - transient)


def test_cyclic_shear_has_its_closed_form():
    time, omega, size = np.linspace(0.0, 4.0, 401), 2.0 * np.pi / 2.0, 0.3
    found, t = traction_along(lambda t: sheared(size * np.sin(omega * t)), time), time[1:]
    S13 = SHEAR * size * convolved(np.sin(omega * t), [cyclic(t, omega, tau) for tau in TIMES_S])
    square = [square_of_sine(t, omega, tau) for tau in TIMES_S]
    S33 = (0.5 * LAME + SHEAR) * size**2 * convolved(np.sin(omega * t) ** 2, square)
    check(found, S13, S33, size * np.sin(omega * t))


def square_of_sine(t, omega, tau):
    """∫ e^(-(t - s)/τ) d(sin² ωs) = ∫ e^(-(t - s)/τ) ω sin(2ωs) ds."""
    product, twice = 2.0 * omega * tau, 2.0 * omega * t
    change = np.sin(twice) - product * (np.cos(twice) - np.exp(-t / tau))
    return omega * tau / (1.0 + product**2) * change


def test_cyclic_uniaxial_stretch_has_its_closed_form():
    """E_33 = a + a²/2 with a = 0.2 sin ωt, and so S_33 = (λ + 2μ) E_33."""
    time, omega, size = np.linspace(0.0, 4.0, 401), np.pi, 0.2
    found, t = traction_along(lambda t: stretched(size * np.sin(omega * t)), time), time[1:]
    a = size * np.sin(omega * t)
    history = [
        size * cyclic(t, omega, tau) + 0.5 * size**2 * square_of_sine(t, omega, tau) for tau in TIMES_S
    ]
    S33 = (LAME + 2.0 * SHEAR) * convolved(a + 0.5 * a**2, history)
    expected = (1.0 + a) * S33
    assert np.abs(found[:, 2] - expected).max() < 1e-4 * np.abs(expected).max()
    assert np.abs(found[:, :2]).max() < 1e-12


def test_stresses_turn_with_the_tissue():
    cos, sin = np.cos(1.1), np.sin(1.1)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]) @ np.array(
        [[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]]
    )
    time = np.linspace(0.0, 2.0, 11)
    straight, turned = (traction_along(lambda t: sheared(0.3 * t), time, each) for each in (None, turn))
    late = 2 * np.arange(1, 11) >= 11
    np.testing.assert_allclose(turned, np.where(late[:, None], straight @ turn.T, straight), atol=1e-14)


# ------------------------------------------------------------------------------- tangent


@pytest.mark.parametrize("isochoric", [False, True])
@pytest.mark.parametrize(("kind", "mean"), [("hex8", True), ("tet4", True), ("tet10", False)])
def test_the_tangent_is_the_derivative_of_the_forces(kind, mean, isochoric):
    mesh = block(kind, n_across=2, n_down=2, width_mm=2.0, height_mm=2.0, layers_mm={"skin": 1.0}).mesh
    materials = {"skin": NeoHookean(), "soft_tissue": relaxing(Yeoh(), TIMES_S, isochoric)}
    values = {"skin": np.array([0.1, 0.4]), "soft_tissue": np.array([0.014, -0.001, 1e-4, 0.3, *SHARES])}
    body = Body(mesh, materials, mean)
    unknowns = np.arange(3 * mesh.n_nodes).reshape(-1, 3)
    n, places = unknowns.size, []
    for part in body.blocks:
        own = unknowns[part.nodes].reshape(len(part.nodes), -1)
        places.append(own[:, :, None] * n + own[:, None, :])
    body.bind(places, n * n)
    u, d = 0.05 * np.random.default_rng(3).standard_normal((2, mesh.n_nodes, 3))
    thetas = body.in_step(values, body.at_rest(), 0.3)
    thetas = body.in_step(values, body.after(u + 0.5 * d, thetas), 0.7)
    force, stiffness, _ = body.tangent(u, thetas)
    np.testing.assert_allclose(force, body.force(u, thetas)[0], atol=1e-12 * np.abs(force).max())
    ahead, behind = (body.force(u + sign * 1e-5 * d, thetas)[0] for sign in (1, -1))
    slope = (ahead - behind) / 2e-5
    along = (stiffness.reshape(n, n) @ d.ravel()).reshape(-1, 3)
    np.testing.assert_allclose(along, slope, atol=1e-7 * np.abs(slope).max())


# ---------------------------------------------------------------------------- the solver

SIZE = {"width_mm": 24.0, "height_mm": 10.0, "grading": 1.4}
YEOH = [0.0141, -0.0011, 1.05e-4, 0.4]
PATH = ((0.0, 0.0), (2.0, 0.0), (2.0, 0.0), (2.0, -15.0))
WHEN = (0.0, 1.0, 3.0, 4.0)
TIGHT = {"depth_steps": 4, "rotation_step_deg": 7.5, "tolerance": 1e-10}
LIMB = block("hex8", n_across=8, n_down=2, **SIZE)
BONDED_MM = 4.0
DEPTH_OVER_TIME = Channel(
    name="depth_over_time", abscissa="time_s", ordinate="depth_mm", abscissa_label="", ordinate_label=""
)


def glued(limb):
    x = limb.mesh.points_mm
    disc = np.flatnonzero((x[:, 2] == 0.0) & (np.hypot(x[:, 0], x[:, 1]) < BONDED_MM))
    return replace(limb, mesh=replace(limb.mesh, node_sets={**limb.mesh.node_sets, "bonded": disc}))


def make_job(values, materials=None, path=PATH, when=WHEN, friction=0.6, **changes):
    values = values if isinstance(values, dict) else {"soft_tissue": values}
    protocol = Indentation(
        indenter=Sphere(radius_mm=7.5),
        path=np.array(path),
        friction=friction,
        time_s=None if when is None else np.array(when),
    )
    return Job(
        spot="block",
        set_id=0,
        materials=materials or {"soft_tissue": relaxing(Yeoh(), TIMES_S)},
        thetas={region: np.asarray(theta, dtype=float) for region, theta in values.items()},
        protocol=protocol,
        **changes,
    )


def run(job, limb=LIMB, **settings):
    simulation = JaxSolver(JaxSettings(**TIGHT | settings)).simulate(job, limb)
    assert simulation.status is Status.OK, simulation.message
    return simulation


def test_no_share_changes_nothing():
    elastic = run(make_job(YEOH, {"soft_tissue": Yeoh()}))
    none = run(make_job([*YEOH, 0.0, 0.0]))
    for name, curve in elastic.response.curves.items():
        at = none.response.curves[name]
        expected = np.interp(at.time_s, curve.time_s, curve.ordinate)
        np.testing.assert_allclose(at.ordinate, expected, atol=1e-7 * np.abs(expected).max())


def test_a_tissue_that_relaxes_needs_times():
    with pytest.raises(StudyError, match="'soft_tissue' relaxes, which needs the times of its press"):
        JaxSolver().check(make_job([*YEOH, *SHARES], when=None), LIMB)


def test_fields_of_a_tissue_that_relaxes_carry_its_force(tmp_path):
    """At the base: the mean of the elements' stress is as far off before the dwell as after it."""
    job = make_job([*YEOH, *SHARES], path=PATH[:3], when=WHEN[:3])
    simulation = run(job, fields="all", fields_folder=str(tmp_path))
    files = sorted(tmp_path.rglob("*.vtu"))
    assert len(files) == len(simulation.diagnostics["depth_mm"])
    points = LIMB.mesh.points_mm[LIMB.mesh.cells["hex8"]]
    at_base = points[:, :, 2].min(axis=1) < LIMB.mesh.points_mm[:, 2].min() + 1e-9
    areas = np.prod(np.ptp(points[at_base], axis=1)[:, :2], axis=1)
    stress_ = [meshio.read(files[k]).cell_data["cauchy_stress_MPa"][0][at_base, 8] for k in (3, -1)]
    before, after = (-(each * areas).sum() for each in stress_)
    force = np.array(simulation.diagnostics["force_N"])[:, 2]
    assert force[-1] < 0.85 * force[3]
    assert before == pytest.approx(force[3], rel=0.1)
    assert after / before == pytest.approx(force[-1] / force[3], rel=0.01)


@pytest.mark.parametrize("isochoric", [False, True])
@pytest.mark.parametrize(("kind", "mean"), [("hex8", True), ("tet4", True), ("tet10", False)])
def test_the_stress_of_fields_does_the_work_of_the_forces(kind, mean, isochoric):
    """Σ x ⊗ f over the nodes is ∫ σ dv over the deformed elements, whatever the history."""
    mesh = block(kind, n_across=2, n_down=2, width_mm=2.0, height_mm=2.0).mesh
    turn = np.linalg.qr(np.random.default_rng(5).standard_normal((3, 3)))[0]
    material, theta = relaxing(Yeoh(), TIMES_S, isochoric), np.array([*YEOH, *SHARES])
    body = Body(mesh, {"soft_tissue": material}, mean, turn)
    u, d = 0.05 * np.random.default_rng(3).standard_normal((2, mesh.n_nodes, 3))
    thetas = body.in_step({"soft_tissue": theta}, body.at_rest(), 0.3)
    thetas = body.in_step({"soft_tissue": theta}, body.after(u + 0.5 * d, thetas), 0.7)
    work = np.einsum("ai,aj->ij", body.force(u, thetas)[0], mesh.points_mm + u)
    (part,), volumes = body.blocks, np.zeros(mesh.n_cells)
    np.add.at(volumes, np.arange(mesh.n_cells), part.volumes[part.places].sum(axis=1))
    for history, is_same in ((body.after(u, thetas)[0].lost(SHARES), True), (None, False)):
        cauchy, _, J = cell_fields(material, theta, part, u, turn, history)
        carried = np.einsum("c,cij->ij", volumes * J, cauchy)
        assert np.allclose(carried, work, rtol=0.0, atol=1e-9 * np.abs(work).max()) is is_same


def test_a_dwell_has_steps_where_something_relaxes():
    protocol = make_job(YEOH).protocol
    plain, fine = (schedule(protocol, 4, 7.5, fastest_s) for fastest_s in (0.0, 0.5))
    times = [target.time_s for target in plain.targets]
    assert times == [0.25, 0.5, 0.75, 1.0, 3.0, 3.5, 4.0]
    dwell = np.array([t.time_s for t in fine.targets if 1.0 < t.time_s <= 3.0])
    assert set(times) < {target.time_s for target in fine.targets}
    assert dwell[0] == pytest.approx(1.05)
    assert dwell[-1] == 3.0
    assert np.diff(np.log10(dwell - 1.0)).max() < 1.0 / 6.0 + 1e-9


@pytest.mark.parametrize("limb", [LIMB, glued(LIMB)], ids=["sphere", "bonded"])
@pytest.mark.parametrize(("depth_mm", "on_the_way", "in_the_end"), [(0.3, 4e-3, 1e-3), (2.0, 0.03, 2e-3)])
def test_press_and_dwell_are_the_convolution_of_the_elastic_curve(limb, depth_mm, on_the_way, in_the_end):
    """Where strains are small, and after the dwell: stresses of a deep press turn while they relax."""
    given = {"path": ((0.0, 0.0), (depth_mm, 0.0), (depth_mm, 0.0)), "when": (0.0, 1.0, 16.0)}
    given |= {"friction": 0.0, "channels": (FORCE_OVER_TIME,)}
    found = run(make_job([*YEOH, *SHARES], **given), limb).response["force_over_time"]
    elastic = run(make_job(YEOH, {"soft_tissue": Yeoh()}, **given), limb).response["force_over_time"]
    at_once = np.interp(found.time_s, elastic.time_s, elastic.ordinate)
    off = found.ordinate - relaxed(found.time_s, at_once, TIMES_S, SHARES)
    assert found.ordinate[-1] < 0.52 * elastic.ordinate[-1]
    assert np.abs(off).max() < on_the_way * found.ordinate.max()
    assert np.abs(off[-1]) < in_the_end * found.ordinate.max()


def test_cut_steps_are_followed(monkeypatch):
    """Every step of the twist cut in two is a twist of twice the steps, also in time."""
    job = make_job([*YEOH, *SHARES], slopes=True)
    expected = run(job, rotation_step_deg=3.75).response["torque"]
    tried = set()

    def fail_first(model, thetas, load, *rest):
        angle = round(float(np.rad2deg(np.arcsin(load.pose.rotation[0, 1]))), 3)
        if angle in {7.5, 15.0} - tried:
            tried.add(angle)
            return Balance(rest[0].displacements, 0, "made to fail")
        return equilibrium(model, thetas, load, *rest)

    monkeypatch.setattr(load_stepping, "equilibrium", fail_first)
    simulation = run(job)
    assert simulation.diagnostics["n_cuts"] == 2
    torque = simulation.response["torque"]
    np.testing.assert_allclose(torque.ordinate[-2:], expected.ordinate[[-3, -1]], rtol=1e-6)
    for name, slopes in torque.slopes.items():
        wanted = expected.slopes[name][[-3, -1]]
        np.testing.assert_allclose(slopes[-2:], wanted, atol=1e-5 * np.abs(wanted).max() + 1e-9)


def two_regions():
    limb = block("hex8", n_across=8, n_down=2, layers_mm={"skin": 4.0}, **SIZE)
    materials = {"skin": relaxing(NeoHookean(), [1.0]), "soft_tissue": relaxing(Yeoh(), TIMES_S, True)}
    values = {"skin": [0.08, 0.45, 0.25], "soft_tissue": [*YEOH, *SHARES]}
    return limb, materials, values


@pytest.mark.slow
@pytest.mark.parametrize("is_bonded", [False, True])
def test_slopes_are_differences(is_bonded):
    """Of two regions that relax otherwise: in all values, shares among them."""
    limb, materials, values = two_regions()
    limb, settings = glued(limb) if is_bonded else limb, {"tolerance": 1e-11}
    channels = (FORCE_OVER_TIME, TORQUE_OVER_TIME)

    def curves(values, **changes):
        return run(
            make_job(values, materials, channels=channels, **changes), limb, **settings
        ).response.curves

    found = curves(values, slopes=True)
    names = [(region, k, p.name) for region, m in materials.items() for k, p in enumerate(m.parameters)]
    for region, k, name in names:
        slopes = {channel: curve.slopes[f"{region}.{name}"] for channel, curve in found.items()}
        step = 3e-5 * min(np.abs(c.ordinate).max() / np.abs(slopes[n]).max() for n, c in found.items())
        ends = []
        for sign in (1, -1):
            theta = np.array(values[region])
            theta[k] += sign * step
            ends.append(curves(values | {region: theta}))
        for channel, curve in found.items():
            difference = (ends[0][channel].ordinate - ends[1][channel].ordinate) / (2.0 * step)
            rounding = settings["tolerance"] * np.abs(curve.ordinate).max() / step
            error = np.abs(slopes[channel] - difference).max()
            assert error < 1e-5 * np.abs(difference).max() + rounding, (region, name, channel)


@pytest.mark.slow
def test_the_slope_in_friction_is_a_difference():
    found, step = run(make_job([*YEOH, *SHARES], slopes=True)).response["torque"], 1e-5
    ahead, behind = (
        run(make_job([*YEOH, *SHARES], friction=0.6 + sign * step)).response["torque"] for sign in (1, -1)
    )
    difference = (ahead.ordinate - behind.ordinate) / (2.0 * step)
    np.testing.assert_allclose(
        found.slopes["friction"], difference, atol=1e-4 * np.abs(difference).max() + 1e-9
    )


def held_force(values, **changes):
    """Depth over time of a tool that presses with 1 N from 1 s to 6 s."""
    path, when = ((0.0, 0.0), (4.0, 0.0), (4.0, 0.0)), (0.0, 1.0, 6.0)
    job = make_job(values, path=path, when=when, channels=(DEPTH_OVER_TIME,), **changes)
    loads = np.full((3, 6), np.nan)
    loads[1:, 0] = 1.0
    return replace(job, protocol=replace(job.protocol, loads=loads))


def test_under_a_constant_force_the_tool_sinks_in():
    depth = run(held_force([*YEOH, *SHARES]), tolerance=1e-5).response["depth_over_time"]
    late = depth.time_s >= 1.0
    assert late.sum() > 5
    assert (np.diff(depth.ordinate[late]) > 0.0).all()
    assert depth.ordinate[-1] > 1.2 * depth.ordinate[late][0]


@pytest.mark.slow
def test_slopes_of_the_depth_under_a_constant_force_are_differences():
    values = np.array([*YEOH, *SHARES])
    found = run(held_force(values, slopes=True)).response["depth_over_time"]
    for k, parameter in enumerate(relaxing(Yeoh(), TIMES_S).parameters):
        slopes = found.slopes[f"soft_tissue.{parameter.name}"]
        step = 1e-5 * found.ordinate.max() / np.abs(slopes).max() * np.eye(len(values))[k]
        ahead, behind = (
            run(held_force(values + sign * step)).response["depth_over_time"].ordinate for sign in (1, -1)
        )
        difference = (ahead - behind) / (2.0 * step[k])
        assert np.abs(slopes - difference).max() < 2e-5 * np.abs(difference).max(), parameter.name
