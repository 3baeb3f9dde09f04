"""Content of a mesh file, and the tables of study.toml that read it, tried before they are shown."""

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
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
from palpate.mesh.layers import outer_layer
from palpate.mesh.topology import surface_faces
from palpate.plugins.interfaces import LimbSource
from palpate.plugins.optional import InspectedTable, Inspection
from palpate.toml_text import ASKED, toml_value

WORDS: Mapping[str, str] = {
    "bone": "bone bones os femur tibia fibula humerus radius ulna patella skull vertebra vertebrae "
    "sacrum scapula clavicle sternum mandible rib ribs talus calcaneus metacarpal metatarsal phalanx "
    "phalanges carpal carpals pelvis ilium knochen schienbein wadenbein elle speiche hueso huesos osso ossa",
    "part": "left right l r proximal distal shaft head neck cortical compact trabecular cancellous rigid "
    "part region body solid volume mesh set elset material the of and",
    "soft": "soft skin dermis fat adipose muscle muscles marrow tendon tendons ligament cartilage fascia "
    "periosteum meniscus over above under below near around between without cutis subcutis subcutaneous "
    "haut fett muskel peau graisse piel grasa musculo pelle grasso muscolo",
}
"""Words of names of regions: a bone's, words for its parts, and words that show that it is no bone."""
UNITS_MM: Mapping[str, float] = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 0.001}
SKIN = re.compile(
    r"(?i)contact|skin|press|outer|surface|superfici|touch|top|indent|haut|oberfl|kontakt|peau|piel|epiderm"
    r"|au(ss|ß)en|(?<![a-z])(ext[eé]r(n(?!us|i)|ior|ieur)|estern(?!on|ón))"
)
FIXED = re.compile(
    r"(?i)fix|(?<![a-z])h[eo]ld|support|clamp|encast|anchor"
    r"|(?P<end>cut|base|bottom|schnitt|coupe|corte(?![xz])|taglio|(?<![a-z])ends?(?![a-z]))"
)


def guessed_unit(points: FloatArray) -> tuple[str, str]:
    """Unit in which points are a limb's, and a finding if that is a guess; millimetres if no unit fits."""
    long = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    fits = [unit for unit, mm in UNITS_MM.items() if 20.0 <= long * mm <= 2000.0]
    unit = fits[0] if fits else "mm"
    if not fits:
        return unit, f"it is {long:.4g} long, which is a limb in no unit; check the file, and set unit"
    if unit == "mm":
        return unit, ""
    return unit, f"it is {long:.4g} long, so its unit is taken to be {unit}; correct unit if that is wrong"


def bones(names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Names that are a bone's, and names that may be: they have other words too, such as forearm_bone."""
    found: tuple[list[str], list[str]] = [], []
    for name in names:
        kinds = _kinds(name)
        if "bone" in kinds and "soft" not in kinds:
            found["" in kinds].append(name)
    return found


def _kinds(name: str) -> set[str]:
    """Kinds of the words of a name; empty for a word that is of none."""
    words = [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)]
    known = {word: kind for kind, of in WORDS.items() for word in of.split()}
    return {known.get(word, "bone" if word.endswith("knochen") else "") for word in words}


def likely_sets(names: Sequence[str], regions: Sequence[str] = ()) -> tuple[str | None, list[str], list[str]]:
    """Name that is likely the skin's, names of likely supports, else bone among the regions; and a finding.

    The finding has the names that are neither, next to supports: each may hold the limb too.
    """
    skins = sorted(
        filter(_is_pressed, names), key=lambda name: (name != "contact", _is_fixed(name), len(name))
    )
    of_bone = [name for found in bones(names) for name in found]
    held = [name for name in names if name not in skins[:1] and (name in of_bone or _is_fixed(name))]
    held = ["fixed"] if "fixed" in held else held
    free = [name for name in names if name not in (*skins[:1], *held)] if held else []
    unused = (
        [f"not used: {', '.join(free)}; if the limb is held there, add the name to fixed"] if free else []
    )
    return next(iter(skins), None), held or bones(regions)[0], unused


def is_skin(name: str) -> bool:
    """True if a region has the name of skin; hypodermis and subcutis are fat."""
    return bool(
        re.search(r"(?i)skin|(?<![a-z])(epi)?derm|(?<!sub)cutis|(?<!unter)haut|peau|piel|pelle", name)
    )


