"""A plugin's stage on the command line: its command, schema, files and section."""

from pathlib import Path

import polars as pl
import pytest

LOOP = Path(__file__).parents[2] / "examples" / "loop_work.py"


@pytest.mark.slow
def test_a_stage_that_a_study_asks_for_is_part_of_its_run(call, study, tmp_path):
    path = study / "study.toml"
    path.write_text(f"{path.read_text()}\n[stages.loop_work]\nchannel = 'pull'\n")
    assert call("--plugin", LOOP, "run", study).code == 0
    table = pl.read_parquet(tmp_path / "runs" / "toy" / "loop_work.parquet")
    assert {"measured", "fit of all spots, scenario pull only"} <= set(table["curve"])
    page = (tmp_path / "runs" / "toy" / "report" / "index.html").read_text()
    assert "Work lost in the twist, measured and fitted" in page
    shown = call("--plugin", LOOP, "loop_work", study, "--json")
    assert shown.json == {"loop_work": table.to_dicts(), "warnings": []}
    schema = call("--plugin", LOOP, "schema", "loop_work").json
    assert schema["required"] == ["loop_work", "warnings"]


@pytest.mark.slow
def test_settings_of_a_stage_decide_its_table(call, study):
    path = study / "study.toml"
    text = path.read_text()
    path.write_text(f"{text}\n[stages.loop_work]\nchannel = 'pull'\n")
    assert call("--plugin", LOOP, "run", study).code == 0
    path.write_text(f"{text}\n[stages.loop_work]\nchanel = 'torque'\n")
    refused = call("--plugin", LOOP, "check", study)
    assert refused.code == 2
    assert "stages.loop_work" in refused.err
