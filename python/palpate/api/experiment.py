"""Equilibrium states of a press, the limits of a motion, and the steps of a dwell."""

from typing import TYPE_CHECKING

from palpate.lazy_imports import deferred

if TYPE_CHECKING:
    from palpate.domain.curves import abscissae_of as abscissae_of
    from palpate.domain.equilibrium_states import (
        POSE as POSE,
        STATE_COLUMNS as STATE_COLUMNS,
        TIME as TIME,
        WRENCH as WRENCH,
        EquilibriumStates as EquilibriumStates,
    )
    from palpate.domain.relaxing import dwell_times as dwell_times
    from palpate.domain.waypoints import (
        DEPTH as DEPTH,
        MOST_TILT_DEG as MOST_TILT_DEG,
        MOST_WAYPOINTS as MOST_WAYPOINTS,
    )

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)
    __dir__ = __getattr__("__dir__")
