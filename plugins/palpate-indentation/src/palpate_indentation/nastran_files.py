"""Bulk data of Nastran (``.bdf``, ``.nas``, ``.fem``) as contents of a mesh file.

Cards may be free, small or large fields. Elements of one property are a group; ``SPC``, ``SPC1`` and the
permanent constraints of ``GRID`` are the supports.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from palpate.api import MeshError
from palpate.api.mesh import SOLIDS as BRICKS, Support
from palpate_indentation.mesh_content import MeshFile, ordered

SHAPES: Mapping[str, tuple[str, str, int, int]] = MappingProxyType(
    {
        "CTETRA": ("tetra", "tetra10", 4, 10),
        "CHEXA": ("hexahedron", "hexahedron20", 8, 20),
        "CPENTA": ("wedge", "wedge15", 6, 15),
        "CPYRAM": ("pyramid", "pyramid13", 5, 13),
        "CPYRA": ("pyramid", "pyramid13", 5, 13),
        "CTRIA3": ("triangle", "", 3, 0),
        "CTRIA6": ("triangle", "triangle6", 3, 6),
        "CQUAD4": ("quad", "", 4, 0),
        "CQUAD8": ("quad", "quad8", 4, 8),
    }
)
"""meshio's kinds without and with midside nodes of each card, and their numbers of nodes."""


def read_nastran(path: Path) -> MeshFile:
    """Contents of bulk data, from ``BEGIN BULK`` (if any) to ``ENDDATA``.

    Raises
    ------
    MeshError
        A card is cut off or has a coordinate system of its own; it names the line.
    """
    return _Bulk(path).content()


