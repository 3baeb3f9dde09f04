"""A run with one more press: its study, where its fit starts, and how much narrower it is."""

import numpy as np
import polars as pl
import pytest

from palpate.domain import Job
from palpate.run.directory import RunDirectory
from palpate.run.ledger import Ledger
from palpate.run.result import ALL_SPOTS
from palpate.stages import pipeline
from palpate.study.reading import read_study
from palpate_planning.candidates import Allowed, extended_study
from palpate_planning.propose import PlanOptions, propose
from palpate_planning.tables import proposal_tables

ALLOWED = Allowed(protocol={"depth": ["2 mm", "4 mm"], "twist": [[], ["20 deg", "0 deg"]]})


@pytest.fixture
def extended(run, tmp_path):
    """A proposal, and the study with its best press, measured where the parameters are known."""
    study, folder, plugins = run
    proposal = propose(study, folder, plugins, options=PlanOptions(allowed=ALLOWED, n_points=3))
    press = proposal.steps[0].chosen.press.press
    file = tmp_path / "press.txt"
    thetas = study.space.thetas(np.array([0.07, 0.345]))
    materials = {region.region: region.material for region in study.space.regions}
    job = Job(spot="p1", set_id=0, materials=materials, thetas=thetas, protocol=press.protocol)
    study.loader.save(file, study.solver.simulate(job, None).response)
    name, written = extended_study(folder, study.file, None, file)
    assert name == press.name
    extended = read_study(written, plugins)
    assert np.array_equal(extended.protocol_at(name).path, press.protocol.path)
    return proposal, extended


@pytest.mark.slow
def test_press_added_to_a_run_narrows_as_expected_and_starts_at_its_answer(run, extended, tmp_path):
    study, folder, plugins = run
    proposal, extended = extended
    more, alone = tmp_path / "extended", tmp_path / "alone"
    answer = RunDirectory(folder).fit().joint_values(study.generalise_by)
    assert answer.keys() == {"tissue.E", "tissue.nu"}
    pipeline.run_study(extended, more, plugins, forked_from=folder, adopt=True, fit_start=answer)
    pipeline.run_study(extended, alone, plugins)  # the study is a study as any other
    expected = proposal_tables(proposal)["intervals"].filter(parameter="tissue.nu", step=1)["width"][0]
    after = _width_of_ratio(more)
    assert after / _width_of_ratio(folder) == pytest.approx(expected, rel=0.25)
    assert _width_of_ratio(alone) == pytest.approx(after, rel=1e-2)

    first = RunDirectory(more).fit().trace.filter(fit=ALL_SPOTS).row(0, named=True)
    assert {name: first[name] for name in answer} == answer
    # The proposal has simulated the press with the same values; the reported ones of three fits are others,
    # and are searched for by simulated curves where there is no mesh.
    assert len(_keys(more) - _keys(folder)) <= 9 * len(extended.spots)
    known = _keys(more)
    assert _keys(alone) - _keys(folder)
    again = pipeline.run_stage("fit", extended, more, plugins).fit()
    assert again.trace.equals(RunDirectory(more).fit().trace)  # later commands start there too
    assert _keys(more) == known


def _width_of_ratio(run):
    rows = pl.read_parquet(run / "intervals.parquet").filter(parameter="tissue.nu")
    return float((rows["upper"] - rows["lower"])[rows["fit"].is_in(["p1", ALL_SPOTS]).arg_max()])


def _keys(run):
    with Ledger(run) as ledger:
        return set(ledger.seconds())
