"""Blocked archives of Ansys Mechanical APDL (CDWRITE, ``.cdb``) as contents of a mesh file.

Blocks of elements have one record for every kind of solid: an element of fewer corners repeats nodes of the
brick. Components are the sets; commands ``D`` on nodes and on components are the supports.
"""

import re
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType

import numpy as np

from palpate.api import MeshError
from palpate.api.mesh import SOLIDS as BRICKS, Support
from palpate_indentation.mesh_content import MeshFile

SOLIDS = frozenset({45, 62, 64, 65, 72, 73, 92, 95, 185, 186, 187, 190, 285, 5, 69, 70, 87, 90, 98, 226, 227})
"""Numbers of Ansys' solid elements, those of heat and coupled fields too."""
AXES: Mapping[str, str] = MappingProxyType({"UX": "x", "UY": "y", "UZ": "z", "ALL": "xyz"})
_SHAPES: tuple[tuple[str, str, tuple[int, ...], tuple[int, ...]], ...] = (
    ("tetra", "tetra10", (0, 1, 2, 4), (8, 9, 11, 16, 17, 18)),
    ("pyramid", "pyramid13", (0, 1, 2, 3, 4), (8, 9, 10, 11, 16, 17, 18, 19)),
    ("wedge", "wedge15", (0, 1, 2, 4, 5, 6), (8, 9, 11, 12, 13, 15, 16, 17, 18)),
    ("hexahedron", "hexahedron20", (0, 1, 2, 3, 4, 5, 6, 7), tuple(range(8, 20))),
)
"""Kinds of meshio without and with midside nodes, and the nodes of the brick that are corners and middles."""
_FORMAT = re.compile(r"(\d*)([iaeg])(\d+)", re.IGNORECASE)
_HEADER_FIELDS = 11


