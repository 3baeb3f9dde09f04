"""Text files of Gmsh (``.msh`` 2 and 4) as contents of a mesh file, whatever groups overlap or are left out.

Version 2 writes an element once for each of its physical groups, and version 4 gives each entity its groups:
here an element is there once, in all of them.
"""

import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from palpate.api import MeshError
from palpate.api.mesh import SOLIDS
from palpate_indentation.mesh_content import MeshFile, once

TYPES: Mapping[int, tuple[str, int]] = MappingProxyType(
    {
        15: ("vertex", 1),
        1: ("line", 2),
        8: ("line3", 3),
        2: ("triangle", 3),
        9: ("triangle6", 6),
        3: ("quad", 4),
        16: ("quad8", 8),
        10: ("quad9", 9),
        4: ("tetra", 4),
        11: ("tetra10", 10),
        5: ("hexahedron", 8),
        17: ("hexahedron20", 20),
        6: ("wedge", 6),
        18: ("wedge15", 15),
        7: ("pyramid", 5),
        19: ("pyramid13", 13),
        12: ("hexahedron20", 27),
        13: ("wedge15", 18),
        14: ("pyramid13", 14),
    }
)
"""meshio's kind and the number of nodes of Gmsh's types of elements.

Nodes in the middles of faces and of the element, which Gmsh adds at order 2, are last and are left out: the
element is cut into tetrahedra.
"""
_EDGES: Mapping[str, str] = MappingProxyType(
    {
        "tetra10": "01 12 02 03 23 13",
        "hexahedron20": "01 03 04 12 15 23 26 37 45 47 56 67",
        "wedge15": "01 02 03 12 14 25 34 35 45",
        "pyramid13": "01 03 04 12 14 23 24 34",
    }
)
"""Ends of the edges in whose middles Gmsh's nodes after the corners are, in its order."""
_Groups = Mapping[tuple[int, int], list[int]]


def read_gmsh(path: Path) -> MeshFile | None:
    """Contents of a text file of version 2 or 4.1; None for another one.

    Raises
    ------
    MeshError
        It has elements of another type, or is cut off; or it is another one, and two groups have one name.
    """
    sections = _sections(path)
    version, is_binary = (sections.get("MeshFormat", "") + " 0 1").split()[:2]
    names = _names(sections.get("PhysicalNames", ""))
    if is_binary == "0" and version in ("4", "4.0"):
        raise MeshError(f"{path}: version {version} is not read; save it as version 4.1 or 2.2")
    if is_binary != "0" or version not in ("2", "2.0", "2.1", "2.2", "4.1"):
        _refuse_twice(path, names.values())
        return None
    for needed in ("Nodes", "Elements"):
        if needed not in sections:
            raise MeshError(f"{path}: no section ${needed}, or it does not end; save the mesh again")
    is_old = version.startswith("2")
    numbers, points = (_nodes_2 if is_old else _nodes_4)(sections["Nodes"])
    found = _elements_2(sections["Elements"]) if is_old else _elements_4(sections)
    of_shape, groups = _by_shape(path, found)
    index = np.full(int(numbers.max(initial=0)) + 1, -1)
    index[numbers] = np.arange(len(numbers))
    blocks = tuple(
        (shape, index[np.array(cells.rows, dtype=np.int64)[:, _order(shape)]])
        for shape, cells in of_shape.items()
    )
    if any((cells < 0).any() for _, cells in blocks):
        raise MeshError(f"{path}: an element names a node that is not there; save the mesh again")
    nodes = {number: k for k, number in enumerate(numbers.tolist())}
    elements = [cells.tags for cells in of_shape.values()]
    of_elements = _data(sections, "ElementData", elements, [len(cells) for _, cells in blocks])
    content = MeshFile(
        points=points,
        blocks=blocks,
        point_data={name: values[0] for name, values in _data(sections, "NodeData", [nodes], [len(points)])},
        cell_data={
            "gmsh:physical": tuple(np.array(cells.first) for cells in of_shape.values()),
            **dict(of_elements),
        },
        cell_sets=_sets(groups, list(of_shape), names),
    )
    return once(content)


def _refuse_twice(path: Path, names: Iterable[str]) -> None:
    """Refuse two groups of one name, of which meshio keeps one."""
    if twice := [name for name, n in Counter(names).items() if n > 1]:
        raise MeshError(
            f"{path}: two groups have the name '{twice[0]}'; save the mesh as text of version 4.1"
        )


def _sets(
    groups: Mapping[tuple[int, int], Mapping[str, set[int]]],
    shapes: Sequence[str],
    names: Mapping[tuple[int, int], str],
) -> dict[str, tuple[NDArray[np.int64], ...]]:
    """Rows of each physical group in the block of each shape, by a name of its own."""
    # A volume and its surface may have one name; groups of one dimension that share it have their numbers.
    alike = Counter((group[0], names[group]) for group in groups if group in names)
    called = {group: names.get(group, f"physical {group[1]}") for group in groups}
    called |= {group: f"{name} {group[1]}" for group, name in names.items() if alike[group[0], name] > 1}
    largest = {called[group]: group for group in sorted(groups)}
    return {
        called[group]
        if group in names and largest[called[group]] == group
        else f"{called[group]} of dimension {group[0]}": tuple(
            np.array(sorted(members.get(shape, ())), dtype=np.int64) for shape in shapes
        )
        for group, members in groups.items()
    }


