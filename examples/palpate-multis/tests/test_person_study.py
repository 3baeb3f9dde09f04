"""The study of one person: what its command writes, and what its table lacks."""

import re
from importlib.resources import files
from pathlib import Path

import meshio
import numpy as np
import polars as pl
import pytest

from palpate import read_study
from palpate.errors import PalpateError
from palpate.experiment.measured import load_measured
from palpate.limb.loading import load_limbs
from palpate.plugins.catalogue import Plugins
from palpate_multis import write_study
from palpate_multis.presses import of_multis

READY = Path(str(files("palpate_multis") / "studies" / "multis"))
SITES = ("LA_P", "UA_P", "LL_P", "UL_A")


def test_the_ready_study_is_the_one_that_is_written_of_multis(tmp_path: Path) -> None:
    write_study(tmp_path, "012", SITES)
    texts = ["study.toml", *(f"measured/{site}.csv" for site in SITES)]
    assert [(tmp_path / name).read_text() for name in texts] == [(READY / name).read_text() for name in texts]
    for site in SITES:
        written, ready = (meshio.read(folder / "meshes" / f"{site}.vtu") for folder in (tmp_path, READY))
        np.testing.assert_array_equal(written.points, ready.points)
        np.testing.assert_array_equal(written.cells[0].data, ready.cells[0].data)


@pytest.mark.slow
def test_spots_have_the_slopes_and_layers_of_the_table() -> None:
    plugins = Plugins.load()
    study = read_study(Path(plugins.studies["multis"].directory), plugins)
    measured, limbs = load_measured(study, plugins.channels), load_limbs(study)
    rows = pl.read_csv(READY.parents[1] / "data" / "presses.csv", schema_overrides={"person": pl.String})
    for site in SITES:
        (row,) = rows.filter((pl.col("person") == "012") & (pl.col("site") == site)).iter_rows(named=True)
        force = measured[site]["force"]
        slope = np.diff(force.ordinate) / np.diff(force.abscissa) / row["area_mm2"]
        np.testing.assert_allclose(slope, row["stiffness_MPa_per_mm"], rtol=1e-3)
        assert force.ordinate[-1] == pytest.approx(row["max_force_N"], abs=1e-4)
        mesh = limbs[site].mesh
        heights = mesh.points_mm[mesh.cells["hex8"], 2]
        for number, layer in enumerate(("skin", "fat", "muscle")):
            here = heights[mesh.cell_regions["hex8"] == number]
            assert np.ptp(here) == pytest.approx(row[f"{layer}_mm"])
            assert mesh.regions[number] == layer


@pytest.mark.parametrize(
    ("person", "site", "words"),
    [
        ("012", "LA_X", "0 presses of person '012' at 'LA_X', not one; the sites of this person are LA_A"),
        ("999", "LA_A", "the sites of this person are none"),
    ],
)
def test_a_press_that_is_not_there_is_named(tmp_path: Path, person: str, site: str, words: str) -> None:
    with pytest.raises(PalpateError, match=re.escape(words)):
        write_study(tmp_path, person, [site])


def test_presses_of_ones_own_need_a_site(tmp_path: Path) -> None:
    with of_multis().open("rb") as stream:
        own = pl.read_csv(stream).head(3)
    own.write_csv(tmp_path / "own.csv")
    write_study(tmp_path / "mine", str(own["person"][0]), ["LA_A"], tmp_path / "own.csv")
    assert (tmp_path / "mine" / "meshes" / "LA_A.vtu").exists()
    own.drop("site").write_csv(tmp_path / "own.csv")
    with pytest.raises(PalpateError, match="no column 'site'"):
        write_study(tmp_path / "mine", "6", ["LA_A"], tmp_path / "own.csv")
