"""A sweep that is not complete is reported as incomplete by every stage, table and warning."""

import contextlib
import sqlite3
from dataclasses import replace

import polars as pl
import pytest

from palpate.domain import Response
from palpate.scoring.completeness import described
from palpate.simulation import jobs as simulation
from palpate.stages import pipeline
from palpate.stages.core_stages import selected
from palpate_report import from_run
from palpate_report.answer.result import make_conclusion
from palpate_report.data.tables import make_tables
from palpate_report.figures.drawings import nmse_distribution, responses
from palpate_report.figures.space import parameter_space


@pytest.fixture
def partial(make_study, plugins, tmp_path, monkeypatch):
    """A run folder that holds the first so many of 2 × 12 simulations, spot by spot."""

    def made(n_done):
        study, folder = make_study(), tmp_path / "run"
        pipeline.measure(study, folder, plugins)
        for name in ("sample", "simulate"):
            pipeline.run_stage(name, study, folder, plugins)
        stored = simulation.stored
        monkeypatch.setattr(simulation, "stored", lambda *given: stored(*given)[:n_done])
        return study, folder

    return made


@pytest.mark.slow
@pytest.mark.parametrize(
    ("n_done", "missing"), [(20, "p2: 8 of 12"), (12, "p2: 0 of 12"), (5, "p1: 5 of 12")]
)
def test_every_stage_reports_what_is_missing_of_the_sweep(partial, plugins, undrawn, n_done, missing, notes):
    study, folder = partial(n_done)
    pipeline.run_stage("score", study, folder, plugins, notes)
    chosen = selected(pipeline.run_stage("select", study, folder, plugins, notes))
    report = from_run.report(study, folder, plugins, notes)
    assert len(notes.texts) == 2
    for note in notes.texts:
        assert note.startswith(f"warning: incomplete sweep, {n_done} of 24 simulations (")
        assert missing in note
    (why,) = [each.why for each in report.conclusion.warnings[:2] if each.what == "Incomplete sweep"]
    assert missing in why
    for table in report.tables.values():
        assert "simulated" in table.columns
    assert f"Incomplete sweep: {n_done} of 24" in (folder / "report" / "index.html").read_text()
    assert any("thin sweep" in each.what for each in report.conclusion.warnings)
    if n_done > 12:
        assert report.tables["table2_nmse"]["simulated"].to_list() == ["12 of 12", "8 of 12"]
        assert not chosen.without_result
    else:  # nothing at p2
        assert chosen.generalisation.is_empty()
        assert {spot for spot, _ in chosen.without_result} == {"p2"}
        assert "no simulation was scored" in described(chosen.without_result)
        assert any(
            each.what == "No result for 3 of 6 spots and scenarios" for each in report.conclusion.warnings
        )


@pytest.mark.slow
def test_a_set_that_is_not_simulated_is_missing(make_study, plugins, tmp_path, notes):
    study, folder = make_study(n_total=16), tmp_path / "run"
    pipeline.run_study(study, folder, plugins)
    with contextlib.closing(sqlite3.connect(folder / "ledger.sqlite")) as connection, connection:
        connection.execute("DELETE FROM simulations WHERE key IN (SELECT key FROM jobs WHERE set_id >= 12)")
    scores = pipeline.run_stage("score", study, folder, plugins, notes).table("scores")
    assert scores.select("spot", "set_id").n_unique() == 24
    assert notes.texts[0].startswith("warning: incomplete sweep, 24 of 32 simulations (p1: 12 of 16, p2: 12")


def test_the_set_for_all_spots_reports_their_number(content):
    made = content()
    partial = replace(made, scores=made.scores.filter((pl.col("spot") == "p1") | (pl.col("set_id") < 30)))
    lead = make_conclusion(partial, make_tables(partial)).lead
    assert lead.startswith("One set for all 2 spots, of 30 sets simulated at each: set ")


def test_a_spot_without_a_simulation_is_drawn_without_sets(content):
    made = content()
    of_p1 = replace(
        made,
        scores=made.scores.filter(spot="p1"),
        selection=made.selection.filter(spot="p1"),
        generalisation=made.generalisation[:0],
        responses={key: found for key, found in made.responses.items() if key[0] == "p1"},
    )
    assert parameter_space(of_p1, "p2").axes
    assert responses(of_p1, "p2").axes
    assert nmse_distribution(of_p1).axes


def test_a_complete_sweep_has_no_such_column_or_warning(content):
    made = content()
    assert made.completeness.is_complete
    assert not made.without_result
    assert str(made.completeness) == "80 of 80 simulations"


def test_a_scenario_that_no_set_can_be_ranked_in_is_named_with_the_reason(
    make_study, plugins, tmp_path, tissue, one_figure
):
    class NoTorque(tissue.Analytic):
        def behave(self, job):
            whole = super().behave(job)
            return replace(whole, response=Response(curves={"force": whole.response["force"]}))

    result = pipeline.run_study(make_study(solver=NoTorque()), tmp_path / "run", plugins)
    missing = result.selected.without_result
    assert set(missing) == {(spot, name) for spot in ("p1", "p2") for name in ("I", "II")}
    assert "no curve 'torque'" in missing["p1", "I"]
    named = {each.what: each.why for each in result.report.conclusion.warnings}
    assert "p1, scenario I" in named["No result for 4 of 6 spots and scenarios"]
    assert "torque at p1" in named["A measured channel could not be compared with any simulation"]
    assert "NaN" not in (tmp_path / "run" / "report" / "index.html").read_text().split("<script")[0]
