"""``palpate synthesise``: curves for an experiment that has not been made."""

from pathlib import Path

import numpy as np
import pytest

from .conftest import Call

STRETCHES = np.linspace(1.0, 2.0, 11)


@pytest.fixture
def planned(study: Path) -> Path:
    """Toy study with files that say along which stretches it will be pulled."""
    text = (study / "study.toml").read_text()
    (study / "study.toml").write_text(text.replace('"lines"', '"csv"').replace(".txt", ".csv"))
    for name in ("s1.csv", "s2.csv"):
        rows = "".join(f"{float(x)!r},0\n" for x in STRETCHES)
        (study / name).write_text("stretch,stress_MPa\n" + rows)
    return study


def test_writes_the_curves_of_the_truth_and_reports_the_files(
    call: Call, planned: Path, tmp_path: Path
) -> None:
    outcome = call("synthesise", planned, "--into", "made")
    assert outcome.code == 0
    for name in ("s1.csv", "s2.csv", "origin.json"):
        assert f"\nmade/{name}\n" in outcome.out
    x, y = np.loadtxt(tmp_path / "made" / "s2.csv", delimiter=",", skiprows=1).T
    assert np.array_equal(x, STRETCHES)
    assert y == pytest.approx(2.0 * (x - 1.0) * (1.0 + 0.5 * (x - 1.0)))


@pytest.mark.slow
@pytest.mark.usefixtures("one_figure")
def test_a_run_on_the_curves_is_near_the_truth(call: Call, planned: Path, tmp_path: Path) -> None:
    files = call("synthesise", planned, "--into", "made", "--json").json["files"]
    for file in files[:2]:
        (planned / Path(file).name).write_bytes((tmp_path / file).read_bytes())
    best = call("run", planned, "--json").json["selection"][0]
    assert best["rubber.k [kPa]"] == pytest.approx(2000.0, abs=2000.0 / 20)  # one stratum of the design


def test_nothing_is_overwritten(call: Call, planned: Path) -> None:
    before = (planned / "s1.csv").read_bytes()
    outcome = call("synthesise", planned)
    assert outcome.code == 2
    assert "s1.csv: exists and is not overwritten" in outcome.err
    assert "--into" in outcome.err
    assert (planned / "s1.csv").read_bytes() == before


def test_noise_and_seed_reach_the_curves(call: Call, planned: Path, tmp_path: Path) -> None:
    for folder, seed in (("a", 1), ("b", 1), ("c", 2)):
        assert call("synthesise", planned, "--into", folder, "--noise", 0.1, "--seed", seed).code == 0
    a, b, c = ((tmp_path / folder / "s1.csv").read_bytes() for folder in "abc")
    assert a == b != c


def test_help_describes_what_such_curves_can_show(call: Call) -> None:
    text = " ".join(call("synthesise", "--help").out.split())
    assert "[truth]" in text
    assert "not that the model is right" in text
