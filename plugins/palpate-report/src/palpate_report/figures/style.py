"""Style of every figure for print: sizes in mm, type, colours for all kinds of colour vision, files."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from string import ascii_lowercase, ascii_uppercase
from types import MappingProxyType
from typing import Any, cast

import matplotlib as mpl
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter

from palpate.api import Parameter
from palpate_report.data.report_data import label_of
from palpate_report.settings import BY_ITSELF, ReportSettings

MM = 1.0 / 25.4
"""Inches in a millimetre."""

FONTS = ("Arial", "Helvetica", "Liberation Sans", "Arimo", "Nimbus Sans", "DejaVu Sans")
"""Fonts of figures: PNG and PDF have the first that is installed. The third to fifth are as wide as Arial."""

STYLE: Mapping[str, Any] = MappingProxyType(
    {
        "figure.dpi": 300,
        "figure.constrained_layout.use": True,
        "font.family": ("sans-serif", "DejaVu Sans"),  # the second for a lowered number that the first lacks
        "font.sans-serif": FONTS,
        "font.size": 7.0,
        "axes.titlesize": 7.0,
        "axes.labelsize": 7.0,
        "xtick.labelsize": 6.5,
        "ytick.labelsize": 6.5,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.linewidth": 0.6,
        "axes.grid": False,
        "axes.titlelocation": "center",
        "axes.axisbelow": True,
        # No offset or power of ten next to an axis, where it collides with the label.
        "axes.formatter.limits": (-6, 6),
        "axes.formatter.useoffset": False,
        "axes.formatter.use_mathtext": False,  # it is parsed for each tick of each file
        "legend.frameon": False,
        "legend.fontsize": 6.5,
        "lines.linewidth": 1.1,
        "svg.hashsalt": "palpate",
        # Text stays text, which a journal edits: in SVG by the names of the fonts, in PDF as TrueType.
        "svg.fonttype": "none",
        "pdf.fonttype": 42,
    }
)

_SETTINGS: ContextVar[ReportSettings] = ContextVar("settings", default=BY_ITSELF)


@contextmanager
def styled(settings: ReportSettings = BY_ITSELF) -> Iterator[None]:
    """Draw figures in the style for print with these settings; nobody else's style changes."""
    fonts = tuple(dict.fromkeys((settings.font, *FONTS)))
    token = _SETTINGS.set(settings)
    try:
        with mpl.rc_context(cast("Any", {**STYLE, "font.sans-serif": fonts})):
            yield
    finally:
        _SETTINGS.reset(token)


def column_mm(is_wide: bool) -> float:
    """Width of two columns of a journal's page, or of one."""
    settings = _SETTINGS.get()
    return settings.double_column if is_wide else settings.single_column


Dash = str | tuple[int, tuple[int, ...]]

MEASURED_COLOUR = "#0072B2"
LEAST_COLOUR = "#D7191C"
LINES: tuple[tuple[str, Dash], ...] = (
    ("#D55E00", "-"),
    ("#E69F00", "--"),
    ("#CC79A7", "-."),
    ("#009E73", ":"),
    ("#56B4E9", (0, (5, 1, 1, 1, 1, 1))),
    ("#000000", (0, (1, 1))),
)
"""Okabe and Ito's colours, distinct for all kinds of colour vision, each with its dash."""


def sized(width_mm: float, height_mm: float) -> Figure:
    """Make an empty figure."""
    return Figure(figsize=(width_mm * MM, height_mm * MM))