def skin_of(limb: Limb) -> tuple[str, float | None] | None:
    """Region of the skin: by its name, else the outer layer, with its thickness [mm]; None if it has none.

    Skin is at most 4 mm thick, and no region with the name of another tissue.
    """
    regions = limb.mesh.used_regions
    if len(regions) < 2 or not limb.mesh.node_sets.get("contact", np.empty(0)).size:
        return None
    if named := sorted(filter(is_skin, regions)):
        return named[0], None
    outer = outer_layer(limb.mesh)
    return outer if outer and outer[1] <= 4.0 and "soft" not in _kinds(outer[0]) else None


def _is_pressed(name: str) -> bool:
    """Whether a name is the skin's; external alone is a word of clamps, muscles and bones too."""
    found = SKIN.search(name)
    if found is None or not re.match("(?i)ext[eé]r|estern", found[0]):
        return found is not None
    return (
        FIXED.search(name) is None
        and re.search("(?i)fixat", name) is None
        and not _kinds(name) & {"soft", "bone"}
    )


def _is_fixed(name: str) -> bool:
    """Whether a name is a support's; an end of soft tissue may be none."""
    found = FIXED.search(name)
    return found is not None and (found["end"] is None or "soft" not in _kinds(name))


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
    found, shown, spots = dict.fromkeys(findings), list(tables), list[Spot]()
    limb, of_bone, asked = None, bones(()), [text for text in findings if text.startswith(ASKED)]
    if supports:
        rows = [(each.name, " ".join(each.axes), str(len(each.nodes))) for each in supports]
        shown.append(
            InspectedTable(title="Supports", columns=("condition", "axes", "nodes"), rows=tuple(rows))
        )
    try:
        limb = source(source.Settings.model_validate(settings)).load(path, Spot(name=path.stem))
        of_bone = bones(limb.mesh.regions)
        limb = tidied(limb, rigid=of_bone[0])
        if spots := places(limb):
            limb = replace(limb, spot=spots[0])
        asked += questions((), of_bone[1], skin_of(limb))
        found |= dict.fromkeys((*questions(spots), *asked))
        check_limb(limb, limb.mesh.regions)
        found |= dict.fromkeys((*limb.remarks, *limb.warnings, *partly_fixed(limb.mesh)))
        shown.append(_sets(limb))
    except MeshError as error:
        found[f"these tables do not read it yet: {str(error).removeprefix(f'{path}: ')}"] = None
    return Inspection(
        tables=tuple(shown),
        findings=tuple(found),
        study_text=study_text(path, source.name, settings, spots, of_bone[0], asked),
        record={
            "source": source.name,
            "settings": dict(settings),
            "findings": list(found),
            "tables": {t.title: [dict(zip(t.columns, row, strict=True)) for row in t.rows] for t in shown},
            "surface": None if limb is None else asdict(surface_shares(limb.mesh)),
        },
        limb=limb,
    )


def places(limb: Limb) -> list[Spot]:
    """Spot at the origin if that is on the skin, else spots where the skin's nodes are densest."""
    mesh = limb.mesh
    contact = mesh.node_sets.get("contact", np.empty(0, dtype=np.int64))
    if not contact.size:
        return []
    points, extent = mesh.points_mm[contact], float(np.ptp(mesh.points_mm, axis=0).max())
    tree, targets = scipy.spatial.KDTree(points), [np.zeros(3)]
    if tree.query(targets[0])[0] >= 0.02 * extent:
        # A mesh is finest under its indenter; of a uniform one this is the middle of the skin.
        near = tree.query_ball_point(points, 0.1 * extent, return_length=True)
        dense, wide = (points[near >= share * near.max()] for share in (0.8, 0.6))
        found = _patches(dense, 0.1 * extent)
        if not all(_is_round(each, 1.2) for each in found) and 2 * len(wide) < len(points):
            found = [part for each in _patches(wide, 0.1 * extent) for part in _around_each(each)]
        targets = [each.mean(axis=0) for each in found]
    spots = []
    for target in targets:
        middle, normal = contact[tree.query(target)[1]], np.zeros(3)
        for faces, n in surface_faces(mesh):
            here = mesh.points_mm[faces[(faces == middle).any(axis=1), :n]]
            normal += np.cross(here[:, 1] - here[:, 0], here[:, -1] - here[:, 0]).sum(axis=0)
        if normal.any():
            if not target.any() and normal[2] > 0.99 * np.linalg.norm(normal):
                return [limb.spot]
            position = mesh.points_mm[middle] if target.any() else target
            spots.append(Spot(name=limb.spot.name, position_mm=position, normal=normal))
    return spots


