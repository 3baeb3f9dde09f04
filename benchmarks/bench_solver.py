"""Times of whole simulations of the embedded solver: ``make bench-solver``.

Every simulation is a sphere that presses 10 mm deep into Ogden's material with friction 1 and
twists 0 → −22.5° → 22.5° → 0, with the solver's default settings. Every figure comes from a
process of its own on one thread, one after the other. Times are processor seconds unless they
say otherwise.

``--sizes``
    One path on blocks of tet10 and on meshes of a forearm, next to the same solver with new factors
    for every linear system; peak memory; the exponent of cost ∝ n^p.
``--many N``
    N sets of a sweep in one process, which have warm starts, next to cold runs: each in a process
    that imports, prepares the limb and solves. Some sets stand for all. Where a set spends its time.
``--slopes``
    One path with the derivatives in the three parameters and the friction, next to without.

``--before FOLDER``
    Another commit of palpate, built in place there: every path and every path with derivatives is run by
    both in turns, and ratios are printed.

Without any of the first three, all of them. ``--mesh FILE`` takes a mesh of yours (point data ``fixed`` and
``contact``, cell data ``region`` of 0) instead of those that palpate carries.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

DEPTH_MM, RADIUS_MM = 10.0, 7.5
PATH = [(0.0, 0.0), (DEPTH_MM, 0.0), (DEPTH_MM, -22.5), (DEPTH_MM, 22.5), (DEPTH_MM, 0.0)]
THETA = (0.06, 3.0, 1.0)
LOWER, UPPER = np.array([0.03, 1.0, 0.25]), np.array([0.2, 8.0, 2.5])
BLOCKS = ((6, 2), (8, 4), (10, 5), (12, 6), (14, 7))
"""Cells across and down: about 2, 7, 12, 20 and 33 thousand unknowns."""

FOREARMS = ("forearm-demo", "forearm")
"""Studies with a mesh of the spot p2."""

REFINED = "refined:12:3"
"""The mesh of the study forearm with edges of at most 3 mm within 12 mm of the spot."""

N_COLD = 5
"""Cold runs that stand for all."""

LEAST_SETS = 110
"""Fewest sets with some after the warm starts."""

N_TURNS = 3
"""Runs of a path without and with derivatives."""

N_LATE = 30
"""Sets after the warm starts that stand for all of them."""

MOST_WITH_PEER = 15_000
"""Unknowns beyond which the peer, with new factors for every system, is left out."""

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
WANTED_MANY, WANTED_EXTRA, WANTED_EXPONENT = 6.0, 0.25, 1.35


def forearm(study: str) -> str:
    """A mesh file that palpate carries."""
    return str(Path(str(files("palpate_forearm"))) / "studies" / study / "meshes" / "p2.vtu")


def load(mesh: str) -> Any:
    """The limb of a mesh file, of ``block:across:down``, or of ``refined:near:edge``."""
    from palpate.domain import Spot
    from palpate.mesh.specimens import block
    from palpate_indentation.mesh_source import MeshioSource

    if mesh.startswith("refined:"):
        from palpate.mesh.refinement import refined

        return refined(load(forearm("forearm")), *map(float, mesh.split(":")[1:]))
    if not mesh.startswith("block:"):
        return MeshioSource().load(Path(mesh), Spot(name="p2"))
    across, down = map(int, mesh.split(":")[1:])
    return block("tet10", n_across=across, n_down=down, width_mm=60.0, height_mm=30.0, grading=1.4)


def jobs(thetas: Any, limb: Any, path: Any = PATH) -> list[Any]:
    """A job for each set of parameters."""
    from palpate.domain import Indentation, Job
    from palpate.domain.indenter import Sphere
    from palpate_materials.uncoupled import Ogden

    protocol = Indentation(indenter=Sphere(radius_mm=RADIUS_MM), path=np.array(path), friction=1.0)
    materials = {region: Ogden() for region in limb.mesh.regions}
    return [
        Job(
            spot=limb.spot.name,
            set_id=k,
            materials=materials,
            thetas={region: np.array(t) for region in materials},
            protocol=protocol,
        )
        for k, t in enumerate(thetas)
    ]


def designed(n_sets: int) -> np.ndarray:
    """Sets (n, 3) in the ranges of a study."""
    from palpate._core import latin_hypercube

    return LOWER + (UPPER - LOWER) * latin_hypercube(n_sets, 3, 1)


class Clock:
    """Processor seconds by share: what a part takes counts neither for what it was called from."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._parts = ["Python and the rest"]
        self._since = time.process_time()

    def _tick(self) -> None:
        now = time.process_time()
        self.seconds[self._parts[-1]] = self.seconds.get(self._parts[-1], 0.0) + now - self._since
        self._since = now

    @contextmanager
    def within(self, part: str) -> Iterator[None]:
        """Count for a part."""
        self._tick()
        self._parts.append(part)
        try:
            yield
        finally:
            self._tick()
            self._parts.pop()

    def watch(self, owner: type, name: str, part: str) -> None:
        """Count every call of a method for a part."""
        method: Callable[..., object] = getattr(owner, name)

        def timed(*args: object, **options: object) -> object:
            with self.within(part):
                return method(*args, **options)

        setattr(owner, name, timed)

    def shares(self) -> dict[str, float]:
        """Seconds by part since the last call."""
        self._tick()
        found, self.seconds = self.seconds, {}
        return found


