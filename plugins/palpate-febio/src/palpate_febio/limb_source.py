"""Limbs from decks of FEBio: mesh, sets, surfaces and regions."""

import xml.etree.ElementTree as ET  # types, and the error; documents are read by defusedxml
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import defusedxml.ElementTree
import numpy as np
from pydantic import Field

from palpate.api import FloatArray, IntArray, Limb, LimbSource, Mesh, MeshError, Settings, Spot, convert
from palpate.api.mesh import CELLS

LARGEST_FILE_BYTES = 2_000_000_000
RIGID = "rigid body"
SPEC_VERSIONS = ("2.5", "3.0", "4.0")
REACHING = ("from", "file", "path")
"""Attributes by which a deck names another file."""

FACE_NODES: Mapping[str, int] = MappingProxyType({"tri3": 3, "tri6": 6, "tri7": 7, "quad4": 4, "quad8": 8})


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Elements of one kind with one material; ``cells`` (n, n_nodes) index into the deck's points."""

    name: str
    kind: str
    cells: IntArray
    material: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Deck:
    """Content of a deck, in its own names and units.

    Parameters
    ----------
    surfaces : mapping of name to (n,) integer array
        Nodes of the faces.
    held : tuple of str
        Node sets whose displacement is fixed in all directions.
    touched : tuple of str
        Primary surfaces of the surface pairs.
    """

    points: FloatArray
    parts: tuple[Part, ...]
    node_sets: Mapping[str, IntArray]
    surfaces: Mapping[str, IntArray]
    held: tuple[str, ...]
    touched: tuple[str, ...]


def read_deck(path: Path) -> Deck:
    """Deck of a file of version 2.5, 3.0 or 4.0, which may come from anybody.

    Raises
    ------
    MeshError
        The file is missing, too large, not XML, or has a document type, which could define entities; or the
        deck lacks something, or reaches for other files. It names the file and the line or the tag.
    """
    if not path.is_file():
        raise MeshError(f"{path}: no such file; check the path of the deck")
    if path.stat().st_size > LARGEST_FILE_BYTES:
        raise MeshError(f"{path}: larger than {LARGEST_FILE_BYTES:,} bytes; is this a deck?")
    try:
        root: ET.Element = defusedxml.ElementTree.fromstring(path.read_bytes(), forbid_dtd=True)
    except defusedxml.DTDForbidden:
        raise MeshError(f"{path}: it has a document type, which could define entities; remove it") from None
    except (ET.ParseError, ValueError, LookupError) as error:
        raise MeshError(f"{path}: not XML that can be read ({error}); write the deck again") from None
    return _Reader(path, root).deck()


