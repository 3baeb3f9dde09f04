"""``palpate febio-deck``: what is in a deck, as lines of a study."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.api import AsJson, Session

if TYPE_CHECKING:
    from palpate.api import Material
    from palpate_febio.deck_reader import Deck, DeckMaterial


def febio_deck(
    context: typer.Context,
    deck: Annotated[Path, typer.Argument(metavar="FILE", help="A .feb file, version 2.5 to 4.0.")],
    as_json: AsJson = False,
) -> None:
    """Show a deck's mesh, sets and materials, with each coefficient as a study would write it."""
    from palpate_febio.deck_reader import read_deck

    session = Session.of(context)
    found = describe(read_deck(deck), session.plugins.materials)
    if as_json:
        session.json(found)
        return
    for heading in ("parts", "node_sets", "surfaces"):
        session.say(f"{heading}: " + (", ".join(f"{k} ({n})" for k, n in found[heading].items()) or "none"))
    session.say(f"held: {', '.join(found['held']) or 'none'}")
    for material in found["materials"].values():
        session.say("")
        session.say(f"# FEBio's {material['febio_type']}: {material['values']}")
        session.say(material["study"] or f"# no material of palpate is FEBio's {material['febio_type']}")


def describe(deck: Deck, materials: Mapping[str, type[Material]]) -> dict[str, Any]:
    """What is in a deck, in plain values.

    Parameters
    ----------
    deck : Deck
    materials : mapping of name to Material class
        Those that may be its counterpart.
    """
    from palpate_febio.deck_reader import RIGID

    unique = {m.name: m for m in deck.materials.values() if m.febio_type != RIGID}
    return {
        "n_nodes": len(deck.points),
        "parts": {part.name: len(part.cells) for part in deck.parts},
        "node_sets": {name: len(nodes) for name, nodes in deck.node_sets.items()},
        "surfaces": {name: len(nodes) for name, nodes in deck.surfaces.items()},
        "held": list(deck.held),
        "materials": {
            name: {
                "febio_type": material.febio_type,
                "values": dict(material.values),
                "study": study_lines(name, material, materials),
            }
            for name, material in unique.items()
        },
    }


def study_lines(region: str, material: DeckMaterial, materials: Mapping[str, type[Material]]) -> str | None:
    """The region's lines in study.toml, every coefficient fixed; None without a counterpart.

    The convention is the one that FEBio 4.4 to 4.11 was measured to have.
    """
    from palpate_febio.spelling import SPELLED, expected_convention

    for name, (febio_type, renamed) in SPELLED.items():
        if febio_type != material.febio_type or name not in materials:
            continue
        built = _with_terms(materials[name], material)
        if built is None:
            return None
        lines = [f"[region.{region}]", f'material = "{name}"']
        if (convention := expected_convention(built)) != "textbook":
            lines.append(f'convention = "{convention}"')
        if "terms" in (settings := dict(built.settings)):
            lines.append(f"settings = {{ terms = {settings['terms']} }}")
        lines.append(f"[region.{region}.parameters]")
        numbers = [(p.name, p.unit, material.values[renamed.get(p.name, p.name)]) for p in built.parameters]
        return "\n".join(
            [*lines, *(f'{k} = "{v:.12g} {unit}"' if unit else f"{k} = {v:.12g}" for k, unit, v in numbers)]
        )
    return None


def _with_terms(kind: type[Material], material: DeckMaterial) -> Material | None:
    """The material with as many terms as the deck gives; None where a coefficient is missing."""
    from palpate_febio.spelling import SPELLED

    _, renamed = SPELLED[kind.name]
    terms = "terms" in kind.Settings.model_fields
    for n in range(6 if terms else 1, 0, -1):
        built = kind(kind.Settings(terms=n)) if terms else kind()  # type: ignore[call-arg]
        if all(renamed.get(p.name, p.name) in material.values for p in built.parameters):
            return built
    return None
