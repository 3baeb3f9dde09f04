"""Finer meshes than a fit began with, where their error is much of the variance of what is asked for."""

from dataclasses import replace

import polars as pl

from palpate.limb.loading import fine_edge_mm, finer_limb
from palpate.run.result import StudyInputs
from palpate.stages.stage import Run

SHARE = 0.2
"""Share of the mesh in the variance of a parameter above which meshes are refined."""

SHORTER = 0.7
"""Longest edge of the next finer mesh over that of the last one."""

SHOWN_BY = "two meshes"
"""What shows an error that a finer mesh lessens: the scatter between meshes of one size stays."""


def finer_inputs(run: Run) -> StudyInputs | None:
    """Inputs with finer meshes than those of a run's fit; None: these are fine enough, or may not be finer.

    Fine enough is an error of at most :data:`SHARE` of the variance of every parameter of what leads. Only
    meshes whose edges the study leaves to the run are refined, up to its ``fine_nodes``.
    """
    if not (worst := _worst(run)):
        return None
    study, limbs, edges_mm = run.study, run.limbs, dict(run.inputs.edges_mm)
    finer, nodes = {}, 0
    for spot in study.spots:
        name = spot.spot.name
        if spot.fine_edge_mm is None and f"{name}/fine" in limbs:
            edge_mm = SHORTER * (edges_mm.get(name) or fine_edge_mm(study, spot, limbs[name]))
            limb = finer_limb(study, replace(spot, fine_edge_mm=edge_mm), limbs)
            assert limb is not None  # its edges are stated
            nodes = max(nodes, limb.mesh.n_nodes)
            if limb.mesh.n_nodes <= study.fine_nodes:
                finer[name], edges_mm[name] = limb, edge_mm
    if not finer:
        if nodes:
            run.progress.note(
                f"{worst}; a finer one would have {nodes:,} nodes, and may have {study.fine_nodes:,}: "
                "set `fine_nodes` in [fit] to let it"
            )
        return None
    sizes = ", ".join(f"{edges_mm[spot]:.2g} mm at {spot}" for spot in finer)
    run.progress.note(f"{worst}: refined to edges of {sizes}, and fitted again")
    fine = {f"{spot}/fine": limb for spot, limb in finer.items()}
    return replace(run.inputs, limbs={**limbs, **fine}, edges_mm=edges_mm)


def _worst(run: Run) -> str:
    """Largest share of the mesh in a variance, in words; empty: it is little, or cannot be lessened."""
    certainty = run.fit().certainty
    if certainty.budget.is_empty() or certainty.mesh_errors.is_empty():
        return ""
    lead = run.fitted()
    of_lead = {"fit": lead.fit, "scenario": lead.scenario}
    shares = certainty.budget.filter(pl.col("share") > SHARE, **of_lead, cause="mesh").sort("share")
    if shares.is_empty() or certainty.mesh_errors.filter(**of_lead, shown_by=SHOWN_BY).is_empty():
        return ""
    return f"the mesh is {100.0 * shares['share'][-1]:.0f} % of the variance of {shares['parameter'][-1]}"