class _Archive:
    """Nodes, elements, components and conditions of a file, by the numbers that it gives them."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.types: dict[int, int] = {}
        self.index: dict[int, int] = {}
        self.middles: dict[tuple[int, int], int] = {}
        self.points: list[tuple[float, float, float]] = []
        self.cells: dict[str, list[list[int]]] = {}
        self.tags: dict[str, list[tuple[int, int, int, int]]] = {}
        self.other: dict[str, int] = {}
        self.components: dict[tuple[str, str], list[int]] = {}
        self.held: dict[tuple[str, str], list[int]] = {}
        self.warnings: list[str] = []
        self.selected: set[int] | None = set()  # None: by a command that is not read
        self._lines = self._numbered()
        self._line = 0
        for line in self._lines:
            self._command([cell.strip() for cell in line.split("!")[0].split(",")])

    def _numbered(self) -> Iterator[str]:
        with self.path.open(encoding="utf-8", errors="replace") as stream:
            for self._line, text in enumerate(stream, 1):
                yield text.rstrip("\r\n")

    def refused(self, what: str) -> MeshError:
        """Error that names the line."""
        return MeshError(f"{self.path}: line {self._line}: {what}")

    def _command(self, cells: list[str]) -> None:
        match cells[0].upper(), *cells[1:]:
            case "ET", number, kind, *_:
                self.types[int(number)] = int(re.sub(r"\D", "", kind) or 0)
            case "ETBLOCK", *_:
                for row in self._rows():
                    self.types[row[0]] = row[1]
            case "NBLOCK", *_:
                self._nodes()
            case "EBLOCK", _, *of:
                self._elements(is_solid=bool(of) and of[0].upper() == "SOLID")
            case "CMBLOCK", name, kind, count, *_:
                self._component(name.upper(), kind.upper(), int(count))
            case ("ALLSEL", *_) | ("NSEL", "ALL", *_):
                self.selected = {*self.index}
            case (("CMSEL" | "NSEL" | "NSLE" | "NSLA" | "NSLK" | "NSLL" | "NSLV") as command, *names):
                self._select(command, *map(str.upper, names))
            case "D", where, axis, *more:
                value, _, last, step, *axes = [*more, *[""] * 4]
                for each in filter(AXES.__contains__, map(str.upper, (axis, *axes))):
                    self._condition(where.upper(), each, value, last, step)
            case ("N", first, *_) | ("EN", first, *_) if first.isdigit() and not self.points:
                raise self.refused(
                    "nodes by single commands; write the archive in the blocked format of CDWRITE"
                )

    def _ends(self) -> tuple[list[int], int]:
        """Ends of the fields of a line by its Fortran format, and how many of them are whole numbers."""
        fields = [
            (kind.lower(), int(width))
            for n, kind, width in _FORMAT.findall(next(self._lines, ""))
            for _ in range(int(n or 1))
        ]
        if not fields:
            raise self.refused("no Fortran format such as (3i9,6e21.13e3); write the archive again")
        ends = np.cumsum([0, *(width for _, width in fields)]).tolist()
        return ends, sum(kind == "i" for kind, _ in fields)

    def _rows(self) -> Iterator[list[int]]:
        """Whole numbers of the lines of a block, which ends with -1 or with a command."""
        ends, _ = self._ends()
        for line in self._lines:
            if line.lstrip().startswith("-1") or line[:1].strip(" -0123456789"):
                return
            cells = (line[a:b].strip() for a, b in pairwise(ends))
            yield [int(cell) for cell in cells if re.fullmatch(r"-?\d+", cell)]

    def _nodes(self) -> None:
        ends, n_whole = self._ends()
        for line in self._lines:
            if not line[: ends[1]].strip().isdigit():
                return
            cells = [line[a:b].strip() for a, b in pairwise(ends[n_whole : n_whole + 4])]
            try:
                x, y, z = (float(cell.upper().replace("D", "E") or 0.0) for cell in cells)
            except ValueError:
                raise self.refused("a coordinate is no number; write the archive again") from None
            self.index[int(line[: ends[1]])] = len(self.points)
            self.points.append((x, y, z))

    def _elements(self, *, is_solid: bool) -> None:
        open_cell: tuple[int, list[int]] | None = None
        for row in self._rows():
            if not is_solid:
                self._leave_out(f"type {row[1]} without nodes of a solid")
            elif open_cell is None:
                if len(row) < _HEADER_FIELDS:
                    raise self.refused("an element of fewer than 11 fields; write the archive again")
                open_cell = (row[8], row)
            else:
                open_cell[1].extend(row)
            if open_cell is not None and len(open_cell[1]) >= _HEADER_FIELDS + open_cell[0]:
                self._element(open_cell[1])
                open_cell = None
        if open_cell is not None:
            raise self.refused("the last element has too few nodes; the file may be cut off: write it again")

    def _element(self, row: list[int]) -> None:
        """One element; nodes of a tetrahedron are the eight of a degenerate brick, or its own four."""
        kind, nodes = self.types.get(row[1], 0), row[_HEADER_FIELDS:]
        if kind not in SOLIDS:
            self._leave_out(f"SOLID{kind}" if not kind else f"{kind}")
            return
        # Midside nodes that are left out at the end of a record are not written.
        usual = (10,) if kind in frozenset({87, 92, 98, 187, 227}) else (4, 8, 20)
        n_nodes = next((n for n in usual if n >= len(nodes)), 0)
        nodes += [0] * (n_nodes - len(nodes))
        if len(nodes) in (4, 10):
            shape = "tetra" if len(nodes) == 4 else "tetra10"
        elif len(nodes) in (8, 20):
            n_corners = len(dict.fromkeys(nodes[:8]))
            found = next((each for each in _SHAPES if len(each[2]) == n_corners), None)
            if found is None or len({nodes[k] for k in found[2]}) != n_corners:
                raise self.refused(f"an element of {n_corners} corners, which is no solid; remesh it")
            linear, quadratic, corners, middles = found
            shape = linear if len(nodes) == 8 else quadratic
            nodes = [nodes[k] for k in (corners if len(nodes) == 8 else corners + middles)]
        else:
            raise self.refused(f"an element of {len(nodes)} nodes; palpate reads solids of 4, 8, 10 and 20")
        if 0 in nodes:
            ends = [(nodes[a], nodes[b]) for a, b in BRICKS[shape][0].edges]
            n_corners = len(nodes) - len(ends)
            nodes = [node or self._middle(*ends[k - n_corners]) for k, node in enumerate(nodes)]
        self.cells.setdefault(shape, []).append(nodes)
        self.tags.setdefault(shape, []).append((row[10], row[0], row[1], row[3]))

    def _middle(self, first: int, second: int) -> int:
        """Number of a node in the middle of an edge that has none."""
        ends = (min(first, second), max(first, second))
        if ends not in self.middles:
            self.middles[ends] = -1 - len(self.middles)
            self.index[self.middles[ends]] = len(self.points)
            a, b = (np.array(self.points[self.index[end]]) for end in ends)
            self.points.append(tuple((0.5 * (a + b)).tolist()))
        return self.middles[ends]

    def _leave_out(self, what: str) -> None:
        self.other[what] = self.other.get(what, 0) + 1

    def _component(self, name: str, kind: str, count: int) -> None:
        found: list[int] = []
        ends, _ = self._ends()
        n_read = 0
        while n_read < count:
            line = next(self._lines, "")
            cells = [line[a:b].strip() for a, b in pairwise(ends)]
            values = [int(cell) for cell in cells if re.fullmatch(r"-?\d+", cell)]
            if not values:
                raise self.refused(f"component '{name}' has {n_read} of {count} numbers; write it again")
            for value in values:  # a negative number ends a range
                found.extend(range(found[-1] + 1, -value + 1) if value < 0 and found else [value])
            n_read += len(values)
        self.components.setdefault((name, kind), []).extend(found)

    def _select(self, command: str, how: str = "S", name: str = "", *_: str) -> None:
        """Select a component's nodes, or those with, without or among the selected; None if not read."""
        nodes, now = {*self.components.get((name, "NODE"), ())}, self.selected
        found = {"S": nodes, "": nodes}
        found |= {} if now is None else {"A": now | nodes, "U": now - nodes, "R": now & nodes}
        self.selected = found.get(how) if command == "CMSEL" else None

    def _condition(self, where: str, axis: str, value: str, last: str, step: str) -> None:
        named, nodes = self.components.get((where, "NODE")), list[int]()
        if where in ("ALL", "P"):
            nodes = sorted(self.selected or ())
        elif where.isdigit():
            end = int(last) if last.isdigit() else int(where)
            nodes = [*range(int(where), end + 1, max(1, int(step) if step.isdigit() else 1))]
        nodes = named or nodes
        # A parameter or a table may be any number.
        if not (nodes and re.fullmatch(r"([-+]?(0+\.?0*|\.0+)([ED][-+]?\d+)?)?", value.upper())):
            what = f"moves {len(nodes)} nodes" if nodes else f"names '{where}', which no component is"
            if where in ("ALL", "P") and not nodes:
                what = "holds nodes of a selection that is not read,"
            self.warnings.append(
                f"D,{where},{axis} in line {self._line} {what} and is not used; name held nodes as `fixed`"
            )
            return
        self.held.setdefault((where if named or where == "ALL" else "", AXES[axis]), []).extend(nodes)


