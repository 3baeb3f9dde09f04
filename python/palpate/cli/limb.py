"""``palpate limb``: the meshes of a study, read and checked, or made from a scan."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import typer

from palpate.cli.experiment import StageGroup, stage_group
from palpate.cli.options import AsJson, StudyPath
from palpate.cli.progress import StageProgress
from palpate.cli.session import Session
from palpate.errors import StudyError

if TYPE_CHECKING:
    from palpate.domain import Limb


def limb(context: typer.Context, study: StudyPath, as_json: AsJson = False) -> None:
    """Read and check the mesh around every spot of a study; `palpate limb SCAN` makes meshes of a scan."""
    from palpate.limb.loading import limb_warnings
    from palpate.stages import pipeline

    session = Session.of(context)
    if study.is_file() and study.suffix.lower() != ".toml":
        stage = context.parent and context.parent.command
        kinds = stage.suffixes.values() if isinstance(stage, StageGroup) else ()
        others = ", ".join(sorted(set().union(*kinds)))
        raise StudyError(
            f"{study}: neither a study (study.toml) nor a file that a plugin makes a mesh of "
            f"({others or 'no plugin that does is installed'}); name one of the two"
        )
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
        cells = [
            [
                *(row[key] for key in ("spot", "n_nodes", "n_cells")),
                ", ".join(row["regions"]),
                ", ".join(f"{name} {size}" for name, size in row["node_sets"].items()),
            ]
            for row in rows
        ]
        session.table("Limbs", ["spot", "nodes", "cells", "regions", "node sets"], cells)
    else:
        session.say("No limb: the study's solver takes no mesh.")


def show_remarks(session: Session, limbs: "Mapping[str, Limb]") -> None:
    """Print on stderr what was read, left out and changed of each spot's mesh."""
    for spot, limb in limbs.items():
        for text in limb.remarks if spot == limb.spot.name else ():
            session.stderr.print(f"spot '{spot}': {text}", markup=False)


def limb_commands() -> typer.Typer:
    """``palpate limb STUDY``, and the commands that plugins add."""
    return stage_group(limb, "STUDY | SCAN")
