"""Checks that a model has failed, causes that the intervals lack, and apparent moduli."""

from collections.abc import Iterator
from dataclasses import dataclass

import polars as pl

from palpate.api.fit import Adequacy
from palpate.api.runs import relaxation_of
from palpate_report.data.report_data import ReportData

INADEQUATE = {
    "discrepancy": "Look at the residuals, then check depth offset, friction, bias and mesh; else the "
    "material law does not describe the tissue.",
    "specimen": "Look at the residuals: this material law does not describe them within the budget.",
    "ranges": "Widen the ranges, if the material law allows it; else it does not describe the tissue.",
}
"""What to do about a fit whose model does not describe the data, by check."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FailedCheck:
    """A check that the model of a fit has failed; its kind is a key of :data:`INADEQUATE`."""

    fit: str
    scenario: str
    kind: str
    verdict: Adequacy
    message: str

    @property
    def remedy(self) -> str:
        """Sentence on what to do."""
        return INADEQUATE[self.kind]


def failed_checks(data: ReportData) -> Iterator[FailedCheck]:
    """Checks of all fits whose model does not describe the data within the budget."""
    checks = data.fit.adequacy
    # Apparent moduli are still a result; what else fails takes it away.
    failed = (pl.col("verdict") != Adequacy.DESCRIBES.value) & (pl.col("check") != "relaxation")
    for row in checks.filter(failed).iter_rows(named=True):
        kind = row["check"] if row["check"] in INADEQUATE else "discrepancy"
        yield FailedCheck(
            fit=row["fit"],
            scenario=row["scenario"],
            kind="specimen" if kind == "discrepancy" and data.study.protocol is None else kind,
            verdict=Adequacy(row["verdict"]),
            message=row["message"],
        )


def left_out(data: ReportData) -> dict[str, str]:
    """Causes that the intervals of what leads are without, since they could not be simulated, and why."""
    # Tables of earlier runs have no status, and no row without a share.
    rows = data.leading_rows(data.table("budget")).iter_rows(named=True)
    return {row["cause"]: row["status"] for row in rows if row["share"] is None}


def apparent(data: ReportData) -> str:
    """Sentence on moduli that are apparent ones, since the tissue relaxed; empty where they are not."""
    if data.study.models_relaxation(data.generalising):
        return ""
    found = relaxation_of(data.measured, data.study.budget.gain)
    return found.sentence[:1].upper() + found.sentence[1:] if found and found.is_beyond else ""
