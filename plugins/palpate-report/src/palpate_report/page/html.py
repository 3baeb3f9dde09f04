"""One page that holds a whole run, and asks no network for anything.

``index.html.jinja`` is its frame: the card, then the sections (:mod:`palpate_report.page.html`), whose blocks
``blocks.html.jinja`` shows. What the page's own script draws is in :mod:`palpate_report.page.page_data`.
"""

import base64
import hashlib
import re
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from datetime import datetime
from functools import cache
from itertools import groupby
from pathlib import Path
from types import MappingProxyType

import jinja2
import polars as pl
from markupsafe import Markup, escape

from palpate.api import PluginError, Summary
from palpate.api.files import write_atomically
from palpate.api.report import Block, Choice, Figure, Fold, Paragraph, Picture, Table, heading, shown
from palpate.api.runs import answering_for, file_name
from palpate_report.answer.card import answer
from palpate_report.answer.law import typeset
from palpate_report.answer.result import Conclusion, Report, ordered
from palpate_report.data.marks import with_minus
from palpate_report.data.report_data import ReportData
from palpate_report.data.showable import address, checked, figure_data, is_own
from palpate_report.page.page_data import page_data


@dataclass(frozen=True, slots=True)
class RenderedSection:
    """A section as the page shows it."""

    name: str
    title: str
    entry: str
    result: str
    is_open: bool
    blocks: tuple[Block, ...]

    @property
    def figures(self) -> Iterator[Figure]:
        """Figures of the section, those that are folded too."""
        return _figures(self.blocks)


def laid_out(data: ReportData, report: Report) -> list[RenderedSection]:
    """Every section that has something to show; one that fails shows why, unless it is the core's own."""
    found: list[RenderedSection] = []
    for section in ordered(data.sections):
        try:
            with nullcontext() if is_own(section) else answering_for(section, "laying out the report"):
                made = section()
                is_open, blocks = made.is_open(data, report), checked(made, made.blocks(data, report))
                result = made.result(data, report)
        except PluginError as error:
            data.note(f"warning: section '{section.name}' of the page could not be made: {error}")
            result, is_open, blocks = "", False, (Paragraph(f"This section could not be made: {error}."),)
        if blocks:
            entry = section.entry or section.title
            found.append(RenderedSection(section.name, section.title, entry, result, is_open, blocks))
    place = next((i for i, each in enumerate(found) if each.name == "provenance"), len(found))
    found[place:place] = [_of_stage(name, *made) for name, made in data.summaries.items()]
    return found


def _of_stage(name: str, does: str, summary: Summary) -> RenderedSection:
    """Section of a plugin's stage: what it does, its lines and its tables."""
    title = name.replace("_", " ").capitalize()
    tables = (Table.of(caption, frame) for caption, frame in summary.tables.items())
    result = "; ".join(summary.labelled.values()) or next(iter(summary.lines), "")
    blocks: tuple[Block, ...] = (*map(Paragraph, (does, *summary.lines)), *summary.figures, *tables)
    return RenderedSection(name, title, title, result, False, blocks)


def _figures(blocks: Iterable[Block]) -> Iterator[Figure]:
    for block in blocks:
        if isinstance(block, Figure):
            yield block
        elif isinstance(block, Fold):
            yield from _figures(block.blocks)
        elif isinstance(block, Choice):
            yield from _figures(block.options)


_FOLDER = Path(__file__).parent

LEADING_PICTURES = {
    "limbs": "The limb with its bones and the indenter at each spot",
    "intervals": "Every parameter by spot and scenario, with its interval; the numbers are under Values",
}
"""Figures of the first screen, next to the card."""


def _leading_pictures(
    data: ReportData, conclusion: Conclusion, pictures: Mapping[str, bytes]
) -> list[Picture]:
    """Figures of the first screen with their labels; a refused run shows its misfit, and no interval."""
    law = {"stress_strain": "Stress over stretch of the fitted material, with its 95 % band"}
    labels = LEADING_PICTURES if data.limbs else law | {"intervals": LEADING_PICTURES["intervals"]}
    if conclusion.failure:
        name = "generalised" if len(data.spots) > 1 else f"response_{file_name(data.spots[0])}"
        labels = {name: "Measured curves, and the refused fit"}
    return [Picture(label=labels[name], content=pictures[name]) for name in labels if name in pictures]


def write_page(
    data: ReportData,
    tables: Mapping[str, pl.DataFrame],
    conclusion: Conclusion,
    files: Sequence[Path],
    folder: Path,
    pictures: Mapping[str, bytes],
) -> Path:
    """Write ``index.html``, which needs none of the files that it links to."""
    path = folder / "index.html"
    page = render(data, tables, conclusion, [file.relative_to(folder) for file in files], pictures)
    write_atomically(path, page.encode())
    return path


