"""Limbs from decks of FEBio: mesh, sets, surfaces and regions."""

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from palpate.api import BoolArray, IntArray, Limb, LimbSource, Mesh, MeshError, Settings, Spot, convert
from palpate.api.files import InspectedTable, Inspection
from palpate.api.mesh import (
    CELLS,
    Cut,
    FixedNodes,
    curved,
    cut,
    fixed_nodes,
    guessed_unit,
    inspected,
    likely_sets,
    region_name,
)
from palpate_febio.deck_reader import OTHER_SOLIDS, Deck, read_deck


class FebioDeckSettings(Settings):
    """Settings of :class:`FebioDeckSource`."""

    unit: Literal["mm", "cm", "m", "um"] = Field("mm", description="Unit of the deck's coordinates.")
    regions: dict[str, str | list[str]] = Field(
        default_factory=dict,
        description="Region by the deck's material or part, or by several; empty: each material is a region "
        "of its own name.",
    )
    fixed: str | list[str] = Field(
        "",
        description="Node set, surface or rigid part that is held still, or several; empty: all that the "
        "deck holds in x, y and z.",
    )
    contact: str | list[str] = Field(
        "",
        description="Node set or surface that is the outer skin, or several; empty: 'contact', or else the "
        "limb's surface in the deck's one contact.",
    )
    leave_out: list[str] = Field(
        default_factory=list, description="Parts or materials that are no limb, such as an elastic indenter."
    )


class FebioDeckSource(LimbSource[FebioDeckSettings]):
    """Limbs from ``.feb`` decks, versions 2.5 to 4.0: mesh, sets and regions; rigid bodies are left out."""

    suffixes = frozenset({".feb"})
    name = "febio_deck"
    summary = "decks of FEBio (.feb) with regions by material and node sets or surfaces"

    @classmethod
    def inspect(cls, path: Path, other: Path | None = None) -> Inspection:
        """Look into a deck; it has no second file.

        Raises
        ------
        MeshError
            The deck cannot be read.
        """
        deck = read_deck(path)
        unit, finding = guessed_unit(deck.points)
        settings: dict[str, object] = {} if unit == "mm" else {"unit": unit}
        if any(region_name(part.material) != part.material for part in deck.parts):
            settings["regions"] = {region_name(part.material): part.material for part in deck.parts}
        skin, held, unused = likely_sets([*deck.node_sets, *deck.surfaces])
        if skin not in (None, "contact") and len(deck.touched) != 1:
            settings["contact"] = skin
        findings = [finding] if finding else []
        if not deck.supports and held:
            settings["fixed"] = held
            sets = ", ".join(f"'{name}'" for name in held)
            by_name = f"no condition of the deck holds nodes; fixed is {sets} by its name alone: check it"
            findings += [by_name, *unused]
        parts = [(p.name, p.kind, p.material, str(len(p.cells))) for p in deck.parts]
        parts += [(name, "rigid", "", f"{len(nodes)} nodes") for name, nodes in deck.rigid.items()]
        named = [(name, "node set", f"{len(nodes)} nodes") for name, nodes in deck.node_sets.items()]
        named += [(name, "surface", f"{len(nodes)} nodes") for name, nodes in deck.surfaces.items()]
        tables = [
            InspectedTable(
                title="Parts", columns=("part", "kind", "material", "elements"), rows=tuple(parts)
            ),
            InspectedTable(title="Names in the deck", columns=("name", "kind", "content"), rows=tuple(named)),
        ]
        return inspected(path, cls, settings, tables, deck.supports, findings)

    def load(self, path: Path, spot: Spot) -> Limb:
        """Limb of one spot.

        Raises
        ------
        MeshError
            The deck cannot be read safely, or lacks a set; naming what it has.
        """
        deck = read_deck(path, self.settings.leave_out)
        if not deck.parts:
            raise MeshError(f"{path}: no deformable elements; palpate needs the limb, not only rigid bodies")
        used = np.unique(np.concatenate([part.cells.ravel() for part in deck.parts]))
        number = np.full(len(deck.points), -1)
        number[used] = np.arange(len(used))
        other = sorted({part.kind for part in deck.parts} & OTHER_SOLIDS.keys())
        kinds = [OTHER_SOLIDS.get(p.kind) or CELLS[p.kind].meshio for p in deck.parts]
        blocks = tuple((kind, p.cells) for kind, p in zip(kinds, deck.parts, strict=True))
        made = cut(deck.points, blocks) if other else None
        fixed = self._fixed(path, deck, number >= 0)
        sets = {"fixed": fixed.nodes, "contact": self._contact(path, deck, fixed.nodes)}
        regions, unit_mm = self._regions(path, deck), convert(f"1 {self.settings.unit}", "mm")
        cells, ids = _elements(deck, regions, number, made)
        mesh = Mesh(
            points_mm=deck.points[used] * unit_mm,
            cells=cells,
            cell_regions=ids,
            regions=tuple(dict.fromkeys(regions.values())),
            node_sets={name: number[nodes][number[nodes] >= 0] for name, nodes in sets.items()},
        )
        remarks = [f"the rigid part '{part}' is left out" for part in deck.rigid]
        if made:
            remarks.append(f"elements {', '.join(other)} are cut into {len(made.tets)} tetrahedra")
            if made.ends.size:
                mesh = curved(mesh, number[made.ends], made.middles * unit_mm)
        return Limb(
            spot=spot,
            mesh=mesh,
            remarks=(*remarks, *fixed.remarks),
            warnings=(*deck.warnings, *fixed.warnings),
            absent=deck.absent,
        )

    def _regions(self, path: Path, deck: Deck) -> Mapping[str, str]:
        """Region of each part."""
        wanted = {region: _names(source) for region, source in self.settings.regions.items()}
        if not wanted:
            return {part.name: part.material for part in deck.parts}
        by_source = {source: region for region, sources in wanted.items() for source in sources}
        found = {}
        for part in deck.parts:
            region = by_source.get(part.name) or by_source.get(part.material)
            if region is None:
                raise MeshError(
                    f"{path}: part '{part.name}' with material '{part.material}' is named by no region of "
                    f"the settings ({', '.join(f'{s} as {r}' for s, r in by_source.items())}); add it there, "
                    "or to leave_out"
                )
            found[part.name] = region
        return found

    def _fixed(self, path: Path, deck: Deck, in_limb: BoolArray) -> FixedNodes:
        named = [_nodes(path, deck, name) for name in _names(self.settings.fixed)]
        return fixed_nodes(
            path,
            deck.supports,
            in_limb,
            np.unique(np.concatenate(named)) if named else None,
            setting="the setting fixed",
            there=_there(deck),
            unused=deck.warnings,
        )

    def _contact(self, path: Path, deck: Deck, fixed: IntArray) -> IntArray:
        names = _names(self.settings.contact)
        if not names:
            touched = [name for name in deck.touched if not np.isin(deck.surfaces[name], fixed).all()]
            names = ["contact"] if "contact" in {*deck.node_sets, *deck.surfaces} or not touched else touched
            if len(names) > 1:
                raise MeshError(
                    f"{path}: the deck's contacts touch several surfaces of the limb ({', '.join(names)}); "
                    "name the outer skin in the setting contact"
                )
        return np.unique(np.concatenate([_nodes(path, deck, name) for name in names]))


