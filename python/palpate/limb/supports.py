"""Supports of a mesh file: which nodes its conditions hold, and which of them hold a node in part."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate.domain import BoolArray, IntArray
from palpate.errors import MeshError

AXES = "xyz"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Support:
    """Condition of a file that holds nodes.

    Parameters
    ----------
    name : str
        The condition in the file's words.
    nodes : (n,) integer array
    axes : str
        Axes that it holds, some of ``xyz``.
    """

    name: str
    nodes: IntArray
    axes: str = AXES


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FixedNodes:
    """Nodes (n,) held in all axes, with remarks on what holds them and warnings of what is not used."""

    nodes: IntArray
    remarks: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def _not_named(
    supports: Sequence[Support], in_limb: BoolArray, named: IntArray, setting: str
) -> Iterator[str]:
    """Warnings of nodes that the file holds and the setting does not name."""
    free = in_limb.copy()
    free[named] = False
    for each in supports:
        if free[each.nodes].any():
            yield (
                f"the file holds {np.count_nonzero(free[each.nodes])} more nodes by {each.name}"
                f"{_in_part(each.axes)}, which {setting} does not name, so these nodes are free; "
                "name them there too"
            )


def _partly_held(supports: Sequence[Support], partly: BoolArray) -> Iterator[str]:
    """Warnings of nodes that are held in some directions alone."""
    for each in supports:
        if partly[each.nodes].any() and each.axes:
            yield (
                f"{np.count_nonzero(partly[each.nodes])} nodes are held in {_listed(each.axes)} alone by "
                f"{each.name}; palpate fixes a node in x, y and z or not at all, so these nodes are free; "
                "fix them in all three in the file, or name their set in the setting for fixed nodes"
            )


def fixed_nodes(
    path: Path,
    supports: Sequence[Support],
    in_limb: BoolArray,
    named: IntArray | None,
    *,
    setting: str,
    there: Iterable[str],
    unused: Iterable[str] = (),
) -> FixedNodes:
    """Nodes of a limb that are held: as a setting names them, or all that its file holds in x, y and z.

    Parameters
    ----------
    path : Path
        Of the mesh file.
    in_limb : (n_nodes,) boolean array
        Nodes of the file that belong to the limb.
    named : (n,) integer array, optional
        Nodes of the setting; None where it names none.
    setting : str
        How messages call the setting.
    there : iterable of str
        Names in the file that the setting may have.
    unused : iterable of str
        Warnings of what else may hold nodes in the file.

    Raises
    ------
    MeshError
        Nothing is named, and no condition of the file holds a node.
    """
    if named is not None:
        return FixedNodes(nodes=named, warnings=tuple(_not_named(supports, in_limb, named, setting)))
    found = _held_by_file(supports, in_limb)
    if not found.nodes.size:
        raise MeshError(
            f"{path}: no condition of the file holds nodes of the limb in x, y and z "
            f"({'; '.join((*unused, *found.warnings)) or 'there are none'}); name held nodes in {setting} "
            f"(there: {', '.join(there) or 'none'})"
        )
    return found


def _held_by_file(supports: Sequence[Support], in_limb: BoolArray) -> FixedNodes:
    """Nodes that the conditions of a file hold in x, y and z, with a warning where one holds less."""
    held = _held(supports, in_limb)
    fixed = np.flatnonzero(held.all(axis=1))
    by = ", ".join(
        f"{np.count_nonzero(in_limb[support.nodes])} by {support.name}{_in_part(support.axes)}"
        for support in supports
        if in_limb[support.nodes].any()
    )
    partly: BoolArray = np.asarray(held.any(axis=1) & ~held.all(axis=1))
    remark = f"the file fixes {fixed.size} nodes of the limb ({by})"
    return FixedNodes(nodes=fixed, remarks=(remark,), warnings=tuple(_partly_held(supports, partly)))


def _held(supports: Sequence[Support], in_limb: BoolArray) -> BoolArray:
    """Mask (n_nodes, 3) of the axes in which each node is held."""
    held = np.zeros((len(in_limb), 3), dtype=np.bool_)
    for support in supports:
        for axis in support.axes:
            held[support.nodes, AXES.index(axis)] = True
    held[~in_limb] = False
    return held


def _in_part(axes: str) -> str:
    return "" if set(axes) == set(AXES) else f" in {_listed(axes)}"


def _listed(axes: str) -> str:
    return " and ".join(sorted(axes))
