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
        EQUAL as EQUAL,
        REST_TOLERANCE as REST_TOLERANCE,
        cauchy_stress as cauchy_stress,
        check_reference_state as check_reference_state,
        initial_moduli as initial_moduli,
        moduli_at_rest as moduli_at_rest,
        principal_derivatives as principal_derivatives,
        stress as stress,
        stress_and_tangent as stress_and_tangent,
    )

if "jax" in sys.modules:
    from palpate.mechanics import spectral as spectral
else:
    # A plugin that compiles functions of its own must not do so in single precision before.
    os.environ.setdefault("JAX_ENABLE_X64", "true")

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)
