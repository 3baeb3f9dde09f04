"""Patches of linear tetrahedra, meshes of mixed kinds, and the rules of the elements."""

from math import factorial

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from palpate.domain import Mesh
from palpate.mesh.specimens import block
from palpate_jax.body import Body, blocks
from palpate_jax.elements import ELEMENTS, PLAIN_ELEMENTS, tetrahedron_patches
from palpate_materials.uncoupled import Ogden, Yeoh

YEOH = np.array([0.0141, -0.0011, 1.05e-4, 0.8])
OGDEN = np.array([0.055, 2.4, 0.9])
SIX_TETS = np.array([[0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]])
MATERIALS = {"skin": Ogden(), "soft_tissue": Yeoh()}
THETAS = {"skin": OGDEN, "soft_tissue": YEOH}
F = np.array([[1.1, 0.2, 0.0], [0.05, 0.9, 0.1], [0.0, -0.1, 1.05]])


def box(kind, n_across=4, n_down=4, **more):
    """A block of one kind, or of hex8 below and tet4 above; its points are not in the order of a grid."""
    if kind != "mixed":
        return block(kind, n_across=n_across, n_down=n_down, width_mm=4.0, height_mm=3.0, **more).mesh
    mesh = box("hex8", n_across, n_down, **more)
    cells, regions = mesh.cells["hex8"], mesh.cell_regions["hex8"]
    above = mesh.points_mm[cells].mean(axis=1)[:, 2] > -1.5
    return Mesh(
        points_mm=mesh.points_mm,
        cells={"hex8": cells[~above], "tet4": cells[above][:, SIX_TETS].reshape(-1, 4)},
        cell_regions={"hex8": regions[~above], "tet4": np.repeat(regions[above], 6)},
        regions=mesh.regions,
        node_sets=mesh.node_sets,
    )


def scattered(seed=0, n=300):
    """A cloud of points in a ball and their Delaunay tetrahedra without slivers."""
    from scipy.spatial import Delaunay

    rng = np.random.default_rng(seed)
    points = rng.standard_normal((n, 3))
    points *= (rng.random((n, 1)) ** (1 / 3)) / np.linalg.norm(points, axis=1, keepdims=True)
    tets = Delaunay(points).simplices
    edges = points[tets[:, 1:]] - points[tets[:, :1]]
    volumes = np.linalg.det(edges)
    tets[volumes < 0] = tets[volumes < 0][:, [1, 0, 2, 3]]
    return points, tets[np.abs(volumes) > 1e-5]


# ------------------------------------------------------------------------ rules


def test_the_plain_rule_of_tet10_integrates_cubics():
    rule = PLAIN_ELEMENTS["tet10"]
    assert rule.slopes.shape == (8, 10, 3)
    assert ELEMENTS["tet10"].slopes.shape == (4, 10, 3)
    from palpate_jax.elements import _tet_points_plain

    points, weights = _tet_points_plain()
    for powers in np.ndindex(4, 4, 4):
        if sum(powers) <= 3:
            exact = np.prod([factorial(k) for k in powers]) / factorial(sum(powers) + 3)
            assert (weights * np.prod(points**powers, axis=1)).sum() == pytest.approx(exact, abs=1e-14)


# ---------------------------------------------------------------------- patches


def face_neighbours(tets):
    faces = np.sort(tets[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]], axis=2).reshape(-1, 3)
    _, label, counts = np.unique(faces, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(label.ravel(), kind="stable")
    shared = counts[label.ravel()[order]] == 2
    return (order[shared] // 4).reshape(-1, 2)


@pytest.mark.parametrize("seed", range(3))
def test_patches_hang_together_by_faces_and_none_is_small(seed):
    points, tets = scattered(seed)
    labels = tetrahedron_patches(points, tets)
    pairs = face_neighbours(tets)
    inside = pairs[labels[pairs[:, 0]] == labels[pairs[:, 1]]]
    links = coo_array((np.ones(len(inside)), inside.T), shape=(len(tets), len(tets)))
    n_parts, _ = connected_components(links, directed=False)
    sizes = np.bincount(labels)
    assert n_parts == len(sizes) == labels.max() + 1
    assert sizes.max() <= 12
    assert 6.0 <= sizes.mean() <= 9.0
    _, pieces = connected_components(
        coo_array((np.ones(len(pairs)), pairs.T), shape=(len(tets), len(tets))), directed=False
    )
    main = pieces == np.bincount(pieces).argmax()
    assert (sizes[labels[main]] >= 5).mean() > 0.98
    assert sizes[labels[main]].min() > 1


def test_patches_of_a_split_grid_are_its_cells():
    mesh = box("tet4")
    labels = tetrahedron_patches(mesh.points_mm, mesh.cells["tet4"])
    assert (labels.reshape(-1, 6) == labels[::6, None]).all()
    assert (np.bincount(labels) == 6).all()


def test_patches_do_not_depend_on_the_position_of_the_limb():
    points, tets = scattered()
    turn, _ = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))
    labels = tetrahedron_patches(points, tets)
    np.testing.assert_array_equal(tetrahedron_patches(7.0 * points @ turn.T + 3.0, tets), labels)


