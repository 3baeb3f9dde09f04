"""One page that holds a whole run, and asks no network for anything."""

import base64
import hashlib
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import polars as pl
from markupsafe import Markup

from palpate.domain import Parameter
from palpate.report.best_sets import with_brief_names
from palpate.report.page_data import page_data
from palpate.report.report_data import ReportData
from palpate.report.table_files import shown
from palpate.report.tables import TITLES
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
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_FOLDER),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    environment.filters["shown"] = shown
    script, library = _own("page.js"), _library()
    return environment.get_template("index.html.jinja").render(
        study=data.study,
        notice=data.notice,
        solver=f"{data.study.solver.name} {data.study.solver.version()}",
        n_sets=data.design.n_sets,
        incomplete="" if data.completeness.is_complete else str(data.completeness),
        verdict=verdict,
        tables={name: _table(name, frame) for name, frame in tables.items()},
        convergence=_table("convergence", data.convergence),
        intervals=list(_intervals(data)),
        data=page_data(data),
        generalising=data.generalising.name,
        generalises="generalised" in tables and len(data.spots) > 1,
        provenance=list(_provenance(data.manifest)),
        comparisons=[_solver_comparison(*item) for item in data.comparisons.items()],
        files=_by_stem(files),
        # These come from palpate's own files and hold no name of anybody's study.
        style=Markup(_own("page.css")),
        script=Markup(script),
        library=base64.b64encode(zlib.compress(library.encode(), 9)).decode(),
        policy=_policy(script, library),
    )


def _own(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")


def _library() -> str:
    """The plotting library's own text, which comes with its package."""
    from plotly.offline import get_plotlyjs

    return str(get_plotlyjs())


def _policy(*scripts: str) -> str:
    """What the page may do: run these scripts, and load nothing from anywhere."""
    hashes = (base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in scripts)
    allowed = " ".join(f"'sha256-{digest}'" for digest in hashes)
    return f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:"


# -------------------------------------------------------------------- parts of it


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table as it is shown: headings and cells are text, and whether it is of numbers."""

    name: str
    title: str
    columns: tuple[tuple[str, bool], ...]
    rows: tuple[tuple[tuple[str, bool], ...], ...]


def _table(name: str, frame: pl.DataFrame) -> Table:
    rows = tuple(tuple((shown(v), not isinstance(v, str)) for v in row) for row in frame.iter_rows())
    columns = tuple(
        (_heading(column), dtype.is_numeric())
        for column, dtype in zip(frame.columns, frame.dtypes, strict=True)
    )
    return Table(name=name, title=TITLES.get(name, name), columns=columns, rows=rows)


def _heading(column: str) -> str:
    """Name of a column for people; that of a parameter is what the study calls it."""
    for begin, said in (("nmse_", "NMSE "), ("r2_", "R² "), ("fopt_", "Fopt ")):
        if column.startswith(begin):
            return said + column.removeprefix(begin)
    labels = {"nmse": "NMSE", "r2": "R²", "fopt": "Fopt", "difference_percent": "difference [%]"}
    seconds = column.endswith("_s") and "." not in column
    plain = column if "." in column else column.removesuffix("_s").replace("_", " ")
    return labels.get(column, f"{plain} [s]" if seconds else plain)


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """One row of the picture of intervals; ``start``, ``width`` and ``at`` are percent of the range."""

    fit: Mapping[str, Any]
    name: str
    most_correlated_with: str
    start: float
    width: float
    at: float
    truth: float | None


def _intervals(data: ReportData) -> Iterator[Interval]:
    brief = {p.name: (p, b.name) for p, b in with_brief_names(data)}
    for row in data.identifiability.iter_rows(named=True):
        parameter, name = brief[row["parameter"]]
        known = row["lower"] is not None
        start, stop = (_percent(parameter, row[end]) if known else 0.0 for end in ("lower", "upper"))
        truth = data.study.truth.get(row["parameter"])
        yield Interval(
            fit=row,
            name=name,
            most_correlated_with=brief[row["most_correlated_with"]][1] if row["most_correlated_with"] else "",
            start=start,
            width=round(stop - start, 2),
            at=_percent(parameter, row["value"]),
            truth=None if truth is None else _percent(parameter, truth),
        )


def _percent(parameter: Parameter, value: float) -> float:
    return round(min(max(100.0 * share_of_range(parameter, value), 0.0), 100.0), 2)


def _provenance(manifest: Mapping[str, Any]) -> Iterator[tuple[str, list[tuple[str, str]]]]:
    """What the numbers depended on: groups of keys and their values, the single ones first."""
    single = [(key, shown(value)) for key, value in manifest.items() if not _is_deep(value)]
    if single:
        yield "study", single
    for key, value in manifest.items():
        if _is_deep(value) and (rows := list(_leaves(value, ""))):
            yield key, rows


def _is_deep(value: object) -> bool:
    return isinstance(value, (Mapping, list))


def _leaves(value: object, path: str) -> Iterator[tuple[str, str]]:
    """Every number and text within, under the keys that lead to it; lists of plain values are one."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _leaves(item, f"{path} · {key}" if path else str(key))
    elif isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
        for i, item in enumerate(value):
            yield from _leaves(item, f"{path} · {i + 1}" if path else str(i + 1))
    else:
        yield path, ", ".join(map(shown, value)) if isinstance(value, list) else shown(value)


def _solver_comparison(name: str, data: Any) -> dict[str, Any]:  # noqa: ANN401 - whatever the file holds
    """Rows of a comparison that have a form, and what could not be compared."""
    known = data if isinstance(data, Mapping) else {}
    rows = [row for row in known.get("rows") or [] if isinstance(row, Mapping)]
    columns = tuple(dict.fromkeys(str(key) for row in rows for key in row))
    return {
        "passed": known.get("passed") is True,
        "solvers": ", ".join(f"{solver} {version}" for solver, version in _items(known.get("solvers"))),
        "missing": [shown(item) for item in known.get("missing") or []],
        "table": Table(
            name=name,
            title=f"Solvers compared: {name}",
            columns=tuple((column.replace("_", " "), False) for column in columns),
            rows=tuple(
                tuple((shown(row.get(c)), not isinstance(row.get(c), str)) for c in columns) for row in rows
            ),
        ),
    }


def _items(value: object) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        yield from ((str(key), shown(item)) for key, item in value.items())


def _by_stem(files: Sequence[Path]) -> list[tuple[str, list[tuple[str, str]]]]:
    """Files of one name together: the name, and kind and place of each."""
    found: dict[str, list[tuple[str, str]]] = {}
    for file in files:
        found.setdefault(file.stem, []).append((file.suffix[1:].upper(), file.as_posix()))
    return list(found.items())
