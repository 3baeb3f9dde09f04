"""The example of a robot that asks for its next press."""

from pathlib import Path

import pytest

import palpate_certainty
import palpate_materials
from palpate.plugins.registry import load_file
from palpate.testing.studies import StudyRunner

EXAMPLE = Path(__file__).parents[2] / "examples" / "closed_loop.py"


@pytest.mark.slow
@pytest.mark.parametrize(("until", "most", "n_widths"), [(1e-3, 2, 2), (1e3, 2, 1)])
def test_loop_ends_when_it_is_sure_or_has_pressed_enough(
    tmp_path, capsys, soft_region, until, most, n_widths
):
    study, plugins = StudyRunner(tmp_path).study(
        palpate_materials,
        palpate_certainty,
        region=soft_region,
        sampling={"n_sets": 0},
        fit={"search": "least_squares"},
        truth={"tissue": {"E": "70 kPa", "nu": 0.345}},
    )
    closed_loop = load_file(EXAMPLE)
    widths = closed_loop.loop(
        study.file, tmp_path / "loop", plugins, until=until, most_presses=most, noise=0.002
    )
    assert len(widths) == n_widths
    assert widths == sorted(widths, reverse=True)
    assert capsys.readouterr().out.count("the widest interval is") == n_widths
    assert (tmp_path / "loop" / f"press-{most if n_widths == most else 0}").is_dir()
