"""Reports of the stages' results, for any names of channels."""

import csv
import subprocess
import sys
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from matplotlib import rc_context, rcParams
from matplotlib.image import imread

from palpate.domain import Channel, Curve, Design, ParameterSpace, Response, Scenario
from palpate.fit.least_squares import LeastSquares
from palpate.plugins.provides import Provides
from palpate.plugins.score import ScoringRules
from palpate.run.ownership import keep_only
from palpate.run.result import FitResult
from palpate.scoring.scores import score
from palpate.scoring.selection import select
from palpate.simulation.jobs import simulate
from palpate_report.answer.headline import draws_of
from palpate_report.answer.result import Report
from palpate_report.data.report_data import ReportData
from palpate_report.data.tables import finding, make_tables
from palpate_report.figures import drawings
from palpate_report.figures.contours import paths
from palpate_report.figures.drawings import generalised, interval_plot, nmse_distribution, responses
from palpate_report.figures.space import MOST_PAIRS, parameter_space
from palpate_report.figures.style import STYLE, save
from palpate_report.from_run import write_report
from palpate_report.sections.sweep import OtherChannels


@pytest.fixture
def outlined(monkeypatch):
    """Figures without the cost of their formats, for what is about something else."""

    def save(figure, stem):
        files = [stem.with_name(f"{stem.name}{suffix}") for suffix in (".svg", ".pdf", ".png")]
        figure.draw_without_rendering()
        for file in files:
            file.write_text("<svg></svg>")
        return files

    monkeypatch.setattr(drawings, "save", save)


def test_table_1_is_the_papers_in_long_form(content):
    made = content()
    table = make_tables(made)["table1_coefficients"]
    assert table.columns == [
        "region", "material", "convention", "spot", "scenario", "parameter", "value", "unit",
    ]  # fmt: skip
    assert len(table) == 2 * 3 * 2
    row = table.row(0, named=True)
    assert (row["material"], row["spot"], row["scenario"], row["unit"]) == ("spongy", "p1", "I", "MPa")
    assert row["value"] == made.selection["soft_tissue.stiffness"][0]


def test_table_2_has_a_column_per_scenario(content):
    made = content()
    table = make_tables(made)["table2_nmse"]
    assert table.columns == ["spot", "I", "II", "III"]
    assert table.row(1)[1:] == tuple(made.selection["fopt"][3:6])


def test_the_cross_table_shows_what_a_fit_to_one_channel_costs_in_the_other(content):
    table = make_tables(content())["cross_channel"]
    assert table["fitted_to"].to_list()[:3] == ["force + torque", "torque", "force"]
    for row in table.iter_rows(named=True):
        assert row["nmse_force"] >= 0.0
        assert row["r2_torque"] <= 1.0


def test_a_partial_fit_is_held_against_the_channels_that_it_has_not_seen(content):
    made = content(search=LeastSquares())
    tables = make_tables(made)
    table = tables["unfitted_channels"]
    assert table.select("search", "spot", "scenario", "unfitted").rows() == [
        (search, spot, *unseen)
        for search in ("sweep", "fit")
        for spot in ("p1", "p2")
        for unseen in (("II", "force"), ("III", "torque"))
    ]
    of_torque, of_force = made.selection.row(1, named=True), made.selection.row(2, named=True)
    first = table.row(0, named=True)
    best = min(made.selection["nmse_force"][0], of_force["nmse_force"])
    assert (first["nmse"], first["nmse_fitted"]) == (of_torque["nmse_force"], best)
    assert first["times"] == first["nmse"] / best
    result = OtherChannels().result(made, Report.of(made))
    assert result == f"R² of a curve that a fit leaves out: {table['r2'].min():.4g} or more"
    worst = table[4:].sort("times", descending=True, maintain_order=True).row(0, named=True)
    message = finding(tables)
    assert f"a fit to {worst['fitted_to']} alone predicts {worst['unfitted']} less well" in message
    assert (
        f"({worst['spot']}, scenario {worst['scenario']}: NMSE {worst['nmse']:.3g} against about 0" in message
    )
    assert message.endswith(f"by a fit to {worst['unfitted']}, R² {worst['r2']:.3f}).")
    sweep = table.filter(search="sweep")
    of_sweep = finding({"unfitted_channels": sweep})
    assert any(f" against {row['nmse_fitted']:.3g} by a fit to " in of_sweep for row in sweep.to_dicts())
    assert finding(tables, ["I"]) == ""
    assert "scenario III" in finding(tables, ["I", "III"])
    both_exact = table.with_columns(nmse=pl.lit(0.0), nmse_fitted=pl.lit(0.0), times=pl.lit(float("inf")))
    assert not finding({"unfitted_channels": both_exact})


