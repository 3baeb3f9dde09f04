"""One page that holds a whole run, and asks no network for anything.

Each section is a block of ``index.html.jinja``, which reads it from the :class:`ReportData`, the tables and
the verdict; what the figures draw is in :mod:`palpate.report.page_data`.
"""

import base64
import hashlib
import zlib
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
import polars as pl
from markupsafe import Markup

from palpate.domain import Parameter
from palpate.report.answer import answer, budget_bars
from palpate.report.best_sets import Best, initial_moduli
from palpate.report.forest import forest
from palpate.report.page_data import page_data
from palpate.report.report_data import ReportData
from palpate.report.table_files import shown
from palpate.report.tables import COMPARISON_TITLES, TITLES
from palpate.report.verdict import Verdict
from palpate.run.result_files import write_atomically
from palpate.stages.identifiability import share_of_range

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
    style, script = ((_FOLDER / name).read_text(encoding="utf-8") for name in ("page.css", "page.js"))
    source, packed = library()
    leading = [best for best in verdict.bests if best.scenario == data.generalising.name]
    by_stem: dict[str, list[Path]] = {}
    for file in files:
        by_stem.setdefault(file.stem, []).append(file)
    picture = forest(data, verdict.bests)
    return template().render(
        answer=answer(data, verdict, picture),
        forest=picture,
        budget=list(budget_bars(data)),
        report=data,
        convergence=data.convergence,
        study=data.study,
        verdict=verdict,
        tables=tables,
        titles=TITLES,
        leading=leading,
        moduli=list(_moduli(data, leading)),
        intervals=list(_intervals(data)),
        data=page_data(data),
        generalising=data.generalising.name,
        generalises="generalised" in tables and len(data.spots) > 1,
        provenance=list(_provenance(data.manifest)),
        comparisons={name: _comparison(found) for name, found in data.comparisons.items()},
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
    environment.filters |= {"shown": shown, "heading": _heading, "brief": "{:.3g}".format}
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


def _heading(column: str) -> str:
    """Name of a column for people; that of a parameter is what the study calls it."""
    labels = {"nmse": "NMSE", "r2": "R²", "fopt": "Fopt"}
    measure, _, name = column.partition("_")
    if measure in labels:
        return f"{labels[measure]} {name}".rstrip()
    if "." in column:
        return column
    plain, unit = column, ""
    for suffix, brackets in (("_s", " [s]"), ("_percent", " [%]")):
        if column.endswith(suffix):
            plain, unit = column.removesuffix(suffix), brackets
    return plain.replace("_", " ") + unit


def _moduli(data: ReportData, bests: Sequence[Best]) -> Iterator[tuple[str, list[float | None]]]:
    """Rows of the initial moduli of each best set, and of the known answer if there is one."""
    columns = [best.moduli for best in bests]
    if data.study.truth:
        columns.append(dict(initial_moduli(data, data.study.truth)))
    for region in dict.fromkeys(region for column in columns for region in column):
        of = f" of {region}" if len(data.study.space.regions) > 1 else ""
        for i, name in enumerate(("initial shear modulus", "Young's modulus")):
            values = [column[region][i] if region in column else None for column in columns]
            yield f"{name}{of} [{data.modulus_unit}]", values


def _intervals(data: ReportData) -> Iterator[dict[str, Any]]:
    """Rows of the identifiability under brief names, with places in percent of the range for their bars."""
    for row in data.identifiability.iter_rows(named=True):
        parameter, other = data.brief[row["parameter"]], data.brief.get(row["most_correlated_with"])
        places = {end: row[end] for end in ("lower", "upper", "value")}
        places["truth"] = data.study.truth.get(row["parameter"])
        yield row | {
            "name": parameter.name,
            "most_correlated_with": other and other.name,
            "at": {end: _percent(parameter, value) for end, value in places.items() if value is not None},
        }


def _percent(parameter: Parameter, value: float) -> float:
    return round(min(max(100.0 * share_of_range(parameter, value), 0.0), 100.0), 2)


def _provenance(manifest: Mapping[str, Any]) -> Iterator[tuple[str, list[tuple[str, str]]]]:
    """What the numbers depended on: groups of keys and their values, the single ones first."""
    deep = {key: value for key, value in manifest.items() if isinstance(value, (Mapping, list))}
    single = {key: value for key, value in manifest.items() if key not in deep}
    for group, value in (("study", single), *deep.items()):
        if rows := list(_leaves(value, "")):
            yield group, rows


def _leaves(value: object, path: str) -> Iterator[tuple[str, str]]:
    """Every number and text within, under the keys that lead to it; lists of plain values are one."""
    if isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
        value = dict(enumerate(value, 1))
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _leaves(item, f"{path} · {key}" if path else str(key))
    else:
        yield path, ", ".join(map(shown, value)) if isinstance(value, list) else shown(value)


def _comparison(found: object) -> dict[str, Any]:
    """A comparison of solvers as far as it has the form of one: its rows, and what could not be compared."""
    known = found if isinstance(found, Mapping) else {}
    rows = [row for row in known.get("rows") or [] if isinstance(row, Mapping)]
    columns = list(dict.fromkeys(str(key) for row in rows for key in row))
    solvers = known.get("solvers")
    return {
        "passed": known.get("passed") is True,
        "solvers": solvers if isinstance(solvers, Mapping) else {},
        "missing": known.get("missing") or [],
        "columns": columns,
        "rows": [[row.get(column) for column in columns] for row in rows],
    }
