"""``palpate friction-memory``: torque against the number of steps, and the stiffness found with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.api import AsJson, PalpateError, Session

if TYPE_CHECKING:
    from palpate.api import Limb, Material, Plugins, Response, Solver

TWIST_DEG = 22.5
MATERIAL = "yeoh"
THETA = (0.0129, -1.008e-3, 9.2077e-5, 0.6)
"""The paper's generalised set, textbook; the paper gives no κ."""

DEMO = ("forearm-demo", "meshes/p1.vtu")
RIGHT = "embedded"

Make = Callable[[float], "Solver"]
"""Makes a solver whose steps of rotation are at most this many degrees."""


def friction_memory(
    context: typer.Context,
    steps: Annotated[
        list[int] | None,
        typer.Option("--steps", min=1, help="Steps of a quarter of the twist; repeat for more."),
    ] = None,
    depth_mm: Annotated[float, typer.Option("--depth-mm", min=0.1, help="How deep to press.")] = 3.0,
    as_json: AsJson = False,
) -> None:
    """Show the error of the torque, and of the stiffness identified by it, without friction history."""
    from palpate_validation.friction_memory import friction_results, recorded

    session = Session.of(context)
    limb, problem = _forearm(session.plugins)
    forms, missing = _forms(session.plugins, limb)
    runs, right = {}, None
    for form, make in forms.items():
        for n in steps or [5, 10]:
            session.note(f"{form}, {n} steps a quarter")
            runs[form, n] = _run(session.plugins, limb, depth_mm, make(TWIST_DEG / n))
            if form == RIGHT and runs[form, n][0] is not None:
                right = runs[form, n][0]
    found = [*recorded(), *(() if right is None else friction_results(problem, runs, right))]
    if right is None:
        missing.append(f"the embedded solver on {problem}: without it there is no reference to compare with")
    if as_json:
        session.json({"results": [asdict(o) for o in found], "missing": missing})
        return
    session.table("Friction without memory", list(HEADS), [_cells(o) for o in found])
    for line in missing:
        session.say(f"missing: {line}")
    session.say(EXPLANATION)


HEADS = ("problem", "contact", "steps", "torque [N·mm]", "of the right one", "stiffness found / true", "note")
EXPLANATION = (
    "The penalty form resets the sticking points in every step. Its torque falls with the number of steps, "
    "and a stiffness identified by torque rises as much: it depends on the step, not on the tissue. The "
    "augmented form keeps what its augmentation has converged and resets the rest in every step: its "
    "verification shows how much. The embedded solver keeps the sticking points."
)


def _cells(result: Any) -> list[str]:  # noqa: ANN401 -- an FrictionResult
    stiffness = result.stiffness or {}
    return [
        result.problem,
        result.form,
        str(result.n_steps),
        "–" if result.torque_Nmm is None else f"{result.torque_Nmm:.4g}",
        "–" if result.relative is None else f"{result.relative:.0%}",
        ", ".join(f"{name} {value:.2f}" for name, value in stiffness.items()) or "–",
        result.note,
    ]


def _forearm(plugins: Plugins) -> tuple[Limb, str]:
    """A small forearm where the forearm study is installed, else a block."""
    study, mesh = DEMO
    if study in plugins.studies and "meshio" in plugins.limb_sources:
        from palpate.api import read_study

        folder = Path(plugins.studies[study].directory)
        read = read_study(folder, plugins, need_measured=False)
        spot = next(s for s in read.spots if s.mesh is not None and s.mesh == (folder / mesh))
        assert read.limb_source is not None
        return read.limb_source.load(folder / mesh, spot.spot), "the demo's forearm"
    from palpate.specimens import block

    return block(n_across=8, n_down=4, grading=1.3), "a block"


def _forms(plugins: Plugins, limb: Limb) -> tuple[dict[str, Make], list[str]]:
    """The embedded solver with FEBio's elements, and FEBio's two forms of contact where it is installed."""
    from palpate_febio.settings import FebioSettings
    from palpate_febio.solver import FebioSolver

    forms: dict[str, Make] = {}
    missing = []
    if "jax" in plugins.solvers:
        jax = plugins.solvers["jax"]
        elements = {"mean_dilatation": "hex8" in limb.mesh.cells}
        forms[RIGHT] = lambda step: jax(jax.Settings.model_validate({"rotation_step_deg": step} | elements))
    try:
        FebioSolver().binary()
    except PalpateError as error:
        missing.append(
            f"FEBio's two forms on the same limb: {error}. The recorded figures are of smaller problems"
        )
        return forms, missing
    settings = FebioSettings.model_validate({})
    forms["augmented"] = lambda step: FebioSolver(settings.model_copy(update={"rotation_step_deg": step}))
    forms["penalty"] = lambda step: FebioSolver(
        settings.model_copy(update={"rotation_step_deg": step, "contact": "paper"})
    )
    return forms, missing


def _run(plugins: Plugins, limb: Limb, depth_mm: float, solver: Solver) -> tuple[Response | None, str]:
    import numpy as np

    from palpate.api import Indentation, Job, Sphere, Status

    material: Material = plugins.materials[MATERIAL]()
    waypoints = [(0.0, 0.0), (depth_mm, 0.0), (depth_mm, -TWIST_DEG), (depth_mm, TWIST_DEG), (depth_mm, 0.0)]
    job = Job(
        spot=limb.spot.name,
        set_id=0,
        materials=dict.fromkeys(limb.mesh.regions, material),
        thetas=dict.fromkeys(limb.mesh.regions, np.array(THETA)),
        protocol=Indentation(indenter=Sphere(radius_mm=7.5), path=np.array(waypoints), friction=1.0),
    )
    solver.check(job, limb)
    simulation = solver.simulate(job, limb)
    sound = simulation.status is Status.OK
    return (simulation.response if sound else None), simulation.message