def _patches(points: FloatArray, near_mm: float) -> list[FloatArray]:
    """Points (n, 3) by patch, the largest first, without patches of less than a third of its points."""
    some = scipy.spatial.KDTree(points[:: 1 + len(points) // 1000])
    apart = np.asarray(some.query(some.data, k=[2])[0]).max()
    joined = some.sparse_distance_matrix(some, max(near_mm, 2.0 * apart))
    patches = scipy.sparse.csgraph.connected_components(joined)[1]
    sizes = np.bincount(patches)
    return [some.data[patches == k] for k in np.argsort(-sizes) if 3 * sizes[k] >= sizes.max()]


def _around_each(points: FloatArray) -> list[FloatArray]:
    """Points (n, 3) of a patch around each indenter, where several are so near that they share it.

    The patch around one indenter is round: in 14 meshes its longer axis is at most 1.3 times the shorter one.
    """
    along = points @ np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][0]
    for n in range(1, 5):
        starts = points[np.argsort(along)[(2 * np.arange(n) + 1) * len(points) // (2 * n)]]
        nearest = scipy.cluster.vq.kmeans2(points, starts, iter=50, minit="matrix")[1]
        parts = [points[nearest == k] for k in range(n)]
        if all(_is_round(part, 1.4) for part in parts):
            return parts
    return [points]


def _is_round(points: FloatArray, most: float) -> bool:
    """Whether the longest axis of points (n, 3) is at most so many times the next one; true of few."""
    if len(points) < 10:
        return True
    long, short, _ = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(long <= most * short)


def questions(
    spots: Sequence[Spot], regions: Sequence[str] = (), skin: tuple[str, float | None] | None = None
) -> Iterator[str]:
    """Questions about the place of the spot, if that is a guess, and about regions that may be bone or skin.

    ``skin`` is a region, with its thickness [mm] if that alone shows that it is skin.
    """
    where = f"in spot '{spots[0].name}' the origin is not on the skin" if spots else ""
    if len(spots) > 1:
        places = " and ".join(f"({', '.join(f'{x:.1f}' for x in spot.position_mm)}) mm" for spot in spots)
        yield f"{ASKED}: where did the tool press? {where}; the mesh is finest at {places}"
    elif spots and spots[0].position_mm.any():
        yield (
            f"{ASKED}: is the spot right? {where}, so the spot is where the mesh is finest; correct "
            "position and normal if the tool pressed elsewhere"
        )
    for name in regions:
        yield f"{ASKED}: is region '{name}' bone? If it is, add it to rigid under [limb]"
    if skin and skin[1] is not None:
        yield (
            f"{ASKED}: is region '{skin[0]}' skin? No region has that name, and this one is the outer layer, "
            f"{skin[1]:.2g} mm thick; if it is not, give it another material"
        )


def _sets(limb: Limb) -> InspectedTable:
    """Node sets and regions of the limb as the proposed tables read it."""
    mesh = limb.mesh
    counts = np.bincount(np.concatenate([*mesh.cell_regions.values()]), minlength=len(mesh.regions))
    rows = [("region", name, f"{n} elements") for name, n in zip(mesh.regions, counts, strict=True)]
    rows += [("node set", name, f"{len(nodes)} nodes") for name, nodes in mesh.node_sets.items()]
    rows.append(("outer surface", "fixed, in contact, free", str(surface_shares(mesh))))
    return InspectedTable(title="As these tables read it", columns=("what", "name", "size"), rows=tuple(rows))


def study_text(
    path: Path,
    name: str,
    settings: Mapping[str, Any],
    spots: Sequence[Spot],
    rigid: Sequence[str],
    asked: Iterable[str],
) -> str:
    """Tables of study.toml that read a mesh, with its questions; places among several are comments.

    ``asked`` are the questions about regions and sets.
    """
    lines = ["[[spot]]", f"name = {json.dumps(path.stem)}", f"mesh = {json.dumps(path.as_posix())}"]
    lines += [f"# {question}" for question in questions(spots)]
    for spot in spots:
        if spot.position_mm.any() or (spot.normal != [0.0, 0.0, 1.0]).any():
            position = f"position = {toml_value([f'{x:.6g} mm' for x in spot.position_mm])}"
            normal = f"normal = {np.round(spot.normal, 6).tolist()}"
            lines += (f"{'# ' if len(spots) > 1 else ''}{line}" for line in (position, normal))
    lines += ["", "[limb]", f'source = "{name}"', *([f"rigid = {toml_value([*rigid])}"] if rigid else [])]
    lines += (f"# {question}" for question in asked)
    if settings:
        lines += ["", "[limb.settings]", *(f"{key} = {toml_value(value)}" for key, value in settings.items())]
    return "\n".join([*lines, ""])
