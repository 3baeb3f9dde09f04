"""Sets, regions and sizes of a mesh file, and settings of the limb source ``meshio`` that read it."""

import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from palpate.api import IntArray, LimbSource
from palpate.api.files import ASKED, InspectedTable, Inspection
from palpate.api.mesh import SOLIDS, guessed_unit, inspected, likely_sets, region_name, skin_of
from palpate_indentation.mesh_content import MeshFile

VOLUME = frozenset(SOLIDS)
LABELS = ("region", "label", "labels", "material", "materialids", "material_id", "part", "partid")
"""Cell data that usually hold the region of each element, the likeliest first."""
MOST_REGIONS = 20


def inspect_mesh(path: Path, content: MeshFile, source: type[LimbSource[Any]]) -> Inspection:
    """Inspection of a mesh file with the settings that read it."""
    findings = [*content.remarks, *content.warnings]
    settings: dict[str, Any] = {}
    unit, finding = guessed_unit(content.points)
    if unit != "mm":
        settings["unit"] = unit
    findings += [finding] if finding else []
    settings |= _regions(content)
    sets = _node_sets(content, [*map(str, settings.get("regions", {}).values())], findings)
    if sets:
        settings["node_sets"] = sets
    if settings == {"regions": {"soft_tissue": 0}}:
        settings = {}  # as they are by default

    def inspection() -> Inspection:
        asked = _about_numbers(settings.get("regions", {}))
        return inspected(path, source, settings, _tables(content), content.supports, [*findings, *asked])

    made = inspection()
    skin = skin_of(made.limb) if made.limb else None
    if skin is None or skin[1] is None or not skin[0].startswith("region_"):
        return made
    named = {skin[0]: "skin"}
    if len(settings["regions"]) == 2:
        named |= {name: "soft_tissue" for name in settings["regions"] if name != skin[0]}
    findings.append(
        f"{ASKED}: is region {settings['regions'][skin[0]]} skin? Only numbers name the regions, and this "
        f"is the outer layer, {skin[1]:.2g} mm thick; if it is not, rename it under regions"
    )
    settings["regions"] = {named.get(name, name): of for name, of in settings["regions"].items()}
    return inspection()


def _about_numbers(regions: Collection[str]) -> Iterator[str]:
    """Finding on regions that have no name in the file."""
    if numbered := [name for name in regions if name.startswith("region_")]:
        yield (
            f"regions are numbers alone in the file: rename {', '.join(numbered)} under regions, and name "
            "bone as rigid under [limb]"
        )


def _regions(content: MeshFile) -> dict[str, Any]:
    """Regions by numbers in cell data, else by groups of elements, else one region."""
    volume = [k for k, (kind, _) in enumerate(content.blocks) if kind in VOLUME]
    if not volume:
        return {}
    names = sorted(content.cell_data, key=lambda n: LABELS.index(n.lower()) if n.lower() in LABELS else 99)
    groups = _covering(content, volume)
    for name in names:
        values = np.concatenate([np.asarray(content.cell_data[name][k]) for k in volume])
        if values.ndim != 1 or values.dtype.kind not in "biuf" or name.startswith("gmsh:geom"):
            continue
        labels = np.unique(values.astype(np.float64))
        whole = np.isfinite(labels).all() and (labels == np.round(labels)).all()
        if not whole or not 0 < labels.size <= MOST_REGIONS or (groups and name.lower() not in LABELS):
            continue
        named = ["soft_tissue"] if labels.size == 1 else [f"region_{int(label)}" for label in labels]
        chosen = {"region_data": name} if name != "region" else {}
        return chosen | {"regions": dict(zip(named, map(int, labels), strict=True))}
    if groups:
        numbers = [
            re.fullmatch(r"(?i)(?:physical|volume|property|block) ?(\d+)(?: of dimension 3)?", g)
            for g in groups
        ]
        named = [f"region_{n[1]}" if n else region_name(g) for n, g in zip(numbers, groups, strict=True)]
        named = [f"{of}_{k}" if named.count(of) > 1 else of for k, of in enumerate(named, 1)]
        named = ["soft_tissue"] if len(groups) == 1 else named
        return {"regions": dict(zip(named, groups, strict=True))}
    return {"region_data": "", "regions": {"soft_tissue": 0}}


