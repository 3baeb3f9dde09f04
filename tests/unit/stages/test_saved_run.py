"""A run is read back from its folder as one object."""

import shutil
from dataclasses import replace

import numpy as np
import polars as pl
import pytest

import palpate
from palpate.domain import RegionMaterial
from palpate.errors import MaterialError, PluginError, StudyError
from palpate.stages import pipeline
from palpate.stages.saved_run import FittedMaterial
from palpate_materials.uncoupled import Yeoh
from palpate_report.stage import ReportStage


@pytest.fixture(scope="module")
def saved(tmp_path_factory, one_press):
    folder = tmp_path_factory.mktemp("one_press")
    study, plugins = one_press(folder, sampling={"n_sets": 12})
    pipeline.run_study(study, folder / "run", plugins)
    moved = shutil.move(folder / "run", tmp_path_factory.mktemp("elsewhere"))
    shutil.rmtree(folder)
    return palpate.open_run(moved, plugins)


def test_a_moved_run_has_its_tables_without_the_files_of_its_study(saved):
    assert saved.fit["fopt"].max() < 1e-3
    assert {"parameter", "lower", "upper", "identifiability"} <= set(saved.intervals.columns)
    assert saved.scores["set_id"].n_unique() == 12


def test_a_value_has_the_word_of_the_report(saved):
    named = pl.lit("not").alias("identifiability")
    found = saved.run.fit()
    seen = replace(saved, run=saved.run)
    vars(seen)["_found"] = replace(found, intervals=found.intervals.with_columns(named))
    assert set(seen.intervals["identifiability"]) == {"not identified"}


def test_what_a_notebook_shows_of_it_is_a_line(saved):
    shown = [saved, saved.material()]
    assert all("\n" not in repr(each) and len(repr(each)) < 250 for each in shown)
    for name, value in saved.material().values.items():
        assert f"{name}={value:.6g}" in repr(shown[1])


def test_curves_have_the_measured_and_the_fitted_points(saved):
    measured = saved.curves.filter(source="measured")
    fitted = saved.curves.filter(source="fitted", scenario=saved.study.generalise_by)
    assert measured["scenario"].null_count() == measured.height > 0
    both = measured.join(fitted, on=["spot", "channel", "point"], suffix="_fitted")
    assert both.height == measured.height
    np.testing.assert_array_equal(both["abscissa"], both["abscissa_fitted"])
    for (_,), rows in both.group_by("channel"):
        off = (rows["ordinate"] - rows["ordinate_fitted"]).abs().max()
        assert off < 0.02 * rows["ordinate"].abs().max()


def test_the_material_has_the_values_of_the_headline(saved):
    found = saved.material("tissue")
    assert found.values == {n.removeprefix("tissue."): v for n, v in saved.headline.values.items()}
    (spot,) = saved.headline.spots
    assert saved.material(spot=spot).values == found.values
    assert set(found.intervals["parameter"]) == {"tissue.E", "tissue.nu"}
    with pytest.raises(StudyError, match=r"no region 'bone'; name one of tissue"):
        saved.material("bone")
    with pytest.raises(StudyError, match=f"no fitted spot 'p9'; name one of {spot}"):
        saved.material(spot="p9")


def test_the_figure_is_that_of_the_report_with_an_axis_for_each_channel_of_the_spot(saved):
    with pytest.raises(PluginError, match="no plugin that draws curves is installed"):
        saved.plot()
    stages = {**saved.run.stages, "report": ReportStage()}
    figure = replace(saved, run=replace(saved.run, stages=stages)).plot()
    assert len(figure.axes) == 2
    assert all(axes.get_xlabel() and axes.get_ylabel() for axes in figure.axes)


def test_a_folder_that_is_no_run_is_refused(tmp_path):
    with pytest.raises(palpate.PalpateError, match="manifest"):
        palpate.open_run(tmp_path)


def fitted_yeoh(c1, c2, c3):
    material = Yeoh()
    region = RegionMaterial(region="tissue", material=material, searched=material.parameters, fixed={})
    values = dict(zip([p.name for p in material.parameters], (c1, c2, c3, 1e3), strict=False))
    return FittedMaterial(region=region, values=values, intervals=pl.DataFrame())


@pytest.mark.parametrize("stretch", [0.8, 1.0, 2.0])
def test_stress_of_an_incompressible_yeoh_solid_in_closed_form(stretch):
    c1, c2, c3 = 0.01, 0.002, 0.0005
    found = fitted_yeoh(c1, c2, c3)
    uniaxial = stretch**2 + 2.0 / stretch - 3.0
    slope = c1 + 2.0 * c2 * uniaxial + 3.0 * c3 * uniaxial**2
    expected = 2.0 * (stretch - stretch**-2) * slope
    np.testing.assert_allclose(found.stress(stretch), expected, rtol=1e-6, atol=1e-11)
    biaxial = 2.0 * stretch**2 + stretch**-4 - 3.0
    slope = c1 + 2.0 * c2 * biaxial + 3.0 * c3 * biaxial**2
    expected = 2.0 * (stretch - stretch**-5) * slope
    np.testing.assert_allclose(found.stress(stretch, "equibiaxial"), expected, rtol=1e-6, atol=1e-11)


@pytest.mark.parametrize("wrong", [0.0, -1.2, np.nan, np.inf])
def test_a_stretch_that_cannot_be_is_refused(wrong):
    found = fitted_yeoh(0.01, 0.0, 0.0)
    with pytest.raises(MaterialError, match=f"no stress at {wrong:g} of 'uniaxial'; give finite"):
        found.stress([1.2, wrong])
    assert np.isfinite(found.stress([0.0, -1.2], "simple_shear")).all()


def test_a_mode_that_is_unknown_is_refused():
    with pytest.raises(MaterialError, match=r"mode 'bending' is unknown; name one of uniaxial"):
        fitted_yeoh(0.01, 0.0, 0.0).stress(1.2, "bending")
