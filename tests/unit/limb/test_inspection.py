"""Regions with the name of a bone are rigid, and the spot is where the mesh is finest; else it is asked."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.limb.inspection import bones, likely_sets, places
from palpate.mesh.specimens import block

BONES = (
    *(
        "bone",
        "Bones",
        "BONE-1",
        "bone_2",
        "Tibia",
        "left_tibia",
        "FemurLeft",
        "ulna_and_radius",
        "tibia_shaft",
    ),
    *(
        "cortical bone",
        "rigid_bone",
        "PART-FEMUR-1",
        "head of the femur",
        "patella",
        "L_Humerus",
        "vertebra_4",
    ),
    *("Knochen", "Unterarmknochen", "Schienbein", "hueso", "osso", "pelvis"),
)
ASKED = ("forearm_bone", "skull_base", "bone_cement", "no_bone", "bone_tissue", "stump bone")
SOFT = (
    *(
        "bone_marrow",
        "skin_over_radius",
        "fat_near_tibia",
        "BoneMarrow",
        "tibialis_anterior",
        "quadratus_femoris",
    ),
    *("extensor carpi ulnaris", "fibularis_longus", "patellar_ligament", "soft_tissue", "muscle around bone"),
    *("subcutis", "Knochenmark", "Fettgewebe", "skin", "trombone", "carbonea", "tissue", "3", ""),
)


@pytest.mark.parametrize("name", [*BONES, *ASKED, *SOFT])
def test_a_bone_is_known_by_the_words_of_its_name(name):
    assert bones([name]) == ([name] if name in BONES else [], [name] if name in ASKED else [])


def test_bone_is_a_support_where_no_set_is():
    regions = ["skin", "bone_marrow", "femur"]
    assert likely_sets(["skin face"], regions) == ("skin face", ["femur"], [])
    assert likely_sets(["skin face", "cuts"], regions)[1] == ["cuts"]


def test_soft_tissue_is_a_support_where_its_name_says_so_alone():
    soft = ["skin", "subcutaneous", "bone_marrow", "threshold", "fat_base"]
    assert likely_sets([*soft, "forearm_bone", "Knochen"])[1] == ["forearm_bone", "Knochen"]
    assert likely_sets([*soft, "fixed_muscle", "cut_end"])[1] == ["fixed_muscle", "cut_end"]


def test_a_set_that_is_neither_skin_nor_support_is_named():
    skin, held, (unused,) = likely_sets(["hueso", "corte_izq", "lado", "piel_superficie"])
    assert (skin, held) == ("piel_superficie", ["hueso", "corte_izq"])
    assert "not used: lado; if the limb is held there" in unused
    assert "cuts" in likely_sets(["fixed", "cuts", "contact"])[2][0]
    assert likely_sets(["renal_cortex", "corteza", "contact"])[1] == []
    assert likely_sets(["Schnitt", "Außenseite"])[:2] == ("Außenseite", ["Schnitt"])
    assert likely_sets(["cut surfaces", "Skin Contact"]) == ("Skin Contact", ["cut surfaces"], [])


def test_external_is_the_skin_where_no_other_word_is_in_the_name():
    others = ["humerus_dexter", "external_fixator", "obliquus_externus", "external fixed", "muscle_exterior"]
    for name in [*others, "external_femur"]:
        assert likely_sets([name])[0] is None, name
    for name in ("exterior", "externe", "Extérieur", "external_face", "esterno"):
        assert likely_sets([*others, name])[0] == name


@pytest.mark.parametrize("fine_x_mm", [(0.0,), (-12.0, 12.0), (-6.0, 6.0)])
def test_the_spot_is_at_each_place_where_the_mesh_is_finest(fine_x_mm):
    """Nodes of the skin crowd at one or two places."""
    limb = block("hex8", width_mm=60.0, n_across=30, n_down=2)
    points = limb.mesh.points_mm.copy()
    x = np.linspace(-30.0, 30.0, 4001)
    density = 0.1 + sum(np.exp(-(((x - at) / 4.0) ** 2)) for at in fine_x_mm)
    share = np.cumsum(density) / density.sum()
    points[:, 0] = np.interp((points[:, 0] + 30.0) / 60.0, share, x)
    density = 0.1 + np.exp(-((x / 4.0) ** 2))
    points[:, 1] = np.interp((points[:, 1] + 30.0) / 60.0, np.cumsum(density) / density.sum(), x)
    elsewhere = replace(limb, mesh=replace(limb.mesh, points_mm=points + np.array([0.0, 0.0, 80.0])))
    found = sorted(spot.position_mm.tolist() for spot in places(elsewhere))
    np.testing.assert_allclose(found, [[at, 0.0, 80.0] for at in fine_x_mm], atol=3.0)
    (at_origin,) = places(replace(limb, mesh=replace(limb.mesh, points_mm=points)))
    assert not at_origin.position_mm.any()
