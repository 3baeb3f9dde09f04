"""What ``palpate report`` and ``palpate compare`` print with ``--json``."""

from palpate.api.cli import Closed, IntervalOutput, Row


class ReportOutput(Closed):
    """Files that were written, what they amount to, and warnings, the most severe first."""

    verdict: list[str]
    intervals: list[IntervalOutput]
    warnings: list[str]
    files: list[str]


class CompareOutput(Closed):
    """Tables ``parameters``, ``errors`` and, for runs of the same curves, ``criteria``."""

    tables: dict[str, list[Row]]
    notes: list[str]
    files: list[str]
