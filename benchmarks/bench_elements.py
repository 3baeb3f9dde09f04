"""Times of the element kernels, each next to the same work in JAX in the same run: ``make bench``.

A block of tet10 and one of hex8, Ogden's material, mean dilatation, one core. «tangent» is
the forces and the stiffness with its way into the sparse values; «first tangent» is that
with the compilation.

Then the parts of a tangent next to a roofline: what their operations would take at the speed of a
product of dense matrices on this core, or their bytes at that of a copy, whichever is more.
"""

import sys
import time
from collections.abc import Callable

import numpy as np

from palpate.api.mechanics import ElementBlock
from palpate.mesh.specimens import block
from palpate_jax.autodiff import AutodiffKernel
from palpate_jax.body import blocks
from palpate_jax.compiled import CompiledKernel
from palpate_jax.sparse import Pattern
from palpate_materials.uncoupled import Ogden

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


def best(run: Callable[[], object]) -> float:
    """Least processor time of some rounds."""
    return min(seconds(run) for _ in range(N_ROUNDS))


def core_speed() -> tuple[float, float]:
    """Operations and bytes per second of this core: a product of matrices, and a copy out of memory."""
    matrix, large = np.ones((512, 512)), np.ones(2**24)
    into = np.empty_like(large)
    return 2.0 * 512**3 / best(lambda: matrix @ matrix), 16.0 * 2**24 / best(lambda: np.copyto(into, large))


def operations(q: int, n: int) -> dict[str, float]:
    """Additions, products, quotients and roots of one element with q points and n nodes.

    Four sweeps of three rotations find the stretches of a point. A block of the stiffness takes 54 for each
    point and pair of nodes, and each entry is added to the sparse values.
    """
    pairs = n * (n + 1) / 2
    tangent_of_point = 15 * 21 + n * 15 + n * 9 * 15 + n * 36
    return {
        "deformation": q * (18 * n + 4 * 3 * 60 + 60),
        "forces": q * (18 * n + 60),
        "stiffness": q * (tangent_of_point + 54 * pairs) + 36 * pairs + 9 * n * n,
    }


def moved_bytes(q: int, n: int) -> dict[str, float]:
    """Bytes of one element that are read or written: geometry, points, places and sparse values."""
    geometry, point = 8.0 * q * (3 * n + 1), 8.0 * 23 * q
    return {
        "deformation": geometry + point + 28 * n,
        "forces": geometry + point + 24 * q + 52 * n,
        "stiffness": geometry + point + 96 * q + n * n * (8 + 9 * 16),
    }


def roofline(kind: str, n_across: int, n_down: int) -> None:
    """Print each part's microseconds an element, and how far it is from what the core can do."""
    mesh = block(kind, n_across=n_across, n_down=n_down, width_mm=40.0, height_mm=20.0).mesh
    (part,) = blocks(mesh)
    unknowns = np.arange(3 * mesh.n_nodes).reshape(-1, 3)
    pattern = Pattern([unknowns[part.nodes].reshape(len(part.nodes), -1)], 3 * mesh.n_nodes)
    made = ElementBlock(part.nodes, part.gradients, part.volumes, places=pattern.places(0))
    u = 0.02 * np.random.default_rng(0).standard_normal(mesh.points_mm.shape)
    deformation = made.deform(u)
    psi_i, psi_ij = np.ones(deformation.stretches.shape), np.ones((*deformation.stretches.shape, 3))
    total, values = np.zeros(u.shape), np.zeros(len(pattern.indices) + 1)
    times = {
        "deformation": best(lambda: made.deform(u)),
        "forces": best(lambda: deformation.add_force(psi_i, total)),
        "stiffness": best(lambda: deformation.add_stiffness(psi_i, psi_ij, values)),
    }
    (n_elements, q), n = part.volumes.shape, part.nodes.shape[1]
    per_second, bytes_per_second = core_speed()
    for name, taken in times.items():
        n_operations, n_bytes = operations(q, n)[name], moved_bytes(q, n)[name]
        bound = n_elements * max(n_operations / per_second, n_bytes / bytes_per_second)
        sys.stdout.write(
            f"{kind + ': ' + name:<22}{n_operations:>10.0f}{n_bytes:>10.0f}{taken / n_elements * 1e6:>10.2f}"
            f"{n_operations * n_elements / taken * 1e-9:>10.1f}{taken / bound:>10.1f}\n"
        )
    sys.stdout.write(f"core: {per_second * 1e-9:.0f} Gop/s, {bytes_per_second * 1e-9:.0f} GB/s\n")


def main() -> None:
    sys.stdout.write(f"{'name':<34}{'ours':>12}{'JAX':>12}{'ratio':>8}\n")
    measure("tet10", 7, 7)
    measure("hex8", 14, 10)
    sys.stdout.write(
        f"\n{'part of a tangent':<22}{'operations':>10}{'bytes':>10}{'µs':>10}{'Gop/s':>10}  × roofline\n"
    )
    roofline("tet10", 7, 7)
    roofline("hex8", 14, 10)


if __name__ == "__main__":
    main()