def test_a_single_tetrahedron_is_a_patch():
    points, tets = np.vstack([np.zeros(3), np.eye(3)]), np.array([[0, 1, 2, 3]])
    assert tetrahedron_patches(points, tets).tolist() == [0]


def test_patches_stay_within_their_region():
    mesh = box("tet4", layers_mm={"skin": 1.5})
    found = {b.region: b for b in blocks(mesh)}
    assert set(found) == {"skin", "soft_tissue"}
    for name, part in found.items():
        own = mesh.cells["tet4"][mesh.cell_regions["tet4"] == mesh.regions.index(name)]
        assert set(part.nodes.ravel()) == set(own.ravel())
        assert part.volumes.sum() == pytest.approx(24.0, rel=1e-12)


def test_what_fills_a_patch_up_has_no_volume_and_no_gradient():
    points, tets = scattered()
    mesh = Mesh(
        points_mm=points,
        cells={"tet4": tets},
        cell_regions={"tet4": np.zeros(len(tets))},
        regions=("soft_tissue",),
        node_sets={},
    )
    (part,) = blocks(mesh)
    filling = part.volumes == 0.0
    assert filling.any()
    assert (~filling).sum() == len(tets)
    assert not part.gradients[filling].any()
    np.testing.assert_allclose(part.gradients.sum(axis=2), 0.0, atol=1e-9)
    own = np.array([np.unique(nodes).size for nodes in part.nodes])
    used = (part.gradients != 0.0).any(axis=(1, 3)).sum(axis=1)
    np.testing.assert_array_equal(own, used)
    places = np.einsum("eqai,eaj->eqij", part.gradients, points[part.nodes])
    np.testing.assert_allclose(places[~filling], np.broadcast_to(np.eye(3), (len(tets), 3, 3)), atol=1e-9)


# ----------------------------------------------------------- formulation by region


def test_regions_may_be_named_that_have_the_mean_dilatation():
    mesh = box("hex8", 2, 2, layers_mm={"skin": 1.5})
    u = 0.05 * np.random.default_rng(6).standard_normal((mesh.n_nodes, 3))
    found = {b.region: b.mean_dilatation for b in blocks(mesh, ("skin",))}
    assert found == {"skin": True, "soft_tissue": False}

    def forces(mean):
        return Body(mesh, MATERIALS, mean).force(u, THETAS)[0]

    mixed, below = forces(("skin",)), mesh.points_mm[:, 2] < -1.5
    np.testing.assert_allclose(mixed[below], forces(False)[below], rtol=1e-12)
    np.testing.assert_allclose(
        mixed[mesh.points_mm[:, 2] == 0], forces(True)[mesh.points_mm[:, 2] == 0], rtol=1e-12
    )
    assert not np.allclose(forces(True)[below], forces(False)[below], rtol=1e-3)


# ------------------------------------------------- laws that every mesh must keep

CASES = [
    pytest.param(kind, mean, id=f"{kind}-{'mean' if mean else 'plain'}")
    for kind in ("hex8", "tet10", "tet4", "mixed")
    for mean in (True, False)
]


@pytest.mark.parametrize(("kind", "mean"), CASES)
def test_constant_strain_balances_inside_and_turning_it_turns_the_forces(kind, mean):
    mesh = box(kind)
    body = Body(mesh, MATERIALS, mean)
    places = mesh.points_mm @ F.T
    forces, _ = body.force(places - mesh.points_mm, THETAS)
    span = np.abs(mesh.points_mm - mesh.points_mm.mean(axis=0)).max(axis=0)
    inside = (np.abs(mesh.points_mm - mesh.points_mm.mean(axis=0)) < span - 1e-9).all(axis=1)
    assert inside.sum() >= 27
    assert np.abs(forces[inside]).max() < 1e-12 * np.abs(forces).max()
    turn, _ = np.linalg.qr(np.random.default_rng(2).standard_normal((3, 3)))
    turn *= np.linalg.det(turn)
    turned, _ = body.force(places @ turn.T + 5.0 - mesh.points_mm, THETAS)
    np.testing.assert_allclose(turned, forces @ turn.T, atol=1e-12 * np.abs(forces).max())


def linearised(body, u, thetas):
    """Forces and the dense tangent, to be multiplied and solved with."""
    places = []
    for part in body.blocks:
        dofs = (3 * part.nodes[:, :, None] + np.arange(3)).reshape(len(part.nodes), -1)
        places.append(dofs[:, :, None] * u.size + dofs[:, None, :])
    body.bind(places, u.size**2)
    forces, values, _ = body.tangent(u, thetas)
    return forces, values.reshape(u.size, u.size)


