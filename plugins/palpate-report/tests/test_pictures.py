"""Pictures of limb and log on the page, as far as there is room."""

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from palpate.plugins.sections import Fold, Picture
from palpate_report.sections import origins as pictures
from palpate_report.sections.origins import Pictures
from palpate_report.testing import small_runs


def shown(paths):
    data, report = small_runs()["a sweep"]
    return list(Pictures().blocks(replace(data, pictures={"p1": paths}), report))


@pytest.fixture
def drawn(tmp_path):
    def made(name, size):
        noise = np.random.default_rng(0).integers(0, 255, (*size[::-1], 3), dtype=np.uint8)
        Image.fromarray(noise).save(tmp_path / name)
        return tmp_path / name

    return made


def test_without_a_picture_there_is_no_section():
    assert shown([]) == []


def test_a_picture_is_reduced_to_the_width_of_the_page_and_named(drawn):
    paragraph, fold = shown([drawn("4_onset.png", (1800, 60))])
    assert isinstance(fold, Fold)
    (picture,) = fold.blocks
    assert isinstance(picture, Picture)
    assert picture.label.endswith("4 onset")
    with Image.open(io.BytesIO(picture.content)) as image:
        assert image.size == (900, 30)
    assert "more are" not in paragraph.text


@pytest.mark.slow
def test_pictures_that_do_not_fit_are_counted(drawn, monkeypatch):
    monkeypatch.setattr(pictures, "MOST_BYTES", 20_000)
    paragraph, fold = shown([drawn("a.png", (800, 800)), drawn("b.png", (80, 80))])
    assert [picture.label.rpartition(": ")[2] for picture in fold.blocks] == ["b"]
    assert "1 more are in the run directory" in paragraph.text


def test_a_picture_that_cannot_be_read_is_counted(drawn, tmp_path):
    whole = drawn("c.png", (80, 80))
    (tmp_path / "a.png").touch()
    (tmp_path / "b.png").write_bytes(whole.read_bytes()[:2000])
    paragraph, fold = shown([tmp_path / "a.png", tmp_path / "b.png", whole, tmp_path / "gone.png"])
    assert [picture.label.rpartition(": ")[2] for picture in fold.blocks] == ["c"]
    assert "3 more are in the run directory" in paragraph.text
