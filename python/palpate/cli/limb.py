"""``palpate limb``: the meshes of a study, read and checked."""

import typer

from palpate.cli.options import AsJson, StudyPath
from palpate.cli.session import Session


def limb(context: typer.Context, study: StudyPath, as_json: AsJson = False) -> None:
    """Read and check the mesh around every spot."""
    from palpate import pipeline

    session = Session.of(context)
    limbs = pipeline.check(session.study(study), session.plugins).limbs
    rows: list[dict[str, object]] = [
        {
            "spot": spot,
            "n_nodes": limb.mesh.n_nodes,
            "n_cells": limb.mesh.n_cells,
            "regions": list(limb.mesh.regions),
            "node_sets": {name: int(nodes.size) for name, nodes in limb.mesh.node_sets.items()},
        }
        for spot, limb in limbs.items()
    ]
    if as_json:
        session.json(rows)
    elif rows:
        session.table("Limbs", list(rows[0]), [list(map(str, row.values())) for row in rows])
    else:
        session.say("No limb: the study's solver makes homogeneous tests.")
