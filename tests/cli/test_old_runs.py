"""Runs that earlier versions left: taken over, with the numbers they had, and gone on with."""

import json
import shutil
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from palpate.domain import Job, Status
from palpate.ledger import Ledger, Writer
from palpate.ledger.format import VERSION
from palpate.ledger.takeover import take_over

OLD_RUNS = Path(__file__).parents[1] / "data" / "old_runs"
VERSIONS = sorted(path.name for path in OLD_RUNS.iterdir() if path.is_dir())


@pytest.fixture(params=VERSIONS)
def old_run(request, tmp_path):
    return Path(shutil.copytree(OLD_RUNS / request.param, tmp_path / "run"))


def test_there_is_a_run_of_every_version_of_the_ledger():
    assert {f"ledger_{number}" for number in range(1, VERSION + 1)} <= set(VERSIONS)


def test_its_simulations_have_the_numbers_that_the_law_gives(old_run):
    with Writer(old_run) as writer:
        take_over(old_run, writer)
    with Ledger(old_run) as ledger:
        rows = ledger.frame("simulations")
        jobs = {
            row["key"]: Job(spot="s1", set_id=row["set_id"], materials={}, thetas={}, protocol=None)
            for row in rows.iter_rows(named=True)
        }
        found = ledger.simulations(jobs)
    moduli = pl.read_parquet(old_run / "design.parquet")["rubber.k"]
    assert sorted(s.job.set_id for s in found.values()) == [0, 1, 2, 3]
    for simulation in found.values():
        assert simulation.status is Status.OK
        (curve,) = simulation.response.curves.values()
        strain = curve.abscissa - 1.0
        expected = moduli[simulation.job.set_id] * strain * (1.0 + 0.5 * strain)
        np.testing.assert_allclose(curve.ordinate, expected, rtol=1e-12)


@pytest.mark.usefixtures("one_figure")
def test_a_run_goes_on_with_what_is_finished(call, study, old_run, tmp_path):
    path = study / "study.toml"
    path.write_text(path.read_text().replace("n_sets = 20", "n_sets = 4"))
    ran = call("run", study, "--out", old_run, "--go-on", "--json")
    assert ran.code == 0, ran.err
    with Ledger(old_run) as ledger:
        rows = ledger.frame("simulations")
    assert rows.height == 4
    assert rows["n_attempts"].max() == 1, "a finished simulation was done again"
    assert json.loads((old_run / "manifest.json").read_text())["study"] == "toy"
