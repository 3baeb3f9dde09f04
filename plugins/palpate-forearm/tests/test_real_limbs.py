"""Real limbs: their spots have segments, and their licences are stated."""

import tomllib
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from palpate.api.runs import read_options
from palpate_forearm import palpate_studies
from palpate_limb.from_scan import ReadScan, read_scan
from palpate_limb.options import ScanOptions
from palpate_limb.segment import cut

STUDIES = {study.name: study for study in palpate_studies()}
FOLDERS = {name: Path(STUDIES[name].directory) for name in ("forearm-real", "residual-limb")}


def options(name: str) -> ScanOptions:
    return read_options(FOLDERS[name] / "limb.toml", ScanOptions, {})


@cache
def read(name: str) -> ReadScan:
    return read_scan(FOLDERS[name] / "skin.ply", options(name).model_copy(update={"unit": None}))


def test_what_to_run_first_meshes_the_residual_limb() -> None:
    command, folder = STUDIES["residual-limb"].first_command, FOLDERS["residual-limb"]
    stage, scan, option, file = command.format(folder=folder).split()
    assert (stage, option) == ("limb", "--options")
    assert Path(scan).is_file()
    assert Path(file).is_file()


@pytest.mark.slow
@pytest.mark.parametrize("name", FOLDERS)
def test_every_spot_has_a_segment_with_bones_below_it(name: str) -> None:
    scan, stump = read(name), options(name).stump
    assert scan.unit == options(name).unit, "guessed as it is declared"
    study = tomllib.loads((FOLDERS[name] / "study.toml").read_text())
    assert list(scan.spots) == [spot["name"] for spot in study["spot"]]
    for found in scan.spots.values():
        segment = cut(scan.surface, scan.bones, found.spot, scan.axis, stump=stump)
        assert segment.bones
        gaps = [float(bone.nearest(np.zeros((1, 3)))[1][0]) for bone in segment.bones]
        assert 3.0 < min(gaps) < 45.0


def test_the_forearm_is_an_adults() -> None:
    """An adult's ulna is 220 to 290 mm long, and the forearm 61 to 96 mm wide."""
    scan = read("forearm-real")
    ulna = next(bone for bone in scan.bones if bone.name == "ulna")
    assert 220.0 < np.ptp(ulna.points_mm @ scan.axis) < 290.0


@pytest.mark.parametrize(("name", "licence"), [("forearm-real", "2.1 Japan"), ("residual-limb", "BY-SA 4.0")])
def test_the_licence_is_beside_the_files_and_in_the_metadata(name: str, licence: str) -> None:
    text = (FOLDERS[name] / "LICENCE.md").read_text()
    assert licence in text
    assert "Changed:" in text
    for file in FOLDERS[name].glob("*.ply"):
        assert file.name in text
    metadata = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())
    assert {"CC-BY-SA-4.0", "CC-BY-SA-2.1-JP"} <= set(metadata["project"]["license"].split())
    assert (FOLDERS[name] / "README.md").read_text().count("LICENCE.md") == 1
