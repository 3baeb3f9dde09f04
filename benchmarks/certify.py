"""Comparison of solvers with each other and with FEBio: a command in one file.

``palpate --plugin benchmarks/certify.py certify``; it needs palpate-febio. The folder ``solver_comparison``
next to it has the problems and the recorded results.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.api import PalpateError, PluginError, StudyError, hookimpl
from palpate.api.cli import AsJson, Command, Session, examples
from palpate.api.runs import FIRST_PARTY, answering_for
from palpate_febio.api import FebioSolver, probe_theta

if TYPE_CHECKING:
    from palpate.api import Limb, Solver
    from palpate.api.runs import Plugins
    from solver_comparison.comparison import SolverComparison

if (folder := str(Path(__file__).parent)) not in sys.path:
    sys.path.append(folder)  # of solver_comparison

HEADS = ("problem", "material", "quantity", "solver", "against")


def certify(
    context: typer.Context,
    material: Annotated[str | None, typer.Argument(help="A material; by default all recorded ones.")] = None,
    mesh: Annotated[
        Path | None,
        typer.Option(
            "--mesh",
            metavar="FILE",
            help="Also on this mesh (.feb, .vtu …): spot at the origin, normal +z, regions all of MATERIAL.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--into",
            metavar="FILE",
            help="Write the JSON there too.",
        ),
    ] = None,
    solver: Annotated[
        list[str] | None,
        typer.Option(
            "--solver", metavar="NAME", help="A solver to compare; repeat for more. Default: palpate's."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compare solvers with FEBio's recorded curves, and with FEBio where it is installed."""
    from palpate.api.files import write_atomically

    session = Session.of(context)
    comparison = _compare(session, material, mesh, solver or ())
    if out is not None:
        file = out / "solver-comparison.json" if out.is_dir() else out
        write_atomically(file, json.dumps(comparison.as_json(), indent=1).encode() + b"\n")
    if as_json:
        session.json(comparison.as_json())
    else:
        _show(session, comparison)
    if not comparison.passed:
        raise typer.Exit(1)


def _compare(
    session: Session, material: str | None, mesh: Path | None, solvers: Sequence[str]
) -> SolverComparison:
    from solver_comparison.comparison import SolverComparison
    from solver_comparison.pairwise import not_shared

    judged, febio, contenders, missing = _contenders(session.plugins, solvers)
    rows = []
    for row in _rows(session, material, mesh, contenders, febio):
        session.note(f"{row.problem}, {row.material}, {row.quantity}, {row.solver}: {row.verdict}")
        rows.append(row)
    made = {name: make(True) for name, make in contenders.items()}
    versions = {name: _version(solver) for name, solver in made.items()}
    provided = {name: solver.provides for name, solver in made.items()}
    missing += not_shared(provided, list(session.plugins.channels.values()))
    return SolverComparison(
        rows=tuple(rows), solvers=versions, missing=tuple(missing), judged=frozenset(judged)
    )


def _version(solver: Solver) -> str:
    try:
        with answering_for(solver, "asking for its version"):
            return solver.version()
    except PalpateError as error:
        return str(error)


def _contenders(plugins: Plugins, asked: Sequence[str]) -> tuple[list[str], Any, dict[str, Any], list[str]]:
    """Names to compare, the installed FEBio or None, a factory for each solver, and what is missing.

    Palpate's solvers come first: they are the references of the others, never the other way round.
    """
    for name in asked:
        if not _takes_mesh(plugins.solvers[name]):
            raise PluginError(
                f"solver '{name}' takes no mesh with its default settings, but every problem here has one"
            )
    febio, missing = _installed_febio(any(_is_febio(plugins.solvers[name]) for name in asked))
    able = [name for name, each in plugins.solvers.items() if _takes_mesh(each)]
    own = [name for name in able if _is_own(plugins.solvers[name])]
    judged = list(asked) or own
    if unasked := [name for name in able if name not in own and name not in judged]:
        missing.append(f"not compared: {', '.join(unasked)}; name each with --solver")
    is_other = any(not _is_own(plugins.solvers[name]) for name in judged)
    references = [name for name in own if is_other or name in judged]
    makers = {
        name: _maker(plugins.solvers[name])
        for name in dict.fromkeys([*references, *judged])
        if febio is not None or not _is_febio(plugins.solvers[name])
    }
    return [name for name in judged if name in makers], febio, makers, missing


