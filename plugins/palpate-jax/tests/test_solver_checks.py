"""What the embedded solver refuses before the first step."""

import contextlib
from dataclasses import replace

import numpy as np
import pytest

from palpate.domain import HomogeneousTests, Indentation, Job, Limb, Spot
from palpate.domain.indenter import Sphere
from palpate.errors import MaterialError, MeshError, StudyError
from palpate.mesh.specimens import block
from palpate_indentation import Box, BoxSettings, Ring, RingSettings
from palpate_jax.schedule import schedule
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_materials.uncoupled import Yeoh

PROTOCOL = Indentation(indenter=Sphere(radius_mm=7.5), path=np.array([(0.0, 0.0), (2.0, 0.0)]), friction=0.5)
JOB = Job(
    spot="block",
    set_id=0,
    materials={"soft_tissue": Yeoh()},
    thetas={"soft_tissue": np.array([0.0141, -0.0011, 1.05e-4, 0.8])},
    protocol=PROTOCOL,
)


@pytest.mark.parametrize("kind", ["hex8", "tet10", "tet4"])
def test_a_sound_job_passes(kind):
    JaxSolver().check(JOB, block(kind))


def test_limbs_stay_prepared():
    """A copy of a limb, as it comes from another process, finds what was prepared for an earlier job."""
    solver, limbs = JaxSolver(), [block(n_across=n, n_down=1) for n in (2, 4)]
    prepared = [solver._paths._prepared(limb, JOB.materials) for limb in limbs]
    for limb, expected in zip(limbs, prepared, strict=True):
        copy = replace(limb, mesh=replace(limb.mesh, points_mm=limb.mesh.points_mm.copy()))
        assert solver._paths._prepared(copy, {"soft_tissue": Yeoh()}) is expected
    moved = replace(limbs[0], mesh=replace(limbs[0].mesh, points_mm=1.5 * limbs[0].mesh.points_mm))
    assert solver._paths._prepared(moved, JOB.materials) not in prepared


def test_limbs_used_last_stay_as_far_as_there_is_room(monkeypatch):
    solver, limbs = JaxSolver(), [block(n_across=n, n_down=1) for n in (2, 3, 4)]
    small, middle, large = (solver._paths._prepared(limb, JOB.materials) for limb in limbs)
    assert solver._paths._prepared(limbs[0], JOB.materials) is small
    room = limbs[0].mesh.n_nodes + limbs[1].mesh.n_nodes
    monkeypatch.setattr("palpate_jax.path_simulation.NODES_KEPT", room)
    assert solver._paths._prepared(limbs[1], JOB.materials) is middle
    assert solver._paths._prepared(limbs[0], JOB.materials) is small
    assert solver._paths._prepared(limbs[1], JOB.materials) is middle
    assert solver._paths._prepared(limbs[2], JOB.materials) is not large
    assert solver._paths._prepared(limbs[0], JOB.materials) is not small


@pytest.mark.parametrize(("offset", "word"), [(2.0, "off"), (-2.0, "inside")])
def test_a_spot_off_the_surface_is_refused(offset, word):
    limb = block()
    moved = Limb(spot=Spot(name="p9", position_mm=[0.0, 0.0, offset]), mesh=limb.mesh)
    with pytest.raises(MeshError, match=rf"'p9'.*{word} the surface by .*mm"):
        JaxSolver().check(JOB, moved)


def test_a_tool_that_starts_inside_of_the_limb_is_refused_by_name():
    """The middle of the plate is at the spot, its edges are in the hill round it."""
    limb = block(width_mm=20.0)
    bowl = limb.mesh.points_mm + [0.0, 0.0, 0.01] * np.sum(limb.mesh.points_mm[:, :2] ** 2, axis=1)[:, None]
    plate = Box(BoxSettings(length="12 mm", width="8 mm", height="4 mm", edge="1 mm"))
    job = replace(JOB, protocol=replace(PROTOCOL, indenter=plate))
    JaxSolver().check(job, limb)
    with pytest.raises(MeshError, match=r"at depth 0 the box is inside the surface by 0\.\d+ mm near"):
        JaxSolver().check(job, replace(limb, mesh=replace(limb.mesh, points_mm=bowl)))


