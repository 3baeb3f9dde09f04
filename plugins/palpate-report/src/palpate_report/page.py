"""One page that holds a whole run, and asks no network for anything.

``index.html.jinja`` is its frame: the card, then the sections (:mod:`palpate_report.layout`), whose blocks
``blocks.html.jinja`` shows. What the page's own script draws is in :mod:`palpate_report.page_data`.
"""

import base64
import hashlib
import zlib
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from itertools import groupby
from pathlib import Path

import jinja2
import polars as pl
from markupsafe import Markup

from palpate.api.files import write_atomically
from palpate.api.report import Block, address, figure_data, heading
from palpate_report.answer import answer, colour_of
from palpate_report.forest import forest
from palpate_report.layout import laid_out
from palpate_report.page_data import page_data
from palpate_report.report_data import ReportData
from palpate_report.result import Report
from palpate_report.rounding import rounded
from palpate_report.table_files import shown
from palpate_report.tables import COMPARISON_TITLES
from palpate_report.verdict import Verdict

_FOLDER = Path(__file__).parent


def write_page(
    data: ReportData,
    tables: Mapping[str, pl.DataFrame],
    verdict: Verdict,
    files: Sequence[Path],
    folder: Path,
) -> Path:
    """Write ``index.html``, which needs none of the files that it links to."""
    path = folder / "index.html"
    page = render(data, tables, verdict, [file.relative_to(folder) for file in files])
    write_atomically(path, page.encode())
    return path


def render(
    data: ReportData, tables: Mapping[str, pl.DataFrame], verdict: Verdict, files: Sequence[Path]
) -> str:
    """Text of the page.

    Parameters
    ----------
    data : ReportData
    tables : mapping of name to DataFrame
    verdict : Verdict
    files : sequence of Path
        Files that the page links to, relative to it.
    """
    names = ("page.css", "skin.js", "page.js")
    style, *scripts = ((_FOLDER / name).read_text(encoding="utf-8") for name in names)
    script = "\n".join(scripts)
    source, packed = library()
    by_stem: dict[str, list[Path]] = {}
    for file in files:
        by_stem.setdefault(file.stem, []).append(file)
    picture = forest(data, verdict.bests)
    sections = laid_out(data, Report(tables=tables, files=tuple(files), verdict=verdict))
    figures = [figure for section in sections for figure in section.figures]
    numbers = {id(figure): k for k, figure in enumerate(figures)}
    return template().render(
        answer=answer(data, verdict, picture),
        forest=picture,
        report=data,
        study=data.study,
        verdict=verdict,
        sections=sections,
        number_of=lambda figure: numbers[id(figure)],
        data=page_data(data) | {"figures": [figure_data(figure) for figure in figures]},
        generalises="generalised" in tables and len(data.spots) > 1,
        files=by_stem,
        # These come from palpate's own files and hold no name of anybody's study.
        style=Markup(style),
        script=Markup(script),
        library=packed,
        policy=_policy(script, source),
    )


def comparison_page(
    runs: Sequence[str],
    tables: Mapping[str, pl.DataFrame],
    notes: Sequence[str],
    picture: str,
    files: Sequence[Path],
) -> str:
    """Text of the page of a comparison, with its figure, an SVG in base 64, and no script."""
    return template("comparison.html.jinja").render(
        runs=runs,
        tables=tables,
        titles=COMPARISON_TITLES,
        notes=notes,
        picture=picture,
        files=files,
        style=Markup((_FOLDER / "page.css").read_text(encoding="utf-8")),
        policy=_policy(),
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
        "shown": shown,
        "heading": heading,
        "rounded": rounded,
        "address": address,
        "colour": colour_of,
    }
    environment.filters |= filters | {"kind": _kind, "grouped": _grouped}
    return environment.get_template(name)


@cache
def library() -> tuple[str, str]:
    """Return the library that draws figures, and the same compressed."""
    from plotly.offline import get_plotlyjs

    source: str = get_plotlyjs()
    return source, base64.b64encode(zlib.compress(source.encode(), 9)).decode()


def _policy(*scripts: str) -> str:
    """What the page may do: run these scripts, and load nothing from anywhere."""
    hashes = (base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in scripts)
    allowed = " ".join(f"'sha256-{digest}'" for digest in hashes)
    return f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:"


def _kind(value: object) -> str:
    """Name of the class of a block or a cell."""
    return type(value).__name__


def _grouped(blocks: Sequence[Block]) -> Iterator[tuple[str, list[Block]]]:
    """Blocks of one kind that follow each other: figures are beside each other where there is room."""
    for kind, found in groupby(blocks, _kind):
        yield kind, list(found)
