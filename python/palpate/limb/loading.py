"""Limbs of a study: made by its limb source, checked, and refined under the indenter."""

import functools
from collections.abc import Iterator, Mapping, Set
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl

from palpate.domain import FINE, Indentation, Limb, Refinement, Spot
from palpate.domain.material import AnisotropicMaterial
from palpate.errors import MeshError, StudyError
from palpate.limb.cell_fields import check_frames, with_fields
from palpate.limb.checks import check_depth, check_fine, check_limb, is_finer
from palpate.limb.inspection import skin_of
from palpate.limb.mesh_joints import holes
from palpate.limb.outer_surface import partly_fixed
from palpate.limb.tidying import tidied
from palpate.mesh.layers import thickness_mm
from palpate.mesh.refinement import automatic_edge_mm, refined
from palpate.mesh.spot_frame import NEAR, RIM, contact_edge_mm, spot_axes
from palpate.plugins.guard import answering_for
from palpate.plugins.optional import PressChecker
from palpate.study.reading import Study, StudySpot
from palpate.study.spots import mesh_note

# Presses that differ in their twist alone share a finer mesh.
_refined = functools.lru_cache(maxsize=8)(refined)


def load_limbs(study: Study, *, to_show: bool = False) -> dict[str, Limb]:
    """Limb of each spot and of its finer mesh, by :attr:`Job.limb_name`, checked.

    Empty when the solver needs none. With ``to_show`` finer meshes are left out, and limbs without their
    mesh file: what has been simulated needs neither.

    Raises
    ------
    MeshError
        A mesh cannot be read or simulated.
    StudyError
        The solver needs a mesh and the study names none.
    """
    if not study.solver.provides.mesh:
        return {}
    limbs, there = dict[str, Limb](), set[str]()
    meshes = {spot.spot.name: spot.mesh for spot in study.spots if spot.mesh is not None}
    for region in study.space.regions:
        if isinstance(region.material, AnisotropicMaterial) and not region.material.fields:
            check_frames(region, meshes, map(mesh_note, meshes.values()), one_frame=study.meshes.one_frame)
    for spot in study.spots:
        if spot.mesh is None and not to_show:
            raise StudyError(
                f"spot '{spot.spot.name}' has no mesh, which solver '{study.solver.name}' needs; name a mesh "
                "file"
            )
        for name, path in spot.meshes.items():
            if not to_show or (name == spot.spot.name and path.is_file()):
                limbs[name], regions = _load(study, spot.spot, path)
                there |= regions
        if not to_show and (fine := finer_limb(study, spot, limbs)):
            limbs[f"{spot.spot.name}{FINE}"] = fine
    if limbs.keys() >= set(study.spot_names):
        _check_every_region(study, limbs, there)
    return limbs


def finer_limb(study: Study, spot: StudySpot, limbs: Mapping[str, Limb]) -> Limb | None:
    """Finer mesh of a spot for its press, checked: that among ``limbs``, or its mesh refined; None: none.

    Raises
    ------
    MeshError
        It is not finer, or not of the same limb.
    """
    name = spot.spot.name
    coarse, fine = limbs[name], limbs.get(f"{name}{FINE}") if spot.fine_mesh else None
    place, near_mm = f"{spot.place}: {spot.fine_mesh or ''}".removesuffix(": "), _near_mm(study, name)
    edge_mm = fine_edge_mm(study, spot, coarse)
    if edge_mm:
        try:
            within, beyond = _refined_mm(study, name)
            fine = _refined(coarse, within, edge_mm, beyond)
        except MeshError as error:
            raise MeshError(f"{place}: {error}") from error
        if spot.fine_edge_mm is None and not is_finer(coarse, fine, near_mm):
            return None
    if fine is not None:
        check_fine(coarse, fine, near_mm, place)
    return fine


def with_edges(study: Study, edges_mm: Mapping[str, float]) -> Study:
    """The study with longest edges of finer meshes by spot, where it names none."""
    chosen = (edges_mm.get(s.spot.name) if s.fine_edge_mm is None else s.fine_edge_mm for s in study.spots)
    spots = (replace(spot, fine_edge_mm=each) for spot, each in zip(study.spots, chosen, strict=True))
    return replace(study, spots=tuple(spots))


def fine_meshes(study: Study, limbs: Mapping[str, Limb], edges_mm: Mapping[str, float]) -> pl.DataFrame:
    """One row per spot whose own mesh is refined: spot, longest edge_mm under the indenter, n_nodes."""
    study = with_edges(study, edges_mm)
    rows = [
        (spot.spot.name, edge_mm, limbs[fine].mesh.n_nodes)
        for spot in study.spots
        if (fine := f"{spot.spot.name}{FINE}") in limbs
        and (edge_mm := fine_edge_mm(study, spot, limbs[spot.spot.name]))
    ]
    return pl.DataFrame(rows, ["spot", "edge_mm", "n_nodes"], orient="row") if rows else pl.DataFrame()


