"""The fit on the command line: without a sweep, stage by stage, and where it fails."""

import re

import pytest

pytestmark = pytest.mark.usefixtures("one_figure")


@pytest.fixture
def without_sweep(study):
    """Toy study that fits from the ranges alone."""
    path = study / "study.toml"
    path.write_text(path.read_text().replace("n_sets = 20", "n_sets = 0"))
    return study


def test_every_command_works_without_a_sweep(call, without_sweep, tmp_path):
    assert call("check", without_sweep, "--json").json["n_sets"] == 0
    ran = call("run", without_sweep, "--json")
    assert ran.code == 0, ran.err
    assert (ran.json["n_sets"], ran.json["n_simulations"], ran.json["selection"]) == (0, 0, [])
    joint = [row for row in ran.json["fit"] if row["fit"] == "all spots"]
    assert [row["rubber.k"] for row in joint] == pytest.approx([2.0, 2.0], rel=1e-5)
    before = {path.name: path.read_bytes() for path in (tmp_path / "runs" / "toy").glob("*.parquet")}
    again = call("resume", "runs/toy", "--json", "--trust-plugins", plugin=None)
    assert (again.code, again.json["fit"]) == (0, ran.json["fit"])
    assert before == {path.name: path.read_bytes() for path in (tmp_path / "runs" / "toy").glob("*.parquet")}
    assert call("status", "runs/toy").code == 0
    for stage in ("experiment", "sample", "simulate", "score", "select", "fit", "report"):
        outcome = call(stage, without_sweep, "--out", "apart")
        assert outcome.code == 0, (stage, outcome.err)
    assert call("fit", without_sweep, "--out", "apart", "--json").json["fit"] == ran.json["fit"]
    more = call("run", without_sweep, "--sets", "8", "--out", "more", "--json")
    assert (more.code, more.json["n_sets"], more.json["n_simulations"]) == (0, 8, 16)


@pytest.mark.parametrize(
    ("n_sets", "more", "expected"),
    [
        (0, '[fit]\nsearch = "sweep"', "sampling.n_sets: no set to choose from with fit.search = 'sweep'"),
        (0, "", "sampling.n_sets: no set to scale with selection.stiffness_scaling"),
        (1, "", "sampling.n_sets: one set is no sweep; give 2 or more, or 0"),
        (-1, "", "must be greater than or equal to 0"),
    ],
)
def test_what_needs_a_sweep_is_refused_without_one(call, study, n_sets, more, expected):
    path = study / "study.toml"
    text = path.read_text().replace("n_sets = 20", f"n_sets = {n_sets}")
    if "stiffness" in expected:
        text = text.replace("[selection]", "[selection]\nstiffness_scaling = true")
    path.write_text(text + more)
    refused = call("run", study)
    assert refused.code == 2
    assert re.search(rf"study\.toml:\d+: .*{re.escape(expected)}", refused.err), refused.err
