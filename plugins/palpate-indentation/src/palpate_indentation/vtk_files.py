"""Unstructured grids of VTK: .vtu of any version and compression, and legacy .vtk, ASCII or binary.

Voxels become hexahedra, pixels quadrilaterals. Words of cells name groups; other text is left out.
"""

import base64
import lzma
import re
import zlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from palpate.api import MeshError
from palpate_indentation.mesh_content import MOST_GROUPS, MeshFile

CELL_TYPES: Mapping[int, tuple[str, int]] = MappingProxyType(
    {
        1: ("vertex", 1),
        3: ("line", 2),
        5: ("triangle", 3),
        8: ("quad", 4),
        9: ("quad", 4),
        10: ("tetra", 4),
        11: ("hexahedron", 8),
        12: ("hexahedron", 8),
        13: ("wedge", 6),
        14: ("pyramid", 5),
        21: ("line3", 3),
        22: ("triangle6", 6),
        23: ("quad8", 8),
        24: ("tetra10", 10),
        25: ("hexahedron20", 20),
        26: ("wedge15", 15),
        27: ("pyramid13", 13),
        28: ("quad9", 9),
        29: ("hexahedron27", 27),
        34: ("triangle7", 7),
    }
)
"""Names of meshio and numbers of nodes by VTK's number of the type."""
REORDERED: Mapping[int, list[int]] = MappingProxyType({8: [0, 1, 3, 2], 11: [0, 1, 3, 2, 4, 5, 7, 6]})
"""Nodes of pixels and voxels in the order of quadrilaterals and hexahedra."""
BY_SIZE: Mapping[int, Mapping[int, int]] = MappingProxyType(
    {
        2: {1: 1},  # poly-vertex, poly-line
        4: {2: 3},
        68: {3: 21},
        69: {3: 5, 6: 22},
        70: {4: 9, 9: 28},
        71: {4: 10, 10: 24},
        72: {8: 12, 27: 29},
        73: {6: 13},
    }
)
"""Cells of Lagrange's types as those of fixed order, by their number of nodes."""

NUMBERS: Mapping[str, str] = MappingProxyType(
    {
        name: kind
        for kind, names in {
            "i1": "Int8 char signed_char",
            "i2": "Int16 short",
            "i4": "Int32 int vtktypeint32 vtkidtype",
            "i8": "Int64 long vtktypeint64",
            "u1": "UInt8 unsigned_char bit",
            "u2": "UInt16 unsigned_short",
            "u4": "UInt32 unsigned_int",
            "u8": "UInt64 unsigned_long",
            "f4": "Float32 float",
            "f8": "Float64 double",
        }.items()
        for name in names.split()
    }
)
"""Types of numbers of NumPy by the names of .vtu, and in small letters of legacy files."""

Array = NDArray[np.generic]


def read_vtu(path: Path) -> MeshFile:
    """Contents of an unstructured grid in XML, its pieces joined.

    Raises
    ------
    MeshError
    """
    content = path.read_bytes()
    raw = b""
    if found := re.search(rb"<AppendedData[^>]*>\s*_", content):
        end = content.rfind(b"</AppendedData")
        raw = content[found.end() : end if end > 0 else len(content)]
        content = content[: found.end() - 1] + (content[end:] if end > 0 else b"")
    # A declared version other than XML's own stops the parser; the declaration is not needed.
    content = re.sub(rb"^\s*<\?xml.*?\?>", b"", content, count=1, flags=re.DOTALL)
    try:
        root = ElementTree.fromstring(content)
    except ElementTree.ParseError as error:
        raise MeshError(f"{path}: no XML that can be read ({error}); write the mesh again") from None
    if root.get("type") != "UnstructuredGrid":
        raise MeshError(
            f"{path}: a {root.get('type') or root.tag} and no UnstructuredGrid; export the volume mesh"
        )
    arrays = _XmlArrays(path, root, raw)
    pieces = [_piece(path, arrays, piece) for piece in root.iterfind("UnstructuredGrid/Piece")]
    if not pieces:
        raise MeshError(f"{path}: no volume elements (no <Piece>); export the volume mesh")
    starts = np.cumsum([0, *(len(points) for points, *_ in pieces)])
    cells = [nodes + start for (_, _, of, *_), start in zip(pieces, starts, strict=False) for nodes in of]
    types = np.concatenate([types for _, types, *_ in pieces])
    return _content(
        path,
        np.concatenate([points for points, *_ in pieces]),
        types,
        cells,
        _joined([data for *_, data, _ in pieces]),
        _joined([data for *_, data in pieces]),
    )


