"""The comparison of a reproduction with the paper, as files."""

import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from palpate.api.runs import RunResult
from palpate_report.api import markdown
from papers_study.paper_tables import SETS_KEPT, side_by_side
from papers_study.reproduction import ReproductionResult

TITLES = {
    "sets": "Sets and simulations",
    "table1": "Table 1: coefficients",
    "table2": "Table 2: Fopt",
    "generalised": "One set for all spots",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """The figures of the paper next to the figures of a reproduction.

    Parameters
    ----------
    tables : mapping of name to DataFrame
        As :func:`papers_study.paper_tables.side_by_side` returns them.
    errata : tuple of mapping
        As :func:`errata` returns them.
    not_shared : tuple of str
        What a reproduction cannot have in common with the paper.
    failed : mapping of material name to str
        Materials without a row, and why.
    """

    tables: Mapping[str, pl.DataFrame]
    errata: tuple[Mapping[str, str], ...]
    not_shared: tuple[str, ...]
    failed: Mapping[str, str]

    def as_dict(self) -> dict[str, Any]:
        """Everything in plain values, for a script."""
        return asdict(self) | {"tables": {name: frame.to_dicts() for name, frame in self.tables.items()}}


def compare(outcome: ReproductionResult) -> Comparison:
    """Compare the figures of the paper with the runs, by material name."""
    results = outcome.results
    return Comparison(
        tables=side_by_side(results),
        errata=tuple(errata(results)),
        not_shared=tuple(_printed()["not_shared"]),
        failed=outcome.failed,
    )


def write(comparison: Comparison, results: Mapping[str, RunResult], folder: Path) -> Path:
    """Write ``tables/*.csv`` and ``comparison.md``, and return the latter's path."""
    (folder / "tables").mkdir(parents=True, exist_ok=True)
    for name, frame in comparison.tables.items():
        frame.write_csv(folder / "tables" / f"{name}.csv")
    file = folder / "comparison.md"
    file.write_text(_markdown(comparison, results, folder), encoding="utf-8")
    return file


def _markdown(comparison: Comparison, results: Mapping[str, RunResult], folder: Path) -> str:
    pages = [
        f"- [{name}]({page.relative_to(folder).as_posix()})"
        for name, result in results.items()
        for page in result.report.files
        if page.suffix == ".html"
    ]
    parts = [
        "# The paper's study, repeated",
        "**The curves are simulated.** Differences from the paper by construction:",
        "\n".join(f"- {line}" for line in comparison.not_shared),
        "Compare the pattern of the rows: the spots are not the paper's points.",
        *(f"**Nothing of {name}:** {why}" for name, why in comparison.failed.items()),
        *(f"## {markdown(TITLES[name], frame)}" for name, frame in comparison.tables.items()),
        f"## {markdown('Inconsistencies in the paper', pl.DataFrame(comparison.errata))}",
        "## Reports",
        "\n".join(pages),
    ]
    return "\n\n".join(parts) + "\n"


# ------------------------------------------------------------------------ errata


def errata(results: Mapping[str, RunResult]) -> list[dict[str, str]]:
    """Rows of what does not fit in the paper: where, what is printed, what was found, what is done here."""
    printed = _printed()
    in_runs = (_kept_sets(results), _normaliser(results))
    return [*printed["statements"], *in_runs, *printed["contact"], _law(results)]


def _printed() -> dict[str, Any]:
    text = (files("papers_study") / "printed" / "errata.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def _kept_sets(results: Mapping[str, RunResult]) -> dict[str, str]:
    kept = [
        f"{result.design.n_sets} of {result.design.n_drawn} {name}"
        for name, result in results.items()
        if SETS_KEPT[name] < 250
    ]
    return {
        "where": "Drucker's criterion",
        "paper": "leaves 140 of 250 Yeoh sets; the strains and loads are not given",
        "found": "over 20 draws of 250 the printed formula leaves 149 ± 5, FEBio 4's stress 171 ± 4 "
        "(uniaxial, equibiaxial and planar, stretch 0.3 to 3)",
        "here": f"kept: {', '.join(kept)}" if kept else "Yeoh was not run",
    }


def _normaliser(results: Mapping[str, RunResult]) -> dict[str, str]:
    found = "an error of 10 % of a symmetric twist would score far more than one of 10 % of the force"
    if results:
        measured = next(iter(results.values())).measured
        factors = {
            spot: float(np.mean(np.abs(y)) / np.abs(np.mean(y))) ** 2
            for spot, y in ((s, r["torque"].ordinate) for s, r in measured.items())
        }
        found = (
            "the mean of a symmetric twist's torque is nearly zero: divided by it the torque NMSE here would "
            f"be {min(factors.values()):.3g} to {max(factors.values()):.3g} times as large"
        )
    return {
        "where": "NMSE",
        "paper": "divided by the squared mean of the measured values",
        "found": f"{found}; the errors of table 2 are not of that size",
        "here": "divided by the squared mean of |measured| (mean_abs)",
    }


def _law(results: Mapping[str, RunResult]) -> dict[str, str]:
    # A spot at which a scenario found nothing has a null, and is passed over.
    too_little = pl.col("I") < pl.col("II") + pl.col("III")
    broken = [
        f"{name} {spot}"
        for name, result in results.items()
        for spot in result.report.tables["table2_nmse"].filter(too_little)["spot"]
    ]
    return {
        "where": "a check that table 2 passes",
        "paper": "I is at least II and III together in 12 of 12 rows",
        "found": "it has to be: II and III minimise one channel each, I both at once",
        "here": "holds in every row" if not broken else f"BROKEN for {', '.join(broken)}",
    }