def read_ansys(path: Path) -> MeshFile:
    """Contents of a blocked archive.

    Raises
    ------
    MeshError
        Something cannot be read; with the line, and what to do.
    """
    archive = _Archive(path)
    index = archive.index
    try:
        blocks = tuple(
            (kind, np.array([[index[n] for n in nodes] for nodes in cells], dtype=np.int64))
            for kind, cells in archive.cells.items()
        )
    except KeyError as error:
        raise MeshError(
            f"{path}: an element names node {error.args[0]}, which is in no NBLOCK; write the nodes too"
        ) from None
    tags = {kind: np.array(rows, dtype=np.int64) for kind, rows in archive.tags.items()}
    names = ("material", "type", "section")
    supports = tuple(
        Support(name=f"D{',' if where else ''}{where}", nodes=_rows(index, nodes), axes=axes)
        for (where, axes), nodes in archive.held.items()
    )
    return MeshFile(
        points=np.array(archive.points, dtype=np.float64).reshape(-1, 3),
        blocks=blocks,
        cell_data={name: tuple(tags[kind][:, k] for kind, _ in blocks) for k, name in enumerate(names, 1)},
        point_sets={
            name: _rows(index, nodes) for (name, kind), nodes in archive.components.items() if kind == "NODE"
        },
        cell_sets={
            name: tuple(np.flatnonzero(np.isin(tags[kind][:, 0], members)) for kind, _ in blocks)
            for (name, of), members in archive.components.items()
            if of.startswith("ELEM") and any(np.isin(tags[kind][:, 0], members).any() for kind, _ in blocks)
        },
        supports=supports,
        remarks=tuple(
            f"{n} elements of Ansys' {what} are no tissue and are left out"
            for what, n in archive.other.items()
        ),
        warnings=tuple(archive.warnings),
    )


def _rows(index: Mapping[int, int], numbers: list[int]) -> np.ndarray:
    """Rows of the nodes that are there, in rising order."""
    return np.array(sorted({index[n] for n in numbers if n in index}), dtype=np.int64)