def panels(n: int, n_columns: int, height_mm: float, margin_mm: float) -> tuple[Figure, list[Any]]:
    """Figure with so many panels of this height, in so many columns."""
    n_rows = -(-n // n_columns)
    figure = sized(column_mm(n_columns > 1), height_mm * n_rows + margin_mm)
    axes = list(figure.subplots(n_rows, n_columns, squeeze=False).flat)
    for empty in axes[n:]:
        empty.remove()
    return figure, axes[:n]


def save(figure: Figure, stem: Path) -> list[Path]:
    """Write a figure as ``<stem>.svg``, ``<stem>.pdf`` and ``<stem>.png``, alike each time."""
    svg, pdf, png = (stem.with_name(f"{stem.name}{suffix}") for suffix in (".svg", ".pdf", ".png"))
    # Not print_figure, which draws twice; these two leave their own dpi behind.
    dpi = figure.dpi
    canvas: Any = FigureCanvasSVG(figure)
    canvas.print_svg(svg, metadata={"Date": None})
    figure.set_layout_engine("none")  # what the first drawing has laid out stays
    canvas = FigureCanvasPdf(figure)
    canvas.print_pdf(pdf, metadata={"CreationDate": None})
    figure.set_dpi(dpi)
    canvas = FigureCanvasAgg(figure)
    canvas.print_png(png)
    return [svg, pdf, png]


class PlainNumbers(LogFormatter):
    """Numbers as they are written, on those ticks of a log scale that have room for one."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Label of a tick."""
        return f"{x:g}" if super().__call__(x, pos) else ""


def set_log(axis: Axes, *names: str) -> None:
    """Give axes (``x``, ``y``) a log scale, with plain numbers as labels."""
    for name in names:
        getattr(axis, f"set_{name}scale")("log")
        one: Axis = getattr(axis, f"{name}axis")
        one.set_major_formatter(PlainNumbers())
        one.set_minor_formatter(PlainNumbers())


GREEK = MappingProxyType(
    {"alpha": "α", "beta": "β", "gamma": "γ", "kappa": "κ", "lambda": "λ", "mu": "μ", "nu": "ν", "tau": "τ"}
)
"""Letters that names of parameters spell out."""


def symbol(name: str) -> str:
    """Name of a parameter in print: ``c1`` with its number lowered, ``mu1`` with a Greek letter."""
    name = re.sub(rf"^(?:{'|'.join(GREEK)})(?=\d|\b)", lambda found: GREEK[found[0]], name)
    lowered = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
    return re.sub(r"(?<=^[^\W\d_])\d+", lambda found: found[0].translate(lowered), name)


def symbols(text: str) -> str:
    """Words with every name of a parameter as figures print it."""
    return " ".join(map(symbol, text.split(" ")))


def axis_label(parameter: Parameter) -> str:
    """Label of an axis of a parameter: symbol and unit."""
    return symbol(label_of(parameter))


def lettered(axes: Iterable[Axes]) -> None:
    """Letter panels from ``a`` or ``A`` on, where there are several."""
    every, first = list(axes), _SETTINGS.get().letters
    letters = {"a": ascii_lowercase, "A": ascii_uppercase, "none": ""}[first]
    for axis, letter in zip(every, letters if len(every) > 1 else "", strict=False):
        axis.set_title(letter, loc="left", fontweight="bold", fontsize=8.0)


def finished(figure: Figure, axes: Iterable[Axes], notice: str, legend: Sequence[Artist] = ()) -> Figure:
    """Figure with one legend of all that these axes show below it, each label once, and a notice above.

    The notice is on the data, such as that they are simulated; ``legend`` has what no axis labels.
    """
    shown = [axis for axis in axes if axis.axison or axis.has_data()]
    labelled: dict[str, Any] = {str(each.get_label()): each for each in legend}
    lettered(shown)
    for axis in shown:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            labelled.setdefault(label, handle)
    if labelled:
        n_columns = int(figure.get_figwidth() / (0.45 + 0.052 * max(map(len, labelled))))
        figure.legend(
            list(labelled.values()),
            list(labelled),
            loc="outside lower center",
            ncols=max(1, min(n_columns, len(labelled))),
        )
    if notice:
        figure.suptitle(notice, fontsize=6.5, color="0.35")
    return figure
