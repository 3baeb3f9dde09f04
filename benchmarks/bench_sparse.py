"""Factors of real tangents, faer's next to CHOLMOD's and SuperLU's: ``make bench-sparse``.

Blocks of tet10 and hex8 dented by a sphere, Ogden's material, and the forearm of the demo's
study. Every solver has a process of its own, on one thread, and gets the same matrix, which is the
symmetric part of the tangent without the coupling of friction and pressure. Times are processor
seconds, the least of some rounds; memory is what the process gained at its peak. CHOLMOD is left
out where it is not installed.
``--quick`` stops at 25,000 unknowns.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from palpate.domain import Limb, Spot
from palpate.mesh.specimens import block

THETA = np.array([0.061, 3.1, 1.3])
DEPTH_MM, RADIUS_MM = 0.5, 7.5
BLOCKS = {
    "tet10": ((8, 3), (12, 7), (16, 8), (20, 10)),
    "hex8": ((16, 6), (24, 13), (32, 16), (40, 20)),
}
"""Cells across and down: about 5, 25, 50 and 100 thousand unknowns."""

PEER = "superlu"

LARGEST = {PEER: 30_000}
"""Unknowns beyond which a solver takes minutes or the memory of a laptop."""

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")


def tangent(limb: Limb, path: Path) -> int:
    """Write the tangents of a limb, dented by hand to the sphere's shape; the number of unknowns."""
    from palpate.domain.indenter import Sphere
    from palpate_jax.contact import ContactLaw, ContactState
    from palpate_jax.model import Model
    from palpate_jax.schedule import pose
    from palpate_materials.uncoupled import Ogden

    model = Model(limb, {"soft_tissue": Ogden()}, True)
    x, y, z = model.points.T
    shift = np.zeros_like(model.points)
    shift[:, 2] = -0.98 * DEPTH_MM * np.exp(-(x**2 + y**2) / (2.0 * RADIUS_MM * DEPTH_MM) + z / 15.0)
    shift.reshape(-1)[~model._free] = 0.0
    place = pose(np.array([DEPTH_MM, 0, 0, 0, 0, 0]))
    law = ContactLaw(Sphere(radius_mm=RADIUS_MM), 1000.0 * 0.5 * THETA[0] / RADIUS_MM, 1.0)
    load = ContactState(place, model.contact.no_memory(place), law)
    linearised = model.linearised(shift, {"soft_tissue": THETA})
    np.savez(
        path,
        indptr=model.pattern.indptr,
        indices=model.pattern.indices,
        values=linearised.preconditioner(load),
        rhs=linearised.residual(load).free,
    )
    return model.pattern.n_unknowns


def forearm() -> Limb:
    """The first limb of the forearm study."""
    from palpate_indentation.mesh_source import MeshioSource

    folder = Path(str(files("palpate_forearm"))) / "studies" / "forearm" / "meshes"
    return MeshioSource().load(folder / "p2.vtu", Spot(name="p2"))


class Measured:
    """What a solver is measured by: analyse (on construction), factorise, apply."""

    def __init__(self, solver: str, matrix: sp.csr_array) -> None:
        self.matrix = matrix
        name, _, self.precision = solver.partition(" ")
        getattr(self, f"_{name}")()

    def _faer(self) -> None:
        from palpate._core import SparseFactor

        factor = SparseFactor(self.matrix.indptr, self.matrix.indices, precision=self.precision)
        self.factorise: Callable[[], object] = lambda: factor.factorise(self.matrix.data)
        self.apply: Callable[[np.ndarray], np.ndarray] = factor.precondition

    def _cholmod(self) -> None:
        from sksparse import cholmod

        columns = sp.csc_matrix(self.matrix)
        factor = cholmod.analyze(columns, mode="supernodal", ordering_method="nesdis")
        self.factorise = lambda: factor.cholesky_inplace(columns)
        self.apply = factor

    def _superlu(self) -> None:
        from scipy.sparse.linalg import splu

        columns = sp.csc_array(self.matrix)
        symmetric = {"permc_spec": "MMD_AT_PLUS_A", "options": {"SymmetricMode": True}}
        found: list[Any] = []

        def factorise() -> None:
            found[:] = [splu(columns, diag_pivot_thresh=0.01, **symmetric)]

        self.factorise = factorise
        self.apply = lambda rhs: found[0].solve(rhs)


