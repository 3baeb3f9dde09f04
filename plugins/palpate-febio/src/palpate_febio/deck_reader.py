"""Reads decks: mesh, sets, surfaces, domains and materials."""

import xml.etree.ElementTree as ET  # types, and the error; documents are read by defusedxml
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import defusedxml.ElementTree
import numpy as np

from palpate.api import FloatArray, IntArray, MeshError
from palpate.mesh.topology import CELLS

LARGEST_FILE_BYTES = 2_000_000_000
RIGID = "rigid body"
SPEC_VERSIONS = ("2.5", "3.0", "4.0")
REACHING = ("from", "file", "path")
"""Attributes by which a deck names another file."""

FACE_NODES: Mapping[str, int] = MappingProxyType({"tri3": 3, "tri6": 6, "tri7": 7, "quad4": 4, "quad8": 8})


@dataclass(frozen=True, slots=True, eq=False)
class DeckMaterial:
    """A material of a deck, and FEBio's type of it."""

    name: str
    febio_type: str


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Elements of one kind with one material; ``cells`` (n, n_nodes) index into the deck's points."""

    name: str
    kind: str
    cells: IntArray
    material: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Deck:
    """What a deck holds, in its own names and units.

    Parameters
    ----------
    points : (n_nodes, 3) array
    parts : tuple of Part
    node_sets : mapping of name to (n,) integer array
    surfaces : mapping of name to (n,) integer array
        Nodes of the faces.
    held : tuple of str
        Node sets whose displacement is fixed in all directions.
    touched : tuple of str
        Primary surfaces of the surface pairs.
    materials : mapping of name to DeckMaterial
    """

    points: FloatArray
    parts: tuple[Part, ...]
    node_sets: Mapping[str, IntArray]
    surfaces: Mapping[str, IntArray]
    held: tuple[str, ...]
    touched: tuple[str, ...]
    materials: Mapping[str, DeckMaterial]


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
        points = self.points(mesh)
        materials = self.materials()
        return Deck(
            points=points,
            parts=tuple(self.parts(mesh, materials)),
            node_sets={self.name(e): self.nodes(e, self.set_numbers(e)) for e in mesh.findall("NodeSet")},
            surfaces={self.name(e): self.surface(e) for e in mesh.findall("Surface")},
            held=tuple(self.held()),
            touched=tuple(e.findtext("primary", "").strip() for e in mesh.findall("SurfacePair")),
            materials=materials,
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

    def parts(self, mesh: ET.Element, materials: Mapping[str, DeckMaterial]) -> Iterator[Part]:
        by_domain = {e.get("name"): e.get("mat") for e in self.root.iterfind("MeshDomains/*")}
        for block in mesh.findall("Elements"):
            kind, name = block.get("type", ""), self.name(block)
            material = by_domain.get(name) or block.get("mat")
            if material is None or material not in materials:
                raise self.refused(f"elements '{name}' have no material (given: {material}); give them one")
            if materials[material].febio_type == RIGID:
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

    def materials(self) -> dict[str, DeckMaterial]:
        found = {}
        for element in self.root.iterfind("Material/material"):
            name = element.get("name") or f"material{element.get('id')}"
            found[name] = DeckMaterial(name, element.get("type", ""))
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
    """Whether a file's name stays in the folder: one plain name, no folder, drive or variable."""
    return bool(named) and not any(c in named for c in "/\\:~$%") and named not in (".", "..")
