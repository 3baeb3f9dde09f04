"""Nodes, elements, sets and surfaces of an input file of Abaqus or CalculiX, its instances put together.

Keywords, options and names are read as Abaqus does: without regard to case and blanks, lines continued
after a comma, nodes and elements in any number of blocks.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from palpate.api import MeshError

SOLIDS: Mapping[int, str] = MappingProxyType(
    {4: "tetra", 5: "pyramid", 6: "wedge", 8: "hexahedron", 10: "tetra10", 15: "wedge15", 20: "hexahedron20"}
)
SHELLS = re.compile(r"(?:STRI|SFM3D|M3D|R3D|CPS|CPE|DS|S)(\d)[A-Z0-9]*$")
FLAT: Mapping[int, str] = MappingProxyType({3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"})
NO_LIMB = re.compile(
    r"MASS|ROTARYI|SPRING|DASHPOT|CONN|T3D|B3|R2D|RB3D|DCOUP|HEATCAP|PIPE|JOINT|D?GAP|FRAME|US?\d+$|D$"
)
"""Elements that are no tissue: masses, springs, connectors, trusses, beams."""

FACES: Mapping[str, tuple[tuple[int, ...], ...]] = MappingProxyType(
    {
        "tetra": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
        "hexahedron": ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
        "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
        "pyramid": ((0, 1, 2, 3), (0, 4, 1), (1, 4, 2), (2, 4, 3), (3, 4, 0)),
    }
)
"""Corners of the faces S1, S2, … of each solid, without its midside nodes."""
EDGES: Mapping[str, tuple[tuple[int, int], ...]] = MappingProxyType(
    {
        "tetra": ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)),
        "hexahedron": (
            *((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)),
            *((0, 4), (1, 5), (2, 6), (3, 7)),
        ),
        "wedge": ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    }
)
"""Ends of the edges whose middles are the nodes after the corners."""

GENERATED = ("NGEN", "NFILL", "ELGEN", "NCOPY", "ELCOPY", "NMAP", "SYSTEM")


@dataclass(slots=True, eq=False)
class Keyword:
    """A keyword with its options, in capitals without blanks, and the cells of its data lines."""

    name: str
    options: dict[str, str]
    line: int
    rows: list[list[str]] = field(default_factory=list)


@dataclass(slots=True, eq=False)
class _Body:
    """A part, or the nodes of the assembly, in its own numbers."""

    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    elements: dict[str, dict[int, list[int]]] = field(default_factory=dict)
    node_sets: dict[str, set[int]] = field(default_factory=dict)
    element_sets: dict[str, set[int]] = field(default_factory=dict)


SOLID = ("tetra", "hexahedron", "wedge", "pyramid")
"""Beginnings of meshio's names of solid elements."""