class _Reader:
    """One reading of one file."""

    def __init__(self, path: Path, root: ET.Element) -> None:
        self.path = path
        self.root = root
        if root.tag != "febio_spec" or root.get("version") not in SPEC_VERSIONS:
            raise self.refused(
                f"<{root.tag} version={root.get('version')!r}>; palpate reads febio_spec of version "
                f"{', '.join(SPEC_VERSIONS)}, so save the model as one of those"
            )
        refuse_reaching(path, root)
        self.number: dict[int, int] = {}

    def refused(self, what: str) -> MeshError:
        return MeshError(f"{self.path}: {what}")

    def deck(self) -> Deck:
        mesh = self.root.find("Mesh")
        if mesh is None:
            mesh = self.root.find("Geometry")
        if mesh is None:
            raise self.refused("no section Mesh; export the deck with its mesh")
        return Deck(
            points=self.points(mesh),  # first: the others name nodes by their ids
            parts=tuple(self.parts(mesh)),
            node_sets={self.name(e): self.nodes(e, self.set_numbers(e)) for e in mesh.findall("NodeSet")},
            surfaces={self.name(e): self.surface(e) for e in mesh.findall("Surface")},
            held=tuple(self.held()),
            touched=tuple(e.findtext("primary", "").strip() for e in mesh.findall("SurfacePair")),
        )

    def name(self, element: ET.Element) -> str:
        found = element.get("name")
        if found is None:
            raise self.refused(f"a <{element.tag}> without name; name it")
        return found

    def points(self, mesh: ET.Element) -> FloatArray:
        rows: list[list[float]] = []
        for node in mesh.iterfind("Nodes/node"):
            number = self.integer(node, node.get("id"))
            if number in self.number:
                raise self.refused(f"two nodes have the id {number}; give each its own")
            self.number[number] = len(rows)
            row = self.floats(node, node.text)
            if len(row) != 3:
                raise self.refused(f"node {node.get('id')} has {len(row)} coordinates; give three")
            rows.append(row)
        if not rows:
            raise self.refused("no nodes; export the deck with its mesh")
        return np.array(rows)

    def parts(self, mesh: ET.Element) -> Iterator[Part]:
        materials = self.materials()
        by_domain = {e.get("name"): e.get("mat") for e in self.root.iterfind("MeshDomains/*")}
        for block in mesh.findall("Elements"):
            kind, name = block.get("type", ""), self.name(block)
            material = by_domain.get(name) or block.get("mat")
            if material is None or material not in materials:
                raise self.refused(f"elements '{name}' have no material (given: {material}); give them one")
            material, febio_type = materials[material]
            if febio_type == RIGID:
                continue
            if kind not in CELLS:
                raise self.refused(
                    f"elements '{name}' of type {kind}; palpate simulates {', '.join(CELLS)}, so mesh "
                    "the limb with those"
                )
            cells = [self.nodes(e, self.integers(e, e.text)) for e in block.findall("elem")]
            if not cells or any(len(c) != CELLS[kind].n_nodes for c in cells):
                raise self.refused(f"elements '{name}': {kind} wants {CELLS[kind].n_nodes} nodes in each")
            yield Part(name, kind, np.array(cells), material)

    def set_numbers(self, element: ET.Element) -> list[int]:
        """Nodes of a set, written as a list, or one <n id> or <node id> each as FEBio 3 did."""
        if len(element):
            return [self.integer(child, child.get("id")) for child in element]
        return self.integers(element, element.text)

    def surface(self, element: ET.Element) -> IntArray:
        found: set[int] = set()
        for face in element:
            if face.tag not in FACE_NODES:
                raise self.refused(f"surface '{element.get('name')}' has a face <{face.tag}>")
            found.update(self.nodes(face, self.integers(face, face.text)).tolist())
        return np.array(sorted(found), dtype=np.int64)

    def held(self) -> Iterator[str]:
        for fix in self.root.iterfind("Boundary/fix"):  # FEBio 2.5
            if fix.get("bc", "").replace(" ", "") == "x,y,z":
                yield fix.get("node_set", "")
        for bc in self.root.iterfind("Boundary/bc"):
            if bc.get("type") == "zero displacement":
                fixed = [bc.findtext(f"{axis}_dof", "0").strip() for axis in "xyz"]
                if fixed == ["1"] * 3:
                    yield bc.get("node_set", "")
            elif bc.get("type") == "fix" and bc.findtext("dofs", "").replace(" ", "") == "x,y,z":
                yield bc.get("node_set", "")

    def materials(self) -> dict[str, tuple[str, str]]:
        """Name and FEBio's type of each material, by what the deck may call it."""
        found = {}
        for element in self.root.iterfind("Material/material"):
            name = element.get("name") or f"material{element.get('id')}"
            found[name] = name, element.get("type", "")
            found.setdefault(element.get("id", ""), found[name])  # FEBio 3 may name it by number
        return found

    def nodes(self, element: ET.Element, numbers: list[int]) -> IntArray:
        try:
            return np.array([self.number[n] for n in numbers], dtype=np.int64)
        except KeyError as missing:
            what = element.get("name") or f"{element.tag} {element.get('id')}"
            raise self.refused(f"'{what}' names node {missing}, which is not there") from None

    def integer(self, element: ET.Element, text: str | None) -> int:
        found = self.integers(element, text)
        if len(found) != 1:
            raise self.refused(f"<{element.tag}> has the id {text!r}; one whole number is needed")
        return found[0]

    def integers(self, element: ET.Element, text: str | None) -> list[int]:
        try:
            return [int(word) for word in (text or "").replace(",", " ").split()]
        except ValueError:
            raise self.refused(
                f"<{element.tag}> holds '{(text or '').strip()[:40]}'; whole numbers are needed"
            ) from None

    def floats(self, element: ET.Element, text: str | None) -> list[float]:
        try:
            values = [float(word) for word in (text or "").replace(",", " ").split()]
        except ValueError:
            values = [np.nan]
        if not np.isfinite(values).all():
            raise self.refused(
                f"<{element.tag} id={element.get('id')!r}> holds '{(text or '').strip()[:40]}'; finite "
                "numbers are needed"
            )
        return values


def refuse_reaching(path: Path, root: ET.Element) -> None:
    """Refuse a deck that includes other files, or names any outside of its own folder.

    Raises
    ------
    MeshError
    """
    for element in root.iter():
        if element.tag.lower() == "include":
            raise MeshError(f"{path}: <{element.tag}> takes in another file; save the deck as one file")
        for attribute in REACHING:
            named = element.get(attribute)
            if named is not None and not _inside(named):
                raise MeshError(
                    f"{path}: <{element.tag} {attribute}={named!r}> reaches outside the deck's folder; "
                    "put the file next to the deck and name it alone"
                )


def _inside(named: str) -> bool:
    """True if a file's name stays in the folder: one plain name, no folder, drive or variable."""
    return bool(named) and not any(c in named for c in "/\\:~$%") and named not in (".", "..")


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
        """Limb of one spot.

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
            return {part.name: part.material for part in deck.parts}
        by_source = {source: region for region, source in wanted.items()}
        found = {}
        for part in deck.parts:
            region = by_source.get(part.name) or by_source.get(part.material)
            if region is None:
                raise MeshError(
                    f"{path}: part '{part.name}' with material '{part.material}' is named by no region of "
                    f"the settings ({', '.join(f'{r} = {s}' for r, s in wanted.items())}); add it"
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
