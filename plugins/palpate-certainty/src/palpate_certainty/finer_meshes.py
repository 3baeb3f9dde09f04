"""Finer meshes than a fit began with."""

from dataclasses import replace

from palpate.api import Run
from palpate.api.runs import FINE, StudyInputs, fine_edge_mm, finer_limb


def finer_inputs(run: Run, worst: str) -> StudyInputs | None:
    """Inputs with finer meshes than a run's fit had; None where the meshes may not be finer.

    Only meshes whose edges the study leaves to the run are refined, up to its ``fine_nodes``.

    Parameters
    ----------
    worst : str
        Reason in words, for the note.
    """
    study, limbs, edges_mm = run.study, run.limbs, dict(run.inputs.edges_mm)
    finer, nodes = {}, 0
    for spot in study.spots:
        name = spot.spot.name
        if spot.fine_edge_mm is None and f"{name}{FINE}" in limbs:
            # Edges of the next finer mesh are 0.7 of the last one's.
            edge_mm = 0.7 * (edges_mm.get(name) or fine_edge_mm(study, spot, limbs[name]))
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
    fine = {f"{spot}{FINE}": limb for spot, limb in finer.items()}
    return replace(run.inputs, limbs={**limbs, **fine}, edges_mm=edges_mm)
