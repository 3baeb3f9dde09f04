"""``palpate next`` and ``extend`` to their ends, where every point is weighed by its errors."""

import re
import shutil

import jsonschema
import numpy as np
import polars as pl
import pytest

import palpate_materials
from palpate.domain import Job
from palpate.errors import StudyError
from palpate.plugins.sections import rounded_rows
from palpate.run.directory import RunDirectory
from palpate.run.ledger import Ledger
from palpate.study.reading import read_options
from palpate.testing import bench
from palpate.testing.studies import StudyRunner
from palpate_planning import commands
from palpate_planning.candidates import Allowed, candidates
from palpate_planning.tables import not_narrowed, realised, shown_intervals, shown_ranking, shown_realised

pytestmark = pytest.mark.usefixtures("one_figure")

ALLOWED = """
[protocol]
depth = ["1 mm", "4 mm"]
twist = [[], ["20 deg", "0 deg"]]
"""
CHOICE = ("--allowed", "allowed.toml", "--presses", 2, "--points", 3)


@pytest.fixture
def weighed(tmp_path, soft_region):
    """Study of one press whose intervals are those of generalised least squares, and its plugins."""
    (tmp_path / "allowed.toml").write_text(ALLOWED)
    return StudyRunner(tmp_path).study(
        palpate_materials,
        region=soft_region,
        sampling={"n_sets": 0},
        fit={"search": "least_squares"},
    )


@pytest.mark.slow
def test_presses_are_planned_over_the_ranges(call, weighed, tmp_path):
    study, _ = weighed
    made = call("next", study.file, *CHOICE, "--json", plugin=bench.__file__)
    assert made.code == 0, made.err
    found = valid(call, "next", made.json)
    assert (tmp_path / "runs" / study.name / "next.json").exists()
    assert [press["press"] for press in found["presses"]] == ["p1-4", "p1-4"]
    _never_widens(found)
    (ratio,) = (row for row in found["intervals"] if (row["step"], row["parameter"]) == (0, "tissue.nu"))
    # 95 % of a value that may be anywhere between 0.2 and 0.49.
    assert ratio["upper"] - ratio["lower"] == pytest.approx(0.95 * 0.29, rel=0.01)


@pytest.mark.slow
def test_next_press_is_ranked_made_and_added(call, weighed, tmp_path):
    study, plugins = weighed
    assert call("run", study.file, "--out", "run", plugin=bench.__file__).code == 0
    made = call("next", "run", *CHOICE, "--json", plugin=bench.__file__)
    assert made.code == 0, made.err
    assert "4 presses × 3 parameter values = 12 simulations, then up to " in made.err
    before = made.err[: made.err.index("fit again")]
    assert re.search(r"about \d+ simulations, .* \(--quick is shorter\)", before)
    found = valid(call, "next", made.json)
    _never_widens(found)
    name = found["presses"][0]["press"]
    _measure(study, plugins, tmp_path, name)
    press = ("--press", name, "--with", f"{name}.txt")
    extended = call("extend", "run", *press, "--json", plugin=bench.__file__)
    assert extended.code == 0, extended.err
    valid(call, "extend", extended.json)
    before, after = (RunDirectory(tmp_path / folder).fit() for folder in ("run", f"run-{name}"))
    for row in found["intervals"]:
        if row["step"] < 2:
            fitted = (before, after)[row["step"]].intervals
            at = fitted.filter(parameter=row["parameter"]).row(0, named=True)  # of the joint fit
            # With the press the fit estimates the discrepancy and the scale of the errors again.
            near = 0.15 if row["step"] else 1e-3
            assert at["upper"] - at["lower"] == pytest.approx(row["upper"] - row["lower"], rel=near)
    found_with_it = realised(found, name, before.intervals, after.intervals)
    assert found_with_it.height == len(after.intervals["parameter"].unique())
    np.testing.assert_allclose(found_with_it["expected"], found_with_it["realised"], rtol=0.15)
    other = next(row["press"] for row in found["ranking"] if row["press"] != name)
    _measure(study, plugins, tmp_path, other)
    printed = call("extend", "run", "--press", other, "--with", f"{other}.txt", plugin=bench.__file__)
    assert printed.code == 0, printed.err
    assert f"95 % intervals before and with {other}, in % of the value" in printed.out
    assert re.search(r"E +± \d+(\.\d+)? % +± ", printed.out)
    start = after.trace.row(0, named=True)
    answer = before.joint_values("both")
    assert {parameter: start[parameter] for parameter in answer} == answer


@pytest.mark.slow
def test_a_plan_is_no_longer_than_the_run_and_a_quick_one_is_shorter(call, weighed, tmp_path):
    study, _ = weighed
    assert call("run", study.file, "--out", "run", plugin=bench.__file__).code == 0
    n_run = _n_simulations(tmp_path / "run")
    shutil.copytree(tmp_path / "run", tmp_path / "quick")
    usual = call("next", "run", plugin=bench.__file__)
    assert usual.code == 0, usual.err
    assert _n_simulations(tmp_path / "run") - n_run <= n_run
    quick = call("next", "quick", "--quick", plugin=bench.__file__)
    assert quick.code == 0, quick.err
    assert "(quick: error sources and finer meshes as at the press so far)" in quick.err
    assert 0 < _n_simulations(tmp_path / "quick") - n_run <= _n_simulations(tmp_path / "run") - n_run
    both = call("next", "run", "--quick", "--points", 3, plugin=bench.__file__)
    assert (both.code, "leave out --quick or --points" in both.err) == (2, True)
    rows = [line for line in usual.out.splitlines() if "(repeat)" in line]
    assert len({row.split()[0] for row in rows}) == 1  # of all shares of the press, the whole