def _installed_febio(required: bool) -> tuple[FebioSolver | None, list[str]]:
    """FEBio, or None and what is missing; an error if it is required."""
    febio = FebioSolver()
    try:
        febio.binary()
    except PalpateError as error:
        if required:
            raise
        return None, [f"FEBio itself: {error}. Its recorded curves are used instead"]
    return febio, []


def _is_febio(solver: type[Solver]) -> bool:
    return issubclass(solver, FebioSolver)


def _takes_mesh(solver: type[Solver]) -> bool:
    """True if a solver simulates a mesh with its default settings."""
    from palpate.api.runs import provided_by_default

    provides = provided_by_default(solver)
    return provides is not None and provides.mesh


def _is_own(solver: type[Solver]) -> bool:
    """True if a solver is released with palpate."""
    return solver.__module__.split(".")[0].replace("_", "-") in FIRST_PARTY


def _maker(solver: type[Solver]) -> Any:
    """Make the solver for a case, with FEBio's element formulation if it has a choice."""

    def make(mean_dilatation: bool | tuple[str, ...]) -> Solver:
        if "mean_dilatation" in solver.Settings.model_fields:
            return solver(solver.Settings.model_validate({"mean_dilatation": mean_dilatation or False}))
        return solver()

    return make


def _rows(
    session: Session,
    wanted: str | None,
    mesh: Path | None,
    contenders: Mapping[str, Any],
    febio: Any,
) -> Iterator[Any]:
    from palpate.api.mesh import block
    from solver_comparison.pairwise import twist_rows
    from solver_comparison.recorded import NAMES, RECORDED_VALUES, block_rows, one_element

    materials = session.plugins.materials
    limb = None if mesh is None else _read(session.plugins, mesh)
    names = list(RECORDED_VALUES) if wanted is None else [wanted]
    for name in names:
        yield from one_element(materials[name](), febio)
    if contenders:
        for case in NAMES if wanted is None else [n for n in NAMES if n == wanted]:
            yield from block_rows(case, materials, contenders)
        name = wanted or "ogden"
        material = materials[name]()
        own = [name for name in contenders if _is_own(session.plugins.solvers[name])]
        problems = [
            ("frictional twist", block(n_across=8, n_down=4, grading=1.3)),
            ("frictional twist, tet10", block("tet10", n_across=4, n_down=2, grading=1.3)),
        ]
        if mesh is not None and limb is not None:
            problems.append((f"twist of {mesh.name}", limb))
        for problem, body in problems:
            theta, channels = probe_theta(material), session.plugins.channels
            yield from twist_rows(body, material, theta, contenders, problem, own, channels.values())
    elif mesh is not None:
        raise StudyError(f"{mesh}: no solver that takes a mesh is installed; install palpate-jax")


def _read(plugins: Plugins, mesh: Path) -> Limb:
    from palpate.api import Spot

    is_deck = mesh.suffix == ".feb"
    source = plugins.limb_sources["febio_deck" if is_deck else "meshio"]
    one_region = source.Settings.model_validate({} if is_deck else {"region_data": ""})
    return source(one_region).load(mesh, Spot(name=mesh.stem))


def _show(session: Session, comparison: Any) -> None:
    from solver_comparison.comparison import ENERGIES

    heads = [*HEADS, "difference", "tolerance", "verdict", "note"]
    shown = {"difference": lambda d: "" if d is None else f"{d:.1e}", "tolerance": "{:.0e}".format}
    rows = [[shown.get(head, str)(getattr(row, head)) for head in heads] for row in comparison.rows]
    session.table("Solver comparison", heads, rows)
    for name, version in comparison.solvers.items():
        session.say(f"{name}: {version}")
    for line in comparison.missing:
        session.say(f"missing: {line}")
    for name, sound in comparison.by_solver.items():
        role = "" if name in comparison.judged or name == ENERGIES else ", as a reference"
        session.say(f"{name}{role}: {'agrees' if sound else 'does not agree'}")
    failed = [n for n, sound in comparison.by_solver.items() if not sound and comparison.counts(n)]
    agree = "agree" if comparison.passed else f"do not agree ({', '.join(failed) or 'nothing was compared'})"
    session.say(f"result: the solvers {agree}")


@hookimpl
def palpate_commands() -> list[Command]:
    """Provide the command."""
    call = "palpate --plugin benchmarks/certify.py certify"
    lines = (
        call,
        f"{call} yeoh --mesh limb.vtu --into solver-comparison.json",
        f"{call} --solver my_solver",
    )
    return [Command(function=certify, panel="Verification", epilog=examples(*lines))]
