"""The contract test of a plugin's section, on runs of a small study.

Subclass it and override the fixture ``section``, as with :mod:`palpate.testing`.
"""

import importlib.util
import json
import re
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import polars as pl
import pytest

import palpate_report
from palpate.api import Component
from palpate.api.report import (
    Block,
    Choice,
    Figure,
    Fold,
    Heading,
    Listing,
    Paragraph,
    Picture,
    ReportWarning,
    Section,
    Table,
)
from palpate.api.runs import Plugins, RunDirectory, read_run, run_study
from palpate.testing import ComponentContract, StudyRunner, overridden, plugins_with
from palpate_report.answer.result import Report
from palpate_report.data.report_data import ReportData
from palpate_report.data.showable import checked, figure_data
from palpate_report.from_run import report_data

__all__ = ["SectionContract", "SmallRun", "small_run", "small_runs"]

MOST_BYTES = 500_000
"""Most bytes of the figures and pictures of a section of a small run."""

RUNS: Mapping[str, Mapping[str, Any]] = {
    "a sweep": {"fit": {"search": "sweep"}},
    "a sweep and a fit": {"fit": {"search": "least_squares"}},
    "a fit alone": {"fit": {"search": "least_squares"}, "sampling": {"n_sets": 0}},
    "a sweep on a mesh": {"fit": {"search": "sweep"}, "limb": {"source": "small_block"}},
}
"""Tables of the small study by what its run has."""


class SmallRun(NamedTuple):
    """Values that a section is given."""

    data: ReportData
    report: Report


@cache
def page() -> Plugins:
    """The core with palpate-report, which lays sections out."""
    return plugins_with(palpate_report)


def small_run(folder: Path, plugins: Iterable[object], tables: Mapping[str, Any]) -> SmallRun:
    """Run a small study, and return what its page is made of.

    Parameters
    ----------
    plugins : iterable of module or object
        Besides the plugins of :mod:`palpate.testing.bench`, and palpate-certainty where it is installed.
    tables : mapping
        Tables of the study, as :class:`palpate.testing.StudyRunner` takes them.
    """
    optional = ["palpate_certainty"] if importlib.util.find_spec("palpate_certainty") else []
    every = dict.fromkeys([*plugins, *map(importlib.import_module, optional)])
    study, loaded = StudyRunner(folder).study(*every, **tables)
    run_study(study, folder / "run", loaded)
    run = read_run(study, RunDirectory(folder / "run"), loaded, is_copy=False)
    sections = {**page().sections, **run.sections}
    data = report_data(replace(run, sections=sections))
    return SmallRun(data, Report.of(data))


@cache
def small_runs() -> Mapping[str, SmallRun]:
    """Runs of ``RUNS`` by what they have, and one without any result; made once in a process."""
    with tempfile.TemporaryDirectory() as folder:
        found = {}
        for name, tables in RUNS.items():
            place = Path(folder) / name
            place.mkdir()
            found[name] = small_run(place, (), tables)
    empty = _without_result(found["a sweep"].data)
    return MappingProxyType(found | {"no result": SmallRun(empty, Report.of(empty))})


class SectionContract(ComponentContract):
    """Laws of a section; override ``section``, and ``runs`` where it needs others to show anything."""

    section = overridden("the section under test")

    @pytest.fixture
    def runs(self) -> Mapping[str, SmallRun]:
        """Provide runs by what they have; one of them without any result."""
        return small_runs()

    @pytest.fixture
    def component(self, section: Section) -> Component:
        """Provide the section as a component."""
        return section

    def test_has_a_title_and_a_place(self, section: Section) -> None:
        assert section.title.strip(), f"section '{section.name}' needs a title"
        places = list(page().sections)
        assert section.after in places, (
            f"section '{section.name}' comes after '{section.after}', which the page has not; choose one of: "
            f"{', '.join(places)}"
        )

    def test_shows_blocks_of_every_run(self, section: Section, runs: Mapping[str, SmallRun]) -> None:
        shown = {}
        for name, run in runs.items():
            shown[name] = checked(section, section.blocks(*run))
            assert isinstance(section.is_open(*run), bool)
            assert isinstance(section.result(*run), str)
        assert any(shown.values()), (
            f"section '{section.name}' shows nothing of any run; override the fixture 'runs' with one of "
            "which it does"
        )

    def test_shows_the_same_of_the_same_run(self, section: Section, runs: Mapping[str, SmallRun]) -> None:
        for run in runs.values():
            first, second = (_content(section.blocks(*run)) for _ in range(2))
            assert first == second, f"section '{section.name}' shows something else the second time"

    def test_its_texts_are_texts(self, section: Section, runs: Mapping[str, SmallRun]) -> None:
        for run in runs.values():
            for text in _texts(section.blocks(*run)):
                found = re.search(r"</?[a-z]+[ >/]", text)
                assert found is None, (
                    f"{text!r}: the page shows {found} as it is; use blocks for what it means"
                )

    def test_what_is_drawn_has_a_label_and_a_size(
        self, section: Section, runs: Mapping[str, SmallRun]
    ) -> None:
        for run in runs.values():
            drawn = [each for each in _every(section.blocks(*run)) if isinstance(each, (Figure, Picture))]
            assert all(each.label.strip() for each in drawn), (
                "a figure or picture has no label; say what it shows"
            )
            size = sum(len(_bytes(each)) for each in drawn)
            assert size <= MOST_BYTES, f"{size} bytes of figures of a small run; the most are {MOST_BYTES}"

    def test_warns_in_words(self, section: Section, runs: Mapping[str, SmallRun]) -> None:
        for run in runs.values():
            for warning in section.warnings(run.data):
                assert isinstance(warning, ReportWarning), f"{warning!r} is no palpate.api.ReportWarning"
                assert warning.what.strip(), "a warning must say what is wrong"
                assert warning.why.strip(), f"{warning.what}: say why it matters, or what to do"


def _without_result(data: ReportData) -> ReportData:
    """The same run, of which no set could be ranked."""
    return replace(
        data,
        scores=data.scores.with_columns(nmse=pl.lit(None, pl.Float64), r2=pl.lit(None, pl.Float64)),
        selection=data.selection.clear(),
        generalisation=data.generalisation.clear(),
        tables={name: table.clear() for name, table in data.tables.items()},
        responses={},
    )


def _every(blocks: Iterable[Block]) -> Iterator[Block]:
    for block in blocks:
        yield block
        if isinstance(block, Fold):
            yield from _every(block.blocks)
        if isinstance(block, Choice):
            yield from _every(block.options)


def _bytes(drawn: Figure | Picture) -> bytes:
    return drawn.content if isinstance(drawn, Picture) else json.dumps(figure_data(drawn)).encode()


def _content(blocks: Iterable[Block]) -> list[str]:
    """Content that blocks show, to compare."""
    return [
        repr(_bytes(each) if isinstance(each, (Figure, Picture)) else each)
        for each in _every(blocks)
        if not isinstance(each, (Fold, Choice))
    ]


def _texts(blocks: Iterable[Block]) -> Iterator[str]:
    for block in _every(blocks):
        match block:
            case Paragraph() | Heading():
                yield block.text
            case Listing():
                yield from (text for item in block.items for text in item)
            case Fold():
                yield block.title
            case Table():
                yield from (block.caption, *block.columns)
                yield from (cell for row in block.rows for cell in row if isinstance(cell, str))
