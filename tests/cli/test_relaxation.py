"""What any loader has measured of relaxation reaches the warnings, the conclusion and the tables."""

from pathlib import Path

import polars as pl
import pytest

from .conftest import Call

RESTING = '''"""Loader of two columns, of a tissue that relaxed."""

import numpy as np

from palpate.api import Curve, ExperimentLoader, Relaxation, Response, hookimpl


class Resting(ExperimentLoader):
    name, summary = "resting", "two columns, after a rest"

    def load(self, path, channel=None):
        x, y = np.loadtxt(path).T
        rest = Relaxation(
            channel=channel, phase="rest", duration_s=1.0, start_value=y[-1], fall=0.12 * y[-1], fall_std=1e-6
        )
        return Response(curves={channel: Curve(channel=channel, abscissa=x, ordinate=y)}, relaxations=[rest])


@hookimpl
def palpate_experiment_loaders():
    return [Resting]
'''
SENTENCE = "relaxed by 12 % in 1 s; these are apparent moduli of this rate"


@pytest.mark.usefixtures("one_figure")
def test_a_loader_of_one_file_has_its_tissue_called_relaxed(call: Call, study: Path) -> None:
    loader, file = study / "resting.py", study / "study.toml"
    loader.write_text(RESTING)
    text = file.read_text().replace('loader = "lines"', 'loader = "resting"')
    file.write_text(text + '\n[fit]\nsearch = "least_squares"\n')
    plugin = ("--plugin", loader)
    assert SENTENCE in call(*plugin, "check", study).err
    lines = call(*plugin, "run", study).out.splitlines()
    said = dict(line.split(maxsplit=1) for line in lines)
    assert SENTENCE in said["Warnings"]
    assert "unclear" in said["Parameters"]
    assert "k = " in said["Parameters"]
    checks = pl.read_parquet("runs/toy/adequacy.parquet").filter(check="relaxation")
    checks = checks.filter(verdict="does not describe")
    assert set(checks["fit"]) == {"all spots", "s1", "s2"}
    assert all(SENTENCE in message for message in checks["message"])
    assert SENTENCE in Path("runs/toy/report/index.html").read_text()
