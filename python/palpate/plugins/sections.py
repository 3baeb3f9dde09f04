"""Sections of the report's page: what they are made of, and what plugins subclass.

A section is data: paragraphs, tables, figures and pictures, which the page lays out in its type and colours.
It has no markup and no script, so that the page runs nothing but its own and loads nothing.
"""

import math
import sys
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

from palpate.domain.component import Component, SettingsT

if TYPE_CHECKING:
    import polars as pl

Value = str | int | float | bool | None


@dataclass(frozen=True, slots=True)
class Word:
    """A word for identifiability in its colour: well, roughly, poorly, not or unclear."""

    text: str


@dataclass(frozen=True, slots=True)
class Lines:
    """Several values in one cell; those after the first are small."""

    values: Sequence[Value | Word]


Cell = Value | Word | Lines
"""Content of a cell of a table, as :func:`shown` prints it."""


@dataclass(frozen=True, slots=True)
class Paragraph:
    """Text."""

    text: str


@dataclass(frozen=True, slots=True)
class Heading:
    """A heading within a section."""

    text: str


@dataclass(frozen=True, slots=True)
class Listing:
    """Items, each with what is strong in it and what follows."""

    items: Sequence[tuple[str, str]]


@dataclass(frozen=True, slots=True)
class Table:
    """Rows under the names of their columns; the first cell of a row is its name.

    Parameters
    ----------
    strong : collection of int
        Numbers of the rows that are set off.
    numeric : collection of int
        Numbers of the columns whose texts are numbers; a column of mostly numbers needs none.
    """

    caption: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    strong: frozenset[int] = frozenset()
    numeric: frozenset[int] = frozenset()

    @classmethod
    def of(cls, caption: str, frame: "pl.DataFrame") -> "Table":
        """Show a data frame; its columns are named for people: ``nmse_force`` is NMSE force."""
        numeric = frozenset(k for k, dtype in enumerate(frame.dtypes) if dtype.is_numeric())
        heads = [heading(column) for column in frame.columns]
        return cls(caption, heads, rounded_rows(frame), numeric=numeric)

    @property
    def is_number(self) -> tuple[bool, ...]:
        """Whether most of the cells of each column that hold something are numbers."""
        columns = ([row[k] for row in self.rows if row[k] is not None] for k in range(len(self.columns)))
        are_mostly = (2 * sum(map(_is_number, cells)) > len(cells) for cells in columns)
        return tuple(k in self.numeric or mostly for k, mostly in enumerate(are_mostly))


def _is_number(cell: Cell) -> bool:
    first = cell.values[0] if isinstance(cell, Lines) and cell.values else cell
    return isinstance(first, (int, float)) and not isinstance(first, bool)


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """A figure as data, drawn by Plotly in the page's type and colours.

    Parameters
    ----------
    label : str
        What the figure shows, for those who cannot see it, and where the numbers are.
    traces : sequence of mapping
        Traces of Plotly, such as ``{"type": "scatter", "x": [...], "y": [...], "name": "fit"}``; numbers
        may be arrays, and what is not finite is left out. Text is text: marks of HTML are shown as they are.
        A colour ``--measured``, ``--least``, ``--ink``, ``--soft`` or ``--line0`` to ``--line5`` is the
        page's, in light and dark.
    layout : mapping
        Layout of Plotly. A title of an axis is a string.
    height : int
        In pixels.
    """

    label: str
    traces: Sequence[Mapping[str, Any]]
    layout: Mapping[str, Any] = field(default_factory=dict)
    height: int = 360


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A picture that is there already, in its own colours.

    Parameters
    ----------
    label : str
        What it shows, for those who cannot see it.
    content : bytes
        Of a PNG, JPEG or SVG file; scripts in an SVG do not run.
    """

    label: str
    content: bytes


@dataclass(frozen=True, slots=True)
class Fold:
    """Blocks under a title that unfolds them."""

    title: str
    blocks: Sequence["Block"]


@dataclass(frozen=True, slots=True)
class Choice:
    """A menu, such as one of scenarios: the page shows the blocks of the chosen option, the first at first.

    Paper shows every option.
    """

    label: str
    options: Sequence[Fold]


@dataclass(frozen=True, slots=True)
class Drawing:
    """Drawing by a script of the page, with its controls: of the page's own sections alone."""

    name: str


Block = Paragraph | Heading | Listing | Table | Figure | Picture | Fold | Choice | Drawing
"""What a section may consist of."""


@dataclass(frozen=True, slots=True)
class ReportWarning:
    """A warning of the report: what is wrong, and why it matters or what to do.

    A note is about a scenario that is not the reported one. The documentation explains each ``code``.
    """

    what: str
    why: str
    is_note: bool = False
    code: str = ""

    def __str__(self) -> str:
        return f"{self.what}. {self.why}"


