"""The ready studies are sound: they load, say what their data are, and hold what their text claims."""

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from palpate.experiment.measured import load_measured, measured_warnings
from palpate.limb.loading import limb_warnings, load_limbs
from palpate.mesh.spot_frame import NEAR, contact_edge_mm
from palpate.plugins.catalogue import Plugins
from palpate.study.checks import setting_warnings
from palpate.study.reading import Study, read_study

FIRST = "first-press"
FOREARM = ("forearm-demo", "forearm")
LAYERED, REAL = "forearm-layered", "forearm-real"
FIBRES = "forearm-fibres"
HOMOGENEOUS = ("treloar", "ecoflex")
TRUTH = {"soft_tissue.c1": 0.0141, "soft_tissue.c2": -0.0011, "soft_tissue.c3": 1.05e-4}


@cache
def plugins() -> Plugins:
    return Plugins.load()


def folder(name: str) -> Path:
    return Path(plugins().studies[name].directory)


@cache
def study(name: str) -> Study:
    return read_study(folder(name), plugins())


@pytest.mark.parametrize("name", [FIRST, *FOREARM, LAYERED, REAL, FIBRES, *HOMOGENEOUS])
def test_every_spot_is_measured_in_every_channel_that_counts(name: str) -> None:
    measured = load_measured(study(name), plugins().channels)
    weighted = {c for scenario in study(name).scenarios for c, w in scenario.weights.items() if w}
    assert list(measured) == [spot.spot.name for spot in study(name).spots]
    for response in measured.values():
        assert set(response) == weighted


WITHOUT_CURVES = ("residual-limb",)  # its curves are made with `palpate synthesise`
COARSE = {"multis": 7}  # its README states what the meshes do not resolve


def test_no_curve_and_no_setting_of_a_ready_study_gives_a_warning() -> None:
    for name in set(plugins().studies) - set(WITHOUT_CURVES):
        found = (
            *setting_warnings(study(name)),
            *measured_warnings(load_measured(study(name), plugins().channels)),
        )
        assert found == (), name


@pytest.mark.slow
def test_no_mesh_of_a_ready_study_gives_a_new_warning() -> None:
    for name in set(plugins().studies) - set(WITHOUT_CURVES):
        found = limb_warnings(study(name), load_limbs(study(name)))
        assert len(found) == COARSE.get(name, 0), found
        assert all("is not resolved" in text or "layer 'skin' is" in text for text in found)


@pytest.mark.parametrize("name", [FIRST, *FOREARM, LAYERED, REAL, FIBRES, *HOMOGENEOUS])
def test_simulated_data_are_called_simulated(name: str) -> None:
    simulated = name not in HOMOGENEOUS
    text = (folder(name) / "study.toml").read_text()
    readme = (folder(name) / "README.md").read_text()
    assert f'data = "{"simulated" if simulated else "measured"}"' in text
    assert ("**The experiment is simulated" in readme) is simulated
    assert ("(simulated" in plugins().studies[name].summary) is simulated


def test_the_silicone_names_its_authors_and_licence() -> None:
    readme = (folder("ecoflex") / "README.md").read_text()
    assert "A. B. Dawood et al. 2026, files EF50_0T_A1…A5" in readme
    assert "CC BY 4.0" in readme


# ----------------------------------------------------------------- homogeneous


def test_the_joint_scenario_is_plain_least_squares_over_all_points() -> None:
    """Weight = number of points, so that Σ w · mean(r²) = Σ r² (with the unit normaliser)."""
    treloar = study("treloar")
    response = load_measured(treloar, plugins().channels)["specimen"]
    joint = {scenario.name: scenario for scenario in treloar.scenarios}["joint"]
    assert joint.weights == {channel: response[channel].abscissa.size for channel in response}
    assert (treloar.scoring.score.settings.normaliser, treloar.search.name) == ("unit", "least_squares")


def test_treloars_curves_are_treloars() -> None:
    response = load_measured(study("treloar"), plugins().channels)["specimen"]
    ends = {c: (response[c].abscissa[-1], response[c].ordinate[-1]) for c in response}
    assert ends == {"uniaxial": (7.6, 6.3176), "equibiaxial": (4.45, 2.4426), "pure_shear": (4.97, 1.805)}


def test_compression_is_negative_stress_over_a_falling_stretch() -> None:
    """Stretch and stress against the raw compression and load of the file: 30 mm high, 50 mm wide."""
    for spot in study("ecoflex").spots:
        ((path,),) = spot.measured.values()
        raw = np.loadtxt(path, delimiter=",", skiprows=8)
        curve = study("ecoflex").loader.load(path, "uniaxial")["uniaxial"]
        np.testing.assert_allclose(curve.abscissa, 1.0 - raw[:, 1] / 30.0, atol=1e-6)
        np.testing.assert_allclose(curve.ordinate, -raw[:, 2] / (np.pi * 25.0**2), atol=1e-8)
        assert len(curve.branches) == 1