def test_a_tool_that_never_touches_is_refused_by_name():
    """A ring around a steep hill."""
    limb, ring = block(n_across=12, width_mm=60.0), Ring(RingSettings(radius="20 mm", edge="2 mm"))
    hill = limb.mesh.points_mm - [0.0, 0.0, 0.05] * np.sum(limb.mesh.points_mm[:, :2] ** 2, axis=1)[:, None]
    job = replace(JOB, protocol=replace(PROTOCOL, indenter=ring))
    JaxSolver().check(job, limb)
    with pytest.raises(MeshError, match=r"the ring is still \d+\.\d+ mm away .* at depth 2 mm, and never"):
        JaxSolver().check(job, replace(limb, mesh=replace(limb.mesh, points_mm=hill)))


@pytest.mark.parametrize(("depth", "sound"), [(4.0, True), (5.0, False)])
def test_a_surface_that_ends_within_the_reach_of_the_sphere_is_refused(depth, sound):
    """√(7.5 · 4) = 5.5 mm and √(7.5 · 5) = 6.1 mm; the block ends at 6 mm."""
    deep = replace(PROTOCOL, path=np.array([(0.0, 0.0), (depth, 0.0)]))
    job = replace(JOB, protocol=deep)
    with (
        contextlib.nullcontext()
        if sound
        else pytest.raises(
            MeshError,
            match=r"'block': the contact surface ends 6 mm from the sphere's axis, near node \d+, .*6.12 mm",
        )
    ):
        JaxSolver().check(job, block(width_mm=12.0))


def test_a_patch_of_contact_that_is_too_small_is_refused():
    limb = block(n_across=12)
    skin = limb.mesh.node_sets["contact"]
    near = skin[np.abs(limb.mesh.points_mm[skin, :2]).max(axis=1) < 3.5]
    small = replace(limb.mesh, node_sets={**limb.mesh.node_sets, "contact": near})
    with pytest.raises(MeshError, match=r"contact surface ends 3 mm .*mark more of the surface"):
        JaxSolver().check(JOB, Limb(spot=limb.spot, mesh=small))
    spot = skin[np.abs(limb.mesh.points_mm[skin, :2]).max(axis=1) == 0.0]
    lone = replace(limb.mesh, node_sets={**limb.mesh.node_sets, "contact": spot})
    with pytest.raises(MeshError, match="no boundary face has all its nodes in the node set 'contact'"):
        JaxSolver().check(JOB, Limb(spot=limb.spot, mesh=lone))


def test_a_region_without_material_is_refused_by_name():
    with pytest.raises(MeshError, match="region 'skin' has no material"):
        JaxSolver().check(JOB, block(layers_mm={"skin": 6.0}))


def test_unstable_rest_is_refused_by_number():
    soft = replace(JOB, thetas={"soft_tissue": np.array([-0.01, 0.0, 1e-4, 0.8])})
    with pytest.raises(MaterialError, match=r"c1"):
        JaxSolver().check(soft, block())


def test_other_protocols_and_missing_meshes_are_refused():
    tests = replace(JOB, protocol=HomogeneousTests(paths={"uniaxial": np.linspace(1.0, 2.0, 5)}))
    with pytest.raises(StudyError, match="'homogeneous'"):
        JaxSolver().check(tests, block())
    with pytest.raises(StudyError, match="needs a mesh"):
        JaxSolver().check(JOB, None)


@pytest.mark.parametrize("depth", [10.0, 2.7, 5.4, 0.7])
def test_stations_keep_waypoints_to_the_last_bit_and_the_largest_step(depth):
    path = Indentation(
        indenter=Sphere(radius_mm=7.5),
        path=np.array([(0, 0), (depth, 0), (depth, -22.5), (depth, 22.5)]),
        friction=1.0,
    )
    targets = schedule(path, 3, 7.0).targets
    assert all((target.share == 1.0).all() for target in targets)
    points = np.array([target.end[[0, 5]] for target in targets])
    for waypoint in path.path[1:]:
        assert (points == waypoint).all(axis=1).any()
    moves = np.abs(np.diff(np.vstack([[0.0, 0.0], points]), axis=0))
    assert moves[:, 0].max() <= depth / 3 * (1 + 1e-12)
    assert moves[:, 1].max() <= 7.0 * (1 + 1e-12)
    assert (points[3:, 0] == depth).all()


def test_a_setting_that_names_an_unknown_region_is_refused():
    solver = JaxSolver(JaxSettings(mean_dilatation=("muscle",)))
    with pytest.raises(
        StudyError, match="mean_dilatation names region 'muscle', and the mesh has soft_tissue"
    ):
        solver.check(JOB, block())
