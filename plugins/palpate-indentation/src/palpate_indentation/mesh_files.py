"""Mesh files through meshio, which only this module uses.

meshio is untyped, ends the interpreter on some bad files, prints errors to the terminal,
unpacks without a limit and accepts coordinates that are not finite. Here all of that
becomes a :class:`~palpate.errors.MeshError` or a plain value.
"""

import contextlib
import io
import lzma
import re
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from palpate.api import MeshError
from palpate.api.files import ProcessLimits, run_function
from palpate_indentation.abaqus_files import read_abaqus
from palpate_indentation.ansys_files import read_ansys
from palpate_indentation.gmsh_files import read_gmsh
from palpate_indentation.mesh_content import MeshFile, numbered_faces, once, ordered
from palpate_indentation.nastran_files import read_nastran
from palpate_indentation.vtk_files import read_legacy_vtk, read_vtu

MOST_BYTES = 1_000_000_000
MOST_MEMORY_MB = 4_000.0


READERS: Mapping[str, Callable[[Path], MeshFile | None]] = MappingProxyType(
    {".inp": read_abaqus, ".cdb": read_ansys, ".msh": read_gmsh, ".vtu": read_vtu, ".vtk": read_legacy_vtk}
    | dict.fromkeys((".bdf", ".nas", ".fem"), read_nastran)
)
"""Readers of palpate, by suffix; meshio reads other formats, and files that such a reader leaves to it."""
SUFFIXES = frozenset(
    {*READERS, ".xdmf", ".xmf", ".mesh", ".meshb", ".med", ".cgns", ".e", ".exo", ".ex2", ".h5m"}
    | {".mdpa", ".avs", ".f3grid", ".su2", ".vol", ".ele", ".ugrid", ".tec"}
)
"""Formats that are read: by palpate's readers, and those with volume elements of meshio."""
UNREADABLE = (ValueError, LookupError, ArithmeticError, TypeError, AttributeError, zlib.error, lzma.LZMAError)
"""Errors of a reader on a broken file."""


def read_mesh_file(path: Path) -> MeshFile:
    """Read any format of meshio, in a subprocess with limits of memory and time.

    Where no elements have the name of a group, the faces of each number in cell data are a group.

    Raises
    ------
    MeshError
        The file is missing, of an unknown format, broken, or needs too much memory or time.
    """
    if not path.is_file():
        raise MeshError(f"{path}: no such file; check the path of the mesh")
    if path.stat().st_size > MOST_BYTES:
        raise MeshError(f"{path}: larger than {MOST_BYTES / 1e9:g} GB; keep only the segment around the spot")
    try:
        return run_function(ProcessLimits(time_s=60.0, memory_mb=MOST_MEMORY_MB), read_here, path)
    except (ChildProcessError, MemoryError) as error:
        how = "too little memory" if isinstance(error, MemoryError) else error
        raise MeshError(
            f"{path}: reading failed ({how}); the file is corrupt or too large; export it again or use a "
            "smaller mesh"
        ) from None


def read_here(path: Path) -> MeshFile:
    """Read a file in this process, which should be a subprocess for it.

    Raises
    ------
    MeshError
        As :func:`read_mesh_file`.
    """
    content = _read(path)
    return content if content.cell_sets else replace(content, cell_sets=numbered_faces(content))


def _read(path: Path) -> MeshFile:
    _refuse_outside(path)
    if (reader := READERS.get(path.suffix.lower())) is not None:
        try:
            if (content := reader(path)) is not None:
                return content
        except UNREADABLE as error:
            raise MeshError(
                f"{path}: cannot be read; the file is broken or cut off; export it again, as .vtu for example"
            ) from error
    import meshio  # here: slow to import

    complaints = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaints), contextlib.redirect_stdout(complaints):
            mesh = meshio.read(path)
    except MemoryError:
        raise
    except (Exception, SystemExit) as error:  # its readers raise anything on a corrupt file
        raise MeshError(_why_unreadable(path, complaints.getvalue() or str(error))) from error
    content = MeshFile(
        points=np.asarray(mesh.points, dtype=np.float64),
        blocks=tuple((str(block.type), _cells(path, str(block.type), block.data)) for block in mesh.cells),
        point_data={str(k): np.asarray(v) for k, v in mesh.point_data.items()},
        cell_data={str(k): tuple(np.asarray(v) for v in blocks) for k, blocks in mesh.cell_data.items()},
        point_sets={str(k): np.asarray(v, dtype=np.int64) for k, v in mesh.point_sets.items()}
        | {name: np.concatenate(rows) for name, rows in _of_families(mesh, "point").items()},
        cell_sets=_cell_sets(mesh),
    )
    if _is_exodus(path) and not content.cell_sets:
        content = replace(content, cell_sets=_blocks_of_exodus(path, [len(of) for _, of in content.blocks]))
    return once(content) if path.suffix.lower() == ".msh" else content


