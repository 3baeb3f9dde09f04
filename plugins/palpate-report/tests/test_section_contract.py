"""Each law of sections fails on what breaks it, with the reason."""

import itertools

import pytest

from palpate.errors import PluginError
from palpate.plugins.sections import Figure, Fold, Paragraph, Picture, ReportWarning, Section
from palpate_report.sections import SECTIONS
from palpate_report.testing import SectionContract, small_runs


class TestTheCore(SectionContract):
    @pytest.fixture(params=SECTIONS, ids=lambda section: section.name)
    def section(self, request):
        return request.param()

    def test_shows_blocks_of_every_run(self, section, runs):
        if section.name not in (
            "generalisation",
            "pictures",
            "deformed",
            "warnings",
        ):  # of several spots, of plots, of skin, of more than the first screen shows
            super().test_shows_blocks_of_every_run(section, runs)


class Faulty(Section):
    name, title, summary = "faulty", "Faulty", "breaks a law"

    def blocks(self, data, report):
        return [Paragraph("fine")]


class Nowhere(Faulty):
    after = "the_moon"


class Empty(Faulty):
    def blocks(self, data, report):
        return []


class NoBlock(Faulty):
    def blocks(self, data, report):
        return [Fold("more", ["<p>text</p>"])]


class NoData(Faulty):
    def blocks(self, data, report):
        return [Figure(label="set", traces=[{"x": {1, 2}}])]


class NoPicture(Faulty):
    def blocks(self, data, report):
        return [Picture(label="a page", content=b"<html></html>")]


class FailsWithoutResult(Faulty):
    def blocks(self, data, report):
        return [Paragraph(f"best set {data.selection['set_id'][0]}")]


COUNT = itertools.count()


class Counting(Faulty):
    def blocks(self, data, report):
        return [Figure(label="count", traces=[{"x": [next(COUNT)]}])]


class Marked(Faulty):
    def blocks(self, data, report):
        return [Paragraph("a <b>strong</b> word")]


class Unlabelled(Faulty):
    def blocks(self, data, report):
        return [Figure(label=" ", traces=[])]


class Large(Faulty):
    def blocks(self, data, report):
        return [Figure(label="noise", traces=[{"x": [k / 7.0 for k in range(100_000)]}])]


class Worried(Faulty):
    def warnings(self, data):
        return ["beware"]


class WithoutReason(Faulty):
    def warnings(self, data):
        return [ReportWarning("Beware", "")]


@pytest.mark.parametrize(
    ("section", "law", "message"),
    [
        (Nowhere, "has_a_title_and_a_place", "comes after 'the_moon'"),
        (Empty, "shows_blocks_of_every_run", "shows nothing of any run"),
        (NoBlock, "shows_blocks_of_every_run", "is no block"),
        (NoData, "shows_blocks_of_every_run", r"a figure has \{1, 2\}"),
        (NoPicture, "shows_blocks_of_every_run", "is no PNG, JPEG or SVG"),
        (FailsWithoutResult, "shows_blocks_of_every_run", "out of bounds"),
        (Counting, "shows_the_same_of_the_same_run", "something else the second time"),
        (Marked, "its_texts_are_texts", "the page shows"),
        (Unlabelled, "what_is_drawn_has_a_label_and_a_size", "has no label"),
        (Large, "what_is_drawn_has_a_label_and_a_size", "bytes of figures"),
        (Worried, "warns_in_words", "is no palpate.api.ReportWarning"),
        (WithoutReason, "warns_in_words", "say why it matters"),
    ],
)
def test_a_faulty_section_is_caught(section, law, message):
    check = getattr(SectionContract(), f"test_{law}")
    with pytest.raises((AssertionError, PluginError, IndexError), match=message):
        check(section()) if law.startswith("has_") else check(section(), small_runs())


def test_a_section_without_a_fault_passes():
    contract = SectionContract()
    contract.test_has_a_title_and_a_place(Faulty())
    for law in ("shows_blocks_of_every_run", "shows_the_same_of_the_same_run", "its_texts_are_texts",
                "what_is_drawn_has_a_label_and_a_size", "warns_in_words"):  # fmt: skip
        getattr(contract, f"test_{law}")(Faulty(), small_runs())
