"""``palpate limb``: the meshes of a study, read and checked, or made from a scan."""

from typing import Any

import typer

from palpate.cli.experiment import StageGroup, stage_group
from palpate.cli.options import AsJson, StudyPath
from palpate.cli.progress import StageProgress
from palpate.cli.session import Session
from palpate.errors import StudyError


def limb(context: typer.Context, study: StudyPath, as_json: AsJson = False) -> None:
    """Read and check the mesh around every spot of a study; `palpate limb SCAN` makes meshes of a scan."""
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
        limbs = pipeline.check_study(session.study(study), session.plugins).limbs
        progress.step()
    rows: list[dict[str, Any]] = [
        {
            "spot": spot,
            "n_nodes": limb.mesh.n_nodes,
            "n_cells": limb.mesh.n_cells,
            "regions": sorted(limb.mesh.used_regions),
            "node_sets": {name: int(nodes.size) for name, nodes in limb.mesh.node_sets.items()},
        }
        for spot, limb in limbs.items()
    ]
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


def limb_commands() -> typer.Typer:
    """``palpate limb STUDY``, and the commands that plugins add."""
    return stage_group(limb, "STUDY | SCAN")