def _is_exodus(path: Path) -> bool:
    return path.suffix.lower() in (".e", ".exo", ".ex2")


def _blocks_of_exodus(path: Path, sizes: list[int]) -> dict[str, tuple[NDArray[np.int64], ...]]:
    """Elements of each block of a file of Exodus, which are of one material, by its name or number."""
    import netCDF4

    with netCDF4.Dataset(path) as file:
        at = [int(name[7:]) - 1 for name in file.variables if name.startswith("connect")]
        names, numbers = (file.variables.get(name) for name in ("eb_names", "eb_prop1"))
        words = ["" for _ in at] if names is None else [str(word) for word in netCDF4.chartostring(names[:])]
        of = {k: k + 1 if numbers is None else numbers[k] for k in at}
        called = [words[k].strip() or f"block {of[k]}" for k in at]
        called = [f"{n} {of[k]}" if called.count(n) > 1 else n for k, n in zip(at, called, strict=True)]
    return {
        name: tuple(np.arange(size if each == name else 0) for each, size in zip(called, sizes, strict=True))
        for name in called
    }


def _why_unreadable(path: Path, reason: str) -> str:
    """Message of a file that meshio does not read, with what to do, and no words of meshio."""
    import meshio

    suffix = path.suffix.lower()
    if suffix not in meshio.extension_to_filetypes:
        known = ", ".join(sorted(SUFFIXES))
        return f"{path}: '{suffix}' is no format of a mesh that is read; save it as one of {known}"
    missing = re.search(r"h5py|netCDF4", reason)
    if missing:
        return f"{path}: cannot be read without {missing[0]}; pip install {missing[0]}"
    return (
        f"{path}: cannot be read as {suffix}; the file is broken or uncommon; export it again, as .vtu for "
        "example"
    )


def _cell_sets(mesh: Any) -> dict[str, tuple[NDArray[np.int64], ...]]:  # noqa: ANN401 - meshio has no types
    """Groups of elements by name: listed ones, and numbered ones with a table of names."""
    groups = {
        str(name): tuple(np.asarray(rows, dtype=np.int64).ravel() for rows in blocks)
        for name, blocks in mesh.cell_sets.items()
        if not str(name).startswith("gmsh:") and len(blocks) == len(mesh.cells)
    }
    numbers = mesh.cell_data.get("gmsh:physical")
    for name, (number, _) in mesh.field_data.items() if numbers is not None else ():
        groups.setdefault(str(name), tuple(np.flatnonzero(np.asarray(rows) == number) for rows in numbers))
    return groups | _of_families(mesh, "cell")


def _of_families(mesh: Any, what: str) -> dict[str, tuple[NDArray[np.int64], ...]]:  # noqa: ANN401
    """Rows of each group of MED in the arrays of its families: a family has a number and names of groups."""
    arrays = getattr(mesh, f"{what}_data").get(f"{what}_tags", ())
    blocks = [np.asarray(rows) for rows in ([arrays] if what == "point" else arrays)]
    families: dict[str, list[int]] = {}
    for number, names in getattr(mesh, f"{what}_tags", {}).items():
        for name in names:
            families.setdefault(str(name).strip(), []).append(int(number))
    return {
        name: tuple(np.flatnonzero(np.isin(rows, numbers)) for rows in blocks)
        for name, numbers in families.items()
        if blocks
    }


_KEYWORD = re.compile(rb"^(?!\*\*)([^,\n]*+)[^\n]*=([^\n]*)$", re.MULTILINE)
"""A line of Abaqus that may include a file: its keyword, and what follows the last ``=``."""
_ENTITY = re.compile(rb"<!(doctype|entity)", re.IGNORECASE)