def _sections(path: Path) -> dict[str, str]:
    """Text of each section by its name; several of one name are numbered."""
    found: dict[str, str] = {}
    for part in path.read_text(encoding="utf-8", errors="replace").split("\n$End")[:-1]:
        name, _, text = part.partition("\n$")[2].partition("\n") if "\n$" in part else part.partition("\n")
        key = name.strip().lstrip("$")
        found[key if key not in found else f"{key} {len(found)}"] = text
    return found


def _names(text: str) -> dict[tuple[int, int], str]:
    lines = (line.split(maxsplit=2) for line in text.splitlines()[1:])
    return {(int(line[0]), int(line[1])): line[2].strip().strip('"') for line in lines if len(line) == 3}


def _nodes_2(text: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    rows = np.array(text.split()[1:], dtype=np.float64).reshape(-1, 4)
    return rows[:, 0].astype(np.int64), rows[:, 1:]


def _nodes_4(text: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    lines = iter(text.splitlines())
    n_blocks, numbers, points = int(next(lines).split()[0]), list[int](), list[list[float]]()
    for _ in range(n_blocks):
        n = int(next(lines).split()[3])
        numbers += [int(line) for line in itertools.islice(lines, n)]
        points += [[float(x) for x in line.split()[:3]] for line in itertools.islice(lines, n)]
    return np.array(numbers, dtype=np.int64), np.array(points, dtype=np.float64).reshape(-1, 3)


_Element = tuple[int, int, int, list[int], list[int]]


@dataclass(frozen=True, slots=True)
class _Cells:
    """Elements of one shape: their nodes, rows by their numbers, and the first group of each."""

    rows: list[list[int]] = field(default_factory=list)
    tags: dict[int, int] = field(default_factory=dict)
    first: list[int] = field(default_factory=list)


def _by_shape(
    path: Path, elements: Iterable[_Element]
) -> tuple[dict[str, _Cells], dict[tuple[int, int], dict[str, set[int]]]]:
    """Elements of each shape, and the rows of each physical group by shape."""
    found: dict[str, _Cells] = {}
    groups: dict[tuple[int, int], dict[str, set[int]]] = {}
    for number, kind, dimension, physical, nodes in elements:
        if kind not in TYPES:
            raise MeshError(f"{path}: elements of Gmsh's type {kind}; mesh the limb in order 1 or 2")
        shape, n_nodes = TYPES[kind]
        if len(nodes) != n_nodes:
            raise MeshError(f"{path}: element {number} has {len(nodes)} nodes, not {n_nodes}; save it again")
        cells = found.setdefault(shape, _Cells())
        row = cells.tags[number] = len(cells.rows)
        cells.rows.append(nodes)
        cells.first.append(next(iter(physical), 0))
        for group in physical:
            groups.setdefault((dimension, group), {}).setdefault(shape, set()).add(row)
    return found, groups


def _elements_2(text: str) -> Iterator[_Element]:
    """Number, type, dimension, physical groups and nodes of each element."""
    for line in text.splitlines()[1:]:
        number, kind, n_tags, *rest = map(int, line.split())
        yield number, kind, _dimension(kind), [t for t in rest[: min(n_tags, 1)] if t], rest[n_tags:]


def _elements_4(sections: Mapping[str, str]) -> Iterator[_Element]:
    groups = _of_entities(sections.get("Entities", ""))
    lines = iter(sections["Elements"].splitlines())
    for _ in range(int(next(lines).split()[0])):
        dimension, entity, kind, n = map(int, next(lines).split())
        for line in itertools.islice(lines, n):
            number, *nodes = map(int, line.split())
            yield number, kind, dimension, groups.get((dimension, entity), []), nodes


def _of_entities(text: str) -> _Groups:
    """Physical groups of each entity, by dimension and number."""
    lines, found = iter(text.splitlines()), {}
    for dimension, n in enumerate(map(int, next(lines, "").split())):
        for line in itertools.islice(lines, n):
            cells = line.split()
            start = 4 if dimension == 0 else 7
            count = int(cells[start])
            # A negative number is a group of the other orientation.
            found[dimension, int(cells[0])] = [abs(int(c)) for c in cells[start + 1 : start + 1 + count]]
    return found


def _dimension(kind: int) -> int:
    shape = TYPES.get(kind, ("", 0))[0]
    flat = {"vertex": 0, "line": 1, "line3": 1}.get(shape, 2)
    return 3 if shape in SOLIDS else flat


def _order(shape: str) -> list[int]:
    """Places of the nodes in Gmsh's order."""
    if shape not in _EDGES:
        return list(range(next(n for name, n in TYPES.values() if name == shape)))
    solid = SOLIDS[shape][0]
    theirs = [frozenset(map(int, pair)) for pair in _EDGES[shape].split()]
    return [*range(solid.n_corners), *(solid.n_corners + theirs.index(frozenset(e)) for e in solid.edges)]


def _data(
    sections: Mapping[str, str], kind: str, places: Sequence[Mapping[int, int]], sizes: Sequence[int]
) -> Iterator[tuple[str, tuple[NDArray[np.float64], ...]]]:
    """Name and values of each section of data, for each block; NaN where there are none."""
    for key, text in sections.items():
        if key.split()[0] != kind:
            continue
        lines = iter(text.splitlines())
        names, _, sizes_given = ([next(lines) for _ in range(int(next(lines)))] for _ in range(3))
        n_values = int(sizes_given[1])
        found = tuple(np.full((size, n_values), np.nan) for size in sizes)
        for line in itertools.islice(lines, int(sizes_given[2])):
            number, *values = line.split()
            for block, place in zip(found, places, strict=True):
                if int(number) in place:
                    block[place[int(number)]] = [float(value) for value in values]
        yield names[0].strip().strip('"'), tuple(b[:, 0] if n_values == 1 else b for b in found)
