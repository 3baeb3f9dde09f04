"""Decks of FEBio as they are written: points, parts, sets, surfaces and supports, in their own names."""

import xml.etree.ElementTree as ET  # types, and the error; documents are read by defusedxml
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import defusedxml.ElementTree
import numpy as np

from palpate.api import FloatArray, IntArray, MeshError
from palpate.api.mesh import CELLS, SOLIDS, Support
from palpate_febio.deck_supports import DeckNames, DeckSupports

LARGEST_FILE_BYTES = 2_000_000_000
MOST_FILES = 100
RIGID = "rigid body"
SPEC_VERSIONS = ("2.5", "3.0", "4.0")

OTHER_SOLIDS: Mapping[str, str] = MappingProxyType(
    {
        "hex20": "hexahedron20",
        "hex27": "hexahedron27",
        "penta6": "wedge",
        "penta15": "wedge15",
        "pyra5": "pyramid",
        "pyra13": "pyramid13",
    }
)
"""Solids that are cut into tetrahedra, by meshio's name."""
SHELLS = frozenset({"tri3", "tri6", "quad4", "quad8", "quad9", "q4ans", "q4eas"})


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Elements of one kind with one material; ``cells`` (n, n_nodes) index into the deck's points."""

    name: str
    kind: str
    cells: IntArray
    material: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Deck:
    """Content of a deck, in its own names and units."""

    points: FloatArray
    parts: tuple[Part, ...]  # deformable ones
    node_sets: Mapping[str, IntArray]
    surfaces: Mapping[str, IntArray]
    rigid: Mapping[str, IntArray]
    supports: tuple[Support, ...]
    touched: tuple[str, ...]
    warnings: tuple[str, ...]
    absent: tuple[str, ...]  # what is to be left out and is not there


def read_deck(path: Path, leave_out: Sequence[str] = ()) -> Deck:
    """Deck of a file of version 2.5, 3.0 or 4.0, which may come from anybody.

    ``leave_out`` names parts or materials that are no limb.

    Raises
    ------
    MeshError
        The file is missing, too large, not XML, or has a document type, which could define entities; or the
        deck lacks something, or reaches for other files. It names the file and the line or the tag.
    """
    sizes: list[int] = []
    return _Reader(path, _joined(path, _parsed(path, sizes), sizes), leave_out).deck()


def _parsed(path: Path, sizes: list[int]) -> ET.Element:
    """Root of a file of a deck; the file's size (bytes) is added to the sizes of the files before it."""
    if not path.is_file():
        raise MeshError(f"{path}: no such file; check the path of the deck")
    sizes.append(path.stat().st_size)
    if sum(sizes) > LARGEST_FILE_BYTES:
        before = f" with the {len(sizes) - 1} files read before it" if len(sizes) > 1 else ""
        raise MeshError(f"{path}: larger than {LARGEST_FILE_BYTES:,} bytes{before}; is this a deck?")
    if len(sizes) > MOST_FILES:
        raise MeshError(f"{path}: the deck includes more than {MOST_FILES} files; save it as fewer")
    try:
        root: ET.Element = defusedxml.ElementTree.fromstring(path.read_bytes(), forbid_dtd=True)
    except defusedxml.DTDForbidden:
        raise MeshError(f"{path}: it has a document type, which could define entities; remove it") from None
    except (ET.ParseError, ValueError, LookupError) as error:
        raise MeshError(f"{path}: not XML that can be read ({error}); write the deck again") from None
    return root


def _joined(path: Path, root: ET.Element, sizes: list[int], by: tuple[Path, ...] = ()) -> ET.Element:
    """Deck with the sections of the files of its folder that it includes, whole or by attribute."""
    for k, section in reversed(list(enumerate(root))):
        is_whole = section.tag == "Include"
        named = (section.text or "").strip() if is_whole else section.get("from", section.get("file"))
        if named is None:
            continue
        if not _inside(named):
            raise _outside(path, section, named)
        other = path.parent / named
        if not other.is_file() or other in (*by, path):
            raise MeshError(f"{path}: <{section.tag}> names the file '{named}'; put it next to the deck")
        found = _joined(other, _parsed(other, sizes), sizes, (*by, path))
        if found.tag != "febio_spec":
            raise MeshError(f"{other}: <{found.tag}> where febio_spec is needed; save it as a deck")
        sections = [of for of in found if is_whole or of.tag == section.tag]
        if not is_whole and (len(section) or not sections):
            why = "the deck has one too" if len(section) else "the file has none"
            raise MeshError(
                f"{path}: <{section.tag}> is to come from '{named}', but {why}; write it in one of the two"
            )
        root[k : k + 1] = sections
    return root