def _refuse_outside(path: Path) -> None:
    """Refuse a mesh file that includes files of other folders, or that defines XML entities."""
    kind = path.suffix.lower()
    named: Iterator[str] = iter(())
    if kind == ".inp":
        named = _included(path)
    elif kind in {".xdmf", ".xmf", ".vtu"}:
        with path.open("rb") as stream:
            if _ENTITY.search(stream.read(100_000)):
                raise MeshError(f"{path}: it defines XML entities, which no mesh needs; write the mesh again")
        named = iter(()) if kind == ".vtu" else _data_files(path)
    for name in named:
        other = Path(name)
        inside = (path.parent / other).resolve().is_relative_to(path.parent.resolve())
        if other.is_absolute() or ".." in other.parts or not inside:
            raise MeshError(
                f"{path}: it names the file '{other}', which is outside of its folder; move it next to "
                "the mesh"
            )
        _refuse_hdf_links(path.parent / other)
    _refuse_hdf_links(path)


def _refuse_hdf_links(path: Path) -> None:
    """Refuse an HDF5 file whose arrays are in other files, which its library would open."""
    if not path.is_file():
        return
    with contextlib.suppress(OSError):
        if not _is_hdf(path):
            return
    try:
        import h5py
    except ImportError:
        return  # meshio cannot read it either, and its message shows that
    try:
        with h5py.File(path, "r", locking=False) as file:
            elsewhere = file.visititems_links(_link_elsewhere) or file.visititems(_stored_elsewhere)
    except (OSError, RuntimeError, KeyError, ValueError) as error:
        raise MeshError(
            f"{path}: corrupt HDF5 ({' '.join(str(error).split())[:200]}); write it again"
        ) from None
    if elsewhere:
        raise MeshError(
            f"{path}: '{elsewhere}' is stored in another file, which is not opened; save the numbers"
        )


def _is_hdf(path: Path) -> bool:
    """Whether it has the signature of HDF5: at 0, or at 512, 1024, … after a user block."""
    place, size, magic = 0, path.stat().st_size, b"\x89HDF\r\n\x1a\n"
    with path.open("rb") as stream:
        while place < size:
            stream.seek(place)
            if stream.read(len(magic)) == magic:
                return True
            place = max(2 * place, 512)
    return False


def _link_elsewhere(name: str, link: Any) -> str | None:  # noqa: ANN401 - h5py has no types
    """Name of a link that leads to another file."""
    return name if type(link).__name__ == "ExternalLink" else None


def _stored_elsewhere(name: str, item: Any) -> str | None:  # noqa: ANN401 - h5py has no types
    """Name of an array that is stored in another file."""
    return name if getattr(item, "external", None) or getattr(item, "is_virtual", False) else None


def _included(path: Path, by: frozenset[Path] = frozenset()) -> Iterator[str]:
    """Files that an Abaqus file includes, recursively, by meshio's rules."""
    by |= {path}
    for keyword, value in _KEYWORD.findall(path.read_bytes().replace(b"\r", b"\n")):
        if keyword.decode(errors="replace").strip().replace("*", "").upper() != "INCLUDE":
            continue
        name = value.decode(errors="replace").strip().strip("'\"")
        yield name
        if (path.parent / name).is_file() and path.parent / name not in by:
            yield from _included(path.parent / name, by)


def _data_files(path: Path) -> Iterator[str]:
    """Files with the arrays of an XDMF; invalid XML is left for meshio to refuse."""
    with path.open("rb") as stream, contextlib.suppress(ElementTree.ParseError):
        for _, element in ElementTree.iterparse(stream):
            text = (element.text or "").strip()
            if element.get("Format") == "HDF":
                yield text.partition(":")[0]
            elif element.get("Format") == "Binary":
                yield text
            element.clear()


def _cells(path: Path, kind: str, given: object) -> NDArray[np.int64]:
    """Nodes of elements in meshio's order, which its reader of Exodus leaves as they are in the file."""
    cells = _integers(path, given)
    return ordered(kind, cells) if _is_exodus(path) else cells


def _integers(path: Path, cells: object) -> NDArray[np.int64]:
    try:
        return np.asarray(cells).astype(np.int64, casting="same_kind")
    except (TypeError, ValueError):
        raise MeshError(f"{path}: cells whose nodes are not whole numbers; write the mesh again") from None
