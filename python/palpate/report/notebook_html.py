"""How studies, curves and results look in a notebook: self-contained HTML and SVG.

IPython asks :data:`VIEWS`, so that the values themselves know nothing of HTML. Every text is
escaped, and colours follow the notebook's own (``currentColor``).
"""

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from html import escape
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from palpate.curves import Curve, Response
    from palpate.domain import Design, Parameter
    from palpate.plugins.catalogue import Catalogue
    from palpate.plugins.interfaces import Material
    from palpate.report.result import RunResult
    from palpate.study.reading import Study

WIDTH, HEIGHT = 220, 120
"""Size of a curve's picture [px]."""

MOST_POINTS = 300
"""Points of a curve that are drawn."""


def table(columns: Sequence[str], rows: Iterable[Sequence[object]], caption: str = "") -> str:
    """Format text as an HTML table."""
    head = "".join(f'<th scope="col">{escape(name)}</th>' for name in columns)
    body = "".join(f"<tr>{''.join(f'<td>{_cell(value)}</td>' for value in row)}</tr>" for row in rows)
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    return f"<table>{title}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _cell(value: object) -> str:
    return escape(f"{value:.4g}" if isinstance(value, float) else str(value))


def picture(curve: "Curve") -> str:
    """Draw a curve as SVG, with its end values."""
    keep = np.unique(np.linspace(0, curve.abscissa.size - 1, MOST_POINTS).astype(int))
    x, y = curve.abscissa[keep], curve.ordinate[keep]
    across, up = _scaled(x, WIDTH), _scaled(-y, HEIGHT)
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(across, up, strict=True))
    spans = f"{x.min():.3g} … {x.max():.3g}; {y.min():.3g} … {y.max():.3g}"
    label = escape(f"{curve.channel}: {spans}")
    return (
        f'<figure style="display:inline-block;margin:4px"><svg role="img" aria-label="{label}" '
        f'width="{WIDTH}" height="{HEIGHT}" viewBox="0 0 {WIDTH} {HEIGHT}">'
        f'<polyline fill="none" stroke="currentColor" points="{points}"/></svg>'
        f"<figcaption>{label}</figcaption></figure>"
    )


def _scaled(values: "np.ndarray[tuple[int], np.dtype[np.float64]]", size: int) -> Iterable[float]:
    span = float(np.ptp(values)) or 1.0
    scaled: list[float] = (4.0 + (size - 8.0) * (values - values.min()) / span).tolist()
    return scaled


def pictures(shown: "Response") -> str:
    """Draw curves side by side."""
    return "".join(picture(curve) for curve in shown.curves.values())


def study(shown: "Study") -> str:
    """Show what a study searches, where, and how."""
    rows: list[tuple[str, object]] = [
        ("data", shown.data),
        ("spots", ", ".join(spot.spot.name for spot in shown.spots)),
        ("materials", ", ".join(f"{r.region}: {r.material.name}" for r in shown.space.regions)),
        ("solver", shown.solver.name),
        ("sets", f"{shown.n_sets} by {shown.sampler.name}, seed {shown.seed}"),
        ("scenarios", ", ".join(scenario.name for scenario in shown.scenarios)),
        ("normaliser", shown.scoring.normaliser.value),
    ]
    about = table(("", ""), rows, f"{shown.name}: {shown.description}")
    return about + parameters(shown.space.parameters, "searched")


def parameters(shown: Sequence["Parameter"], caption: str = "") -> str:
    """Show parameters with units and ranges."""
    columns = ("parameter", "unit", "lower", "upper", "description")
    rows = [(p.name, p.unit, p.lower, p.upper, p.description) for p in shown]
    return table(columns, rows, caption)


def material(shown: "Material") -> str:
    """Show a material's parameters."""
    return parameters(shown.parameters, f"{shown.name}: {shown.summary}")


def design(shown: "Design") -> str:
    """Show how many sets there are, and how far they reach."""
    columns = ("parameter", "unit", "least", "largest")
    rows = [
        (p.name, p.unit, float(values.min()), float(values.max()))
        for p, values in zip(shown.parameters, shown.values.T, strict=True)
    ]
    return table(columns, rows, f"{shown.n_sets} sets of {shown.n_drawn} drawn, seed {shown.seed}")


def catalogue(shown: "Catalogue[object]") -> str:
    """Show what is provided, by whom, and what it is."""
    rows = []
    for name in shown:
        entry = shown[name]
        about = getattr(entry, "summary", "") or getattr(entry, "description", "")
        rows.append((name, shown.provider(name), about))
    return table(("name", "plugin", "summary"), rows, shown.noun)


def run_result(shown: "RunResult") -> str:
    """Show what a run chose, and where the rest of it is."""
    chosen = shown.selected.selection
    page = escape(str(shown.folder / "report" / "index.html"))
    caption = f"least Fopt by spot and scenario; {len(shown.simulations)} simulations"
    verdict = shown.report.verdict
    said = "".join(f"<p>{escape(str(line))}</p>" for line in (*verdict.sentences, *verdict.warnings))
    return f"{table(chosen.columns, chosen.rows(), caption)}{said}<p>report: <code>{page}</code></p>"


VIEWS: Mapping[tuple[str, str], Callable[[Any], str]] = MappingProxyType(
    {
        ("palpate.curves", "Curve"): picture,
        ("palpate.curves", "Response"): pictures,
        ("palpate.domain", "Design"): design,
        ("palpate.plugins.catalogue", "Catalogue"): catalogue,
        ("palpate.plugins.interfaces", "HyperelasticMaterial"): material,
        ("palpate.report.result", "RunResult"): run_result,
        ("palpate.study.reading", "Study"): study,
    }
)
"""What shows a value, by module and name of its class; subclasses are shown alike."""


def html(value: object) -> str:
    """Show a value as a notebook does; empty where it has no view."""
    classes = ((cls.__module__, cls.__name__) for cls in type(value).__mro__)
    return next((VIEWS[cls](value) for cls in classes if cls in VIEWS), "")


def show_in_notebooks() -> None:
    """Let the IPython session that runs here, if one does, show palpate's values as HTML."""
    shell = sys.modules["IPython"].get_ipython()
    if shell is not None:
        formatter = shell.display_formatter.formatters["text/html"]
        for module, name in VIEWS:
            formatter.for_type_by_name(module, name, html)