class Model:
    """One reading of one file; numbers of nodes and elements are by instance and their number there."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.titles: dict[str, str] = {}
        self.bodies: dict[str, _Body] = {"": _Body()}
        self.instances: dict[str, tuple[str, list[list[str]]]] = {}
        self.later: list[tuple[str, Keyword]] = []
        self.left_out: dict[str, int] = {}
        self.unused: list[str] = []
        self.surfaces: dict[str, set[int]] = {}
        self.points: list[tuple[float, ...]] = []
        self.numbers: dict[tuple[str, int], int] = {}
        self.sets: dict[str, set[int]] = {}
        self.cells: dict[str, list[list[int]]] = {}
        self.owners: dict[tuple[str, int], tuple[str, int]] = {}
        self.groups: dict[str, set[tuple[str, int]]] = {}

    def refused(self, keyword: Keyword, what: str) -> MeshError:
        """Error that names a keyword and its line."""
        return MeshError(f"{self.path}: *{keyword.name} in line {keyword.line}: {what}")

    def read(self) -> "Model":
        """Read the file: parts, then sets and surfaces of the assembly, which may name anything."""
        part = ""
        for keyword in _keywords(self.path):
            match keyword.name:
                case "PART":
                    part = self.title(keyword, "NAME")
                    self.bodies.setdefault(part, _Body())
                case "ENDPART" | "ENDINSTANCE":
                    part = ""
                case "INSTANCE":
                    part = self.title(keyword, "PART")  # whose nodes may be in the instance
                    if part not in self.bodies:
                        raise self.refused(keyword, f"no part '{part}'; define the part before its instance")
                    self.instances[self.title(keyword, "NAME")] = (part, keyword.rows)
                case "NODE" if self.bodies[part].elements and len(self._instances_of(part)) > 1:
                    what = f"another instance of '{self.written(part)}' has nodes"
                    raise self.refused(keyword, f"{what}; write a part for each instance")
                case _ if keyword.name in GENERATED:
                    raise self.refused(keyword, "it makes nodes or elements; write all of them out")
                case _ if not self._define(self.bodies[part], keyword, part):
                    self.later.append((part, keyword))
        self._assemble()
        for part, keyword in self.later:
            match keyword.name:
                case "NSET" | "ELSET":
                    self._late_set(keyword)
                case "SURFACE":
                    self._surface(part, keyword)
        return self

    def title(self, keyword: Keyword, option: str) -> str:
        """Name of something in capitals; as it is written it is kept for messages."""
        written = keyword.options.get(option, "").strip("\"'")
        if not written:
            raise self.refused(keyword, f"it has no {option}; name it")
        self.titles.setdefault(written.upper(), written)
        return written.upper()

    # ------------------------------------------------------------------ parts

    def _define(self, body: _Body, keyword: Keyword, part: str) -> bool:
        """Read nodes, elements and sets of a part; False for any other keyword."""
        match keyword.name:
            case "NODE":
                self._nodes(body, keyword)
            case "ELEMENT":
                self._elements(body, keyword)
            case "NSET" if part and "INSTANCE" not in keyword.options:
                self._collect(keyword, "NSET", body.node_sets, body.element_sets, body)
            case "ELSET" if part and "INSTANCE" not in keyword.options:
                self._collect(keyword, "ELSET", body.element_sets, {}, body)
            case _:
                return False
        return True

    def _nodes(self, body: _Body, keyword: Keyword) -> None:
        if keyword.options.get("SYSTEM", "R").upper() not in ("", "R"):
            raise self.refused(keyword, "coordinates are cylindrical or spherical; write x, y and z")
        found = []
        for row in keyword.rows:
            number, *rest = [self.number(keyword, cell or "0") for cell in row]
            if number != int(number) or not rest or len(rest) > 6:
                raise self.refused(keyword, f"'{', '.join(row)}' is no node; write its number, x, y and z")
            body.nodes[int(number)] = (*rest, 0.0, 0.0)[:3] if len(rest) < 3 else tuple(rest[:3])  # type: ignore[assignment]
            found.append(int(number))
        if "NSET" in keyword.options:
            body.node_sets.setdefault(self.title(keyword, "NSET"), set()).update(found)

    def _elements(self, body: _Body, keyword: Keyword) -> None:
        kind = keyword.options.get("TYPE", "").upper()
        solid = re.fullmatch(r"(?:C3D|DC3D|AC3D)(\d+)[A-Z]*", kind)
        shell = SHELLS.fullmatch(kind)
        if solid and int(solid[1]) in SOLIDS:
            meshio, n = SOLIDS[int(solid[1])], int(solid[1])
        elif shell and int(shell[1]) in FLAT:
            meshio, n = FLAT[int(shell[1])], int(shell[1])
        elif NO_LIMB.match(kind):
            self.left_out[kind] = self.left_out.get(kind, 0) + len(keyword.rows)
            if "ELSET" in keyword.options:
                body.element_sets.setdefault(self.title(keyword, "ELSET"), set())
            return
        else:
            raise self.refused(
                keyword,
                f"elements of type {kind or 'unknown'} are not understood; mesh the limb with C3D4, C3D10 or "
                "C3D8, and delete other elements",
            )
        if kind.startswith("R3D"):  # a rigid surface, whose sets may name nodes of the limb
            self.left_out[kind] = self.left_out.get(kind, 0) + len(keyword.rows)
        cells = [int(self.number(keyword, cell)) for row in keyword.rows for cell in row if cell]
        if len(cells) % (n + 1):
            raise self.refused(keyword, f"{kind} wants {n} nodes in each element; write the mesh again")
        own = body.elements.setdefault(meshio, {})
        for start in range(0, len(cells), n + 1):
            own[cells[start]] = cells[start + 1 : start + n + 1]
        if "ELSET" in keyword.options:
            members = body.element_sets.setdefault(self.title(keyword, "ELSET"), set())
            members.update(cells[:: n + 1])

    def _collect(
        self,
        keyword: Keyword,
        option: str,
        sets: dict[str, set[int]],
        of_elements: Mapping[str, set[int]],
        body: _Body,
    ) -> None:
        """Add to a set of a part: numbers, ranges, and sets by name."""
        members = sets.setdefault(self.title(keyword, option), set())
        if "ELSET" in keyword.options and option == "NSET":
            chosen = of_elements.get(self.title(keyword, "ELSET"), set())
            members.update(n for of in body.elements.values() for e in chosen if e in of for n in of[e])
        for row in self._ranges(keyword):
            for member in row:
                if isinstance(member, int):
                    members.add(member)
                elif member not in sets:
                    raise self.refused(
                        keyword, f"no set '{self.titles.get(member, member)}'; define it first"
                    )
                else:
                    members.update(sets[member])

    def _ranges(self, keyword: Keyword) -> Iterator[Sequence[int | str]]:
        """Members of each data line: numbers, or names in capitals."""
        for row in keyword.rows:
            members = [self.member(cell) for cell in row if cell]
            if "GENERATE" not in keyword.options:
                yield members
                continue
            if len(members) not in (2, 3) or not all(isinstance(m, int) for m in members):
                raise self.refused(keyword, f"'{', '.join(row)}' is no range; write first, last and step")
            first, last, step = (*members, 1)[:3]
            yield range(int(first), int(last) + 1, max(1, int(step)))

    def member(self, cell: str) -> int | str:
        """Number, or name in capitals, that a cell holds."""
        written = cell.strip("\"'")
        self.titles.setdefault(written.upper(), written)
        return int(written) if re.fullmatch(r"\+?\d+", written) else written.upper()

    def number(self, keyword: Keyword, cell: str) -> float:
        """Number that a cell holds, with an exponent of Fortran too."""
        try:
            found = float(re.sub(r"[dD]", "e", cell))
        except ValueError:
            raise self.refused(keyword, f"'{cell[:30]}' is no number; correct it") from None
        return found

    # --------------------------------------------------------------- assembly

    def _assemble(self) -> None:
        """Number nodes and elements of all instances through."""
        placed = self.instances or {name: (name, []) for name in self.bodies if name}
        for instance, (part, rows) in {"": ("", []), **placed}.items():
            body = self.bodies[part]
            move = self._motion(rows)
            for number, point in body.nodes.items():
                self.numbers[instance, number] = len(self.points)
                self.points.append(tuple(move[:, :3] @ point + move[:, 3]))
            for kind, cells in body.elements.items():
                own = self.cells.setdefault(kind, [])
                for number, nodes in cells.items():
                    self.owners[instance, number] = (kind, len(own))
                    own.append([self.node(instance, n, f"element {number}") for n in nodes])
            for name, nodes_of in body.node_sets.items():
                found = {self.numbers[instance, n] for n in nodes_of if (instance, n) in self.numbers}
                if len(found) < len(nodes_of):
                    self.unused.append(
                        f"node set '{self.written(name)}' names {len(nodes_of) - len(found)} nodes that are "
                        "not there; they are ignored"
                    )
                for key in _keys(instance, name):
                    self.sets.setdefault(key, set()).update(found)
            for name, elements in body.element_sets.items():
                for key in _keys(instance, name):
                    self.groups.setdefault(key, set()).update((instance, e) for e in elements)

    def node(self, instance: str, number: int, what: str) -> int:
        """Index of a node of an instance, which ``what`` names."""
        found = self.numbers.get((instance, number))
        if found is None:
            raise MeshError(
                f"{self.path}: {what} names node {number}, which is not there; write the mesh again"
            )
        return found

    def _motion(self, rows: Sequence[Sequence[str]]) -> NDArray[np.float64]:
        """Motion (3, 4) of an instance: a translation, then a rotation about a line by degrees."""
        move = np.eye(3, 4)
        values = [[float(cell or 0) for cell in row] for row in rows if row]
        if values:
            move[:, 3] = (*values[0], 0.0, 0.0, 0.0)[:3]
        if len(values) > 1 and len(values[1]) >= 7:
            a, b, angle = np.array(values[1][:3]), np.array(values[1][3:6]), np.deg2rad(values[1][6])
            k = (b - a) / np.linalg.norm(b - a)
            cross = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
            turn = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
            move = np.column_stack([turn, turn @ (move[:, 3] - a) + a])
        return move

    def written(self, name: str) -> str:
        """Name of a set as the file writes it, with the name of its instance before a point."""
        return ".".join(self.titles.get(word, word) for word in name.split("."))

    def _late_set(self, keyword: Keyword) -> None:
        option = keyword.name
        instance = self.title(keyword, "INSTANCE") if "INSTANCE" in keyword.options else ""
        name, sets = self.title(keyword, option), self.sets if option == "NSET" else self.groups
        members: set[object] = sets.setdefault(name, set())  # type: ignore[assignment]
        absent = 0
        if option == "NSET" and "ELSET" in keyword.options:
            members |= self.nodes_of_elements(self.groups.get(self.title(keyword, "ELSET"), set()))
        for row in self._ranges(keyword):
            for member in row:
                if isinstance(member, int):
                    if option == "ELSET":
                        members.add((instance, member))
                    elif (instance, member) in self.numbers:
                        members.add(self.numbers[instance, member])
                    else:
                        absent += 1
                    continue
                found = sets.get(f"{instance}.{member}" if instance else member, sets.get(member))
                if found is None and isinstance(member, str) and option == "NSET":
                    head, _, tail = member.rpartition(".")
                    found = {self.node(head, int(tail), name)} if tail.isdigit() else None
                if found is None:
                    raise self.refused(keyword, f"no set '{self.written(str(member))}'; define it first")
                members |= found
        if absent:
            self.unused.append(
                f"node set '{self.written(name)}' names {absent} nodes that are not there; they are ignored"
            )

    def nodes_of_elements(self, members: set[tuple[str, int]]) -> set[int]:
        """Nodes of elements, by instance and number."""
        return {
            n for e in members if e in self.owners for n in self.cells[self.owners[e][0]][self.owners[e][1]]
        }

    def _surface(self, part: str, keyword: Keyword) -> None:
        """Nodes of a surface: of the faces of elements, of shells, or of a node set."""
        name = self.title(keyword, "NAME")
        found = self.surfaces.setdefault(name, set())
        if keyword.options.get("TYPE", "ELEMENT").upper() not in ("ELEMENT", "NODE"):
            return  # of an analytical tool, by its lines and arcs
        for row in keyword.rows:
            member, face = self.member(row[0]), (row[1].upper() if len(row) > 1 else "")
            for instance in self._instances_of(part):
                found |= self._of_surface(instance, member, face, keyword)

    def _instances_of(self, part: str) -> list[str]:
        return [i for i, (p, _) in self.instances.items() if p == part] if self.instances and part else [part]

    def _of_surface(self, instance: str, member: int | str, face: str, keyword: Keyword) -> set[int]:
        if keyword.options.get("TYPE", "ELEMENT").upper() == "NODE":
            if isinstance(member, int):
                return {self.node(instance, member, "a surface")}
            return self.sets.get(f"{instance}.{member}", self.sets.get(member, set()))
        elements = {(instance, member)} if isinstance(member, int) else None
        if elements is None:
            elements = self.groups.get(f"{instance}.{member}", self.groups.get(str(member)))
        if elements is None:
            raise self.refused(keyword, f"no element set '{self.written(str(member))}'; define it")
        chosen = [self.owners[e] for e in elements if e in self.owners]
        side = re.fullmatch(r"S(\d)", face)
        return {
            n
            for kind, row in chosen
            for n in _face(kind, self.cells[kind][row], int(side[1]) - 1 if side else None)
        }


def _keys(instance: str, name: str) -> tuple[str, ...]:
    """Names of a set of a part: its own, and with its instance."""
    return (name, f"{instance}.{name}") if instance else (name,)


def _face(kind: str, nodes: list[int], face: int | None) -> list[int]:
    """Nodes of a face of an element, those in the middle of its edges too; all nodes of a shell."""
    base = kind.rstrip("0123456789")
    if base not in FACES or face is None or face >= len(FACES[base]):
        return nodes
    corners = FACES[base][face]
    n = {"tetra": 4, "pyramid": 5, "wedge": 6, "hexahedron": 8}[base]
    middles = [n + k for k, ends in enumerate(EDGES.get(base, ())) if set(ends) <= set(corners)]
    return [nodes[k] for k in (*corners, *(m for m in middles if m < len(nodes)))]


def _keywords(path: Path, by: frozenset[Path] = frozenset()) -> Iterator[Keyword]:
    """Keywords of a file with their data lines; keywords of included files stand in their place."""
    current: Keyword | None = None
    open_line = False
    for number, text in _lines(path):
        if text.startswith("*") and len(text) > 1:
            if current is not None:
                yield from _given(path, current, by)
            current, open_line = Keyword("", {}, number), True
            text = text[1:]
        if current is not None and open_line:
            _add_options(current, text)
            open_line = text.endswith(",")
        elif current is not None:
            current.rows.append(_cells(text))
    if current is not None:
        yield from _given(path, current, by)


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Lines of a file that are neither empty nor a comment, with their numbers."""
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").split("\n"), 1):
        if (text := line.strip()) and not text.startswith("**"):
            yield number, text