def watched() -> Clock:
    """A clock on the parts of a simulation."""
    from palpate_jax.body import Body
    from palpate_jax.contact import Contact
    from palpate_jax.initial_guess import InitialGuess
    from palpate_jax.sparse import LinearSolver, Pattern

    clock = Clock()
    parts: dict[str, tuple[type, tuple[str, ...]]] = {
        "Krylov steps": (LinearSolver, ("_iterate",)),
        "factors": (LinearSolver, ("_factorise",)),
        "element kernels": (Body, ("force", "tangent")),
        "contact": (Contact, ("touched", "force", "stiffness", "drag", "remember", "answer", "along")),
        "sparse values": (Pattern, ("add", "symmetric_part")),
    }
    for part, (owner, names) in parts.items():
        for name in names:
            clock.watch(owner, name, part)
    clock.watch(InitialGuess, "at", "guesses")
    return clock


def counted_steps() -> list[int]:
    """Krylov steps of every linear system of Newton's method from here on, as they come."""
    from palpate_jax.sparse import LinearSolver

    iterate, steps = LinearSolver._iterate, []

    def counted(*arguments: Any) -> Any:
        found = iterate(*arguments)
        steps.append(found[1])
        return found

    setattr(LinearSolver, "_iterate", counted)  # noqa: B010
    return steps


def peak() -> float:
    """Largest memory of this process so far [MB]; Linux gives kB."""
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def one_path(mesh: str, **settings: Any) -> dict[str, Any]:
    """The figures of one path, after a short press that compiles and prepares."""
    from palpate_jax import sparse
    from palpate_jax.solver import JaxSettings, JaxSolver

    if settings.pop("factors_always", False):
        sparse.PATIENCE = 0
    limb = load(mesh)
    solver = JaxSolver(JaxSettings(**settings))
    short = jobs([THETA], limb, [(0.0, 0.0), (0.5, 0.0)])[0]
    solver.simulate(short, limb)
    pressed = time.process_time()
    solver.simulate(short, limb)  # once more, to know what of the first was the press itself
    again, steps = time.process_time(), counted_steps()
    started = time.process_time()
    simulation = solver.simulate(jobs([THETA], limb)[0], limb)
    rows = simulation.diagnostics
    return {
        "status": simulation.status.value,
        "unknowns": 3 * (limb.mesh.n_nodes - len(limb.mesh.node_sets["fixed"])),
        "ready_s": pressed - (again - pressed),
        "path_s": time.process_time() - started,
        "krylov": float(np.mean(steps)),
        "iterations": rows["n_iterations"],
        "factors": rows["n_factorisations"],
        "cuts": rows["n_cuts"],
        "peak_MB": peak(),
    }


