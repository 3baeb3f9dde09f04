"""Content of a mesh file, and the tables of study.toml that read it, tried before they are shown."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from palpate.domain import FloatArray, Limb, Spot
from palpate.errors import MeshError
from palpate.limb.checks import check_limb
from palpate.limb.outer_surface import partly_fixed, surface_shares
from palpate.limb.supports import Support
from palpate.limb.tidying import tidied
from palpate.mesh.topology import CELLS, outer_faces
from palpate.plugins.interfaces import LimbSource
from palpate.plugins.optional import InspectedTable, Inspection
from palpate.toml_text import toml_value

LIMB_MM = (20.0, 2000.0)
"""Longest side of the box around a limb's segment."""
UNITS_MM: Mapping[str, float] = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 0.001}
SKIN = re.compile(r"contact|skin|press|outer|surface|touch|top|indent", re.IGNORECASE)
FIXED = re.compile(r"fix|held|hold|bone|cut|support|clamp|encastre|base|bottom|anchor", re.IGNORECASE)


def guessed_unit(points: FloatArray) -> tuple[str, str]:
    """Unit in which points are a limb's, and a finding if that is a guess; millimetres if no unit fits."""
    long = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    fits = [unit for unit, mm in UNITS_MM.items() if LIMB_MM[0] <= long * mm <= LIMB_MM[1]]
    unit = fits[0] if fits else "mm"
    if not fits:
        return unit, f"it is {long:.4g} long, which is a limb in no unit; check the file, and set unit"
    if unit == "mm":
        return unit, ""
    return unit, f"it is {long:.4g} long, so its unit is taken to be {unit}; correct unit if that is wrong"


def likely_sets(names: Sequence[str]) -> tuple[str | None, list[str]]:
    """Name that is likely the skin's, and names that are likely supports, among names of sets."""
    skins = ["contact"] if "contact" in names else sorted(filter(SKIN.search, names), key=len)
    held = [name for name in names if FIXED.search(name) and name not in skins[:1]]
    return next(iter(skins), None), ["fixed"] if "fixed" in held else held


def region_name(text: str) -> str:
    """Name of a region, as near to a text as its characters allow."""
    return re.sub(r"[^A-Za-z0-9_]+", "_", text).strip("_") or "tissue"


def inspected(
    path: Path,
    source: type[LimbSource[Any]],
    settings: Mapping[str, Any],
    tables: Sequence[InspectedTable],
    supports: Sequence[Support],
    findings: Sequence[str],
) -> Inspection:
    """Inspection of a mesh file with the settings that a source proposes, after reading it with them."""
    found, limb, shown, rigid = dict.fromkeys(findings), None, list(tables), list[str]()
    if supports:
        rows = [(each.name, " ".join(each.axes), str(len(each.nodes))) for each in supports]
        shown.append(
            InspectedTable(title="Supports", columns=("condition", "axes", "nodes"), rows=tuple(rows))
        )
    try:
        limb = source(source.Settings.model_validate(settings)).load(path, Spot(name=path.stem))
        bone = re.compile("(?i)bone|femur|tibia|fibula|humer|radius|ulna|patella|skull|vertebra")
        limb = placed(tidied(limb, rigid=(rigid := list(filter(bone.search, limb.mesh.regions)))))
        if limb.spot.position_mm.any():
            where = "the origin is not on the skin, so the spot is where the skin's nodes are densest"
            found[f"{where}; correct position and normal if the tool pressed elsewhere"] = None
        check_limb(limb, limb.mesh.regions)
        found |= dict.fromkeys((*limb.remarks, *limb.warnings, *partly_fixed(limb.mesh)))
        shown.append(_sets(limb))
    except MeshError as error:
        found[f"these tables do not read it yet: {str(error).removeprefix(f'{path}: ')}"] = None
    shares = None if limb is None else surface_shares(limb.mesh)
    return Inspection(
        tables=tuple(shown),
        findings=tuple(found),
        study_text=study_text(path, source.name, settings, limb, rigid),
        record={
            "source": source.name,
            "settings": dict(settings),
            "findings": list(found),
            "tables": {t.title: [dict(zip(t.columns, row, strict=True)) for row in t.rows] for t in shown},
            "surface": None
            if shares is None
            else {"fixed": shares.fixed, "contact": shares.contact, "free": shares.free},
        },
        limb=limb,
    )


def placed(limb: Limb) -> Limb:
    """Limb whose spot is the origin if that is on its skin, else where the skin's nodes are densest."""
    mesh = limb.mesh
    contact = mesh.node_sets.get("contact", np.empty(0, dtype=np.int64))
    if not contact.size:
        return limb
    points, extent = mesh.points_mm[contact], float(np.ptp(mesh.points_mm, axis=0).max())
    tree, target = scipy.spatial.KDTree(points), np.zeros(3)
    if tree.query(target)[0] >= 0.02 * extent:
        # A mesh is finest under its indenter; of a uniform one this is the middle of the skin.
        near = tree.query_ball_point(points, 0.1 * extent, return_length=True)
        target = points[near >= 0.8 * near.max()].mean(axis=0)
    middle, normal = contact[tree.query(target)[1]], np.zeros(3)
    for kind, cells in mesh.cells.items():
        faces = outer_faces(kind, cells)
        here = mesh.points_mm[faces[(faces == middle).any(axis=1), : CELLS[kind].n_face_corners]]
        if len(here):
            normal += np.cross(here[:, 1] - here[:, 0], here[:, -1] - here[:, 0]).sum(axis=0)
    if not normal.any() or (not target.any() and normal[2] > 0.99 * np.linalg.norm(normal)):
        return limb
    position = mesh.points_mm[middle] if target.any() else target
    return replace(limb, spot=Spot(name=limb.spot.name, position_mm=position, normal=normal))


def _sets(limb: Limb) -> InspectedTable:
    """Node sets and regions of the limb as the proposed tables read it."""
    mesh = limb.mesh
    counts = np.bincount(np.concatenate([*mesh.cell_regions.values()]), minlength=len(mesh.regions))
    rows = [("region", name, f"{n} elements") for name, n in zip(mesh.regions, counts, strict=True)]
    rows += [("node set", name, f"{len(nodes)} nodes") for name, nodes in mesh.node_sets.items()]
    rows.append(("outer surface", "fixed, in contact, free", str(surface_shares(mesh))))
    return InspectedTable(title="As these tables read it", columns=("what", "name", "size"), rows=tuple(rows))


def study_text(path: Path, name: str, settings: Mapping[str, Any], limb: Limb | None, bone: list[str]) -> str:
    """Tables of study.toml that read a mesh; the spot's place if it is not the origin with the normal +z."""
    lines = ["[[spot]]", f"name = {json.dumps(path.stem)}", f"mesh = {json.dumps(path.as_posix())}"]
    if limb and ((spot := limb.spot).position_mm.any() or (spot.normal != [0.0, 0.0, 1.0]).any()):
        lines += [
            f"position = {[f'{x:.6g} mm' for x in spot.position_mm]}".replace("'", '"'),
            f"normal = {np.round(spot.normal, 6).tolist()}",
        ]
    lines += ["", "[limb]", f'source = "{name}"', *([f"rigid = {toml_value(bone)}"] if bone else [])]
    if settings:
        lines += ["", "[limb.settings]", *(f"{key} = {toml_value(value)}" for key, value in settings.items())]
    return "\n".join([*lines, ""])