class _Bulk:
    """Nodes, elements and constraints of a file, by the numbers that it gives them."""

    def __init__(self, path: Path) -> None:
        self.path = path
        text = path.read_text(encoding="utf-8", errors="replace")
        # Femap and HyperMesh name a property in a comment.
        named = r'(?im)^\$ *(?:Femap Property|HMNAME PROP) +(\d+) *:? *"?([^"\n]+)'
        self.names = {int(number): name.strip() for number, name in re.findall(named, text)}
        self.points: dict[int, tuple[float, ...]] = {}
        self.cells: dict[str, list[list[int]]] = {}
        self.properties: dict[str, list[int]] = {}
        # Name of a constraint, the number of its set (0: always active) and the axes that it holds.
        self.held: dict[tuple[str, int, str], list[int]] = {}
        self.moved: set[tuple[str, int]] = set()
        self.sums: dict[int, set[int]] = {}
        case = re.split(r"(?im)^\s*begin\s+bulk", text)
        self.selected = {int(n) for n in re.findall(r"(?im)^ *SPC[ =]+(\d+)", case[0] if case[1:] else "")}
        # Line and coordinate system of displacements of nodes that have one.
        self.turned: dict[int, tuple[int, str]] = {}
        self.left_out: dict[str, int] = {}
        for self.line, name, cells in _cards(text):
            try:
                self._card(name, cells)
            except (ValueError, IndexError):
                raise self.refused(f"{name} cannot be read; write the file again") from None

    def refused(self, what: str) -> MeshError:
        """Error that names the line."""
        return MeshError(f"{self.path}: line {self.line}: {what}")

    def _card(self, name: str, cells: list[str]) -> None:
        if name == "GRID":
            self._node(cells)
        elif name == "GRDSET" and {cells[1], cells[5], cells[6]} - {"", "0"}:
            raise self.refused("GRDSET has defaults of nodes; write systems and constraints into each GRID")
        elif name in SHAPES:
            self._element(name, cells)
        elif name == "SPC":
            for node, axes, value in zip(cells[1::3], cells[2::3], cells[3::3], strict=False):
                if node:
                    self._hold("SPC", int(cells[0]), axes, [int(node)], _number(value or "0"))
        elif name == "SPC1":
            self._hold("SPC1", int(cells[0]), cells[1], _spans(cells[2:]), 0.0)
        elif name == "SPCADD":
            self.sums[int(cells[0])] = {int(n) for n in cells[1:] if n}
        elif name == "INCLUDE":
            raise self.refused("INCLUDE takes in another file; write the bulk data as one file")
        elif re.match("RBE|RBAR|RROD|CELAS|CBUSH|CROD|CBAR|CBEAM|MPC", name):
            self.left_out[name] = self.left_out.get(name, 0) + 1

    def _node(self, cells: list[str]) -> None:
        number, system, *rest = [*cells, *[""] * 7][:7]
        if system not in ("", "0"):
            raise self.refused(
                f"node {number} is in coordinate system {system}; export the nodes in the basic system"
            )
        self.points[int(number)] = tuple(_number(x or "0") for x in rest[:3])
        if rest[3] not in ("", "0"):
            self.turned[int(number)] = self.line, rest[3]
        if rest[4] not in ("", "0"):
            self._hold("GRID", 0, rest[4], [int(number)], 0.0)

    def _element(self, name: str, cells: list[str]) -> None:
        linear, quadratic, n_corners, n_nodes = SHAPES[name]
        nodes = [int(x) if x else 0 for x in cells[2 : 2 + max(n_nodes, n_corners)]]
        is_linear = not any(nodes[n_corners:])
        nodes = nodes[:n_corners] if is_linear else nodes
        if not all(nodes) or len(nodes) != (n_corners if is_linear else n_nodes):
            raise self.refused(
                f"{name} {cells[0]} lacks nodes; write all nodes in the middle of its edges, or none"
            )
        kind = linear if is_linear else quadratic
        self.cells.setdefault(kind, []).append(nodes)
        self.properties.setdefault(kind, []).append(int(cells[1] or cells[0]))

    def _hold(self, card: str, number: int, components: str, nodes: list[int], value: float) -> None:
        axes = "".join("xyz"[int(c) - 1] for c in components if c in "123")
        name = f"{card} {number}" if number else card
        if value:
            self.moved.add((name, number))
        elif axes:
            self.held.setdefault((name, number, axes), []).extend(nodes)

    def _active(self, warnings: list[str]) -> set[int]:
        """Numbers of the sets that the case control selects, else of all, with a warning if in doubt."""
        every = ({n for _, n, _ in self.held} | {n for _, n in self.moved}) - {0}
        active = set[int]().union(*(self.sums.get(n, {n}) for n in self.selected)) or every
        if len(self.selected) > 1 or (not self.selected and len(every) > 1):
            numbers = ", ".join(map(str, sorted(self.selected or every)))
            warnings.append(
                f"the case control selects {'several sets' if self.selected else 'no set'} of constraints, "
                f"so sets {numbers} hold the limb together; keep the one set of the test"
            )
        if unused := every - active:
            numbers = ", ".join(map(str, sorted(unused)))
            warnings.append(f"SPC {numbers}: not used, since the case control selects another set")
        return active | {0}

    def _check_axes(self, active: set[int]) -> None:
        """Refuse nodes that are held along some axes of a system of their own."""
        axes_of: dict[int, str] = {}
        for (_, number, axes), nodes in self.held.items():
            for node in self.turned.keys() & set(nodes) if number in active else ():
                axes_of[node] = axes_of.get(node, "") + axes
        for node, axes in axes_of.items():
            self.line, system = self.turned[node]
            if set(axes) != {*"xyz"}:
                raise self.refused(
                    f"node {node} is held in some axes of coordinate system {system}; hold it in 123, or "
                    "write its constraint in the basic system"
                )

    def content(self) -> MeshFile:
        index = {number: k for k, number in enumerate(self.points)}
        warnings = list[str]()
        active = self._active(warnings)
        warnings += [
            f"{name} moves nodes; it is no support and is not used, since the protocol moves the indenter"
            for name, number in sorted(self.moved)
            if number in active
        ]
        self._check_axes(active)
        supports = []
        for name, axes, numbers in (
            (name, axes, of) for (name, n, axes), of in self.held.items() if n in active
        ):
            there = sorted({index[n] for n in numbers if n in index})
            supports.append(Support(name=name, nodes=np.array(there, dtype=np.int64), axes=axes))
            if absent := len(set(numbers) - index.keys()):
                warnings.append(f"{name} names {absent} nodes that are not there; they are ignored")
        if self.left_out:
            cards = ", ".join(f"{n} {name}" for name, n in self.left_out.items())
            warnings.append(f"not used: {cards}; if they hold the limb, name held nodes as `fixed`")
        try:
            blocks = tuple(
                (kind, ordered(kind, np.array([[index[n] for n in nodes] for nodes in of], dtype=np.int64)))
                for kind, of in self.cells.items()
            )
        except KeyError as error:
            raise MeshError(f"{self.path}: an element names node {error}, which is not there") from None
        return MeshFile(
            points=np.array([*self.points.values()], dtype=np.float64).reshape(-1, 3),
            blocks=blocks,
            cell_data={"nastran:ref": tuple(np.array(of) for of in self.properties.values())},
            cell_sets=self._groups(),
            supports=tuple(supports),
            warnings=tuple(warnings),
        )

    def _groups(self) -> dict[str, tuple[NDArray[np.int64], ...]]:
        """Rows of the properties of each name in each block; faces of a name of solids are apart."""
        names = {
            n: self.names.get(n, f"property {n}") for n in sorted(set().union(*self.properties.values()))
        }
        found = {}
        for name in dict.fromkeys(names.values()):
            rows = {
                kind: np.flatnonzero([names[n] == name for n in of]) for kind, of in self.properties.items()
            }
            has_solids = any(len(of) for kind, of in rows.items() if kind in BRICKS)
            for title, is_solid in ((name, has_solids), (f"{name} (faces)" if has_solids else name, False)):
                members = tuple(of if (kind in BRICKS) == is_solid else of[:0] for kind, of in rows.items())
                if any(map(len, members)):
                    found[title] = members
        return found