def test_a_fit_to_all_channels_leaves_nothing_unseen(content, make_study):
    tables = make_tables(content(scenarios=make_study().scenarios[:1]))
    assert "unfitted_channels" not in tables
    assert finding(tables) == ""


def test_a_channel_that_no_scenario_fits_has_nothing_to_be_held_against(content, make_study):
    tables = make_tables(content(scenarios=make_study().scenarios[1:2], generalise_by="II"))
    assert tables["unfitted_channels"]["times"].to_list() == [None, None]
    assert finding(tables) == ""


def test_the_distance_to_the_truth_is_signed_and_relative(content):
    made = content(truth={"soft_tissue.stiffness": 0.4})
    table = make_tables(made)["distance_to_truth"]
    assert set(table["search"]) == {"sweep", "generalised"}
    row = table.row(0, named=True)
    assert row["difference_percent"] == pytest.approx(100 * (row["value"] / 0.4 - 1))
    assert "distance_to_truth" not in make_tables(content())


def test_the_csv_files_hold_every_digit(undrawn, content, tmp_path):
    made = content()
    write_report(made, tmp_path / "report")
    with (tmp_path / "report" / "tables" / "table2_nmse.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert float(rows[0]["II"]) == made.selection["fopt"][1]


@pytest.mark.slow
def test_an_earlier_report_leaves_nothing_behind(content, tmp_path, outlined):
    made = content()
    made = replace(made, measured={"p1": made.measured["p1"]}, generalisation=made.generalisation[:0])
    folder = tmp_path / "report"
    for old in (
        "tables/old.csv",
        "tables/old.tex",
        "tables/old.md",
        "figures/old.svg",
        "figures/old.pdf",
        "figures/old.png",
    ):
        (folder / old).parent.mkdir(parents=True, exist_ok=True)
        (folder / old).touch()
    keep_only(folder, [path for path in folder.rglob("*") if path.is_file()])
    (folder / "tables" / "mine.csv").touch()
    files = write_report(made, folder).files
    found = {p for p in folder.rglob("*") if p.is_file()}
    assert found == {*files, folder / "files.json", folder / "tables" / "mine.csv"}


@pytest.mark.slow
def test_figures_are_drawn_alike_twice(content, tmp_path):
    made = content()
    for name in ("one", "two"):
        with rc_context(dict(STYLE)):
            save(responses(made, "p1"), tmp_path / name)
    for suffix in (".svg", ".pdf"):
        assert (tmp_path / f"one{suffix}").read_bytes() == (tmp_path / f"two{suffix}").read_bytes()
    picture = imread(tmp_path / "one.png")
    assert picture.shape[1] > 1000
    assert np.ptp(picture) == 1.0


@pytest.mark.slow
def test_drawing_changes_nobodys_style(content, tmp_path, outlined):
    before = dict(rcParams)
    files = drawings.write_figures(content(), tmp_path)
    assert len(files) == 3 * 7
    assert dict(rcParams) == before


def test_every_figure_of_simulated_data_is_marked(content):
    made, real = content(), content(data="measured")
    for draw in (
        nmse_distribution, generalised, lambda c: responses(c, "p1"), lambda c: parameter_space(c, "p1"),
    ):  # fmt: skip
        assert "simulated data" in draw(made).get_suptitle()
        assert "simulated" not in draw(real).get_suptitle()


def test_a_response_has_the_experiment_and_a_curve_per_scenario(content):
    made = content()
    axes = responses(made, "p2").axes
    assert [a.get_xlabel() for a in axes[2:]] == ["indentation depth [mm]", "rotation [°]"]
    lines = axes[0].get_lines()
    assert len(lines) == 5
    assert np.array_equal(lines[0].get_ydata(), made.measured["p2"]["force"].ordinate)
    chosen = made.selection.row(3, named=True)
    shown = made.responses["p2", chosen["set_id"]]["force"]
    assert np.array_equal(lines[1].get_ydata(), shown.ordinate)
    styles = {(line.get_color(), line.get_linestyle()) for line in lines[1:]}
    assert len(styles) == 4
    left = axes[2].get_lines()[0].get_ydata()
    np.testing.assert_allclose(left, shown.ordinate - lines[0].get_ydata(), atol=1e-12)


def test_fitted_curves_take_the_place_of_the_sweeps_those_of_the_joint_fit_beside_them(content):
    made = content(search=LeastSquares())
    lines = responses(made, "p1").axes[0].get_lines()[1:]
    joint = "all spots, scenario I, fit"
    assert [line.get_label() for line in lines] == [
        *(f"scenario {n}, fit" for n in ("I", "II", "III")),
        joint,
    ]
    curve = made.fit.curves["all spots", "I", "p1"]["force"]
    assert np.array_equal(lines[-1].get_ydata(), curve.ordinate)
    assert np.array_equal(generalised(made).axes[0].get_lines()[-1].get_ydata(), curve.ordinate)


def test_a_way_is_of_better_and_better_steps_against_simulations(content):
    made = content(search=LeastSquares())
    table = made.fit.table.filter(scenario="I")
    for fit in ("all spots", "p1", "p2"):
        rows = table.filter(fit=fit)
        way = paths(made, fit, "I", "p1")[-1]
        assert way["fopt"][-1] == pytest.approx(rows["fopt"].mean(), rel=1e-9)
        assert (np.diff(way["objective"]) < 0.0).all()
        assert (np.diff(way["n_runs"]) > 0).all()
        assert way["n_runs"][-1] <= rows["n_runs"][0]
        assert way["soft_tissue.grip"][-1] == rows["soft_tissue.grip"][0]


def test_the_way_of_the_fit_is_in_the_parameter_space(content):
    panel = parameter_space(content(search=LeastSquares()), "p1").axes[0]
    ends = [line for line in panel.get_lines() if line.get_marker() == "D"]
    assert [line.get_label().partition(":")[0] for line in ends] == ["all spots", "p1"]
    assert ends[1].get_xdata()[0] == pytest.approx(0.4, rel=1e-4)


def test_the_region_of_the_fit_holds_95_percent_of_its_draws(content):
    made = content(search=LeastSquares())
    draws = draws_of(made, "I", 10_000)
    axis = next(a for a in parameter_space(made, "p1").axes if a.patches)
    (region,) = axis.patches
    at = draws.select("soft_tissue.stiffness", "soft_tissue.grip").to_numpy()
    inside = region.get_path().contains_points(at, radius=1e-12)
    assert inside.mean() == pytest.approx(0.95, abs=0.01)


def test_the_fit_has_the_papers_tables_too(content):
    made = content(search=LeastSquares())
    tables = make_tables(made)
    assert list(tables)[:2] == ["table1_fit", "table2_fit"]
    first, second = tables["table1_fit"], tables["table2_fit"]
    assert first.columns == tables["table1_coefficients"].columns
    assert second["spot"].to_list() == ["all spots", "p1", "p2"]
    joint = made.fit.joint("II")
    assert second["II"][0] == pytest.approx(joint["fopt"].mean())
    value = first.filter(spot="all spots", scenario="II", parameter="stiffness")["value"]
    assert value.to_list() == [joint["soft_tissue.stiffness"][0]]
    distances = make_tables(replace(made, study=replace(made.study, truth={"soft_tissue.grip": 20.0})))
    by_search = distances["distance_to_truth"]["search"].value_counts()
    assert dict(by_search.iter_rows())["joint fit"] == 3


def test_the_distribution_has_every_set_within_its_limits(content):
    made = content()
    axis = nmse_distribution(made).axes[0]
    offsets = np.concatenate([c.get_offsets() for c in axis.collections if len(c.get_offsets()) > 1])
    assert len(offsets) == 80
    low, high = axis.get_ylim()
    assert axis.get_yscale() == "log"
    assert low < offsets[:, 1].min() < offsets[:, 1].max() < high
    assert low > offsets[:, 1].min() / 10.0


def test_intervals_are_drawn_around_each_fitted_value(content):
    made = content(search=LeastSquares(), truth={"soft_tissue.stiffness": 0.4})
    panel, other = interval_plot(made).axes
    drawn = sorted(tuple(line.get_xdata()) for line in panel.get_lines() if line.get_marker() == "|")
    rows = made.fit.intervals.filter(parameter="soft_tissue.stiffness")
    assert drawn == sorted(rows.select("lower", "upper").rows())
    assert [label.get_text() for label in panel.get_yticklabels()] == ["all spots", "p1", "p2"]
    assert "true value" in [line.get_label() for line in panel.get_lines()]
    assert "true value" not in [line.get_label() for line in other.get_lines()]


def test_axes_are_logarithmic_where_the_sweep_is(content):
    made = content()
    first, second = made.design.parameters
    design = replace(made.design, parameters=(replace(first, scale="log"), second))
    panel = parameter_space(replace(made, design=design), "p1").axes[0]
    assert (panel.get_xscale(), panel.get_yscale()) == ("log", "linear")
    shown = [tick.get_text() for tick in panel.get_xticklabels()]
    assert not any("$" in text for text in shown)


def test_a_legend_names_what_the_first_spot_or_channel_lacks(content):
    made = content()
    worse = pl.when(pl.col("spot") == "p1").then(pl.col("nmse") + 10.0).otherwise(pl.col("nmse"))
    above = replace(made, scores=made.scores.with_columns(nmse=worse))
    assert "least" in legend_of(nmse_distribution(above))
    best = made.selection["set_id"][0]
    torque = Response(curves={"torque": made.responses["p1", best]["torque"]})
    half = replace(made, responses={("p1", best): torque})
    assert f"scenario I, set {best}" in legend_of(responses(half, "p1"))


def legend_of(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_the_parameter_space_shows_each_set_once(content):
    made = content()
    panel = parameter_space(made, "p1").axes[0]
    by_label = {c.get_label(): len(c.get_offsets()) for c in panel.collections}
    least = made.selection.row(0, named=True)
    assert f"best set of the sweep, Fopt {least['fopt']:.3g}" in by_label
    coloured = next(c for c in panel.collections if c.get_array() is not None)
    assert len(coloured.get_offsets()) == 40
    assert coloured.get_clim() == (coloured.get_array().min(), coloured.get_array().max())


@pytest.mark.parametrize(("n", "panels"), [(1, 1), (2, 1), (3, 4), (4, 6), (7, MOST_PAIRS)])
def test_any_number_of_parameters_is_shown(content, n, panels):
    made = content()
    one = made.design.parameters[0]
    parameters = tuple(replace(one, name=f"soft_tissue.c{i}") for i in range(n))
    values = np.random.default_rng(0).uniform(0.1, 1.0, (40, n))
    design = Design(parameters=parameters, values=values, seed=0, n_drawn=40)
    figure = parameter_space(replace(made, design=design), "p1")
    assert len([a for a in figure.axes if a.get_label() != "<colorbar>"]) == panels


@pytest.mark.slow
def test_three_channels_of_other_names_and_a_spot_that_lacks_one(
    make_study, plugins, tmp_path, tissue, outlined
):
    names = ("uniaxial", "equibiaxial", "pure_shear")
    x = np.linspace(1.0, 3.0, 30)
    channels = {
        n: Channel(name=n, abscissa="stretch", ordinate="stress_MPa",
                   abscissa_label="stretch", ordinate_label=f"{n} stress [MPa]")
        for n in names
    }  # fmt: skip
    curves = {
        n: Curve(channel=n, abscissa=x, ordinate=(0.4 + 0.1 * i) * x + 20.0 * x**2)
        for i, n in enumerate(names)
    }
    measured = {
        "p1": Response(curves=curves),
        "p2": Response(curves={"uniaxial": curves["uniaxial"]}),
    }
    scenarios = (
        Scenario(name="UT", weights={"uniaxial": 1.0}),
        Scenario(name="all", weights=dict.fromkeys(names, 1.0)),
    )
    study = make_study(protocol=None, scenarios=scenarios, generalise_by="UT", data="measured")
    study.solver.provides = Provides(body="specimen")
    from palpate.sampling.drawing import draw_design
    from palpate.scoring.generalisation import generalise

    design = draw_design(study.space, study.sampler, 20, 1)
    swept = simulate(study, design, {}, measured, tmp_path / "run")
    scores = score(swept, measured, ScoringRules(minimum_coverage=1.0))
    chosen = select(scores, scenarios, design)
    assert chosen.select("spot", "scenario").rows() == [(p, s) for p in ("p1", "p2") for s in ("UT", "all")]
    made = ReportData(
        study=study, folder=tmp_path / "run", channels=channels, measured=measured, design=design,
        scores=scores, selection=chosen,
        generalisation=generalise(scores, scenarios[0], design, list(measured)),
        fit=FitResult(),
        responses={(s.job.spot, s.job.set_id): s.response for s in swept},
    )  # fmt: skip
    assert len(write_report(made, tmp_path / "report").files) == 3 * 6 + 3 + 3 * 7 + 3
    assert len(responses(made, "p1").axes) == 2 * 3
    assert len(responses(made, "p2").axes) == 2
    of_p2 = make_tables(made)["table2_nmse"].row(1, named=True)
    assert of_p2["all"] == of_p2["UT"] > 0.0


def test_two_regions_keep_their_names(space):
    from palpate_report.data.report_data import named_briefly

    one = space.parameters
    assert [p.name for p in named_briefly(one)] == ["stiffness", "grip"]
    two = ParameterSpace(regions=(*space.regions, replace(space.regions[0], region="skin"))).parameters
    assert named_briefly(two) == two
    by_spot = [replace(one[0], name=f"{one[0].name}@{spot}") for spot in ("p1", "p2")]
    assert [p.name for p in named_briefly(by_spot)] == ["stiffness@p1", "stiffness@p2"]


@pytest.mark.slow
def test_what_draws_is_imported_when_something_is_drawn():
    names = "('matplotlib', 'plotly', 'jinja2')"
    code = f"import palpate.stages.pipeline, sys; sys.exit(any(name in sys.modules for name in {names}))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_set_for_all_spots_has_a_row_of_one_width_for_any_number_of_spots(content):
    data = content()
    made = make_tables(data)
    names = [p.name for p in data.design.parameters]
    columns = [name for name in made["generalised"].columns if name != "verdict"]
    assert columns == ["scenario", "set_id", "fopt_mean", "fopt_sd", *names]
    assert made["cost_of_one_set"]["spot"].to_list() == list(data.spots)
