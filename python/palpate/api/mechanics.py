"""Stress, tangent and initial moduli from an energy, and the kernels of finite elements."""

import importlib
from typing import TYPE_CHECKING

from palpate.lazy_imports import deferred

# It turns on JAX's 64-bit mode, which a plugin needs before it compiles functions of its own.
importlib.import_module("palpate.mechanics")

if TYPE_CHECKING:
    from palpate._core import (
        Deformation as Deformation,
        ElementBlock as ElementBlock,
        SparseFactor as SparseFactor,
    )
    from palpate.domain.component import Array as Array
    from palpate.mechanics import (
        cauchy_stress as cauchy_stress,
        check_reference_state as check_reference_state,
        initial_moduli as initial_moduli,
        moduli_at_rest as moduli_at_rest,
        principal_derivatives as principal_derivatives,
        stress as stress,
        stress_and_tangent as stress_and_tangent,
    )
    from palpate.mechanics.homogeneous import MODES as MODES, nominal_stress as nominal_stress
    from palpate.plugins.energy_form import EnergyForm as EnergyForm, StandardMaterial as StandardMaterial

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)
    __dir__ = __getattr__("__dir__")
