"""Measured thicknesses of layers, ``[spot.layers]``."""

from pathlib import Path

import pytest

from palpate.plugins.catalogue import Plugins

from .toy_study import TEXT, messages


def with_layers(line: str) -> str:
    return TEXT.replace("[truth]", f"[spot.layers]\n{line}\n[truth]", 1)


@pytest.mark.parametrize(
    ("line", "remedy"),
    [
        ('skim = "2 mm ± 0.2 mm"', "no region 'skim' (known: rubber)"),
        ('rubber = "2 mm"', 'write "1.6 mm ± 0.2 mm"'),
        ('rubber = "2 mm ± 0.2 N"', "not of the kind of mm"),
        ('rubber = "0 mm ± 0.2 mm"', "greater than 0"),
    ],
)
def test_a_mistake_is_reported_with_its_key(tmp_path: Path, plugins: Plugins, line: str, remedy: str) -> None:
    found = messages(tmp_path, plugins, with_layers(line))
    assert any("spot 's2', layers" in text and remedy in text for text in found), found