@pytest.mark.parametrize(
    "state", ["scattered", "rest", "pulled"], ids=lambda s: s if s == "scattered" else f"equal-{s}"
)
@pytest.mark.parametrize(("kind", "mean"), CASES)
def test_tangent_is_the_slope_of_the_forces_also_at_equal_stretches(kind, mean, state):
    mesh = box(kind, 2, 2, layers_mm={"skin": 1.5})
    body = Body(mesh, MATERIALS, mean)
    rng = np.random.default_rng(4)
    noise, d = 0.05 * rng.standard_normal((2, mesh.n_nodes, 3))
    stretch = {"rest": np.ones(3), "pulled": np.array([0.9, 0.9, 1.3])}
    u = noise if state == "scattered" else mesh.points_mm * (stretch[state] - 1.0)
    forces, dense = linearised(body, u, THETAS)
    assert np.isfinite(forces).all()
    assert np.isfinite(dense).all()
    np.testing.assert_allclose(dense, dense.T, atol=1e-12 * np.abs(dense).max())
    h = 1e-5
    slope = (body.force(u + h * d, THETAS)[0] - body.force(u - h * d, THETAS)[0]) / (2 * h)
    np.testing.assert_allclose((dense @ d.ravel()).reshape(-1, 3), slope, atol=2e-7 * np.abs(slope).max())


@pytest.mark.parametrize(("kind", "mean"), CASES)
def test_rates_are_the_slopes_of_the_forces_in_every_parameter(kind, mean):
    mesh = box(kind, 2, 2, layers_mm={"skin": 1.5})
    body = Body(mesh, MATERIALS, mean)
    noise = 0.05 * np.random.default_rng(7).standard_normal((mesh.n_nodes, 3))
    u = mesh.points_mm * [-0.2, -0.2, 0.6] + noise  # far enough that every coefficient shows
    rates = body.rates(u, THETAS)
    assert set(rates) == {"skin", "soft_tissue"}
    for region, theta in THETAS.items():
        for k, value in enumerate(theta):
            h = 1e-4 * abs(value)
            ends = [
                body.force(u, THETAS | {region: theta + s * h * (np.arange(len(theta)) == k)})[0]
                for s in (1, -1)
            ]
            slope = (ends[0] - ends[1]) / (2 * h)
            share = np.abs(value * (rates[region][k] - slope)).max() / np.abs(ends[0]).max()
            assert share < 1e-9
            assert np.abs(value * slope).max() > 1e-4 * np.abs(ends[0]).max()


@pytest.mark.parametrize(("kind", "mean"), CASES)
def test_newton_converges_quadratically(kind, mean):
    mesh = box(kind, 2, 3, layers_mm={"skin": 1.0})
    body = Body(mesh, MATERIALS, mean)
    span = mesh.points_mm[:, 2].min()
    held = (mesh.points_mm[:, 2] == 0.0) | (mesh.points_mm[:, 2] == span)
    free = np.repeat(~held, 3)
    u = mesh.points_mm @ (np.array([[1.0, 0.0, 0.1], [0.0, 1.0, 0.05], [0.0, 0.0, 1.05]]) - np.eye(3)).T
    sizes = []
    for _ in range(7):
        forces, dense = linearised(body, u, THETAS)
        step = np.zeros(u.size)
        step[free] = np.linalg.solve(dense[np.ix_(free, free)], -forces.ravel()[free])
        u = u + step.reshape(u.shape)
        sizes.append(np.linalg.norm(step) / np.linalg.norm(u))
    before, after = np.array(sizes[:-1]), np.array(sizes[1:])
    assert before[0] > 0.2
    assert (after <= 3.0 * before**2 + 1e-12).all()
    assert after[-1] < 1e-12


def test_tetrahedra_on_hexahedra_keep_their_volume_as_hexahedra_do():
    """A bonded block pressed as a whole: without patches the tetrahedra above would be far too stiff."""
    answers = {}
    for kind, mean in (("hex8", True), ("mixed", True), ("mixed", False)):
        mesh = box(kind, 4, 4)
        body = Body(mesh, {"soft_tissue": Yeoh()}, mean)
        thetas = {"soft_tissue": np.array([0.0141, 0.0, 0.0, 2.0])}
        top = mesh.points_mm[:, 2] == 0.0
        held = top | (mesh.points_mm[:, 2] == mesh.points_mm[:, 2].min())
        u = np.zeros((mesh.n_nodes, 3))
        u[top, 2] = -1e-4
        _, dense = linearised(body, 0.0 * u, thetas)
        free = np.repeat(~held, 3)
        u.reshape(-1)[free] = np.linalg.solve(
            dense[np.ix_(free, free)], -dense[np.ix_(free, ~free)] @ u.reshape(-1)[~free]
        )
        answers[kind, mean] = -(dense @ u.ravel()).reshape(-1, 3)[top, 2].sum()
    right = answers["hex8", True]
    assert answers["mixed", True] == pytest.approx(right, rel=0.05)
    assert answers["mixed", False] > 1.3 * right