def _joined(parts: Sequence[Mapping[str, Array]]) -> dict[str, Array]:
    """Arrays that every piece has."""
    names = [name for name in parts[0] if all(name in part for part in parts)]
    return {name: np.concatenate([part[name] for part in parts]) for name in names}


def _piece(
    path: Path, arrays: "_XmlArrays", piece: ElementTree.Element
) -> tuple[Array, Array, list[NDArray[np.int64]], dict[str, Array], dict[str, Array]]:
    named = {e.get("Name"): e for e in piece.iterfind("Cells/DataArray")}
    points = piece.find("Points/DataArray")
    if points is None or not {"connectivity", "offsets", "types"} <= named.keys():
        raise MeshError(f"{path}: a piece without points or cells; write the mesh again")
    nodes, offsets = (arrays.read(named[name]).astype(np.int64) for name in ("connectivity", "offsets"))
    point_data, cell_data = (
        {
            element.get("Name") or "unnamed": _rows(values, size)
            for element in piece.iterfind(f"{section}/DataArray")
            if element.get("type") in {*NUMBERS, "String"}
            and (size := int(piece.get(count) or 0))
            and ((values := arrays.read(element)).dtype.kind != "U" or values.size == size)
        }
        for section, count in (("PointData", "NumberOfPoints"), ("CellData", "NumberOfCells"))
    )
    cells = np.split(nodes, offsets[:-1]) if offsets.size else []
    return arrays.read(points).reshape(-1, 3), arrays.read(named["types"]), cells, point_data, cell_data


def _rows(values: Array, n: int) -> Array:
    return values if values.size == n else values.reshape(n, -1)