class Section(Component[SettingsT]):
    """A section of the page that the plugin palpate-report makes of a run."""

    title: ClassVar[str]
    """Its heading."""

    entry: ClassVar[str] = ""
    """Its name in the contents; by itself the title."""

    after: ClassVar[str] = "limb"
    """Name of the section that it follows."""

    @abstractmethod
    def blocks(self, data: Any, report: Any) -> Iterable[Block]:  # noqa: ANN401 - of palpate-report
        """Blocks of the results of a run; none where there is nothing to show.

        Called each time that a report is written, also while the run goes on: what has not been found yet is
        empty. It simulates nothing and writes nothing.

        Parameters
        ----------
        data : palpate_report.api.ReportData
            What the stages have left, in the study's units.
        report : palpate_report.api.Report
            Tables, conclusion and files that were made of it.
        """

    def result(self, data: Any, report: Any) -> str:  # noqa: ANN401 - of palpate-report
        """One line that the heading carries: what the section found, such as "widest for c3"."""
        return ""

    def is_open(self, data: Any, report: Any) -> bool:  # noqa: ANN401 - of palpate-report
        """Whether it is unfolded when the page opens."""
        return False

    def warnings(self, data: Any) -> Iterable[ReportWarning]:  # noqa: ANN401 - of palpate-report
        """Warnings for a reader; the terminal and ``--json`` have them too."""
        return ()


def heading(column: str) -> str:
    """Name of a column for people; the heading of a parameter is its name in the study."""
    if "." in column:
        return column
    name, unit = column.removeprefix("n_"), ""
    for suffix, of in {"_s": " (s)", "_percent": " (%)"}.items():
        if name.endswith(suffix):
            name, unit = name.removesuffix(suffix), of
    words = {"nmse": "NMSE", "r2": "R²", "fopt": "Fopt", "aicc": "AICc", "bic": "BIC"}
    return " ".join(words.get(word, word) for word in name.split("_")) + unit


def shown(value: object) -> str:
    """Text of a value for people: four digits, not rounded up to 1; a dash for what is missing."""
    # The least positive number is how an open lower limit of zero is written.
    words = {"None": "–", "nan": "–", "True": "yes", "False": "no", f"{sys.float_info.min:.4g}": "> 0"}
    value = 0.9999 if isinstance(value, float) and 0.9999 < value < 1.0 else value
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return text if isinstance(value, str) else words.get(text, text)


def rounded(value: float, lower: float | None = None, upper: float | None = None) -> str:
    """Text of a value, with two digits of the width of its interval; with three digits where it has none."""
    width = 0.0 if lower is None or upper is None else upper - lower
    if not (width > 0.0 and math.isfinite(width) and math.isfinite(value)):
        return f"{value:.3g}"
    decimals = 1 - math.floor(math.log10(width))
    if decimals > 6 or abs(value) >= 1e6:
        digits = decimals + 1 + math.floor(math.log10(abs(value))) if value else 1
        return f"{value:.{max(1, digits)}g}"
    # Adding zero takes the sign of a rounded zero.
    return f"{round(value, decimals) + 0.0:.{max(0, decimals)}f}"


def rounded_rows(frame: "pl.DataFrame") -> list[tuple[Any, ...]]:
    """Rows of a frame; numbers next to the ends of an interval are texts with the digits of the interval.

    The ends ``x_lower`` and ``x_upper`` are of the other columns that begin with ``x``; ``lower`` and
    ``upper`` of ``value``, ``mean``, ``mean_solved``, ``optimum`` and ``left``.
    """
    rows = frame.rows(named=True)
    for upper in (name for name in frame.columns if name.endswith("upper")):
        stem = upper.removesuffix("upper")
        of = {name for name in frame.columns if f"{name}_".startswith(stem)}
        names = of if stem else {"value", "mean", "mean_solved", "optimum", "left", "lower", upper}
        for row in rows if len(names) > 2 else ():  # "at_upper" is a probability, the end of nothing
            ends = row.get(f"{stem}lower"), row[upper]
            if all(isinstance(end, float) and math.isfinite(end) for end in ends):
                numbers = {name: row[name] for name in names if isinstance(row.get(name), float)}
                row |= {name: rounded(number, *ends) for name, number in numbers.items()}
    return [tuple(row.values()) for row in rows]


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """Results of a stage, as the terminal and the page show them.

    Parameters
    ----------
    lines : sequence of str
        Sentences.
    labelled : mapping of word to str
        Texts, each under its word, such as ``Warnings``.
    figures : sequence of Figure
        Of the page alone.
    values : mapping
        What ``palpate run --json`` has of the stage that comes last.
    missing : str
        What could not be found; the command then ends with exit code 1.
    """

    lines: Sequence[str] = ()
    labelled: Mapping[str, str] = field(default_factory=dict)
    tables: "Mapping[str, pl.DataFrame]" = field(default_factory=dict)
    figures: Sequence[Figure] = ()
    values: Mapping[str, Any] = field(default_factory=dict)
    missing: str = ""
