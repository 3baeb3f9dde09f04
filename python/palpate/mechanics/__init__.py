"""Stress, tangent and initial moduli of any material, from its energy alone.

JAX is imported when one of the functions is first used, so that a plugin may import this module
at its top and ``palpate --help`` stays quick. Its 64-bit mode is on from then on.
"""

import os
import sys
from typing import TYPE_CHECKING

from palpate.lazy_imports import deferred

if TYPE_CHECKING:
    from palpate.mechanics.spectral import (
        EQUAL,
        REST_TOLERANCE,
        cauchy_stress,
        check_reference_state,
        initial_moduli,
        moduli_at_rest,
        principal_derivatives,
        stress,
        stress_and_tangent,
    )

__all__ = [
    "EQUAL",
    "REST_TOLERANCE",
    "cauchy_stress",
    "check_reference_state",
    "initial_moduli",
    "moduli_at_rest",
    "principal_derivatives",
    "stress",
    "stress_and_tangent",
]

if "jax" in sys.modules:
    from palpate.mechanics import spectral as spectral
else:
    # A plugin that compiles functions of its own must not do so in single precision before.
    os.environ.setdefault("JAX_ENABLE_X64", "true")

__getattr__ = deferred("palpate.mechanics", dict.fromkeys(__all__, "spectral"))
