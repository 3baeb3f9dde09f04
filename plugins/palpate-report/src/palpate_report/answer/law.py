"""Name and formula of a material law, from the summary and the docstring of its class."""

import inspect
import re

from markupsafe import Markup, escape

from palpate.api import Material, ParameterSpace, RegionMaterial
from palpate_report.data.marks import in_words


def paragraphs_of(material: Material) -> list[str]:
    """Paragraphs of the docstring of a material, each in one line."""
    text = inspect.cleandoc(type(material).__doc__ or "")
    return [" ".join(part.split()) for part in text.split("\n\n")]


def formula_of(material: Material) -> str:
    """Energy of a material as its docstring has it; empty where it has none."""
    # Beginnings of the paragraph that has the energy.
    return next((part for part in paragraphs_of(material) if part.startswith(("Ψ =", "W ="))), "")


def law_name(material: Material) -> str:
    """Name of a law in a text, as ``Mooney-Rivlin``: the first of its summary where that is its name."""
    first, name = re.split("[:,]", material.summary)[0], material.name.replace("_", "-")
    return first if first.lower() == name else name.capitalize()


def searched_regions(space: ParameterSpace) -> list[RegionMaterial]:
    """Regions whose law depends on a searched parameter."""
    return [region for region in space.regions if space.columns_of(region.region)]


def laws_of(space: ParameterSpace) -> dict[str, str]:
    """Formula of each searched law by its name, empty where it has none."""
    return {law_name(region.material): formula_of(region.material) for region in searched_regions(space)}


def searched_laws(space: ParameterSpace) -> list[str]:
    """Names of the searched laws, each with its region where there are several."""
    searched = searched_regions(space)
    where = [f" {in_words(region.region)}" if len(searched) > 1 else "" for region in searched]
    return [law_name(region.material) + at for region, at in zip(searched, where, strict=True)]


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
