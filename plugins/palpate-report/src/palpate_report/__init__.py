"""The page of a run, its tables and figures."""

from typing import TYPE_CHECKING

from palpate.api import hookimpl

if TYPE_CHECKING:
    from palpate.api import Stage
    from palpate.api.cli import Command
    from palpate.api.report import Section


@hookimpl
def palpate_stages() -> "list[type[Stage]]":
    """Provide the last stage of each run."""
    from palpate_report.stage import ReportStage

    return [ReportStage]


@hookimpl
def palpate_sections() -> "list[type[Section]]":
    """Provide the page of a run."""
    from palpate_report.sections import SECTIONS

    return list(SECTIONS)


@hookimpl
def palpate_commands() -> "list[Command]":
    """``palpate report`` and ``palpate compare``."""
    from palpate.api.cli import RUN, STAGES, Command, examples
    from palpate_report.commands import compare, report

    home = "palpate_report.stage"
    return [
        Command(
            function=report,
            panel=STAGES,
            output=f"{home}:ReportOutput",
            epilog=examples("palpate report runs/arm --open"),
        ),
        Command(
            function=compare,
            panel=RUN,
            output=f"{home}:CompareOutput",
            epilog=examples("palpate compare runs/ogden runs/yeoh"),
        ),
    ]