@pytest.mark.parametrize("name", HOMOGENEOUS)
def test_the_least_squares_solution_is_well_inside_the_ranges(name: str) -> None:
    """Yeoh is linear in its coefficients, so the best set of each scenario is known exactly."""
    ranges = [(p.lower, p.upper) for p in study(name).space.parameters]
    for response in load_measured(study(name), plugins().channels).values():
        for scenario in study(name).scenarios:
            systems = [yeoh_columns(c, response[c].abscissa) for c, w in scenario.weights.items() if w]
            stresses = [response[c].ordinate for c, w in scenario.weights.items() if w]
            best = np.linalg.lstsq(np.vstack(systems), np.concatenate(stresses))[0]
            for value, (lower, upper) in zip(best, ranges, strict=True):
                assert lower + 0.1 * (upper - lower) < value < upper - 0.1 * (upper - lower)


def yeoh_columns(mode: str, t: np.ndarray) -> np.ndarray:
    """Nominal stress of an incompressible Yeoh material per unit of c1, c2, c3: (n, 3)."""
    invariant, slope = {
        "uniaxial": (t**2 + 2 / t, 2 * (t - t**-2)),
        "equibiaxial": (2 * t**2 + t**-4, 2 * (t - t**-5)),
        "pure_shear": (t**2 + t**-2 + 1, 2 * (t - t**-3)),
    }[mode]
    return np.stack([k * (invariant - 3) ** (k - 1) * slope for k in (1, 2, 3)], axis=1)


# --------------------------------------------------------------------- forearm


@pytest.mark.slow
@pytest.mark.parametrize("name", FOREARM)
def test_the_meshes_can_be_simulated(name: str) -> None:
    limbs = load_limbs(study(name))
    for spot, limb in limbs.items():
        most = {"forearm-demo": 1800, "forearm-demo/fine": 13_500, "forearm/fine": 17_000}
        kind = f"{name}/fine" if "/fine" in spot else name
        assert limb.mesh.n_nodes < most.get(kind, 4000)
    for limb in limbs.values():
        points, skin = limb.mesh.points_mm, limb.mesh.node_sets["contact"]
        nearest = points[skin[np.linalg.norm(points[skin, :2], axis=1).argmin()]]
        assert abs(nearest[2]) < 0.05
        assert np.abs(points[skin, 2]).max() > 40.0, "the skin goes all the way round"


