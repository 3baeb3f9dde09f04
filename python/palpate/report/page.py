"""One page with every table and figure, readable from the folder without a network."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2
import polars as pl

from palpate.report.content import Content
from palpate.report.tables import finding
from palpate.results import write_atomically

_TITLES = {
    "table1_coefficients": "Table 1: coefficients by spot and scenario",
    "table2_nmse": "Table 2: NMSE by spot and scenario",
    "unfitted_channels": "What a fit says about channels that it has not seen",
    "cross_channel": "Error in every channel, fitted or not",
    "generalised": "One set for all spots",
    "refined": "Local search from the selected sets",
    "rays": "Best multiple of a set, all moduli scaled together",
    "distance_to_truth": "Distance to the known answer",
    "failures": "Sets that could not be ranked",
}


def write_page(
    content: Content, tables: Mapping[str, pl.DataFrame], figures: Sequence[Path], folder: Path
) -> Path:
    """Write ``index.html`` beside the tables and figures."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
    )
    text = environment.get_template("index.html.jinja").render(
        study=content.study,
        notice=content.notice,
        finding=finding(tables),
        n_sets=content.design.n_sets,
        n_spots=len(content.spots),
        solver=f"{content.study.solver.name} {content.study.solver.version()}",
        normaliser=content.study.normaliser.value,
        tables=[_table(name, frame) for name, frame in tables.items()],
        figures=[path.stem for path in figures if path.suffix == ".svg"],
    )
    path = folder / "index.html"
    write_atomically(path, text.encode())
    return path


def _table(name: str, frame: pl.DataFrame) -> dict[str, Any]:
    rows = [[_cell(value) for value in row] for row in frame.iter_rows()]
    return {"name": name, "title": _TITLES.get(name, name), "columns": frame.columns, "rows": rows}


def _cell(value: object) -> dict[str, object]:
    if value is None:
        return {"shown": "–", "text": False}
    if isinstance(value, float):
        return {"shown": f"{value:.5g}", "text": False}
    return {"shown": str(value), "text": isinstance(value, str)}