def cold(mesh: str, n_sets: int, k: int) -> dict[str, Any]:
    """Set k as unlike those before, from the start of the process on."""
    from palpate_jax.solver import JaxSolver

    limb = load(mesh)
    simulation = JaxSolver().simulate(jobs(designed(n_sets), limb)[k], limb)
    return {"seconds": time.process_time(), "status": simulation.status.value}


def with_warm_starts(sets: np.ndarray, limb: Any, solver: Any) -> list[Any]:
    """The jobs of a sweep: each set with its warm starts."""
    work = []
    for job in jobs(sets, limb):
        n = solver.n_warm_starts(job.set_id)
        warm_starts = dict.fromkeys(limb.mesh.regions, sets[:n]) if n else None
        work.append(
            replace(job, warm_starts=warm_starts, is_warm_start=job.set_id < solver.n_warm_starts(len(sets)))
        )
    return work


def from_warm_starts(mesh: str, n_sets: int, n_late: int) -> dict[str, Any]:
    """The warm starts of a sweep and some of its other sets, in one process: where the time of each goes."""
    from palpate_jax.initial_guess import WarmStartStates
    from palpate_jax.solver import JaxSolver

    limb, clock, solver = load(mesh), watched(), JaxSolver()
    work = with_warm_starts(designed(n_sets), limb, solver)
    groups: dict[int, list[Any]] = {}
    for job in work[: solver.n_warm_starts(n_sets)]:
        groups.setdefault(solver.n_warm_starts(job.set_id), []).append(job)
    late = np.unique(np.linspace(solver.n_warm_starts(n_sets), n_sets - 1, n_late).astype(int))
    groups[solver.n_warm_starts(n_sets)] = [work[k] for k in late]
    clock.shares()
    found = {"ready_s": time.process_time(), "groups": {}}
    with TemporaryDirectory() as folder:
        solver._states = WarmStartStates(Path(folder))  # nothing from an earlier run
        for name, group in groups.items():
            simulations = [solver.simulate(job, limb) for job in group]
            rows = [s.diagnostics for s in simulations]
            found["groups"][name] = {
                "n": len(group),
                "spent": clock.shares(),
                "ok": sum(s.status.value == "ok" for s in simulations),
                "iterations": float(np.mean([r["n_iterations"] for r in rows])),
                "factors": float(np.mean([r["n_factorisations"] for r in rows])),
                "cuts": sum(r["n_cuts"] for r in rows),
            }
    return found | {"peak_MB": peak()}


def with_slopes(mesh: str) -> dict[str, Any]:
    """Processor seconds and factors of a path without and with derivatives: in turns, the least."""
    from palpate_jax.solver import JaxSolver

    limb = load(mesh)
    solver, (job,), (short,) = JaxSolver(), jobs([THETA], limb), jobs([THETA], limb, [(0.0, 0.0), (0.5, 0.0)])
    solver.simulate(replace(short, slopes=True), limb)
    best = {"plain": (np.inf, 0), "slopes": (np.inf, 0)}
    for name in list(best) * N_TURNS:
        before = time.process_time()
        simulation = solver.simulate(replace(job, slopes=name == "slopes"), limb)
        spent = time.process_time() - before
        best[name] = min(best[name], (spent, simulation.diagnostics["n_factorisations"]))
    return best


CHILDREN = {f.__name__: f for f in (one_path, cold, from_warm_starts, with_slopes)}


