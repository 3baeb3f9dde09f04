"""Changed code: its cost is reported by name, and only ``--trust`` keeps earlier results."""

import json

import polars as pl
import pytest

from palpate.errors import StudyError
from palpate.run.directory import RunDirectory
from palpate.run.ledger import Ledger

from .conftest import PLUGIN
from .test_resume import tables

pytestmark = pytest.mark.usefixtures("one_figure")
quick = pytest.mark.usefixtures("without_report")

BOTH = ("--trust", "material:spring", "--trust", "solver:closed_form")


@pytest.fixture
def without_report(monkeypatch):
    """Leave the report out of every run, for what is not about it."""
    monkeypatch.setattr("palpate_report.from_run.write_figures", lambda data, folder: ())


@pytest.fixture
def plugin(tmp_path):
    """A copy of the toy plugin, and how to change what its solver answers."""
    file = tmp_path / "toy_plugin.py"

    def write(factor=1.0):
        with open(PLUGIN, encoding="utf-8") as usual:
            changed = "ordinate=theta[0]" if factor == 1.0 else f"ordinate={factor} * theta[0]"
            file.write_text(usual.read().replace("ordinate=theta[0]", changed))
        return str(file)

    return write


def scores(folder):
    return pl.read_parquet(folder / "scores.parquet")


def n_simulated(folder):
    """Count the simulations of a run: of its sweep and its fit."""
    with Ledger(folder) as ledger:
        return ledger.frame().height


@pytest.mark.slow
@quick
def test_changed_code_is_named_and_its_results_are_made_again(call, study, ran, plugin):
    before, n_first = scores(ran), n_simulated(ran)
    refused = call("run", study, plugin=plugin(2.0))
    assert refused.code == 2
    assert "material:spring: code changed, source " in refused.err
    assert "solver:closed_form: code changed, source " in refused.err
    assert "0 of 20 finished simulations are still valid" in refused.err
    assert "--trust material:spring --trust solver:closed_form keeps them" in refused.err
    assert call("run", study, "--go-on", plugin=plugin(2.0)).code == 0
    assert not scores(ran).equals(before)
    n_other = n_simulated(ran)
    assert n_other >= n_first + 20, "every set of the sweep, and a fit"
    back = call("run", study, "--go-on", plugin=plugin())
    assert back.code == 0
    assert scores(ran).equals(before)
    assert n_simulated(ran) == n_other


@pytest.mark.slow
def test_trusted_results_stay_in_every_later_stage_and_are_on_record(call, study, ran, plugin):
    before, n_first = scores(ran), n_simulated(ran)
    assert call("run", study, *BOTH, plugin=plugin(2.0)).code == 0
    assert scores(ran).equals(before)
    for again in (("run", ran), ("score", study), ("report", study)):
        done = call(*again, plugin=plugin(2.0))
        assert done.code == 0, done.err
    assert scores(ran).equals(before)
    assert n_simulated(ran) == n_first
    manifest = json.loads((ran / "manifest.json").read_text())
    (origin,) = manifest["trusted"]["material:spring"]
    assert manifest["trusted"]["material:spring"][origin] == [manifest["fingerprints"]["material:spring"]]
    assert "Results of earlier code are accepted" in (ran / "report" / "index.html").read_text()
    changed_again = call("run", study, plugin=plugin(3.0))
    assert "0 of 20 finished simulations are still valid" in changed_again.err
    assert call("run", study, *BOTH, plugin=plugin(3.0)).code == 0
    assert scores(ran).equals(before)


@pytest.mark.slow
def test_a_stage_after_the_sweep_refuses_other_code(call, study, ran, plugin):
    before = tables(ran)
    for stage in ("simulate", "score", "select", "report"):
        refused = call(stage, study, plugin=plugin(2.0))
        assert refused.code == 2
        assert "were made before a change of loader of spot 's1'" in refused.err  # the plugin has it too
    assert tables(ran) == before


@pytest.mark.slow
@quick
def test_a_copy_of_a_run_accepts_what_it_was_copied_with(call, study, tmp_path, ran, plugin):
    assert call("run", study, "--fork", "copy", *BOTH, plugin=plugin(2.0)).code == 0
    assert call("run", "copy", plugin=plugin(2.0)).code == 0
    assert scores(tmp_path / "copy").equals(scores(ran))
    assert n_simulated(tmp_path / "copy") == n_simulated(ran)


@pytest.mark.slow
@quick
def test_stages_after_the_sweep_use_the_same_results(call, study, ran, plugin):
    n_first = n_simulated(ran)
    assert call("sample", study, plugin=plugin(2.0)).code == 0
    assert call("run", study, *BOTH, plugin=plugin(2.0)).code == 0
    assert n_simulated(ran) == n_first


@pytest.mark.slow
@quick
def test_results_under_a_trusted_key_are_not_shared(call, study, tmp_path, plugin):
    path = study / "study.toml"
    path.write_text(path.read_text().replace('name = "in_process"', 'name = "in_process"\ncache = "cache"'))
    call("run", study, "--sets", "10", plugin=plugin())
    shared = n_simulated(study / "cache")
    assert shared >= 10, "every set of the sweep, and a fit"
    assert call("run", study, *BOTH, plugin=plugin(2.0)).code == 0
    assert n_simulated(study / "cache") == shared


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("material:sprong", "did you mean 'material:spring'?"),
        ("sampler:lhs", "no such component"),
        ("material:spring", "holds no results of it"),
    ],
)
def test_what_cannot_be_trusted_is_refused(call, study, name, message):
    refused = call("run", study, "--trust", name)
    assert refused.code == 2
    assert message in refused.err


@quick
@pytest.mark.usefixtures("ran")
def test_a_changed_measured_file_is_reported_though_it_costs_no_simulation(call, study):
    file = study / "s1.txt"
    rows = [line.split() for line in file.read_text().splitlines()]
    file.write_text("".join(f"{x} {float(y) * 1.3}\n" for x, y in rows))
    for given in (study, "runs/toy"):
        again = call("run", given)
        assert again.code == 0, again.err
        if given == study:
            assert "inputs.s1.txt: " in again.err
            assert "20 of 20 finished simulations are still valid" in again.err
        else:
            assert "inputs." not in again.err


@quick
def test_nonsense_in_the_manifest_is_refused(call, study, ran):
    manifest = RunDirectory(ran).manifest()
    for key in ("fingerprints", "trusted", "inputs", "plugin_files", "study_file"):
        for nonsense in (3, [1], {"material:spring": 3}):
            (ran / "manifest.json").write_text(json.dumps(manifest | {key: nonsense}))
            with pytest.raises(StudyError, match="damaged"):
                RunDirectory(ran).manifest()
    again = call("run", study)
    assert (again.code, again.err.count("\n")) == (2, 1)
    assert "manifest.json: damaged (" in again.err


@pytest.mark.parametrize("command", [("card", "runs/toy", "--for", "json"), ("report", "runs/toy")])
def test_the_command_that_was_given_is_named_with_its_plugin(call, study, plugin, command):
    file = plugin()
    assert call("sample", study, plugin=file).code == 0
    refused = call(*command, plugin=None)
    assert refused.code == 2
    assert refused.err.rstrip().endswith(f"palpate --plugin {file} {' '.join(command)}")
