"""Layers of another thickness at each spot, with one material for all spots."""

from pathlib import Path

import pytest

import palpate_indentation
import palpate_jax
import palpate_materials
from palpate import open_problem, read_study
from palpate.simulation.synthesis import synthesise
from palpate.testing import plugins_with

from .block_study import study_of, write_block

STUDY = (
    study_of(("p1", "p2"), ("skin", "soft_tissue"))
    + """
[region.skin]
material = "neo_hookean"

[region.skin.parameters]
E = { lower = "0.05 MPa", upper = "0.4 MPa" }
nu = 0.45

[region.soft_tissue]
material = "neo_hookean"

[region.soft_tissue.parameters]
E = "30 kPa"
nu = 0.45

[truth]
skin.E = "0.15 MPa"
"""
)
SKIN_MM = {"p1": 2.0, "p2": 4.0}


def write_limbs(folder: Path, skin_mm: dict[str, float]) -> None:
    for spot, thickness in skin_mm.items():
        write_block(folder / f"{spot}.vtu", {"skin": thickness}, n_down=3)


@pytest.mark.slow
def test_one_modulus_fits_spots_with_skin_of_different_thickness(tmp_path: Path) -> None:
    plugins = plugins_with(palpate_indentation, palpate_jax, palpate_materials)
    (tmp_path / "study.toml").write_text(STUDY)
    write_limbs(tmp_path, SKIN_MM)
    study = read_study(tmp_path / "study.toml", plugins, need_measured=False)
    synthesise(study, plugins.channels)
    with open_problem(study, plugins=plugins) as problem:
        assert list(problem.names) == ["skin.E"], "one column for both spots"
        assert problem.fopt([0.15]) < 1e-8
        assert problem.fopt([0.17]) > 1e-4
    write_limbs(tmp_path, dict(zip(SKIN_MM, reversed(SKIN_MM.values()), strict=True)))
    with open_problem(study, plugins=plugins) as problem:
        assert problem.fopt([0.15]) > 1e-2, "each spot has the thickness of its own mesh"