def in_own_process(
    what: Callable[..., dict[str, Any]], *arguments: Any, source: str = "", **options: Any
) -> dict[str, Any]:
    """The figures of a function of this module that runs in a new process, and ``wall_s`` of it all.

    ``source`` is a folder with another commit of palpate to run it with.
    """
    command = [sys.executable, __file__, "--child", what.__name__, json.dumps([arguments, options])]
    environment = os.environ | ONE_THREAD
    if source:
        folders = [Path(source) / "python", *Path(source).glob("plugins/*/src")]
        environment["PYTHONPATH"] = os.pathsep.join(map(str, folders))
    started = time.perf_counter()
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, env=environment, check=True)
    figures: dict[str, Any] = {"wall_s": time.perf_counter() - started}
    return figures | json.loads(done.stdout)


def write(*cells: object) -> None:
    """Print a row of a table."""
    sys.stdout.write("| " + " | ".join(map(str, cells)) + " |\n")
    sys.stdout.flush()


def heading(*names: str) -> None:
    """Print the first two rows of a table."""
    sys.stdout.write("\n")
    write(*names)
    sys.stdout.write("|" + "---|" * len(names) + "\n")


def sizes(meshes: dict[str, str], before: str) -> None:
    """Print a row for each mesh, and how the cost grows over the blocks."""
    peers = ("before: ready s", "path s", "ratio", "ratio") if before else ("new factors always s", "ratio")
    heading(
        *(
            "limb",
            "unknowns",
            "ready s",
            "path s",
            "iterations",
            "factors",
            "Krylov steps",
            "cuts",
            "peak MB",
        ),
        *peers,
    )
    costs: dict[str, list[tuple[int, float]]] = {}
    for name, mesh in meshes.items():
        own = in_own_process(one_path, mesh)
        if own["status"] == "ok":
            costs.setdefault(name.split(",")[0], []).append((own["unknowns"], own["path_s"]))
        write(
            f"{name}" + ("" if own["status"] == "ok" else f" ({own['status']})"),
            *(f"{own['unknowns']:,}", f"{own['ready_s']:.2f}", f"{own['path_s']:.2f}", own["iterations"]),
            *(own["factors"], f"{own['krylov']:.1f}", own["cuts"], f"{own['peak_MB']:.0f}"),
            *(older(own, mesh, before) if before else always_new(own, mesh)),
        )
    for name, cost in costs.items():
        if len(cost) > 1:
            slope = np.polyfit(*np.log(np.array(cost)).T, 1)[0]
            sys.stdout.write(f"{name}: cost ∝ n^{slope:.2f}, wanted n^{WANTED_EXPONENT}\n")


def older(own: dict[str, Any], mesh: str, source: str) -> tuple[str, ...]:
    """Times of another commit, and ratios to them."""
    peer = in_own_process(one_path, mesh, source=source)
    pairs = [(own[k], peer[k]) for k in ("ready_s", "path_s")]
    return (*(f"{theirs:.2f}" for _, theirs in pairs), *(f"{ours / theirs:.2f}" for ours, theirs in pairs))


def always_new(own: dict[str, Any], mesh: str) -> tuple[str, str]:
    """Time with new factors for every system, and the ratio of it."""
    if own["unknowns"] > MOST_WITH_PEER:
        return "–", "–"
    always = in_own_process(one_path, mesh, factors_always=True)["path_s"]
    return f"{always:.1f}", f"{always / own['path_s']:.1f}"


