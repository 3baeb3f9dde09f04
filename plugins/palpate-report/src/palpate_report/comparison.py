"""Several runs side by side: materials of one limb, or limbs of one material."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from palpate.api import FORCE, FloatArray, Indentation, ParameterName
from palpate.api.files import write_atomically
from palpate.api.fit import OTHER_RATE, channel_of, explained, mark_of
from palpate.api.report import Block, Lines, Paragraph, Picture, Table, Word
from palpate.api.runs import keep_only
from palpate_report.answer.curves import for_all_spots, residuals, same_curves
from palpate_report.answer.model_verdict import UNREADABLE, model_verdict
from palpate_report.answer.paper_tables import materials_of, paper_tables
from palpate_report.data.best import weighted_channels
from palpate_report.data.display_units import in_display_units
from palpate_report.data.marks import Headline, with_unit
from palpate_report.data.report_data import ReportData
from palpate_report.data.table_files import write_tables
from palpate_report.data.tables import EXACT, TITLES

MEANINGS = ((2.0, "as good as the best"), (7.0, "less support"), (np.inf, "hardly any support"))
"""What a difference of AICc up to each limit means (Burnham & Anderson, Model Selection, 2002, ch. 2.6)."""

CLOSE = MEANINGS[0][0]
"""Difference of a criterion up to which runs are as good as each other."""

FEWEST_POINTS = 5
"""Independent points of each parameter below which AICc decides nothing."""

TOO_FEW = "too few independent points"

CRITERIA = (
    "AICc and BIC weigh how well the curves are described against the number of parameters; less is better, "
    "and only differences mean anything. A weight is the probability that a model is the best of these. "
    "Neighbouring points of a curve are counted as far as the residuals of the best run are independent. "
    "A model with the least criterion need not be a good one: look at R² and the curves."
)
"""What the criteria are, for readers."""


def named(runs: Mapping[Path, ReportData]) -> dict[str, ReportData]:
    """Runs under the names of their materials, or of their folders where these are the same."""
    for name in (lambda _, data: materials_of(data), lambda path, _: path.name, lambda path, _: str(path)):
        found = {name(path, data): in_display_units(data) for path, data in runs.items()}
        if len(found) == len(runs):
            return found
    return found


def comparison_tables(runs: Mapping[str, ReportData]) -> dict[str, pl.DataFrame]:
    """Tables ``parameters``, ``errors`` and, for runs of the same curves, ``criteria``."""
    of_other_rates, _ = other_rates(runs)
    tables = {
        "parameters": [
            row
            for name, data in runs.items()
            for row in _parameters(name, data, OTHER_RATE if name in of_other_rates else "")
        ],
        "errors": [_errors(name, data) for name, data in runs.items()],
        "criteria": _criteria(runs) if same_curves(runs) else [],
    }
    return {name: pl.DataFrame(rows, infer_schema_length=None) for name, rows in tables.items() if rows}


def press_durations_s(data: ReportData) -> list[float]:
    """Durations of the presses of a run up to their deepest; none where neither motion nor log has any."""
    found = []
    for spot in data.spots:
        motion, curve = data.study.protocol_at(spot), data.measured[spot].curves.get(FORCE.name)
        if isinstance(motion, Indentation) and motion.time_s is not None:
            found.append(motion.press_s)
        elif curve is not None and curve.time_s is not None:
            found.append(float(curve.time_s[curve.abscissa.argmax()] - curve.time_s[0]))
    return [seconds for seconds in found if seconds > 0.0]


def other_rates(runs: Mapping[str, ReportData]) -> tuple[frozenset[str], str]:
    """Runs whose moduli are not comparable since their rates differ, and a sentence on it; else nothing.

    A model without time has apparent moduli of the rate of its presses; one that relaxes has those at once.
    """
    at_once = [name for name, data in runs.items() if data.study.relaxes]
    apparent = {n: s for n, data in runs.items() if n not in at_once and (s := press_durations_s(data))}
    ends = [(min(seconds), max(seconds)) for seconds in apparent.values()]
    # Ratio of the durations of presses from which on apparent moduli are not compared.
    differ = any(max(of) > 3.0 * min(of) for of in zip(*ends, strict=True))  # fastest, and slowest
    if not apparent or not (differ or at_once):
        return frozenset(), ""
    texts = [
        f"{name} pressed in {least:.3g}{f' to {most:.3g}' if most > least else ''} s"
        for name, (least, most) in zip(apparent, ends, strict=True)
    ]
    texts += [f"{name} relaxes, with moduli at once" for name in at_once]
    return frozenset((*apparent, *at_once)), (
        f"The moduli are not comparable: {'; '.join(texts)}. A model without time finds apparent moduli of "
        "its rate. Compare runs of one rate, or fit the relaxation in all."
    )


def _leading(data: ReportData) -> dict[str, Any]:
    """Row of the fit of all spots, or of the only one; without a fit of the set for all; or nothing."""
    if data.is_fitted:
        return data.leading_rows(data.fit.ends).row(0, named=True)
    if len(data.spots) > 1:
        rows = data.generalisation.with_columns(fopt=pl.col("fopt_mean"))
    else:
        rows = data.selection.filter(scenario=data.generalising.name)
    return next(rows.head(1).iter_rows(named=True), {})


def _parameters(run: str, data: ReportData, of_moduli: str = "") -> Iterator[dict[str, Any]]:
    """Rows of a run, with a word on its moduli that joins their verdicts."""
    kinds = {name: parameter.kind for name, parameter in data.searched.items()}
    for each in (*data.estimates, *data.moduli):
        lower, upper = (each.lower, each.upper) if each.level else (None, None)
        is_modulus = kinds.get(ParameterName.parse(each.name).shared, "modulus") == "modulus"
        words = (each.verdict, of_moduli if is_modulus else "")
        yield {"run": run, "parameter": each.parameter, "value": each.value, "lower": lower, "upper": upper,
               "unit": each.unit, "verdict": ", ".join(filter(None, words))}  # fmt: skip


def _errors(run: str, data: ReportData) -> dict[str, Any]:
    found = _leading(data)
    return {
        "run": run,
        "fitted_to": weighted_channels(data.generalising),
        "spots": len(data.spots),
        "fopt": found.get("fopt"),
        **{f"nmse_{name}": found.get(f"nmse_{name}") for name in data.measured_channels},
        **{f"r2_{name}": found.get(f"r2_{name}") for name in data.measured_channels},
    }


# ---------------------------------------------------------- information criteria


def _criteria(runs: Mapping[str, ReportData]) -> list[dict[str, Any]]:
    """AICc and BIC of each run, with errors of a size to be estimated in each channel."""
    left = {run: _residuals(data) for run, data in runs.items()}
    if not all(left.values()):
        return []
    best = min(left.values(), key=lambda each: sum(map(_mean_square, each.values())))
    n = {name: _independent(parts) for name, parts in best.items()}
    total, rows = sum(n.values()), []
    for run, data in runs.items():
        fitted = data.study.parametrisation.parameters(data.study.space, data.spots)
        k = len(fitted if data.is_fitted else data.design.parameters) + len(n)
        fit = sum(n[name] * np.log(max(_mean_square(parts), EXACT)) for name, parts in left[run].items())
        aicc = fit + 2.0 * k + 2.0 * k * (k + 1.0) / (total - k - 1.0) if total > k + 1.0 else None
        rows.append({"run": run, "n_parameters": k - len(n), "n_independent_points": round(total, 1),
                     "aicc": aicc, "bic": fit + k * np.log(total)})  # fmt: skip
    if any(row["aicc"] is None for row in rows):
        return []
    enough = [row for row in rows if total >= FEWEST_POINTS * row["n_parameters"]]
    least, least_bic = (min(row[name] for row in enough or rows) for name in ("aicc", "bic"))
    odds = {row["run"]: np.exp((least - row["aicc"]) / 2.0) for row in enough}
    for row in rows:
        row["difference"] = row["aicc"] - least
        row["difference_bic"] = row["bic"] - least_bic
        row["weight"], row["meaning"] = None, TOO_FEW
        if row in enough:
            row["weight"] = odds[row["run"]] / sum(odds.values())
            row["meaning"] = next(text for most, text in MEANINGS if row["difference"] <= most)
    return sorted(rows, key=lambda row: row["difference"])


def _notes(tables: Mapping[str, pl.DataFrame], runs: Mapping[str, ReportData], laws: bool) -> Iterator[str]:
    """Notes that a reader of the tables must know: refused runs first, or laws without a reason for each."""
    models = {name: model_verdict(data) for name, data in runs.items()}
    refused = [name for name, model in models.items() if model.failure]
    if noticed := [name for name, data in runs.items() if data.notice]:
        yield f"{', '.join(noticed)}: {runs[noticed[0]].notice}."
    is_short = laws and len(refused) < len(models)
    yield from (
        f"{n}: {m.sentence}" for n, m in models.items() if m.sentence and not (m.failure and is_short)
    )
    if refused and is_short:
        yield f"{UNREADABLE} from laws that do not describe the curves: {', '.join(refused)}."
    if sentence := other_rates(runs)[1]:
        yield sentence
    if sentence := explained(map(mark_of, tables["parameters"]["verdict"])):
        yield sentence
    yield CRITERIA if "criteria" in tables else f"AICc and BIC are left out: {_no_criteria(runs)}."
    if "criteria" in tables:
        few = tables["criteria"].filter(meaning=TOO_FEW)["run"].to_list()
        table = tables["criteria"].filter(pl.col("meaning") != TOO_FEW)
        if few:
            of = "here" if table.is_empty() else f"on {', '.join(few)}"
            yield (
                f"The criteria decide nothing {of}: there are fewer than {FEWEST_POINTS} independent points "
                "for a parameter, and the term for few points outweighs the misfit."
            )
        table = tables["criteria"] if table.is_empty() else table
        by_aicc, by_bic = (table.sort(name, maintain_order=True)["run"][0] for name in ("aicc", "bic"))
        far = table.filter((pl.col("difference") > CLOSE) != (pl.col("difference_bic") > CLOSE))["run"]
        if by_aicc != by_bic or not far.is_empty():
            of = f" on {', '.join(far)}" if by_aicc == by_bic else f": {by_aicc} by AICc, {by_bic} by BIC"
            yield f"AICc and BIC disagree{of}. Read neither as a choice."


def _no_criteria(runs: Mapping[str, ReportData]) -> str:
    """Reason why there are no information criteria."""
    if not same_curves(runs):
        return "the runs were fitted to different curves or channels"
    missing = [run for run, data in runs.items() if not _residuals(data)]
    if missing:
        return f"there are no simulated curves of {', '.join(missing)}"
    return "the curves have too few independent points for so many parameters"


def _residuals(data: ReportData) -> dict[str, list[FloatArray]]:
    """Residuals over the rms ordinate of each fitted channel by spot; empty where there is no result.

    Of the least Fopt: a criterion is of the largest likelihood.
    """
    data = data.without_assessment()
    found: dict[str, list[FloatArray]] = {}
    channels = dict.fromkeys(map(channel_of, data.generalising.weighed))
    for spot in data.spots:
        _, simulated = for_all_spots(data, spot)
        for name, curve in data.measured[spot].curves.items():
            if name in channels and name in simulated:
                size = float(np.sqrt(np.mean(curve.ordinate**2)))
                found.setdefault(name, []).append(residuals(curve, simulated[name]) / size)
    return found


def _mean_square(parts: list[FloatArray]) -> float:
    return float(np.nanmean(np.concatenate(parts) ** 2))


def _independent(parts: list[FloatArray]) -> float:
    """Number of independent points on curves with these residuals, by the correlation of neighbours."""
    finite = [part[np.isfinite(part)] for part in parts]
    squares = sum(float(part @ part) for part in finite)
    together = sum(float(part[1:] @ part[:-1]) for part in finite)
    correlation = min(max(together / squares, 0.0), 0.99) if squares else 0.0
    return sum(part.size for part in finite) * (1.0 - correlation) / (1.0 + correlation)


# ------------------------------------------------------------------------- files


def _by_parameter(table: pl.DataFrame) -> Table:
    """Values, intervals and verdicts of the runs side by side; runs of few common parameters row by row."""
    cells: dict[tuple[str, str], Lines] = {}
    for row in table.iter_rows(named=True):
        run, verdict = row.pop("run"), row.pop("verdict")
        value = Headline(**row)
        texts = filter(None, (with_unit(value.text, value.unit), value.interval))
        cells[value.parameter, run] = Lines([*texts, *([Word(verdict)] if verdict else ())])
    names, runs = table["parameter"].unique(maintain_order=True), table["run"].unique(maintain_order=True)
    if 2 * len(cells) < len(names) * len(runs):
        return Table.of(TITLES["parameters"], table)
    rows = [[name, *(cells.get((name, run)) for run in runs)] for name in names]
    return Table(TITLES["parameters"], ["parameter", *runs], rows)


def write_comparison(
    runs: Mapping[str, ReportData],
    folder: Path,
    first: Mapping[str, pl.DataFrame] | None = None,
    conclusion: str = "",
) -> dict[str, Any]:
    """Write ``tables/``, ``figures/`` and ``index.html``; return tables, notes and files.

    Laws that were fitted for the comparison have tables that come ``first`` and a conclusion.
    """
    from palpate_report.figures.drawings import write_comparison_figures
    from palpate_report.page.html import comparison_page

    tables = dict(first or {}) | comparison_tables(runs)
    notes = [*filter(None, [conclusion]), *_notes(tables, runs, bool(conclusion))]
    failures = [note for note in notes if UNREADABLE in note]
    figures = write_comparison_figures(runs, folder / "figures")
    files = (*write_tables(tables, folder / "tables", paper_tables(runs), failures), *figures)
    named, drawn = ", ".join(runs), [file for file in figures if file.suffix == ".svg"]
    page, links = folder / "index.html", [file.relative_to(folder) for file in files]
    blocks: tuple[Block, ...] = (
        *map(Paragraph, notes),
        *(
            _by_parameter(table) if name == "parameters" else Table.of(TITLES.get(name, name), table)
            for name, table in tables.items()
        ),
        *(Picture(label=f"{f.stem.capitalize()} of {named}", content=f.read_bytes()) for f in drawn),
    )
    write_atomically(page, comparison_page(f"Comparison of {named}", blocks, links).encode())
    keep_only(folder, (*files, page))
    return {"tables": tables, "notes": notes, "files": (*files, page)}
