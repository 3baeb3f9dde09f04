"""Normals and curvature of a rigid surface, from its signed distance alone."""

from functools import partial
from typing import Any, Protocol

import jax
import jax.numpy as jnp
import numpy as np

from palpate.domain.curves import FloatArray

jax.config.update("jax_enable_x64", True)  # type: ignore[no-untyped-call]

LEAST_POINTS = 256
"""Points are padded to this number times a power of two, so that few sizes are compiled."""


class RigidBody(Protocol):
    """A rigid body with a distance in the array API; equal bodies have one shape."""

    def distance(self, points: Any) -> Any:  # noqa: ANN401 -- an array of NumPy or JAX
        """Signed distance (...) [mm] of points (..., 3)."""

    def __hash__(self) -> int: ...


def distance_derivatives(indenter: RigidBody, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Normals (n, 3) and curvature (n, 3, 3) [1/mm]: derivatives of a distance at points (n, 3) [mm].

    Points are in the indenter's frame. Compiled code is shared with equal indenters.
    """
    n = len(points)
    size = LEAST_POINTS << max(int(np.ceil(np.log2(max(n, 1) / LEAST_POINTS))), 0)
    padded = np.ones((size, 3))
    padded[:n] = points
    normals, curvature = _derivatives(indenter, padded)
    return np.asarray(normals)[:n], np.asarray(curvature)[:n]


@partial(jax.jit, static_argnums=0)
def _derivatives(indenter: RigidBody, points: Any) -> tuple[Any, Any]:  # noqa: ANN401 -- arrays of JAX
    gradient = jax.grad(lambda x: jnp.sum(indenter.distance(x)))
    return jax.vmap(gradient)(points), jax.vmap(jax.jacfwd(gradient))(points)
