"""Outputs of a report read back: each row of the answer as spreadsheets, LaTeX and the page have it."""

import csv
import html
import re

import polars as pl
import pytest

from palpate.api.fit import ALL_SPOTS, FIT, MODULI, PARAMETER
from palpate_report.data.best import headlines_of
from palpate_report.data.table_files import escaped


def disagreeing_rows(data, folder):
    """Each output with the place of a value that is other there than in the answer, of all fits and sets."""
    every = [*_in_spreadsheets(data, folder / "tables"), *_in_latex(data, folder), *_on_page(data, folder)]
    assert len(every) >= data.answer.height  # each row was compared
    return [(output, place) for output, place, found, expected in every if found != expected]


def table_of(path):
    """Rows of a table for spreadsheets, with numbers, under heads without units; none without the table."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return [{name.partition(" [")[0]: _number(text) for name, text in row.items()} for row in rows]


def _number(text):
    try:
        return float(text) if text else None
    except ValueError:
        return text


def _in_spreadsheets(data, tables):
    """Values, ends and verdicts of parameters in the tables of intervals and of coefficients."""
    intervals = {(r["fit"], r["scenario"], r["parameter"]): r for r in table_of(tables / "intervals.csv")}
    values = [
        {(r["spot"], r["scenario"], f"{r['region']}.{r['parameter']}"): r for r in table_of(tables / name)}
        for name in ("table1_coefficients.csv", "table1_fit.csv")
    ]
    for row in data.answer.filter(kind=PARAMETER).iter_rows(named=True):
        key, is_fit = (row["spot"], row["scenario"], row["parameter"]), row["source"] == FIT
        if is_fit and row["level"]:
            found, names = intervals.pop(key), ("value", "lower", "upper", "verdict")
            yield "intervals.csv", key, [found[n] for n in names], [row[n] for n in names]
        if is_fit or row["spot"] != ALL_SPOTS:
            found, names = values[is_fit][key], ("value", "verdict")
            yield "table 1", key, [found[n] for n in names], [row[n] for n in names]
        else:  # the set for all spots has a table of its own
            (found,) = table_of(tables / "generalised.csv")
            yield "generalised.csv", key, found[row["parameter"]], row["value"]
    yield "intervals.csv", "rows that the answer lacks", list(intervals), []


def _shown(data):
    """Rows of fits, or of the sets of a sweep without a fit, each with its value as outputs show it."""
    of_fits = pl.col("source") == FIT if data.is_fitted else pl.col("spot") != ALL_SPOTS
    frame = data.answer.filter(of_fits)
    return zip(frame.iter_rows(named=True), headlines_of(frame, data.searched), strict=True)


def _in_latex(data, folder):
    """Values to their printed digits, their intervals and their marks, in the narrow table 1."""
    text = (folder / "tables/paper_table1.tex").read_text(encoding="utf-8")
    lines = [line.removesuffix(r"\\") for line in text.splitlines() if line.endswith(r"\\")]
    heads, cells, spot, scenario = [*(p.name for p in data.searched.values()), MODULI[0]], {}, "", ""
    for row in ([cell.strip() for cell in line.split("&")] for line in lines[2:]):
        spot, scenario = row[0] or spot, row[1] or scenario
        for head, cell in zip(heads, row[2:], strict=False):
            cells.setdefault((spot, scenario, head), []).append(cell)
    for row, value in _shown(data):
        if value.parameter in heads:
            key = (row["spot"], row["scenario"], value.parameter)
            first, *ends = cells[key]
            expected = [row["value"], *((row["lower"], row["upper"]) if row["level"] else ())]
            digits = [float(each) for each in re.findall(r"\$(-?[\d.]+)\$", " ".join([first, *ends]))]
            yield "LaTeX", key, digits, pytest.approx(expected, rel=6e-3)
            yield "marks in LaTeX", key, re.sub(r"\$-?[\d.]+\$", "", first, count=1), escaped(row["marks"])


def _on_page(data, folder):
    """Values, intervals and verdicts in the tables by spot of each scenario."""
    text = html.unescape((folder / "index.html").read_text(encoding="utf-8")).replace("−", "-")
    cells = {}
    for table in re.findall(r"<table>\s*<caption>The fit to .*?</table>", text, re.DOTALL):
        scenario = re.search(r"\(scenario (.+?)\)", table)[1]
        columns = re.findall(r'<th scope="col"[^>]*>(.*?)</th>', table)[1:]
        for head, row in re.findall(r'<tr><th scope="row">(.*?)</th>(.*?)</tr>', table, re.DOTALL):
            for column, cell in zip(columns, re.findall(r"<td[^>]*>(.*?)</td>", row, re.DOTALL), strict=True):
                lines = (re.sub(r"<.*?>", "", line) for line in cell.split("<br>"))
                cells[column, scenario, head] = [each for each in lines if each]
    for row, value in _shown(data):
        key = (row["spot"], row["scenario"], value.label)
        found = [each for each in cells[key] if not each.startswith("optimum")]
        known = [value.text, value.interval, *row["verdict"].split(", ")]
        yield "page", key, found, [each for each in known if each]