def _by_stem(files: Iterable[Path]) -> dict[str, list[Path]]:
    found: dict[str, list[Path]] = {}
    for file in files:
        found.setdefault(file.stem, []).append(file)
    return found


def render(
    data: ReportData,
    tables: Mapping[str, pl.DataFrame],
    conclusion: Conclusion,
    files: Sequence[Path],
    pictures: Mapping[str, bytes] = MappingProxyType({}),
) -> str:
    """Text of the page.

    Parameters
    ----------
    files : sequence of Path
        Files that the page links to, relative to it.
    pictures : mapping of str to bytes
        SVG of each figure by its name.
    """
    script = "\n".join(map(text_of, ("skin.js", "page.js")))
    source, packed = library()
    report = Report(tables=tables, files=tuple(files), conclusion=conclusion, pictures=pictures)
    sections = laid_out(data, report)
    figures = [figure for section in sections for figure in section.figures]
    numbers = {id(figure): k for k, figure in enumerate(figures)}
    return template().render(
        answer=answer(data, conclusion),
        leading_pictures=_leading_pictures(data, conclusion, pictures),
        versions=[v for name, v in data.manifest.get("versions", {}).items() if name == "palpate"],
        date=datetime.now().astimezone().date().isoformat(),
        report=data,
        study=data.study,
        conclusion=conclusion,
        sections=sections,
        number_of=lambda figure: numbers[id(figure)],
        data=page_data(data) | {"figures": [figure_data(figure) for figure in figures]},
        generalises="generalised" in tables and len(data.spots) > 1 and not data.widened,
        files=_by_stem(files),
        script=Markup(script),
        library=packed,
        policy=content_policy(script, source),
    )


def comparison_page(title: str, blocks: Sequence[Block], files: Sequence[Path]) -> str:
    """Text of the page of a comparison or a prediction, which has no script."""
    return template("comparison.html.jinja").render(
        title=title,
        blocks=blocks,
        files=_by_stem(files),
        policy=content_policy(),
    )


@cache
def template(name: str = "index.html.jinja") -> jinja2.Template:
    """Return a page, compiled once in a process."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_FOLDER),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    filters = {
        "shown": _with_minus(shown),
        "minus": _with_minus(str),
        "heading": heading,
        "address": address,
        "width": _width,
        "typeset": typeset,
        "code": _code,
    }
    # Style and scripts come from palpate's own files and hold no name of anybody's study.
    environment.globals["style"] = Markup(text_of("page.css"))
    environment.filters |= filters | {"kind": _kind, "grouped": _grouped}
    return environment.get_template(name)


@cache
def library() -> tuple[str, str]:
    """Return the library that draws figures, and the same compressed."""
    from plotly.offline import get_plotlyjs

    source: str = get_plotlyjs()
    return source, base64.b64encode(zlib.compress(source.encode(), 9)).decode()


def text_of(name: str) -> str:
    """Style sheet or script that a page holds, by the name of its file."""
    return (_FOLDER / name).read_text(encoding="utf-8")


def content_policy(*scripts: str) -> str:
    """Policy of the page: it may run these scripts, and load nothing from anywhere."""
    hashes = (base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in scripts)
    allowed = " ".join(f"'sha256-{digest}'" for digest in hashes)
    return f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:"


def _kind(value: object) -> str:
    """Name of the class of a block or a cell."""
    return type(value).__name__


def _with_minus(text: Callable[..., str]) -> Callable[..., str]:
    """Filter with true minus signs in front of numbers, not within names and dates."""
    return lambda *values: with_minus(text(*values))


def _width(picture: Picture) -> str:
    """Width of an SVG on the page, in CSS; empty of a picture in pixels."""
    found = re.search(rb'<svg[^>]* width="([\d.]+)pt"', picture.content[:2000])
    # Larger than in print, which is read from less far.
    return f"{1.5 * float(found[1]):.0f}pt" if found else ""


def _code(text: str) -> Markup:
    """Text whose commands and settings, in backticks, are set as code; its lines break between words."""
    word, code = Markup("<span>{}</span>"), Markup("<code>{}</code>")
    # A backtick without a second one stays as it is.
    return Markup("").join(
        code.format(Markup(" ").join(map(word.format, part.split(" ")))) if k % 2 else escape(part)
        for k, part in enumerate(re.split("`([^`]*)`", str(text)))
    )


def _grouped(blocks: Sequence[Block]) -> Iterator[tuple[str, list[Block]]]:
    """Blocks of one kind that follow each other: figures are next to each other where there is room."""
    for kind, found in groupby(blocks, _kind):
        yield kind, list(found)
