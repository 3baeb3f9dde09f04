"""The sections of a page, laid out."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from palpate.api import PluginError, Summary
from palpate.api.report import Block, Figure, Fold, Paragraph, Table, checked, is_own
from palpate.api.runs import answering_for
from palpate_report.report_data import ReportData
from palpate_report.result import Report
from palpate_report.section_order import ordered


@dataclass(frozen=True, slots=True)
class Laid:
    """A section as the page shows it."""

    name: str
    title: str
    entry: str
    is_open: bool
    blocks: tuple[Block, ...]

    @property
    def figures(self) -> Iterator[Figure]:
        """Figures of the section, those that are folded too."""
        return _figures(self.blocks)


def laid_out(data: ReportData, report: Report) -> list[Laid]:
    """Every section that has something to show; one that fails says why, unless it is the core's own."""
    found: list[Laid] = []
    for section in ordered(data.sections):
        is_open, blocks = False, tuple[Block, ...]()
        try:
            if is_own(section):
                made = section()
                is_open, blocks = made.is_open(data, report), tuple(made.blocks(data, report))
            else:
                with answering_for(section, "laying out the report"):
                    made = section()
                    is_open, blocks = made.is_open(data, report), checked(made, made.blocks(data, report))
        except PluginError as error:
            is_open, blocks = False, (Paragraph(f"This section could not be made: {error}."),)
        if blocks:
            entry = section.entry or section.title
            found.append(Laid(section.name, section.title, entry, is_open, blocks))
    place = next((i for i, each in enumerate(found) if each.name == "provenance"), len(found))
    found[place:place] = [_of_stage(name, *made) for name, made in data.summaries.items()]
    return found


def _of_stage(name: str, does: str, summary: Summary) -> Laid:
    """Section of a plugin's stage: what it does, its lines and its tables."""
    title = name.replace("_", " ").capitalize()
    tables = (Table.of(caption, frame) for caption, frame in summary.tables.items())
    return Laid(name, title, title, False, (*map(Paragraph, (does, *summary.lines)), *tables))


def _figures(blocks: Iterable[Block]) -> Iterator[Figure]:
    for block in blocks:
        if isinstance(block, Figure):
            yield block
        elif isinstance(block, Fold):
            yield from _figures(block.blocks)
