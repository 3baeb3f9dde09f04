"""The report as a stage: the last of each run, and what the terminal and JSON say of it."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import polars as pl

from palpate.api import Channel, Progress, Response, Run, Stage, StudyError, Summary
from palpate.api.cli import Closed, IntervalOutput, Row
from palpate.api.fit import ALL_SPOTS, Case, mark_of
from palpate.api.report import rounded_rows, shown
from palpate.api.runs import Files, Study, described
from palpate_report.answer.result import Report, equation
from palpate_report.data.display_units import in_display_units
from palpate_report.data.marks import in_words
from palpate_report.from_run import report_data, show_so_far, written
from palpate_report.settings import ReportSettings

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class ReportOutput(Closed):
    """Files that were written, what they amount to, and warnings, the most severe first."""

    conclusion: list[str]
    intervals: list[IntervalOutput]
    warnings: list[str]
    next: str
    files: list[str]


class CompareOutput(Closed):
    """Tables ``parameters``, ``errors`` and, for runs of the same curves, ``criteria``."""

    tables: dict[str, list[Row]]
    notes: list[str]
    files: list[str]


class ReportStage(Stage[ReportSettings]):
    """The page of a run, its tables and figures."""

    name, summary = "report", "Lay the results out as tables and figures under report/."
    needs = ("select",)
    may_fail = False
    of_every_run = True
    comes_last = True

    def check(self, study: Study) -> None:
        """Refuse scenarios that the study does not have."""
        known = [scenario.name for scenario in study.scenarios]
        if unknown := [name for name in self.settings.scenarios if name not in known]:
            raise StudyError(
                f"[stages.report] scenarios: the study has no scenario '{unknown[0]}'; choose of "
                f"{', '.join(known)}"
            )

    def run(self, inputs: Run, progress: Progress) -> Files:
        """Write the report; its tables are no tables of the run."""
        inputs.shared[self.name] = written(inputs, progress)
        return {}

    def show_so_far(self, inputs: Run, first: Case | None = None) -> None:
        """Write the page of what was found so far, and report the values of a first answer."""
        report = inputs.shared[self.name] = show_so_far(inputs)
        if first is not None:
            values = ", ".join(map(equation, report.conclusion.estimates))
            said = f"{values}; the whole run may change it" if values else report.conclusion.headline
            inputs.progress.note(f"first answer: {said}")

    def summarise(self, inputs: Run) -> Summary:
        """Summary of the report that was just written."""
        report = inputs.shared.get(self.name)
        return summary_of(inputs.study, report) if report else Summary()

    def draw_curves(self, run: Run) -> "Figure":
        """Figure of the measured and the fitted curves of each spot, for a notebook."""
        from palpate_report.figures import drawings

        return drawings.for_notebook(in_display_units(report_data(run)))

    def draw_presses(
        self,
        spot: str,
        presses: Mapping[str, Response],
        mean: Response,
        channels: Mapping[str, Channel],
        notice: str,
        folder: Path,
    ) -> tuple[Path, ...]:
        """Draw what was measured at a spot, as in :class:`palpate.plugins.optional.PressDrawer`."""
        from palpate_report.figures import drawings

        return drawings.draw_presses(spot, presses, mean, channels, notice, folder)

    def draw_experiment(
        self,
        study: str,
        presses: Mapping[str, Mapping[str, Response]],
        pictures: Mapping[str, Path],
        channels: Mapping[str, Channel],
        notice: str,
        page: Path,
    ) -> None:
        """Write the page of all curves, as in :class:`palpate.plugins.optional.ExperimentDrawer`."""
        from palpate_report.page.measured import write_measured_page

        write_measured_page(study, presses, pictures, channels, notice, page)


def summary_of(study: Study, report: Report) -> Summary:
    """Conclusion, parameters, warnings and page of a report, with its tables."""
    conclusion = report.conclusion
    pages = [page for page in report.files if page.suffix == ".html"]
    of_each = ("parameter", "unit", "value", "lower", "upper", "identifiability", "verdict", "level")
    return Summary(
        tables={
            in_words(name): _side_by_side(name, frame)
            for name, frame in report.tables.items()
            if frame.height
        },
        labelled={
            **conclusion.lines(study),
            "Time": conclusion.spent,
            "Page": " ".join(page.resolve().as_uri() for page in pages),
        },
        values={
            "conclusion": conclusion.sentences,
            "model": {"verdict": conclusion.model.verdict.value, "sentence": conclusion.model.sentence},
            "intervals": [{name: getattr(each, name) for name in of_each} for each in conclusion.estimates],
            "warnings": list(map(str, conclusion.warnings)),
            "next": conclusion.next_step,
            "files": report.files,
            "tables": {name: frame.to_dicts() for name, frame in report.tables.items()},
        },
        missing=f"no set could be selected at {described(conclusion.without_result)}"
        if conclusion.without_result
        else "",
    )


def _side_by_side(name: str, frame: pl.DataFrame) -> pl.DataFrame:
    """One row per spot and scenario, with a column per parameter, as the paper prints them."""
    if name.startswith("table1_"):
        heads = pl.format("{}.{} [{}]", "region", "parameter", "unit")
        texts = [f"{shown(row['value'])}{mark_of(row['verdict'])}" for row in frame.iter_rows(named=True)]
        index = ["spot", "scenario"]
        return frame.with_columns(head=heads, text=pl.Series(texts)).pivot("head", index=index, values="text")
    if name == "distance_to_truth":
        heads = pl.format("{} [%]", "parameter")
        index = ["search", "spot", "scenario"]
        return frame.with_columns(head=heads).pivot("head", index=index, values="difference_percent")
    if name == "fit":
        return frame.select(pl.col("^(fit|scenario|spot|fopt|n_runs|n_fine|at_bound|message|verdict)$"))
    if name == "identifiability":
        return frame.pivot("parameter", index=["spot", "scenario"], values="verdict")
    if name == "intervals":
        return _intervals(frame)
    if name in ("budget", "parameter_combinations") and ALL_SPOTS in frame["fit"]:
        frame = frame.filter(fit=ALL_SPOTS)
    if name == "budget":
        percent = frame.with_columns((pl.col("share") * 100.0).round(0), cause=pl.col("cause") + " [%]")
        return percent.pivot("cause", index=["fit", "scenario", "parameter"], values="share")
    return frame


def _intervals(frame: pl.DataFrame) -> pl.DataFrame:
    """One row per fit and scenario: value, interval and word of each parameter."""
    rows = [
        {
            "fit": row["fit"],
            "scenario": row["scenario"],
            "parameter": f"{row['parameter']} [{row['unit']}]",
            "text": f"{value} ({lower} to {upper}) {row['verdict']}",
        }
        for row, (value, lower, upper) in zip(
            frame.iter_rows(named=True), rounded_rows(frame.select("value", "lower", "upper")), strict=True
        )
    ]
    return pl.from_dicts(rows).pivot("parameter", index=["fit", "scenario"], values="text")