class _Reader:
    """One reading of one file."""

    def __init__(self, path: Path, root: ET.Element, leave_out: Sequence[str]) -> None:
        self.path = path
        self.root = root
        self.leave_out = leave_out
        if root.tag != "febio_spec" or root.get("version") not in SPEC_VERSIONS:
            raise self.refused(
                f"<{root.tag} version={root.get('version')!r}>; palpate reads febio_spec of version "
                f"{', '.join(SPEC_VERSIONS)}, so save the model as one of those"
            )
        refuse_reaching(path, root)
        # A deck of several files may have a mesh in each.
        meshes = [section for section in root if section.tag in ("Mesh", "Geometry")]
        if not meshes:
            raise self.refused("no section Mesh; export the deck with its mesh")
        self.mesh = ET.Element("Mesh")
        self.mesh.extend(child for section in meshes for child in section)
        self.number: dict[int, int] = {}
        self.sets: dict[str, IntArray] = {}
        self.surfaces: dict[str, IntArray] = {}
        self.rigid: dict[str, IntArray] = {}

    def refused(self, what: str) -> MeshError:
        return MeshError(f"{self.path}: {what}")

    def deck(self) -> Deck:
        mesh = self.mesh
        points = self.points(mesh)  # first: the others name nodes by their ids
        parts = tuple(self.parts(mesh))
        for tag in ("NodeSet", "Surface"):
            sets = [self.name(e) for e in mesh.findall(tag)]
            if len(set(sets)) < len(sets):
                twice = next(name for name in sets if sets.count(name) > 1)
                raise self.refused(f"two <{tag}> have the name '{twice}'; give each its own")
        for e in mesh.findall("NodeSet"):
            self.sets[self.name(e)] = self.node_set(e)
        self.surfaces = {self.name(e): self.surface(e) for e in mesh.findall("Surface")}
        names = DeckNames(
            rigid=self.rigid_bodies(mesh),
            named=self.named,
            listed=lambda e: self.nodes(e, [self.integer(n, n.get("id")) for n in e.findall("node[@id]")]),
            in_limb=frozenset(n for part in parts for n in np.unique(part.cells).tolist()),
        )
        conditions = DeckSupports(self.root, names).read()
        named_parts = {self.part_name(block, k) for k, block in enumerate(mesh.findall("Elements"))}
        named_parts |= {name for name, _ in self.materials().values()}  # not by their ids
        return Deck(
            points=points,
            parts=parts,
            node_sets=self.sets,
            surfaces=self.surfaces,
            rigid=self.rigid,
            supports=tuple(conditions.supports),
            touched=conditions.pressed(),
            warnings=tuple(conditions.warnings),
            absent=tuple(name for name in self.leave_out if name not in named_parts),
        )

    def named(self, name: str) -> IntArray | None:
        """Nodes of a set as a condition of a deck names it."""
        kind, _, rest = name.partition(":")
        mesh = self.mesh
        match kind:
            case "@surface":
                return self.surfaces.get(rest)
            case "@edge" | "@elem_set":
                tag = "Edge" if kind == "@edge" else "ElementSet"
                found = next((e for e in mesh.findall(tag) if e.get("name") == rest), None)
                if found is None:
                    return None
                if tag == "Edge":
                    return self.nodes(found, [n for e in found for n in self.integers(e, e.text)])
                wanted = set(self.set_numbers(found))
                every = mesh.iterfind("Elements/elem")
                return self.nodes_of(e for e in every if self.integer(e, e.get("id")) in wanted)
            case "@part_list":
                of = next((e for e in mesh.findall("PartList") if e.get("name") == rest), None)
                if of is None:
                    return None
                blocks = [(self.part_name(e, k), e) for k, e in enumerate(mesh.findall("Elements"))]
                parts = {part.strip() for part in (of.text or "").split(",")}
                if lost := sorted(parts - dict(blocks).keys()):
                    raise self.refused(f"part list '{rest}' names the part '{lost[0]}', which is not there")
                return self.nodes_of(e for p, of in blocks if p in parts for e in of.findall("elem"))
        return self.sets.get(name)

    def nodes_of(self, elements: Iterable[ET.Element]) -> IntArray:
        """Nodes of some elements, each once."""
        return np.unique([n for e in elements for n in self.nodes(e, self.integers(e, e.text))])

    def rigid_bodies(self, mesh: ET.Element) -> dict[str, IntArray]:
        """Nodes of each rigid body by the name and by the number of its material."""
        by_domain = {e.get("name"): e.get("mat") for e in self.root.iterfind("MeshDomains/*")}
        materials, found = self.materials(), dict[str, list[IntArray]]()
        for k, block in enumerate(mesh.findall("Elements")):
            name = self.part_name(block, k)
            material = materials.get(by_domain.get(name) or block.get("mat") or "", ("", ""))
            if material[1] == RIGID:
                cells = [self.nodes(e, self.integers(e, e.text)) for e in block.findall("elem")]
                self.rigid[name] = np.unique(np.concatenate(cells)) if cells else np.empty(0, dtype=np.int64)
                found.setdefault(material[0], []).append(self.rigid[name])
        bodies = {name: np.unique(np.concatenate(nodes)) for name, nodes in found.items()}
        return {alias: bodies[of[0]] for alias, of in materials.items() if of[0] in bodies}

    @staticmethod
    def part_name(block: ET.Element, k: int) -> str:
        return block.get("name") or block.get("elset") or f"elements {k + 1}"

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
        for k, block in enumerate(mesh.findall("Elements")):
            kind, name = block.get("type", ""), self.part_name(block, k)
            material = by_domain.get(name) or block.get("mat")
            if material is None or material not in materials:
                raise self.refused(f"elements '{name}' have no material (given: {material}); give them one")
            material, febio_type = materials[material]
            if febio_type == RIGID or {name, material} & set(self.leave_out):
                continue
            if kind not in CELLS and kind not in OTHER_SOLIDS:
                shell = "shells" if kind in SHELLS else f"of type {kind}"
                raise self.refused(
                    f"elements '{name}' are {shell}; palpate simulates {', '.join(CELLS)}. Mesh the limb "
                    "with these, or name other parts in the setting leave_out"
                )
            cells = [self.nodes(e, self.integers(e, e.text)) for e in block.findall("elem")]
            n_nodes = SOLIDS[OTHER_SOLIDS[kind]][1] if kind in OTHER_SOLIDS else CELLS[kind].n_nodes
            if not cells or any(len(c) != n_nodes for c in cells):
                raise self.refused(f"elements '{name}': {kind} wants {n_nodes} nodes in each")
            yield Part(name, kind, np.array(cells), material)

    def node_set(self, element: ET.Element) -> IntArray:
        """Nodes of a set, by their numbers and by the names of other sets."""
        found = []
        for child in element:
            other = child.get("node_set") or (child.get("name") if child.get("id") is None else None)
            if other is not None:
                nodes = self.named(other)
                if nodes is None:
                    raise self.refused(
                        f"node set '{element.get('name')}' names '{other}', which is not there"
                    )
                found.append(nodes)
        numbers = [self.integer(c, c.get("id")) for c in element if c.get("id") is not None]
        if len(element) and not numbers and not found:
            raise self.refused(f"node set '{element.get('name')}' has no ids; give each <n> an id")
        numbers += self.integers(element, element.text) if not len(element) else []
        return np.concatenate([*found, self.nodes(element, numbers)])

    def set_numbers(self, element: ET.Element) -> list[int]:
        """Nodes of a set, written as a list, or one <n id> or <node id> each as FEBio 3 did."""
        if len(element):
            return [self.integer(child, child.get("id")) for child in element]
        return self.integers(element, element.text)

    def surface(self, element: ET.Element) -> IntArray:
        found: set[int] = set()
        for face in element:
            if face.tag not in ("tri3", "tri6", "tri7", "quad4", "quad8"):
                raise self.refused(f"surface '{element.get('name')}' has a face <{face.tag}>")
            found.update(self.nodes(face, self.integers(face, face.text)).tolist())
        return np.array(sorted(found), dtype=np.int64)

    def materials(self) -> dict[str, tuple[str, str]]:
        """Name and FEBio's type of each material, by what the deck may call it."""
        found, written = dict[str, tuple[str, str]](), dict[str, str]()
        for element in self.root.iterfind("Material/material"):
            name, number = element.get("name") or f"material{element.get('id')}", element.get("id", "")
            text = " ".join(ET.tostring(element, encoding="unicode").split())
            for what, of in (("name", name), ("id", number)):
                if written.setdefault(f"{what} {of}", text) != text and of:
                    raise self.refused(f"two materials have the {what} '{of}'; give each its own")
            found[name] = name, element.get("type", "")
            found.setdefault(number, found[name])  # FEBio 3 may name it by number
        return found

    def nodes(self, element: ET.Element, numbers: list[int]) -> IntArray:
        try:
            return np.array([self.number[n] for n in numbers], dtype=np.int64)
        except KeyError as missing:
            what = element.get("name") or f"{element.tag} {element.get('id')}"
            raise self.refused(
                f"'{what}' names node {missing}, which is not there; write the deck again with all its nodes"
            ) from None

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
    """Refuse a deck that includes a file within a section, or names one outside of its own folder.

    Raises
    ------
    MeshError
    """
    for element in root.iter():
        if element.tag.lower() == "include":
            raise MeshError(
                f"{path}: <{element.tag}> within a section takes in another file; save the deck as one file"
            )
        # Attributes by which a deck names another file.
        for attribute in ("from", "file", "path"):
            named = element.get(attribute)
            if named is not None and not _inside(named):
                raise _outside(path, element, named)


def _outside(path: Path, element: ET.Element, named: str) -> MeshError:
    return MeshError(
        f"{path}: <{element.tag}> names {named!r}, which reaches outside the deck's folder; put the file "
        "next to the deck and name it alone"
    )


def _inside(named: str) -> bool:
    """True if a file's name stays in the folder: one plain name, no folder, drive or variable."""
    return bool(named) and not any(c in named for c in "/\\:~$%") and named not in (".", "..")