def many(name: str, mesh: str, n_sets: int) -> None:
    """Print what N sets of a sweep cost, next to what they cost alone, and why."""
    sample = np.unique(np.linspace(0, n_sets - 1, N_COLD).astype(int)).tolist()
    alone = [in_own_process(cold, mesh, n_sets, k) for k in sample]
    cold_s = float(np.mean([a["seconds"] for a in alone]))
    found = in_own_process(from_warm_starts, mesh, n_sets, N_LATE)
    groups = found["groups"]
    each = {group: sum(g["spent"].values()) / g["n"] for group, g in groups.items()}
    *first, late = groups
    n_first = sum(groups[g]["n"] for g in first)
    sweep_s = sum(groups[g]["n"] * each[g] for g in first) + (n_sets - n_first) * each[late]
    sweep_s += found["ready_s"]
    heading(f"{name}: sets", "how many", "cpu s each", "iterations", "factors", "cuts", "ok")
    write("cold, each a process", len(sample), f"{cold_s:.2f}", "–", "–", "–", "–")
    for group, g in groups.items():
        counts = (f"{g['iterations']:.0f}", f"{g['factors']:.1f}", g["cuts"], g["ok"])
        write(f"from {group} warm starts", g["n"], f"{each[group]:.2f}", *counts)
    ratio = n_sets * cold_s / sweep_s
    sys.stdout.write(
        f"{n_sets} sets: cold {n_sets * cold_s:.0f} s, with warm starts {sweep_s:.0f} s of one core, "
        f"{ratio:.1f} times (wanted {WANTED_MANY:.0f}); imports and the mesh {found['ready_s']:.1f} s; "
        f"peak {found['peak_MB']:.0f} MB\n"
    )
    profile(groups)


def profile(groups: dict[str, dict[str, Any]]) -> None:
    """Print where the time of a set goes."""
    heading("ms of a set", *(f"from {group} warm starts" for group in groups))
    *_, late = groups.values()
    for part in sorted(late["spent"], key=lambda part: -late["spent"][part]):
        write(part, *(f"{1e3 * g['spent'].get(part, 0.0) / g['n']:.0f}" for g in groups.values()))


def slopes_cost(meshes: dict[str, str], before: str) -> None:
    """Print what the derivatives of three parameters and the friction add."""
    heading(
        *("limb", "path s", "factors", "with derivatives s", "factors"),
        *(f"extra, wanted ≤ {WANTED_EXTRA:.0%}", "before: path s", "with derivatives s", "extra"),
    )
    for name, mesh in meshes.items():
        cells: list[object] = [name]
        for source in ("", before) if before else ("",):
            found = in_own_process(with_slopes, mesh, source=source)
            (plain, n_plain), (slopes, n_slopes) = found["plain"], found["slopes"]
            factors = ((), ()) if source else ((n_plain,), (n_slopes,))
            cells += [
                f"{plain:.2f}",
                *factors[0],
                f"{slopes:.2f}",
                *factors[1],
                f"{slopes / plain - 1.0:.0%}",
            ]
        write(*cells, *("–",) * (9 - len(cells)))


def main() -> None:
    if sys.argv[1:2] == ["--child"]:
        arguments, options = json.loads(sys.argv[3])
        json.dump(CHILDREN[sys.argv[2]](*arguments, **options), sys.stdout)
        return
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--sizes", action="store_true")
    parser.add_argument("--many", type=int, metavar="N", default=0, help=f"at least {LEAST_SETS}")
    parser.add_argument("--slopes", action="store_true")
    parser.add_argument("--before", metavar="FOLDER", default="")
    parser.add_argument("--mesh", action="append", default=[], metavar="FILE")
    given = parser.parse_args()
    if given.many and given.many < LEAST_SETS:
        parser.error(
            f"--many {given.many}: give at least {LEAST_SETS} sets; the first 108 are the warm starts"
        )
    everything = not (given.sizes or given.many or given.slopes)
    forearms = {f"forearm, {Path(mesh).stem}": mesh for mesh in given.mesh}
    forearms = forearms or {f"forearm, {study}": forearm(study) for study in FOREARMS}
    blocks = {} if given.mesh else {f"block, {a} × {d}": f"block:{a}:{d}" for a, d in BLOCKS}
    if given.sizes or everything:
        larger = {} if given.mesh else {"forearm, refined": REFINED}
        sizes(blocks | forearms | larger, given.before)
    if given.slopes or everything:
        slopes_cost(forearms, given.before)
    if given.many or everything:
        many(*list(forearms.items())[-1], given.many or 250)


if __name__ == "__main__":
    main()