def fine_edge_mm(study: Study, spot: StudySpot, limb: Limb) -> float:
    """Longest edge under the indenter to which a spot's mesh is refined, the study's or automatic; 0: not."""
    if spot.fine_edge_mm is not None:
        return spot.fine_edge_mm
    protocol = study.protocol_at(limb.spot.name)
    can = study.solver.provides.slopes and study.search.name != "sweep" and study.fine_runs
    if not can or not isinstance(protocol, Indentation):
        return 0.0
    return automatic_edge_mm(limb, protocol.reach_mm, _near_mm(study, limb.spot.name))


def _near_mm(study: Study, spot: str) -> float:
    """Distance from a spot up to which its elements are under the indenter."""
    protocol = study.protocol_at(spot)
    return NEAR * protocol.indenter.radius_mm if isinstance(protocol, Indentation) else 0.0


def _refined_mm(study: Study, spot: str) -> tuple[float, float]:
    """Distances from a spot that refined edges come within, and beyond.

    The torque's error by the mesh comes from the edge of the contact: a straight press is refined there.
    """
    protocol = study.protocol_at(spot)
    if not isinstance(protocol, Indentation) or protocol.lateral is not None:
        return _near_mm(study, spot), 0.0
    return RIM[1] * protocol.reach_mm, RIM[0] * protocol.reach_mm


def size_at_contact(study: Study, limb: Limb) -> float:
    """Mean edge [mm] of a limb's skin under the study's indenter."""
    return contact_edge_mm(limb, _near_mm(study, limb.spot.name))


def refinement(study: Study, limbs: Mapping[str, Limb]) -> dict[str, Refinement]:
    """Difference of the finer mesh from the first one, of each spot that has both.

    Where the finer one is the first one, refined at the edge of the contact, edges are compared there.
    """
    found = {}
    for spot in study.spots:
        if (fine := limbs.get(f"{(name := spot.spot.name)}{FINE}")) is None:
            continue
        near_mm, beyond_mm = _near_mm(study, name), 0.0
        if is_refined := bool(fine_edge_mm(study, spot, limbs[name])):
            near_mm, beyond_mm = _refined_mm(study, name)
        sizes = [contact_edge_mm(limb, near_mm, beyond_mm) for limb in (limbs[name], fine)]
        protocol = study.protocol_at(name)
        at = {"finer_over_reach": sizes[1] / protocol.reach_mm} if isinstance(protocol, Indentation) else {}
        found[name] = Refinement(ratio=sizes[0] / sizes[1], at_rim=is_refined and beyond_mm > 0.0, **at)
    return found


def _load(study: Study, spot: Spot, path: Path) -> tuple[Limb, frozenset[str]]:
    """Limb of a mesh, and the regions of the mesh, rigid ones too."""
    if study.limb_source is None:
        raise StudyError(f"{study.file}: no [limb] table to read {path} by; add one")
    with answering_for(study.limb_source, f"reading {path}"):
        read = study.limb_source.load(path, spot)
        if not isinstance(read, Limb):
            raise TypeError(f"it returned a {type(read).__name__} and not a Limb")
    try:
        limb = tidied(read, linear=study.meshes.linear, rigid=study.meshes.rigid)
        check_limb(limb, [region.region for region in study.space.regions])
        if isinstance(protocol := study.protocol_at(spot.name), Indentation):
            check_depth(limb, protocol)
        return with_fields(limb, study.space.regions), read.mesh.used_regions
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from error


def _check_every_region(study: Study, limbs: Mapping[str, Limb], there: Set[str]) -> None:
    if absent := [name for name in study.meshes.rigid if name not in there]:
        raise MeshError(
            f"no mesh has region '{absent[0]}', which rigid under [limb] names; correct its name (regions "
            f"of the meshes: {', '.join(sorted(there))})"
        )
    if nowhere := frozenset.intersection(*(frozenset(limb.absent) for limb in limbs.values())):
        raise MeshError(
            f"no mesh has elements of '{min(nowhere)}', which leave_out under [limb.settings] names; correct "
            "its name (`palpate limb inspect MESH` lists the names), or remove it there"
        )
    used = frozenset[str]().union(*(limb.mesh.used_regions for limb in limbs.values()))
    for region in study.space.regions:
        if region.region not in used:
            raise MeshError(
                f"region '{region.region}' has a material but no element that deforms in any mesh; correct "
                f"its name (regions of the meshes: {', '.join(sorted(used))}), or remove its tables"
            )