def _cards(text: str) -> Iterator[tuple[int, str, list[str]]]:
    """Line, name and cells of each card, with the cells of its continuations."""
    lines = text.split("\n")
    begin = next((k for k, line in enumerate(lines, 1) if re.match(r"(?i)\s*begin\s+bulk", line)), 0)
    card: tuple[int, str, list[str]] | None = None
    for number, line in enumerate(lines[begin:], begin + 1):
        content = line.split("$")[0].rstrip()
        if not content:
            continue
        first, cells = _fields(content)
        if card is not None and (not first or first[0] in "+*"):
            card[2].extend(cells)
            continue
        if card is not None:
            yield card
        card = number, first.rstrip("*").upper(), cells
        if card[1] == "ENDDATA":
            return
    if card is not None:
        yield card


def _fields(line: str) -> tuple[str, list[str]]:
    """First field of a line, and its data: eight cells, or four of a large field."""
    if "," in line:
        first, *cells = (cell.strip() for cell in line.split(","))
        n = 4 if "*" in first else 8
    else:
        line = line.expandtabs(8)
        first, width = line[:8].strip(), 16 if "*" in line[:8] else 8
        n = 64 // width
        cells = [line[start : start + width].strip() for start in range(8, 8 + 64, width)]
    return first, [*cells, *[""] * n][:n]


def _number(text: str) -> float:
    """Number in Nastran's spelling, such as 1.5-3 for 0.0015."""
    return float(re.sub(r"(?<=[\d.])([+-]\d+)$", r"E\1", text.upper().replace("D", "E")))


def _spans(cells: Sequence[str]) -> list[int]:
    """Whole numbers of a list with spans such as 1 THRU 25."""
    words, found = [cell.upper() for cell in cells if cell], list[int]()
    for k, word in enumerate(words):
        if word == "THRU":
            found += range(int(words[k - 1]) + 1, int(words[k + 1]))
        else:
            found.append(int(word))
    return found
