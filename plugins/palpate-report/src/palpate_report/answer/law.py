"""Formula of a material law, from the docstring of its class."""

import inspect
import re

from markupsafe import Markup, escape

from palpate.api import Material
from palpate_report.data.report_data import ReportData


def paragraphs_of(material: Material) -> list[str]:
    """Paragraphs of the docstring of a material, each in one line."""
    text = inspect.cleandoc(type(material).__doc__ or "")
    return [" ".join(part.split()) for part in text.split("\n\n")]


def formula_of(material: Material) -> str:
    """Energy of a material as its docstring has it; empty where it has none."""
    # Beginnings of the paragraph that has the energy.
    return next((part for part in paragraphs_of(material) if part.startswith(("Ψ =", "W ="))), "")


def laws_of(data: ReportData) -> dict[str, str]:
    """Formula of each searched law by its name; laws without one are left out."""
    space = data.study.space
    found = {r.material.name: formula_of(r.material) for r in space.regions if space.columns_of(r.region)}
    return {name: formula for name, formula in found.items() if formula}


_TOWER = re.compile(
    r"(?P<above>\^(?:\([^()]*\)|[\w−]+(?:_\w)?))"  # powers
    r"|(?P<below>_\w|(?<=[^\W\d_])\d|(?<=\u0303)\d)"  # indices: Σ_k, c1, Ĩ1
)


def typeset(formula: str) -> Markup:
    """Formula with its powers and indices raised and lowered, as HTML."""

    def raised(found: re.Match[str]) -> str:
        if text := found["above"]:
            return f"<sup>{typeset(text[1:].strip('()'))}</sup>"
        return f"<sub>{found['below'].lstrip('_')}</sub>"

    return Markup(_TOWER.sub(raised, str(escape(formula))))