def _covering(content: MeshFile, volume: list[int]) -> list[str]:
    """Groups that hold each volume element once, small ones first, and names before numbers; or none."""
    starts = np.cumsum([0, *(len(content.blocks[k][1]) for k in volume)])
    taken, chosen = np.zeros(starts[-1], dtype=np.bool_), []
    members = {
        name: np.concatenate([rows[k] + start for k, start in zip(volume, starts[:-1], strict=True)])
        for name, rows in content.cell_sets.items()
        if name in _plain(content.cell_sets)
    }
    for name, rows in sorted(members.items(), key=lambda each: (len(each[1]), each[0][-1:].isdigit())):
        if len(rows) and not taken[rows].any():
            taken[rows] = True
            chosen.append(name)
    return chosen if taken.size and taken.all() else []


def _node_sets(content: MeshFile, groups: list[str], findings: list[str]) -> dict[str, Any]:
    """Node sets of the skin and of what is fixed, by names that say so; else bone among groups is fixed."""
    sets = _names(content)
    # The number of a surface of Gmsh's geometry tells nothing of the limb.
    named = [name for name in sets if not re.fullmatch(r"(Line|Surface|Volume)\d+", name)]
    contact, held, unused = likely_sets(named, groups)
    if contact is None and sets:
        contact, others = _by_shape(content, {name: of for name, of in sets.items() if name not in held})
        held, unused = likely_sets([name for name in sets if name != contact], groups)[1:]
        if contact is not None:
            guessed = "" if held or content.supports else f", and are {', '.join(others)} held"
            held = held or others
            findings.append(
                f"{ASKED}: did the tool press '{contact}'{guessed}? No name shows it, and this set alone "
                "curves outwards; correct node_sets if not"
            )
    fixed: Any = held[0] if len(held) == 1 else held
    if contact is None:
        findings.append("no set of nodes has the name of a skin; name the pressed surface as `contact`")
    if len({name.rstrip("xyzXYZ") for name in held}) < len(held):
        each = f"a node of any of {', '.join(held)} is fixed in x, y and z"
        findings.append(f"{each}; if each of them holds one axis, name one set of the nodes held in all axes")
    findings += unused if not content.supports else []
    if not content.supports and {*held} <= {*groups}:
        so = f"only {', '.join(held)} is fixed; if the cuts are held too, " if held else ""
        plane = 'fixed = { normal = [0, 0, 1], at = "… mm" }'
        held_nodes = f"{so}name held nodes as `fixed`, or give their plane under node_sets: {plane}"
        findings.append(f"no set of nodes has the name of a support; {held_nodes}")
    if contact in (None, "contact") and (content.supports or fixed in ([], "fixed")):
        return {}
    own = {} if content.supports else {"fixed": fixed or "fixed"}
    return {"contact": contact or "contact", **own}