def _elements(
    deck: Deck, regions: Mapping[str, str], number: IntArray, made: Cut | None
) -> tuple[dict[str, IntArray], dict[str, IntArray]]:
    """Elements by kind, and the index of the region of each; tetrahedra alone where the deck is cut."""
    places = {region: k for k, region in enumerate(dict.fromkeys(regions.values()))}
    origins = made.origin if made else [np.arange(len(part.cells)) for part in deck.parts]
    cells: dict[str, list[IntArray]] = {"tet4": [number[made.tets]]} if made else {}
    ids: dict[str, list[IntArray]] = {}
    for part, origin in zip(deck.parts, origins, strict=True):
        if not made:
            cells.setdefault(part.kind, []).append(number[part.cells])
        region = np.full(len(origin), places[regions[part.name]])
        ids.setdefault("tet4" if made else part.kind, []).append(region)
    joined = ({kind: np.concatenate(blocks) for kind, blocks in of.items()} for of in (cells, ids))
    return next(joined), next(joined)


def _names(setting: str | list[str]) -> list[str]:
    return [setting] if isinstance(setting, str) and setting else list(setting)


def _nodes(path: Path, deck: Deck, name: str) -> IntArray:
    for of in (deck.node_sets, deck.surfaces, deck.rigid):
        if (found := of.get(name.removeprefix("@surface:"))) is not None:
            if not found.size:
                raise MeshError(f"{path}: '{name}' is empty; name another set, or fill this one")
            return found
    raise MeshError(
        f"{path}: no node set, surface or rigid part '{name}' (there: {', '.join(_there(deck)) or 'none'}); "
        "name one of them in the settings fixed and contact"
    )


def _there(deck: Deck) -> list[str]:
    return [*deck.node_sets, *deck.surfaces, *deck.rigid]