def least(run: Callable[[], object], at_most_s: float) -> float:
    """Processor seconds of the fastest of up to seven runs."""
    times: list[float] = []
    while len(times) < 7 and sum(times) < at_most_s:
        start = time.process_time()
        run()
        times.append(time.process_time() - start)
    return min(times)


def resident(which: str) -> float:
    """Memory of this process in MB, from Linux."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(float(line.split()[1]) / 1024.0 for line in lines if line.startswith(which))


def measure(solver: str, path: str) -> dict[str, float]:
    """All figures of one solver on one matrix."""
    data = np.load(path)
    matrix = sp.csr_array((data["values"], data["indices"], data["indptr"]))
    rhs = data["rhs"]
    Measured(solver, sp.eye_array(8, format="csr")).factorise()  # loads what it loads
    before = resident("VmRSS")
    Path("/proc/self/clear_refs").write_text("5")  # the peak starts again
    start = time.process_time()
    solve = Measured(solver, matrix)
    analyse = time.process_time() - start
    factorise = least(solve.factorise, 8.0)
    x = solve.apply(rhs)
    peak = resident("VmHWM") - before
    return {
        "analyse": analyse,
        "factorise": factorise,
        "apply": least(lambda: solve.apply(rhs), 1.0),
        "residual": float(np.linalg.norm(matrix @ x - rhs) / np.linalg.norm(rhs)),
        "peak_MB": peak,
    }


def solvers() -> Iterator[str]:
    """Those that are installed."""
    yield from ("faer double", "faer single", PEER)
    if find_spec("sksparse") is None:
        sys.stderr.write("sksparse is not installed, CHOLMOD is left out\n")
    else:
        yield "cholmod"


def in_own_process(solver: str, path: Path) -> dict[str, float] | None:
    """The figures, or nothing where the solver refuses the matrix."""
    command = [sys.executable, __file__, "--measure", solver, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | ONE_THREAD, check=False)
    if done.returncode:
        sys.stderr.write(f"{solver}: {done.stderr.strip().splitlines()[-1]}\n")
        return None
    figures: dict[str, float] = json.loads(done.stdout)
    return figures


def limbs(most_unknowns: float) -> Iterator[tuple[str, Limb]]:
    """Named limbs by size."""
    for kind, sizes in BLOCKS.items():
        for n_across, n_down in sizes:
            limb = block(kind, n_across=n_across, n_down=n_down, width_mm=60.0, height_mm=30.0, grading=1.4)
            if 3 * limb.mesh.n_nodes < 1.3 * most_unknowns:
                yield kind, limb
    yield "forearm", forearm()


def main() -> None:
    """Print one row for every matrix and solver, and the exponent of the cost of each."""
    if sys.argv[1:2] == ["--measure"]:
        json.dump(measure(*sys.argv[2:4]), sys.stdout)
        return
    most = 25_000 if "--quick" in sys.argv else np.inf
    sys.stdout.write(
        "| limb | unknowns | solver | analyse s | factor s | × peer | apply ms | × peer | residual | MB |\n"
        "|---|---|---|---|---|---|---|---|---|---|\n"
    )
    names = list(solvers())
    costs: dict[tuple[str, str], list[tuple[int, float]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "tangent.npz"
        for kind, limb in limbs(most):
            n = tangent(limb, path)
            rows = {s: in_own_process(s, path) for s in names if n <= LARGEST.get(s, n)}
            for solver, row in rows.items():
                if row is not None:
                    write(kind, n, solver, row, rows.get(PEER))
                    costs.setdefault((kind, solver), []).append((n, row["factorise"]))
    for (kind, solver), cost in costs.items():
        if len(cost) > 2:
            slope = np.polyfit(*np.log(np.array(cost)).T, 1)[0]
            sys.stdout.write(f"factor of {solver}, {kind}: cost ∝ n^{slope:.2f}\n")


def write(kind: str, n: int, solver: str, row: dict[str, float], peer: dict[str, float] | None) -> None:
    """Print one row."""
    ratios = ["–" if peer is None else f"{row[what] / peer[what]:.2f}" for what in ("factorise", "apply")]
    sys.stdout.write(
        f"| {kind} | {n:,} | {solver} | {row['analyse']:.2f} | {row['factorise']:.3f} | {ratios[0]} "
        f"| {1e3 * row['apply']:.2f} | {ratios[1]} | {row['residual']:.0e} | {row['peak_MB']:.0f} |\n"
    )
    sys.stdout.flush()


if __name__ == "__main__":
    main()
