"""Directions that come with the mesh: which materials take them, and in whose frame they are."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate import AnisotropicMaterial, Parameter
from palpate.domain import Job, RegionMaterial, Spot
from palpate.errors import MeshError, StudyError
from palpate.limb.cell_fields import check_frames, with_fields
from palpate.limb.loading import load_limbs
from palpate.mesh.specimens import block
from palpate.plugins.interfaces import LimbSource
from palpate.plugins.provides import Provides
from palpate.run.keys import limb_key
from palpate.simulation.jobs import check_jobs
from palpate.study.model import LimbTable

Q = Rotation.from_euler("xyz", [40.0, -70.0, 25.0], degrees=True).as_matrix()
SMALL = {"n_across": 2, "n_down": 1, "width_mm": 4.0, "height_mm": 3.0}


class Fibred(AnisotropicMaterial):
    """Directions along e1 or those of the mesh; nothing computes its energy here."""

    name, summary = "fibred", "one family of fibres"
    parameters = tuple(
        Parameter(name=n, unit="MPa", lower=0.01, upper=0.1, kind="modulus", description=n)
        for n in ("mu", "k")
    )

    def energy_from_F(self, F, theta, fields=None):  # noqa: N802 - the interface's name
        raise NotImplementedError


class FromMesh(Fibred):
    fields = ("fibre",)


def with_fibres(limb, fibres):
    kind = next(iter(limb.mesh.cells))
    return replace(limb, mesh=replace(limb.mesh, cell_fields={"fibre": {kind: fibres}}))


def unit_vectors(n):
    found = np.random.default_rng(1).standard_normal((n, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def test_a_field_is_part_of_the_key_of_the_limb():
    limb = block("hex8", **SMALL)
    fibres = unit_vectors(limb.mesh.n_cells)
    keys = {limb_key(each) for each in (limb, with_fibres(limb, fibres), with_fibres(limb, -fibres))}
    assert len(keys) == 3


def region_of(material):
    return RegionMaterial(region="soft_tissue", material=material, searched=material.parameters, fixed={})


def test_a_limb_keeps_the_fields_that_its_materials_take():
    limb = block("hex8", **SMALL)
    limb = with_fibres(limb, unit_vectors(limb.mesh.n_cells))
    assert list(with_fields(limb, [region_of(FromMesh())]).mesh.cell_fields) == ["fibre"]
    assert list(with_fields(limb, [region_of(Fibred())]).mesh.cell_fields) == []
    with pytest.raises(
        MeshError, match=r"'fibred' of region 'soft_tissue' takes cell data 'fibre', .*there: none"
    ):
        with_fields(block("hex8", **SMALL), [region_of(FromMesh())])


@pytest.mark.parametrize(("row", "message"), [([0, 0, 0], r"\[0.0, 0.0, 0.0\]"), ([1, np.nan, 0], "nan")])
def test_an_element_without_a_direction_is_named(row, message):
    limb = block("hex8", **SMALL)
    fibres = unit_vectors(limb.mesh.n_cells)
    fibres[2] = row
    with pytest.raises(MeshError, match=rf"cell data 'fibre' is .*{message}.* in hex8 element 2 of region"):
        with_fields(with_fibres(limb, fibres), [region_of(FromMesh())])
    with pytest.raises(MeshError, match=r"'fibre' of hex8 has shape \(3, 3\); give \(4,\) or \(4, 3\)"):
        with_fields(with_fibres(limb, fibres[:3]), [region_of(FromMesh())])


def note(rotation):
    motion = np.eye(4)
    motion[:3, :3] = rotation
    return {"scan_to_mesh": motion.tolist()}


@pytest.mark.parametrize(
    ("meshes", "notes", "one_frame", "message"),
    [
        ("ab", [None, None], False, "each of which may have another frame; .* or set one_frame = true"),
        ("ab", [note(np.eye(3)), None], False, "each of which may have another frame"),
        ("ab", [note(np.eye(3)), note(Q)], False, "whose notes give different frames; write the directions"),
        ("ab", [note(np.eye(3)), note(Q)], True, "whose notes give different frames"),
        ("ab", [note(Q), note(Q)], False, None),
        ("ab", [None, {"scan_to_mesh": "no"}], True, None),
        ("aa", [None, None], False, None),
    ],
)
def test_one_direction_for_meshes_of_several_frames_is_refused(tmp_path, meshes, notes, one_frame, message):
    files = {f"p{k}": tmp_path / name for k, name in enumerate(meshes)}
    if message is None:
        check_frames(region_of(Fibred()), files, notes, one_frame=one_frame)
        return
    with pytest.raises(StudyError, match=f"directions of material 'fibred' .* have 2 meshes, {message}"):
        check_frames(region_of(Fibred()), files, notes, one_frame=one_frame)


def test_a_solver_that_gives_no_fields_is_refused_a_material_that_takes_them(make_study):
    study = make_study()
    job = Job(
        spot="p1",
        set_id=0,
        materials={"soft_tissue": FromMesh()},
        thetas={"soft_tissue": np.array([0.02, 0.05])},
        protocol=study.protocol,
    )
    limbs = {"p1": block("hex8", **SMALL)}
    with pytest.raises(StudyError, match="does not provide anisotropic materials such as 'fibred'"):
        check_jobs(study, [job], limbs)
    study.solver.provides = replace(study.solver.provides, anisotropic=True)
    with pytest.raises(
        StudyError, match="does not provide cell data fibre, which material 'fibred' takes; name another"
    ):
        check_jobs(study, [job], limbs)


def test_a_study_declares_that_its_meshes_share_a_frame(make_study, tissue, tmp_path):
    class Meshed(tissue.Analytic):
        provides = Provides(fields=True, anisotropic=True)

    class Blocks(LimbSource):
        name, summary = "blocks", "blocks"

        def load(self, path, spot):
            return replace(block("hex8", **SMALL), spot=spot)

    study = make_study(solver=Meshed(), limb_source=Blocks(), protocol=None)
    spots = tuple(
        replace(each, mesh=tmp_path / f"{each.spot.name}.vtu", spot=Spot(name=each.spot.name))
        for each in study.spots[:2]
    )
    study = replace(study, spots=spots, space=replace(study.space, regions=(region_of(Fibred()),)))
    with pytest.raises(StudyError, match="set one_frame = true under"):
        load_limbs(study)
    assert len(load_limbs(replace(study, meshes=LimbTable(source="", one_frame=True)))) == 2
    assert len(load_limbs(replace(study, spots=spots[:1]))) == 1
