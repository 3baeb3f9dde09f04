"""Limbs from decks of FEBio."""

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from palpate.api import IntArray, Limb, LimbSource, Mesh, MeshError, Settings, Spot, convert
from palpate_febio.deck_reader import Deck, read_deck


class FebioDeckSettings(Settings):
    """Settings of :class:`FebioDeckSource`."""

    unit: Literal["mm", "cm", "m", "um"] = Field("mm", description="Unit of the deck's coordinates.")
    regions: dict[str, str] = Field(
        default_factory=dict,
        description="Region by the deck's material or part; empty: each material is a region of its own "
        "name.",
    )
    fixed: str = Field(
        "",
        description="Node set or surface that is held still; empty: those that the deck holds (zero "
        "displacement).",
    )
    contact: str = Field(
        "",
        description="Node set or surface that is the outer skin; empty: 'contact', or else the primary "
        "surface of the deck's one surface pair.",
    )


class FebioDeckSource(LimbSource[FebioDeckSettings]):
    """Limbs from ``.feb`` decks, versions 2.5 to 4.0: mesh, sets and regions; rigid bodies are left out."""

    name = "febio_deck"
    summary = "decks of FEBio (.feb) with regions by material and node sets or surfaces"

    def load(self, path: Path, spot: Spot) -> Limb:
        """Read the mesh of one spot.

        Raises
        ------
        MeshError
            The deck cannot be read safely, or lacks a set; naming what it has.
        """
        deck = read_deck(path)
        if not deck.parts:
            raise MeshError(f"{path}: no deformable elements; palpate needs the limb, not only rigid bodies")
        regions = self._regions(path, deck)
        used = np.unique(np.concatenate([part.cells.ravel() for part in deck.parts]))
        number = np.full(len(deck.points), -1)
        number[used] = np.arange(len(used))
        cells: dict[str, list[IntArray]] = {}
        ids: dict[str, list[IntArray]] = {}
        names = tuple(dict.fromkeys(regions.values()))
        for part in deck.parts:
            cells.setdefault(part.kind, []).append(number[part.cells])
            region = names.index(regions[part.name])
            ids.setdefault(part.kind, []).append(np.full(len(part.cells), region))
        sets = {"fixed": self._fixed(path, deck), "contact": self._contact(path, deck)}
        mesh = Mesh(
            points_mm=deck.points[used] * convert(f"1 {self.settings.unit}", "mm"),
            cells={kind: np.concatenate(blocks) for kind, blocks in cells.items()},
            cell_regions={kind: np.concatenate(blocks) for kind, blocks in ids.items()},
            regions=names,
            node_sets={name: number[nodes][number[nodes] >= 0] for name, nodes in sets.items()},
        )
        return Limb(spot=spot, mesh=mesh)

    def _regions(self, path: Path, deck: Deck) -> Mapping[str, str]:
        """Region of each part."""
        wanted: dict[str, str] = self.settings.regions
        if not wanted:
            return {part.name: deck.materials[part.material].name for part in deck.parts}
        by_source = {source: region for region, source in wanted.items()}
        found = {}
        for part in deck.parts:
            material = deck.materials[part.material].name
            region = by_source.get(part.name) or by_source.get(material)
            if region is None:
                raise MeshError(
                    f"{path}: part '{part.name}' with material '{material}' is named by no region of the "
                    f"settings ({', '.join(f'{r} = {s}' for r, s in wanted.items())}); add it"
                )
            found[part.name] = region
        return found

    def _fixed(self, path: Path, deck: Deck) -> IntArray:
        if self.settings.fixed:
            return _nodes(path, deck, self.settings.fixed)
        held = [name for name in deck.held if name in deck.node_sets]
        if not held:
            raise MeshError(
                f"{path}: no boundary condition 'zero displacement' in x, y and z on a node set; name what "
                f"is held in the setting fixed (there: {_there(deck)})"
            )
        return np.unique(np.concatenate([deck.node_sets[name] for name in held]))

    def _contact(self, path: Path, deck: Deck) -> IntArray:
        name = self.settings.contact or "contact"
        if not self.settings.contact and name not in {*deck.node_sets, *deck.surfaces}:
            name = deck.touched[0] if len(deck.touched) == 1 else name
        return _nodes(path, deck, name)


def _nodes(path: Path, deck: Deck, name: str) -> IntArray:
    found = deck.node_sets.get(name)
    if found is None:
        found = deck.surfaces.get(name)
    if found is None:
        raise MeshError(
            f"{path}: no node set or surface '{name}' (there: {_there(deck)}); name one of them in the "
            "settings fixed and contact"
        )
    return found


def _there(deck: Deck) -> str:
    return ", ".join([*deck.node_sets, *deck.surfaces]) or "none"
