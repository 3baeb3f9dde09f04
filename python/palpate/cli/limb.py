"""``palpate limb``: the meshes of a study, read and checked, or made from a scan."""

from collections.abc import Mapping
from pathlib import PurePath
from typing import Any

import typer

from palpate.cli.inspect import StageGroup, stage_group
from palpate.cli.options import AsJson, StudyPath
from palpate.cli.session import Session
from palpate.errors import StudyError


def limb(context: typer.Context, study: StudyPath, as_json: AsJson = False) -> None:
    """Read and check the mesh around every spot."""
    from palpate import pipeline

    session = Session.of(context)
    if study.is_file() and study.suffix.lower() != ".toml":
        scans = ", ".join(sorted(SCAN_SUFFIXES))
        remedy = "install palpate-limb" if study.suffix.lower() in SCAN_SUFFIXES else "name one of the two"
        raise StudyError(
            f"{study}: neither a study (study.toml) nor a scan ({scans}) that can be meshed; {remedy}"
        )
    limbs = pipeline.check_study(session.study(study), session.plugins).limbs
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
            [row["spot"], str(row["n_nodes"]), str(row["n_cells"]), ", ".join(row["regions"]), _sizes(row)]
            for row in rows
        ]
        session.table("Limbs", ["spot", "nodes", "cells", "regions", "node sets"], cells)
    else:
        session.say("No limb: the study's solver takes no mesh.")


def _sizes(row: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {size}" for name, size in row["node_sets"].items())


SCAN = "scan"
SCAN_SUFFIXES = frozenset({".ply", ".obj", ".glb", ".stl", ".off"})
"""Of surfaces; what has no colours is refused when it is read, and says so."""


class LimbGroup(StageGroup):
    """The stage, whose first word may also be a scan where a plugin makes limbs of one."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 - as in StageGroup
        """Put the command for scans before a file that is one."""
        if args and SCAN in self.commands and PurePath(args[0]).suffix.lower() in SCAN_SUFFIXES:
            args = [SCAN, *args]
        return super().parse_args(ctx, args)


def limb_commands() -> typer.Typer:
    """``palpate limb STUDY``, and what plugins add to it under names of their own."""
    return stage_group(limb, LimbGroup, "STUDY | SCAN")