def _cells(text: str) -> list[str]:
    cells = [cell.strip() for cell in text.split(",")]
    return cells[:-1] if cells[-1] == "" else cells


def _given(path: Path, keyword: Keyword, by: frozenset[Path]) -> Iterator[Keyword]:
    """Keyword with its data lines, also lines of another file, or the keywords that it includes."""
    # Keywords whose data lines may be in a file of their own.
    if keyword.name != "INCLUDE" and not (
        keyword.name in ("NODE", "ELEMENT", "NSET", "ELSET") and "INPUT" in keyword.options
    ):
        yield keyword
        return
    other = path.parent / keyword.options.get("INPUT", "").strip("\"'")
    if not other.is_file() or other in by:
        raise MeshError(
            f"{path}: *{keyword.name} in line {keyword.line}: no such file '{other.name}'; put it next to it"
        )
    if keyword.name == "INCLUDE":
        yield from _keywords(other, by | {path})
    else:
        keyword.rows += [_cells(text) for _, text in _lines(other)]
        yield keyword


def _add_options(keyword: Keyword, text: str) -> None:
    words = [word.strip() for word in text.split(",")]
    if not keyword.name:
        keyword.name = re.sub(r"\s", "", words.pop(0)).upper()
    for word in filter(None, words):
        key, _, value = word.partition("=")
        keyword.options[re.sub(r"\s", "", key).upper()] = value.strip()
