"""The comparison of a reproduction with the paper, as files."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import polars as pl

from palpate.api.runs import RunResult
from palpate_forearm.errata import NOT_SHARED, Erratum, errata
from palpate_forearm.paper_tables import side_by_side
from palpate_forearm.reproduction import ReproductionResult
from palpate_report.table_files import markdown

TITLES = {
    "sets": "Sets and simulations",
    "table1": "Table 1: coefficients",
    "table2": "Table 2: Fopt",
    "generalised": "One set for all spots",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """The paper's figures next to those of a reproduction.

    Parameters
    ----------
    tables : mapping of name to DataFrame
        As :func:`palpate_forearm.paper_tables.side_by_side` returns them.
    failed : mapping of material name to str
        Materials without a row, and why.
    """

    tables: Mapping[str, pl.DataFrame]
    errata: tuple[Erratum, ...]
    failed: Mapping[str, str]
    not_shared: tuple[str, ...] = NOT_SHARED

    def as_dict(self) -> dict[str, Any]:
        """Everything in plain values, for a script."""
        return {
            "tables": {name: frame.to_dicts() for name, frame in self.tables.items()},
            "errata": [asdict(erratum) for erratum in self.errata],
            "failed": dict(self.failed),
            "not_shared": list(self.not_shared),
        }


def compare(outcome: ReproductionResult) -> Comparison:
    """Compare the paper's figures with those of the runs, by material name."""
    results = outcome.results
    return Comparison(tables=side_by_side(results), errata=tuple(errata(results)), failed=outcome.failed)


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
    errata_table = pl.DataFrame([asdict(erratum) for erratum in comparison.errata])
    parts = [
        "# The paper's study, repeated",
        "**The curves are simulated.** What this cannot have in common with the paper:",
        "\n".join(f"- {line}" for line in comparison.not_shared),
        "Compare the pattern of the rows: the spots are not the paper's points.",
        *(f"**Nothing of {name}:** {why}" for name, why in comparison.failed.items()),
        *(f"## {markdown(TITLES[name], frame)}" for name, frame in comparison.tables.items()),
        f"## {markdown('What in the paper does not fit', errata_table)}",
        "## Reports",
        "\n".join(pages),
    ]
    return "\n\n".join(parts) + "\n"