def limb_warnings(study: Study, limbs: Mapping[str, Limb]) -> list[str]:
    """Warnings about the limbs, each a sentence."""
    found = []
    for name, limb in limbs.items():
        is_fine, here = name not in study.spot_names, limb.mesh.used_regions
        absent = [region.region for region in study.space.regions if region.region not in here]
        if absent and not is_fine:
            found.append(
                f"spot '{name}' has no region {', '.join(absent)}: its parameters change nothing there"
            )
        supports = () if is_fine else (*limb.warnings, *partly_fixed(limb.mesh))
        found.extend(f"spot '{name}': {text}" for text in (*supports, *holes(limb.mesh)))
        found.extend(_coarse(study, name, limb))
        if not is_fine:
            found.extend((*_wide(study, limb), *_layers(study, limb)))
    return found


def press_warnings(study: Study, limbs: Mapping[str, Limb]) -> Iterator[str]:
    """Warnings about settings of loaders that do not fit the press of a spot, each a sentence."""
    for name in study.spot_names:
        loader, protocol = study.loader_at(name), study.protocol_at(name)
        if name in limbs and isinstance(loader, PressChecker) and isinstance(protocol, Indentation):
            is_on_skin = skin_of(limbs[name]) is not None
            with answering_for(loader, "checking the press"):
                found = [*loader.press_warnings(protocol.indenter.name, is_on_skin=is_on_skin)]
            yield from (f"spot '{name}': {text}" for text in found)


def _layers(study: Study, limb: Limb) -> Iterator[str]:
    """Name layers that are thinner than half an edge under the indenter, or not as thick as was measured."""
    protocol, name = study.protocol_at(limb.spot.name), limb.spot.name
    if not isinstance(protocol, Indentation):
        return
    edge_mm, measured = contact_edge_mm(limb, *_refined_mm(study, name)), study.measured_layers_mm(name)
    for region in sorted(limb.mesh.used_regions | measured.keys()):
        if (thick_mm := thickness_mm(limb, region, _near_mm(study, name))) is None:
            if region in measured:
                yield (
                    f"spot '{name}': region '{region}' is no layer of the mesh, so its measured "
                    "thickness has no effect. Remove it from [spot.layers]"
                )
            continue
        expected_mm, sd_mm = measured.get(region, (thick_mm, 0.0))
        if abs(thick_mm - expected_mm) > sd_mm + 0.01 * expected_mm:
            yield (
                f"spot '{name}': layer '{region}' is {thick_mm:.3g} mm thick in the mesh, but its measured "
                f"thickness is {expected_mm:g} mm. The fit uses the thickness in the mesh. Mesh the limb "
                f'again with layer_at.{name}.{region} = "{expected_mm:g} mm" '
                "(`palpate limb SCAN --options FILE`)"
            )
        # Where the contact ends `palpate limb` makes edges of 2 thicknesses on average.
        elif 0.0 < thick_mm < edge_mm / 2.2:
            yield (
                f"spot '{name}': layer '{region}' is {thick_mm:.2g} mm thick, less than half of an edge "
                f"there ({edge_mm:.2g} mm). Its bending is then wrong. Mesh the limb again with small "
                f'edges: `palpate limb SCAN --size "{2.0 * thick_mm:.2g} mm"`'
            )


def _wide(study: Study, limb: Limb) -> Iterator[str]:
    """Say where an indenter is wider than what there is of the limb."""
    protocol = study.protocol_at(limb.spot.name)
    if isinstance(protocol, Indentation):
        normal, radius = limb.spot.normal, protocol.indenter.radius_mm
        skin = limb.mesh.points_mm[limb.mesh.node_sets["contact"]] - limb.spot.position_mm
        across = np.ptp(skin @ spot_axes(normal, limb.spot.along)[:, :2], axis=0)
        if 2.0 * radius > across.min():
            yield (
                f"spot '{limb.spot.name}': a {protocol.indenter.name} of radius {radius:g} mm is wider than "
                f"the skin of the mesh, {across.min():.3g} mm; check the radius in [protocol], and the "
                "unit of the mesh"
            )


def _coarse(study: Study, name: str, limb: Limb) -> Iterator[str]:
    """Say where the mesh does not resolve the indenter's edge."""
    protocol = study.protocol_at(limb.spot.name)
    if isinstance(protocol, Indentation):
        edge, size = protocol.indenter.edge_mm, size_at_contact(study, limb)
        if edge < size:
            yield (
                f"spot '{name}': edges of the mesh under the indenter are {size:.2g} mm long, and "
                f"'{protocol.indenter.name}' is rounded by {edge:.2g} mm: the pressure at its edge is not "
                "resolved; refine the mesh there, or give a larger rounding"
            )