@pytest.mark.slow
def test_a_quick_ranking_is_like_the_careful_one(call, weighed):
    study, _ = weighed
    assert call("run", study.file, "--out", "run", plugin=bench.__file__).code == 0
    of = {}
    for options in (("--quick",), ("--points", 1)):
        found = call("next", "run", "--allowed", "allowed.toml", *options, "--json", plugin=bench.__file__)
        of[options[0]] = {row["press"]: row["error"] for row in found.json["ranking"]}
    for press, error in of["--points"].items():
        assert of["--quick"][press] == pytest.approx(error, rel=0.25), press


def _n_simulations(folder):
    with Ledger(folder) as ledger:
        return len(ledger.seconds())


def valid(call, command, value):
    jsonschema.validate(value, call("schema", command).json)
    return value


def test_a_study_is_its_newest_run_once_that_has_a_fit(tmp_path, monkeypatch):
    study, run = tmp_path / "study.toml", tmp_path / "run"
    run.mkdir()
    study.touch()
    monkeypatch.setattr(commands, "newest_run", lambda given: run)
    assert commands._run_to_extend(study, None) is None
    (run / "fit.parquet").touch()
    assert commands._run_to_extend(study, None) == run
    assert commands._run_to_extend(study, tmp_path / "other") is None
    with pytest.raises(StudyError, match="is for a study"):
        commands._run_to_extend(run, tmp_path / "other")


def test_a_ranking_is_shown_in_percent_with_units():
    ranking = pl.DataFrame(
        {
            "step": [1, 1],
            "press": ["p1-1", "p1-2"],
            "spot": "p1",
            "protocol": ["depth 5 mm", "depth 10 mm"],
            "error": [0.79895, 0.9],
            "width_skin.c1": [0.79895, 0.812],
            "width_skin.c2": [0.98, 0.951],
            "peak_force": [12.3456, 14.0],
        }
    )
    shown = shown_ranking(ranking, {"force": "force (N)"})
    assert shown.columns == ["press", "spot", "protocol", "error", "c1", "c2", "force (N)"]
    assert shown.row(0)[3:] == ("80 %", "80 %", "98 %", "12.3")
    assert not_narrowed(ranking) == ["skin.c2"]
    both = ranking.with_columns(peak_sum=pl.lit(1.0), peak_other=pl.lit(2.0))
    alike = shown_ranking(both, {"force": "force (N)", "sum": "force (N)"})
    assert alike.columns[-3:] == ["force: force (N)", "sum: force (N)", "other"]
    two = ranking.rename({"width_skin.c2": "width_fat.c1"})
    assert {"skin.c1", "fat.c1"} < set(shown_ranking(two, {"force": "force (N)"}).columns)


def test_intervals_are_shown_with_their_own_digits():
    row = {
        "step": 0,
        "parameter": "skin.c1",
        "unit": "kPa",
        "value": 13.97345,
        "lower": 13.0,
        "upper": 14.612345,
    }
    shown = shown_intervals(pl.DataFrame([row | {"width": 0.973, "mesh_bias": 0.4567}]))
    assert rounded_rows(shown) == [(0, "c1", "kPa", "14.0", "13.0", "14.6", "97 %", "0.46")]


def test_a_press_is_compared_with_what_was_expected_of_it():
    proposed = {
        "presses": [{"press": "p1-2"}],
        "ranking": [
            {"step": 1, "press": "p1-2", "width_E": 0.4, "width_nu": 0.9},
            {"step": 1, "press": "p1-1", "width_E": 0.7, "width_nu": 1.0},
            {"step": 2, "press": "p1-1", "width_E": 0.1, "width_nu": 0.1},
        ],
        "intervals": [
            {"step": k, "parameter": "E", "width": width} for k, width in enumerate((1.0, 0.5, 0.2))
        ],
    }
    before = pl.DataFrame([{"fit": "p1", "parameter": "E", "value": 2.0, "lower": 1.0, "upper": 3.0}])
    after = pl.DataFrame(
        [
            {"fit": "p1", "parameter": "E", "value": 5.0, "lower": 1.0, "upper": 9.0},
            {"fit": "all spots", "parameter": "E", "value": 2.5, "lower": 2.1, "upper": 2.9},
            {"fit": "all spots", "parameter": "friction", "value": 0.5, "lower": 0.5, "upper": 0.6},
        ]
    )
    chosen = realised(proposed, "p1-2", before, after)
    assert chosen.columns == ["parameter", "before", "expected", "realised"]
    assert chosen.row(0)[1:] == pytest.approx((0.5, 0.2, 0.16))  # 1 of 2, half of it of 2.5, and 0.4 of 2.5
    assert shown_realised(chosen).rows() == [("E", "± 50 %", "± 20 %", "± 16 %")]
    assert realised(proposed, "p1-1", before, after)["expected"].to_list() == pytest.approx([0.28])


def _never_widens(found):
    """With these weights no press widens any interval, which by least Fopt one may."""
    widths = [value for row in found["ranking"] for key, value in row.items() if key.startswith("width_")]
    assert len(widths) == 16
    assert max(widths) <= 1.0 + 1e-9


def _measure(study, plugins, folder, name):
    """Write what a proposed press measures where the parameters are known."""
    presses = candidates(study, plugins, read_options(folder / "allowed.toml", Allowed, {}))
    (protocol,) = (press.protocol for press in presses if press.name == name)
    materials = {region.region: region.material for region in study.space.regions}
    thetas = study.space.thetas(np.array([study.truth[p.name] for p in study.space.parameters]))
    job = Job(spot="p1", set_id=0, materials=materials, thetas=thetas, protocol=protocol)
    study.loader.save(folder / f"{name}.txt", study.solver.simulate(job, None).response)