class _XmlArrays:
    """Arrays of a .vtu: ASCII, base64 or appended; plain or compressed."""

    def __init__(self, path: Path, root: ElementTree.Element, raw: bytes) -> None:
        self.path = path
        self.raw = raw
        self.order = ">" if root.get("byte_order") == "BigEndian" else "<"
        self.header = self.order + NUMBERS[root.get("header_type", "UInt32")]
        self.unpack = self._unpacker(root.get("compressor", ""))
        appended = root.find("AppendedData")
        self.is_text = appended is not None and appended.get("encoding") == "base64"

    def _unpacker(self, compressor: str) -> Callable[[bytes, int], bytes] | None:
        match compressor:
            case "":
                return None
            case "vtkZLibDataCompressor":
                return lambda block, size: zlib.decompress(block)
            case "vtkLZMADataCompressor":
                return lambda block, size: lzma.decompress(block)
            case "vtkLZ4DataCompressor":
                try:
                    from lz4.block import decompress  # type: ignore[import-untyped]
                except ImportError:
                    raise MeshError(
                        f"{self.path}: compressed with LZ4, which needs lz4; pip install lz4, or save the "
                        "mesh with ZLib or without compression"
                    ) from None
                return lambda block, size: bytes(decompress(block, uncompressed_size=size))
        raise MeshError(
            f"{self.path}: compressed with {compressor}; save the mesh with ZLib or without compression"
        )

    def read(self, element: ElementTree.Element) -> Array:
        """Numbers of a DataArray, or its words, flat."""
        if element.get("type") == "String":  # characters as numbers, each word ends with 0
            characters = bytes(self._numbers(element, "<u1").astype(np.uint8).tolist())
            return np.array(characters.decode(errors="replace").split("\0")[:-1], dtype=np.str_)
        return self._numbers(element, self.order + NUMBERS[element.get("type", "")])

    def _numbers(self, element: ElementTree.Element, kind: str) -> Array:
        match element.get("format", "ascii"):
            case "ascii":
                return np.array((element.text or "").split(), dtype=np.float64 if "f" in kind else np.int64)
            case "appended":
                start = int(element.get("offset") or 0)
                content = self._bytes(self.raw[start:], text=self.is_text)
            case _:
                content = self._bytes((element.text or "").strip().encode(), text=True)
        return np.frombuffer(content, kind).astype(kind[1:])

    def _bytes(self, stored: bytes, *, text: bool) -> bytes:
        """Content of an array after its header: its size, or the sizes of compressed blocks."""
        width = int(self.header[2:])
        if self.unpack is None:
            (size,) = np.frombuffer(_decoded(stored, width, text=text), self.header)
            return _decoded(stored, width + int(size), text=text)[width:]
        (n_blocks,) = np.frombuffer(_decoded(stored, width, text=text), self.header)
        length = width * (3 + int(n_blocks))
        _, size, last, *sizes = np.frombuffer(_decoded(stored, length, text=text), self.header).tolist()
        # Header and blocks are encoded apart from each other.
        rest = stored[4 * -(-length // 3) if text else length :]
        blocks, parts, start = _decoded(rest, sum(sizes), text=text), [], 0
        for k, packed in enumerate(sizes):
            full = last if last and k == len(sizes) - 1 else size
            assert self.unpack is not None
            parts.append(self.unpack(blocks[start : start + packed], full))
            start += packed
        return b"".join(parts)


def _decoded(stored: bytes, n: int, *, text: bool) -> bytes:
    """First n bytes, of base64 or as they are."""
    found = base64.b64decode(stored[: 4 * -(-n // 3)]) if text else stored
    if len(found) < n:
        raise ValueError("cut off")
    return found[:n]


# ----------------------------------------------------------------------- legacy


def read_legacy_vtk(path: Path) -> MeshFile:
    """Contents of an unstructured grid of a legacy file of versions 1 to 5.

    Raises
    ------
    MeshError
    """
    return _Legacy(path).content()


class _Legacy:
    """One reading of one legacy file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.text = path.read_bytes()
        self.at = 0

    def content(self) -> MeshFile:
        first, _, kind = self.line(), self.line(), self.line().upper()
        if not first.startswith("# vtk DataFile") or kind not in ("ASCII", "BINARY"):
            raise MeshError(f"{self.path}: no legacy file of VTK; write the mesh again, as .vtu for example")
        self.is_text = kind == "ASCII"
        points, types = np.empty((0, 3)), np.empty(0, dtype=np.int64)
        cells: list[NDArray[np.int64]] = []
        data: dict[str, dict[str, Array]] = {"POINT_DATA": {}, "CELL_DATA": {}, "": {}}
        section, n = "", 0
        while (line := self.line()) is not None:
            words = line.split()
            match [words[0].upper(), *words[1:]]:
                case ["DATASET", dataset, *_] if dataset.upper() != "UNSTRUCTURED_GRID":
                    raise MeshError(
                        f"{self.path}: a {dataset} and no UNSTRUCTURED_GRID; export the volume mesh"
                    )
                case ["POINTS", number, dtype]:
                    points = self.values(3 * int(number), dtype).astype(np.float64).reshape(-1, 3)
                case ["CELLS", number, size]:
                    cells = self.cells(int(number), int(size))
                case ["CELL_TYPES", number]:
                    types = self.values(int(number), "int").astype(np.int64)
                case ["POINT_DATA" | "CELL_DATA" as section, number]:
                    n = int(number)
                case ["FIELD", _, number]:
                    data[section] |= self.fields(int(number), n)
                case ["SCALARS" | "VECTORS" | "NORMALS" | "TENSORS" as what, name, dtype, *more]:
                    width = {"SCALARS": int(more[0]) if more else 1, "TENSORS": 9}.get(what, 3)
                    if what == "SCALARS":
                        self.skip("LOOKUP_TABLE")
                    data[section][name] = _rows(self.values(n * width, dtype), n)
                case ["LOOKUP_TABLE", _, number]:
                    self.values(4 * int(number), "float" if self.is_text else "unsigned_char")
                case ["COLOR_SCALARS", _, width]:
                    self.values(n * int(width), "float" if self.is_text else "unsigned_char")
                case ["GLOBAL_IDS" | "PEDIGREE_IDS", _, dtype]:
                    self.values(n, dtype)
                case ["TEXTURE_COORDINATES", _, width, dtype]:
                    self.values(n * int(width), dtype)
                case ["METADATA"]:
                    self.metadata()
        return _content(self.path, points, types, cells, data["POINT_DATA"], data["CELL_DATA"])

    def line(self) -> str:
        """Next line that is not empty; None at the end."""
        while self.at < len(self.text):
            end = self.text.find(b"\n", self.at)
            end = len(self.text) if end < 0 else end
            found, self.at = self.text[self.at : end].decode("latin-1").strip(), end + 1
            if found:
                return found
        return None  # type: ignore[return-value]

    def skip(self, word: str) -> None:
        """Pass a line that begins with a word, if it is the next one."""
        start = self.at
        if not (self.line() or "").upper().startswith(word):
            self.at = start

    def metadata(self) -> None:
        """Pass the lines of a section up to an empty one."""
        end = re.compile(rb"\n\s*\n").search(self.text, self.at)
        self.at = len(self.text) if end is None else end.end()

    def words(self, n: int) -> Array:
        """Next n words: a line each in ASCII, which may be empty, and each behind its length in binary."""
        found = []
        for _ in range(n):
            if self.is_text:
                start, end = self.at, self.text.index(b"\n", self.at)
                self.at = end + 1
            else:
                width = 8 >> (self.text[self.at] >> 6)  # the first two bits show the size of the length
                start = self.at + width
                self.at = end = start + int.from_bytes(self.text[self.at : start]) % (1 << 8 * width - 2)
            word = self.text[start:end].decode(errors="replace").strip()
            found.append(unquote(word) if self.is_text else word)
        return np.array(found, dtype=np.str_)

    def values(self, n: int, dtype: str) -> Array:
        """Next n numbers."""
        if dtype.lower() not in NUMBERS:
            line = self.text[: self.at].split(b"\n")[-2].decode("latin-1")
            raise MeshError(f"{self.path}: '{line}' gives no numbers that are read; save the mesh as .vtu")
        kind = np.dtype(">" + NUMBERS[dtype.lower()])
        if dtype.lower() == "bit" and not self.is_text:
            packed = np.frombuffer(self.text, np.uint8, -(-n // 8), self.at)
            self.at += packed.size
            return np.unpackbits(packed)[:n]
        if not self.is_text:
            found = np.frombuffer(self.text, kind, n, self.at)
            self.at += found.nbytes
            return found.astype(kind.newbyteorder("="))
        words: list[bytes] = []
        while len(words) < n:
            end = self.text.find(b"\n", self.at)
            end = len(self.text) if end < 0 else end
            if self.at >= len(self.text):
                raise ValueError("cut off")
            words += self.text[self.at : end].split()
            self.at = end + 1
        return np.array(words[:n], dtype=np.float64 if kind.kind == "f" else np.int64)

    def cells(self, number: int, size: int) -> list[NDArray[np.int64]]:
        """Nodes of each cell: with counts up to version 4, by offsets since version 5."""
        start = self.at
        line = self.line().split()
        if line[0].upper() == "OFFSETS":
            offsets = self.values(number, line[1]).astype(np.int64)
            nodes = self.values(size, self.line().split()[1]).astype(np.int64)
            return np.split(nodes, offsets[1:-1])
        self.at = start
        values, found, at = self.values(size, "int").astype(np.int64), [], 0
        for _ in range(number):
            n = int(values[at])
            found.append(values[at + 1 : at + 1 + n])
            at += 1 + n
        return found

    def fields(self, number: int, n: int) -> dict[str, Array]:
        """Arrays of a field, one row for each of n points or cells; others and text are passed."""
        found = {}
        for _ in range(number):
            while (words := self.line().split())[0].upper() == "METADATA":
                self.metadata()
            if words[0] == "NULL_ARRAY":
                continue
            name, width, length, dtype = words[0], int(words[1]), int(words[2]), words[3]
            is_text = dtype.lower() in ("string", "utf8_string")
            values = self.words(width * length) if is_text else self.values(width * length, dtype)
            if length == n and n and (width == 1 or not is_text):
                found[unquote(name)] = _rows(values, n)
        return found


def _content(
    path: Path,
    points: Array,
    types: Array,
    cells: Sequence[NDArray[np.int64]],
    point_data: Mapping[str, Array],
    cell_data: Mapping[str, Array],
) -> MeshFile:
    """Contents with the cells of each type in one block."""
    if len(types) != len(cells):
        raise MeshError(f"{path}: {len(cells)} cells and {len(types)} types of them; write the mesh again")
    chosen = np.array(
        [BY_SIZE.get(int(kind), {}).get(len(of), int(kind)) for kind, of in zip(types, cells, strict=True)],
        dtype=np.int64,
    )
    unknown = sorted(set(chosen.tolist()) - CELL_TYPES.keys())
    if unknown:
        raise MeshError(
            f"{path}: cells of VTK's type {', '.join(map(str, unknown))} (such as polyhedra) are not "
            "understood; mesh the limb with tetrahedra or hexahedra"
        )
    rows: dict[str, list[NDArray[np.int64]]] = {}
    nodes: dict[str, list[NDArray[np.int64]]] = {}
    for kind in np.unique(chosen).tolist():
        name, n = CELL_TYPES[kind]
        here = np.flatnonzero(chosen == kind)
        if any(len(cells[row]) != n for row in here.tolist()):
            raise MeshError(f"{path}: a {name} without {n} nodes; write the mesh again")
        of = np.stack([cells[row] for row in here.tolist()])
        nodes.setdefault(name, []).append(of[:, REORDERED[kind]] if kind in REORDERED else of)
        rows.setdefault(name, []).append(here)
    order = {name: np.argsort(np.concatenate(of), kind="stable") for name, of in rows.items()}
    places = [np.concatenate(rows[name])[order[name]] for name in nodes]
    words = {name: of for name, of in cell_data.items() if of.dtype.kind == "U" and len(of) == len(cells)}
    return MeshFile(
        points=np.asarray(points, dtype=np.float64).reshape(-1, 3),
        blocks=tuple((name, np.concatenate(of)[order[name]]) for name, of in nodes.items()),
        cell_sets=_groups(words, places),
        point_data=_numbers(point_data, len(points)),
        cell_data={
            name: tuple(values[block] for block in places)
            for name, values in _numbers(cell_data, len(cells)).items()
        },
    )


def _numbers(data: Mapping[str, Array], n: int) -> dict[str, Array]:
    """Arrays of numbers of n points or cells."""
    return {name: of for name, of in data.items() if len(of) == n and of.dtype.kind != "U"}


def _groups(words: Mapping[str, Array], rows: Sequence[Array]) -> dict[str, tuple[NDArray[np.int64], ...]]:
    """Rows in each block of the cells that have a word, with the array's name where arrays share the word."""
    distinct = {name: np.unique(of[of != ""]).tolist() for name, of in words.items()}
    count = Counter(word for of in distinct.values() for word in of)
    return {
        (word if count[word] == 1 else f"{name}: {word}"): tuple(
            np.flatnonzero(words[name][block] == word) for block in rows
        )
        for name, of in distinct.items()
        if len(of) <= MOST_GROUPS
        for word in of
    }