def _by_shape(content: MeshFile, sets: Mapping[str, IntArray]) -> tuple[str | None, list[str]]:
    """Only set whose faces curve outwards, likely the skin, or None; and the other sets that have faces.

    The normals of a bone's faces point to its middle, and cuts are planes.
    """
    faces, points = _outer_faces(content), content.points
    curved, others = list[str](), list[str]()
    for name, nodes in sets.items():
        own = points[faces[np.isin(faces, nodes).all(axis=1)]]
        if not len(own):
            continue
        areas = np.cross(own[:, 1] - own[:, 0], own[:, 2] - own[:, 0])
        is_outward = np.sum(areas * (own.mean(axis=1) - own.mean(axis=(0, 1)))) > 0.0
        normals = left = areas / np.linalg.norm(areas, axis=1, keepdims=True)
        for _ in range(4):  # planes: a piece cut out of a limb has four sides
            alike = left @ left[:: 1 + len(left) // 50].T > 0.999
            left = left[~alike[:, alike.sum(axis=0).argmax()]] if len(left) else left
        (curved if is_outward and 5 * len(left) > len(normals) else others).append(name)
    return (curved[0], others) if len(curved) == 1 else (None, [])


def _outer_faces(content: MeshFile) -> IntArray:
    """Corners of triangles (n, 3) on the outside of the volume elements, two of them for a quadrilateral."""
    found = []
    for n in (3, 4):
        each = [
            cells[:, face]
            for kind, cells in content.blocks
            if kind in VOLUME
            for face in SOLIDS[kind][0].faces
            if len(face) == n
        ]
        faces = np.concatenate([np.empty((0, n), dtype=np.int64), *each])
        _, first, count = np.unique(np.sort(faces), axis=0, return_index=True, return_counts=True)
        outer = faces[first[count == 1]]
        found += [outer[:, [0, k, k + 1]] for k in range(1, n - 1)]
    return np.concatenate(found)


def _names(content: MeshFile) -> dict[str, IntArray]:
    """Data and sets with nodes of the volume elements, but not with all nodes of such a group."""
    solid = np.zeros(len(content.points), dtype=np.bool_)
    for kind, cells in content.blocks:
        if kind in VOLUME:
            solid[cells] = True
    marks = {
        name: np.flatnonzero(values)
        for name, values in content.point_data.items()
        if values.ndim == 1 and values.dtype.kind in "biuf" and np.isin(values, (0, 1)).all()
    }
    every = {**marks, **content.point_sets}
    for name, rows in content.cell_sets.items():
        members = [(kind, of[r]) for (kind, of), r in zip(content.blocks, rows, strict=True) if len(r)]
        if not members:
            continue
        nodes = np.unique(np.concatenate([of.ravel() for _, of in members]))
        if not any(kind in VOLUME for kind, _ in members):
            every[name] = nodes
        elif np.isin(nodes, every.get(name, ())).all():
            del every[name]
    names = [n for n in _plain(every) if 0 < np.count_nonzero(solid[every[n]]) < solid.sum()]
    own = [name for name in names if not re.fullmatch(r"(Line|Surface|Volume)\d+", name)]
    # Gmsh writes each surface of its geometry too: physical groups have their nodes under the user's names.
    double = {n for n in names if n not in own and any(np.isin(every[n], every[o]).all() for o in own)}
    return {name: every[name] for name in names if name not in double}


def _plain(names: Collection[str]) -> list[str]:
    """Names, without a name of an instance that is there without the instance too."""
    return [name for name in names if "." not in name or name.rpartition(".")[2] not in names]


def _tables(content: MeshFile) -> tuple[InspectedTable, ...]:
    extent = np.ptp(content.points, axis=0) if len(content.points) else np.zeros(3)
    size = " x ".join(f"{x:.4g}" for x in extent)
    rows = [("nodes", str(len(content.points)), f"box of {size}")]
    for kind, cells in content.blocks:
        rows.append((kind, str(len(cells)), "volume" if kind in VOLUME else "not simulated"))
    mesh = InspectedTable(title="Mesh", columns=("what", "number", "remark"), rows=tuple(rows))
    named = [(name, "point data", _span(values)) for name, values in content.point_data.items()]
    named += [
        (name, "point set", f"{len(content.point_sets[name])} nodes") for name in _plain(content.point_sets)
    ]
    named += [
        (name, "group of elements", f"{sum(map(len, content.cell_sets[name]))} elements")
        for name in _plain(content.cell_sets)
        if any(map(len, content.cell_sets[name]))
    ]
    named += [
        (name, "cell data", _span(np.concatenate([np.asarray(b).reshape(len(b), -1) for b in blocks])))
        for name, blocks in content.cell_data.items()
        if blocks and len({np.asarray(b).shape[1:] for b in blocks}) == 1
    ]
    sets = InspectedTable(title="Names in the file", columns=("name", "kind", "content"), rows=tuple(named))
    return (mesh, sets) if named else (mesh,)


def _span(values: Any) -> str:  # noqa: ANN401 - any array
    """Values of data in a few words: labels, how many are not zero, or the range."""
    values = np.asarray(values)
    if values.dtype.kind not in "biuf" or not values.size:
        return f"{values.dtype}"
    if values.ndim > 1 and values.shape[1] > 1:
        return f"{values.shape[1]} numbers each"
    found = np.unique(values)
    if set(found.tolist()) <= {0, 1}:
        return f"{np.count_nonzero(values)} of {values.size} are 1"
    if found.size <= MOST_REGIONS and (found == np.round(found)).all():
        return ", ".join(f"{v:g}" for v in found.astype(np.float64))
    return f"{found[0]:.4g} to {found[-1]:.4g}"