def volume(points: np.ndarray, cells: np.ndarray) -> float:
    """Volume [mm³] of curved tetrahedra by the four-point rule on the Jacobian determinant."""
    near, far = 0.1381966011250105, 0.5854101966249685
    slopes = np.array([[-1.0, -1, -1], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    total = 0.0
    for i in range(4):
        weight = np.full(4, near)
        weight[i] = far
        edges = [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]
        middles = [4 * (weight[a] * slopes[b] + weight[b] * slopes[a]) for a, b in edges]
        gradients = np.vstack([(4 * weight - 1)[:, None] * slopes, middles])
        total += np.linalg.det(np.einsum("ak,cai->cik", gradients, points[cells])).sum() / 24.0
    return total


@pytest.mark.slow
def test_the_demo_meshes_are_the_same_limbs() -> None:
    """Volume within 2 %, nearest bone within 1 mm of the finer meshes."""
    demo, full = load_limbs(study("forearm-demo")), load_limbs(study("forearm"))
    for spot in demo:
        a, b = demo[spot].mesh, full[spot.removesuffix("/fine")].mesh
        ratio = volume(a.points_mm, a.cells["tet10"]) / volume(b.points_mm, b.cells["tet10"])
        assert ratio == pytest.approx(1.0, abs=0.02)
        reach = [bone_depth(mesh.points_mm, mesh.node_sets["fixed"]) for mesh in (a, b)]
        assert reach[0] == pytest.approx(reach[1], abs=1.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", FOREARM)
def test_a_refined_mesh_corrects_the_fit_at_each_spot_of_the_phantom(name: str) -> None:
    limbs, near_mm = load_limbs(study(name)), NEAR * study(name).protocol.indenter.radius_mm
    for spot in study(name).spot_names:
        coarse, fine = (contact_edge_mm(limbs[of], near_mm) for of in (spot, f"{spot}/fine"))
        assert fine < 0.35 * study(name).protocol.indenter.radius_mm < coarse


def bone_depth(points: np.ndarray, fixed: np.ndarray) -> float:
    """Distance [mm] from the spot to the nearest node of a bone."""
    bone = points[fixed][np.abs(points[fixed, 0]) < 30.0]
    return float(np.linalg.norm(bone, axis=1).min())


@pytest.mark.parametrize("name", FOREARM)
def test_the_truth_is_the_one_that_made_the_data(name: str) -> None:
    (region,) = study(name).space.regions
    ones = region.material.to_textbook(np.ones(4), region.convention)
    factors = dict(zip((p.name for p in region.material.parameters), ones, strict=True))
    textbook = {key: value * factors[key.split(".")[1]] for key, value in study(name).truth.items()}
    assert textbook == pytest.approx(TRUTH)


def test_the_first_study_is_a_spot_of_the_demo_with_all_but_the_stiffness_known() -> None:
    first, demo = study(FIRST), folder("forearm-demo")
    for file in ("measured/p1.csv", "meshes/p1.vtu"):
        assert (folder(FIRST) / file).read_bytes() == (demo / file).read_bytes()
    (region,) = first.space.regions
    assert {f"soft_tissue.{name}": value for name, value in region.fixed.items() if name != "kappa"} | dict(
        first.truth
    ) == pytest.approx(TRUTH)


def test_the_demo_can_find_the_truth_but_is_not_given_it() -> None:
    for parameter in study("forearm-demo").space.parameters:
        place = (TRUTH[parameter.name] - parameter.lower) / (parameter.upper - parameter.lower)
        assert 0.1 < place < 0.9
        assert abs(place - 0.5) > 0.05


def test_the_full_study_has_the_papers_ranges() -> None:
    paper = study("forearm")
    (region,) = paper.space.regions
    assert (paper.n_sets, region.convention) == (250, "febio4")
    ranges = [(p.lower, p.upper) for p in region.searched]
    assert ranges == [(1.4e-3, 3e-2), (-3e-3, -4.14e-5), (3e-6, 3e-4)]
    assert [f.name for f in paper.filters] == ["drucker"]


def test_the_layered_mesh_has_skin_over_soft_tissue() -> None:
    mesh = load_limbs(study(LAYERED))["p2"].mesh
    skin = mesh.cells["tet10"][mesh.cell_regions["tet10"] == mesh.regions.index("skin")]
    core = mesh.cells["tet10"][mesh.cell_regions["tet10"] == mesh.regions.index("soft_tissue")]
    assert set(mesh.node_sets["contact"]) <= set(skin.ravel())
    interface = mesh.points_mm[np.intersect1d(skin, core)]
    beneath = interface[np.linalg.norm(interface[:, :2], axis=1) < 6.0]
    upper = beneath[beneath[:, 2] > -10.0]
    assert len(upper) > 10
    np.testing.assert_allclose(upper[:, 2], -2.5, atol=0.7)


@pytest.mark.parametrize("name", [LAYERED, REAL])
def test_the_layered_curves_are_of_another_solution_than_the_study_searches_in(name: str) -> None:
    """Half the usual steps, and noise: curves of the study's own mesh and steps would be an inverse crime."""
    layered = study(name)
    spot = layered.spots[-1]
    measured = load_measured(layered, plugins().channels)[spot.spot.name]
    force, torque = measured["force"], measured["torque"]
    settings = layered.solver.settings.model_dump()
    assert np.diff(np.unique(force.abscissa)).max() <= 0.5 * 10.0 / settings["depth_steps"] + 1e-9
    assert np.abs(np.diff(torque.abscissa)).max() <= 0.5 * settings["rotation_step_deg"] + 1e-9
    noise = np.std(np.diff(torque.ordinate, n=2)[2:]) / np.abs(torque.ordinate).max()
    assert noise > 0.005
    assert layered.n_sets == 0
    assert spot.fine_edge_mm is None, "finer meshes correct the fit"


@pytest.mark.parametrize("name", [LAYERED, REAL])
def test_the_layered_study_searches_a_stiffness_of_each_material_around_the_truth(name: str) -> None:
    layered = study(name)
    assert [p.name for p in layered.space.parameters] == ["skin.E", "soft_tissue.c1"]
    for parameter in layered.space.parameters:
        place = (layered.truth[parameter.name] - parameter.lower) / (parameter.upper - parameter.lower)
        assert 0.1 < place < 0.9
        assert abs(place - 0.5) > 0.05


# ------------------------------------------------------------- what texts claim


@pytest.mark.slow
@pytest.mark.parametrize("name", FOREARM)
def test_the_readme_gives_the_right_sizes(name: str) -> None:
    limbs = load_limbs(study(name))
    text = " ".join((folder(name) / "README.md").read_text().split())
    found = re.findall(r"([\d,]+) to ([\d,]+) nodes", text)
    stated = {tuple(int(end.replace(",", "")) for end in ends) for ends in found}
    for fine in (False, True):
        sizes = [limb.mesh.n_nodes for spot, limb in limbs.items() if spot.endswith("/fine") == fine]
        assert (min(sizes), max(sizes)) in stated
