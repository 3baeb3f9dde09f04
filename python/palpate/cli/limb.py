"""``palpate limb``: the meshes of a study, read and checked, or made from a scan."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from palpate.cli.experiment import StageGroup, stage_group
from palpate.cli.options import AsJson, StudyPath
from palpate.cli.progress import StageProgress
from palpate.cli.session import Session
from palpate.errors import MeshError, StudyError, typed

if TYPE_CHECKING:
    from palpate.domain import Limb
    from palpate.plugins.optional import Inspection


def _neither(context: typer.Context, file: Path) -> StudyError:
    """Error of a file that is neither a study nor a scan."""
    stage = context.parent and context.parent.command
    kinds = stage.suffixes.values() if isinstance(stage, StageGroup) else ()
    others = ", ".join(sorted(set().union(*kinds)))
    return StudyError(
        f"{file}: neither a study (study.toml) nor a file that a plugin makes a mesh of "
        f"({others or 'no plugin that does is installed'}); name one of the two"
    )


def limb(context: typer.Context, study: StudyPath, as_json: AsJson = False) -> None:
    """Read and check the mesh around every spot of a study; `palpate limb SCAN` makes meshes of a scan."""
    from palpate.limb.loading import limb_warnings
    from palpate.stages import pipeline

    session = Session.of(context)
    if study.is_file() and study.suffix.lower() != ".toml":
        kinds = session.plugins.limb_sources.values()
        if study.suffix.lower() in set[str]().union(*(getattr(kind, "suffixes", ()) for kind in kinds)):
            raise StudyError(
                f"{study}: a mesh and no study; to look into it: palpate limb inspect {typed(study)}"
            )
        raise _neither(context, study)
    with StageProgress(session, keeps=False) as progress:
        progress.begin("limb", 1)
        checked = session.study(study)
        limbs = pipeline.check_study(checked, session.plugins).limbs
        progress.step()
    rows: list[dict[str, Any]] = [
        {
            "spot": spot,
            "n_nodes": limb.mesh.n_nodes,
            "n_cells": limb.mesh.n_cells,
            "regions": sorted(limb.mesh.used_regions),
            "node_sets": {name: int(nodes.size) for name, nodes in limb.mesh.node_sets.items()},
            "remarks": list(limb.remarks),
            "warnings": list(limb.warnings),
        }
        for spot, limb in limbs.items()
    ]
    show_remarks(session, limbs)
    for text in limb_warnings(checked, limbs):
        session.stderr.print(f"warning: {text}", markup=False)
    if as_json:
        session.json(rows)
    elif rows:
        sets = (", ".join(f"{name} {n}" for name, n in row["node_sets"].items()) for row in rows)
        cells = [
            [row["spot"], row["n_nodes"], row["n_cells"], ", ".join(row["regions"]), of_row]
            for row, of_row in zip(rows, sets, strict=True)
        ]
        session.table("Limbs", ["spot", "nodes", "cells", "regions", "node sets"], cells)
    else:
        session.say("No limb: the study's solver takes no mesh.")


def look_into_mesh(file: Path, session: Session) -> "Inspection":
    """Inspection of a mesh or deck by the limb source of its suffix.

    Raises
    ------
    MeshError
        It cannot be read, or no limb source reads such files.
    """
    from palpate.plugins.guard import answering_for
    from palpate.plugins.optional import FileInspector

    catalogue = session.plugins.limb_sources
    able = [kind for kind in catalogue.values() if isinstance(kind, FileInspector)]
    for kind in able:
        if file.suffix.lower() in kind.suffixes:
            with answering_for(kind, f"inspecting {file}"):
                found: Inspection = kind.inspect(file)  # type: ignore[attr-defined]
            return found
    known = ", ".join(sorted({suffix for kind in able for suffix in kind.suffixes}))
    raise MeshError(f"{file}: no mesh or deck by its suffix; give one of {known or 'none, install a plugin'}")


def show_remarks(session: Session, limbs: "Mapping[str, Limb]") -> None:
    """Print remarks on each spot's mesh on stderr."""
    for spot, limb in limbs.items():
        for text in limb.remarks if spot == limb.spot.name else ():
            session.stderr.print(f"spot '{spot}': {text}", markup=False)


def limb_commands() -> typer.Typer:
    """``palpate limb STUDY``, and the commands that plugins add."""
    return stage_group(limb, "STUDY | SCAN")
