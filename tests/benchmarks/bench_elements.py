"""Times of the element kernels, each next to the same work in JAX in the same run: ``make bench``.

A block of tet10 and one of hex8, Ogden's material, mean dilatation, one core. «tangent» is
the forces and the stiffness with its way into the sparse values; «first tangent» is that
with the compilation.
"""

import sys
import time
from collections.abc import Callable

import numpy as np

from palpate.specimens import block
from palpate_jax.autodiff import AutodiffKernel
from palpate_jax.body import blocks
from palpate_jax.compiled import CompiledKernel
from palpate_jax.sparse import Pattern
from palpate_materials.ogden import Ogden

THETA = np.array([0.06, 3.0, 1.0])
N_ROUNDS = 15


def seconds(run: Callable[[], object]) -> float:
    """Processor time of one run."""
    start = time.process_time()
    run()
    return time.process_time() - start


def report(name: str, times: list[float]) -> None:
    sys.stdout.write(
        f"{name:<34}{times[0] * 1e3:>9.2f} ms{times[1] * 1e3:>9.2f} ms{times[1] / times[0]:>8.1f}\n"
    )


def measure(kind: str, n_across: int, n_down: int) -> None:
    """Print the rows of one kind."""
    mesh = block(kind, n_across=n_across, n_down=n_down, width_mm=40.0, height_mm=20.0).mesh
    (part,) = blocks(mesh)
    unknowns = np.arange(3 * mesh.n_nodes).reshape(-1, 3)
    pattern = Pattern([unknowns[part.nodes].reshape(len(part.nodes), -1)], 3 * mesh.n_nodes)
    u = 0.02 * np.random.default_rng(0).standard_normal(mesh.points_mm.shape)
    total, values = np.zeros(u.shape), np.zeros(len(pattern.indices) + 1)
    kernels = [
        make(Ogden(), part.nodes, part.gradients, part.volumes, True)
        for make in (CompiledKernel, AutodiffKernel)
    ]
    first, tangents, forces, sums = [], [], [], []
    for kernel in kernels:
        kernel.bind(pattern.places(0))
        first.append(seconds(lambda own=kernel: own.add_tangent(u, THETA, total, values)))
        kernel.add_force(u, THETA, total)
        values[:] = 0.0
        kernel.add_tangent(u, THETA, total, values)
        sums.append(values.copy())
        runs = range(N_ROUNDS)
        tangents.append(
            min(seconds(lambda own=kernel: own.add_tangent(u, THETA, total, values)) for _ in runs)
        )
        forces.append(min(seconds(lambda own=kernel: own.add_force(u, THETA, total)) for _ in runs))
    np.testing.assert_allclose(sums[0], sums[1], atol=1e-10 * np.abs(sums[1]).max())
    name = f"{len(part.nodes)} {kind}"
    report(f"{name}: forces", forces)
    report(f"{name}: tangent", tangents)
    report(f"{name}: first tangent", first)


def main() -> None:
    sys.stdout.write(f"{'name':<34}{'ours':>12}{'JAX':>12}{'ratio':>8}\n")
    measure("tet10", 7, 7)
    measure("hex8", 14, 10)


if __name__ == "__main__":
    main()
