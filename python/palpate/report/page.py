"""One page with every table and figure, readable from the folder without a network."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2
import polars as pl

from palpate.report.content import Content
from palpate.results import write_atomically

_TEMPLATE = """\
<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{{ study.name }} · palpate</title>
<style>
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 72rem; padding: 0 1rem; color: #222 }
h1 { margin-bottom: 0 } h2 { margin-top: 2.5rem; border-bottom: 1px solid #ddd }
.notice { background: #fff3cd; border-left: 4px solid #e69f00; padding: .5rem 1rem }
.wide { overflow-x: auto }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 13px }
th, td { padding: .2rem .6rem; text-align: right; border-bottom: 1px solid #eee; white-space: nowrap }
th { border-bottom: 2px solid #999 } .text { text-align: left }
img { max-width: 100%; height: auto }
figure { margin: 1.5rem 0 } figcaption { color: #666; font-size: 13px }
</style>
<h1>{{ study.name }}</h1>
<p>{{ study.description }}</p>
{% if notice %}<p class="notice">These are {{ notice }}.</p>{% endif %}
<p>{{ n_sets }} sets at {{ n_spots }} {{ "spot" if n_spots == 1 else "spots" }}; solver {{ solver }};
NMSE with normaliser {{ normaliser }}. What every number depended on: <a href="../manifest.json">manifest.json</a>.</p>
{% for table in tables %}
<h2 id="{{ table.name }}">{{ table.title }}</h2>
<div class="wide"><table>
<tr>{% for column in table.columns %}<th>{{ column }}</th>{% endfor %}</tr>
{% for row in table.rows %}<tr>{% for cell in row %}<td{% if cell.text %} class="text"{% endif %}>{{ cell.shown }}\
</td>{% endfor %}</tr>
{% endfor %}</table></div>
<p><a href="tables/{{ table.name | urlencode }}.csv">{{ table.name }}.csv</a></p>
{% endfor %}
<h2>Figures</h2>
{% for figure in figures %}
<figure><img src="figures/{{ figure | urlencode }}.svg" alt="{{ figure }}">
<figcaption>{{ figure }}: <a href="figures/{{ figure | urlencode }}.svg">SVG</a>,
<a href="figures/{{ figure | urlencode }}.png">PNG</a></figcaption></figure>
{% endfor %}
</html>
"""

_TITLES = {
    "table1_coefficients": "Table 1: coefficients by spot and scenario",
    "table2_nmse": "Table 2: NMSE by spot and scenario",
    "cross_channel": "Error in every channel, fitted or not",
    "generalised": "One set for all spots",
    "refined": "Local search from the selected sets",
    "distance_to_truth": "Distance to the known answer",
    "failures": "Sets that could not be ranked",
}


def write_page(
    content: Content, tables: Mapping[str, pl.DataFrame], figures: Sequence[Path], folder: Path
) -> Path:
    """Write ``index.html`` beside the tables and figures."""
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    text = environment.from_string(_TEMPLATE).render(
        study=content.study,
        notice=content.notice,
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
