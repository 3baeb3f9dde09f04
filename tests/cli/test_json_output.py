"""``--json`` prints by the schema of ``palpate schema``, and a change of it is a new version."""

import hashlib
import json
import subprocess
import sys
from pathlib import Path

import jsonschema
import pytest

import palpate_certainty
from palpate.cli.app import COMMANDS, STAGES, main
from palpate.cli.options import name_of
from palpate.cli.output import OUTPUTS, VERSION, schema
from palpate.stages import core_stages
from palpate_report.stage import CompareOutput, ReportOutput

from .conftest import Call

pytestmark = pytest.mark.usefixtures("one_figure")

OF_CERTAINTY = {stage.name: stage for stage in palpate_certainty.palpate_stages()}
OF_REPORT = {"report": ReportOutput, "compare": CompareOutput}
CORE_STAGES = {stage.name: stage for stage in core_stages.STAGES}

PUBLISHED = {
    1: "7d784a0eff4752b7",
    2: "0546410e5aeb8c1d",
    3: "8b1545c8a87cf3c1",
    4: "12420e8218a6eede",
    5: "dae185af669f56ed",
    6: "cb8eeecd7c5468de",
}
"""Digest of all schemas of each version."""


def valid(command: str, value: object) -> object:
    validator = jsonschema.Draft202012Validator(schema(command, CORE_STAGES | OF_CERTAINTY, OF_REPORT))
    validator.check_schema(validator.schema)
    validator.validate(value)
    return value


def test_every_command_that_prints_json_has_a_schema() -> None:
    assert {*OUTPUTS, *CORE_STAGES} == {name_of(command) for command in (*COMMANDS, *STAGES)} - {"schema"}


def test_a_change_is_a_new_version() -> None:
    """Raise VERSION where scripts would break, and add the digest here."""
    text = json.dumps(
        [schema(command, CORE_STAGES) for command in {**OUTPUTS, **CORE_STAGES}], sort_keys=True
    )
    assert hashlib.sha256(text.encode()).hexdigest()[:16] == PUBLISHED[VERSION]


@pytest.mark.slow
def test_what_a_study_prints_from_check_to_report(call: Call, study: Path) -> None:
    assert valid("check", call("check", study, "--json").json)["n_sets"] == 20
    for command in ("experiment", "limb", "sample", "simulate", "score", "select", "report"):
        out = [] if command == "limb" else ["--out", "run"]
        valid(command, call(command, study, *out, "--json").json)
    run = valid("run", call("run", study, "--out", "run", "--json").json)
    assert run["n_simulations"] > 20
    assert run["tables"]["table1_coefficients"]
    valid("run", call("run", "run", "--json").json)
    status = valid("status", call("status", "run", "--json").json)
    assert (status["n_finished"], status["running"]) == (run["n_simulations"], None)


def test_what_synthesise_prints(call: Call, study: Path) -> None:
    text = (study / "study.toml").read_text()
    (study / "study.toml").write_text(text.replace('"lines"', '"csv"').replace(".txt", ".csv"))
    for name in ("s1.csv", "s2.csv"):
        (study / name).write_text("stretch,stress_MPa\n1.0,0\n1.5,0\n2.0,0\n")
    printed = call("synthesise", study, "--into", "planned", "--json").json
    assert "planned/s1.csv" in valid("synthesise", printed)["files"]


def test_what_the_others_print(call: Call) -> None:
    valid("init", call("init", "--json").json)
    valid("init", call("init", "--study", "treloar", "rubber", "--json").json)
    valid("plugins", call("plugins", "--json").json)
    assert valid("new-plugin", call("new-plugin", "stage", "mine", "--json").json)
    assert valid("doctor", call("doctor", "--json").json)


def test_the_schema_refuses_what_it_does_not_describe(call: Call, study: Path) -> None:
    printed = call("check", study, "--json").json
    for edit in ({"more": 1}, {"n_sets": "20"}, {"searched": [{"name": "k"}]}):
        assert not jsonschema.Draft202012Validator(schema("check", CORE_STAGES)).is_valid({**printed, **edit})


def test_the_command(call: Call) -> None:
    assert call("schema", "run").json["$id"] == f"urn:palpate:run:{VERSION}"
    assert "synthesise" in call("schema").out
    refused = call("schema", "rnu")
    assert refused.code == 2
    assert "did you mean 'run'" in refused.err


@pytest.mark.slow
def test_raw_writes_of_a_plugin_stay_out_of_the_results(tmp_path):
    plugin = tmp_path / "raw.py"
    plugin.write_text(
        "import os\nfrom palpate import Channel, hookimpl\nos.write(1, b'raw at import')\n"
        "@hookimpl\ndef palpate_channels():\n    os.write(1, b'raw in a hook')\n    return []\n"
    )
    command = [sys.executable, "-m", "palpate", "--plugin", str(plugin), "plugins", "executors", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)
    assert "raw at import" in done.stderr
    assert "raw in a hook" in done.stderr


def test_the_cost_of_a_run_is_in_json_and_in_a_table(whole_run, capsys):
    assert main(["status", str(whole_run), "--json"]) == 0
    status = json.loads(capsys.readouterr().out)
    rows = status["cost"]
    assert {"start-up", "simulate", "report"} <= {row["stage"] for row in rows}
    assert sum(row["n_simulations"] for row in rows if row["work"] != "slopes") == status["n_simulations"]
    assert main(["status", str(whole_run), "--cost"]) == 0
    shown = capsys.readouterr().out
    assert f"{sum(row['processor_s'] for row in rows):.1f}" in shown
    assert "Processor time" in (whole_run / "report" / "index.html").read_text()


def test_a_run_without_a_record_of_its_cost_says_how_to_get_one(ran, capsys):
    (ran / "processor_time.json").unlink()
    assert main(["status", str(ran), "--cost"]) == 2
    assert "`palpate run " in capsys.readouterr().err
