"""Equilibrium states of an indenter along its path, and the curves that channels observe of them.

Pose and wrench are in the frame of the spot (:mod:`palpate.mesh.spot_frame`), moments about its axes. Without
tilt they are conjugate: each component of the wrench is positive where the indenter does work on the tissue
as that component of the pose grows. A component's column is named with its unit, as channels name it.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from palpate.domain.curves import BoolArray, Channel, Curve, FloatArray, Response, frozen_floats, moving_span
from palpate.errors import CurveError

POSE = ("depth_mm", "shift_x_mm", "shift_y_mm", "tilt_x_deg", "tilt_y_deg", "rotation_deg")
"""Columns of a pose: where the indenter's point is below the spot and away from its axis, the rotation
vector of the indenter's axis from the normal, and the rotation about that axis."""

WRENCH = ("force_N", "lateral_x_N", "lateral_y_N", "moment_x_Nmm", "moment_y_Nmm", "torque_Nmm")
"""Columns of a wrench: of the indenter on the tissue, its moment about the indenter's point; the force
is against the normal."""

TIME = "time_s"
"""Column of the time, where the path has one."""

# Four columns along the direction in which the path first shifts, or tilts: they depend on no axes. Smaller
# shifts and tilts than a thousandth of the largest have no direction.
STATE_COLUMNS = (*POSE, *WRENCH, "slide_mm", "tilt_deg", "lateral_force_N", "tilt_moment_Nmm", TIME)
"""Columns that equilibrium states have by themselves."""

_SHIFT, _TILT = slice(1, 3), slice(3, 5)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EquilibriumStates:
    """The k equilibrium states of a simulation in the order travelled, from rest on.

    Parameters
    ----------
    pose : (k, 6) array
        Columns :data:`POSE` [mm, degrees].
    wrench : (k, 6) array
        Columns :data:`WRENCH` [N, N·mm].
    time_s : (k,) array, optional
        Where the path has times.
    others : mapping of column to (k,) array
        More columns that the solver has, such as ``contact_radius_mm``.
    slopes : mapping of parameter to (k, 6) array
        Derivatives of the wrench in the parameters and the friction, as in a curve; empty if not requested.
    pose_slopes : mapping of parameter to (k, 6) array
        Slopes of the pose, where loads are prescribed.

    Raises
    ------
    CurveError
        Shapes differ, or another column has a name of these.
    """

    pose: FloatArray
    wrench: FloatArray
    time_s: FloatArray | None = None
    others: Mapping[str, FloatArray] = field(default_factory=dict)
    slopes: Mapping[str, FloatArray] = field(default_factory=dict)
    pose_slopes: Mapping[str, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("pose", "wrench", "time_s"):
            if (values := getattr(self, name)) is not None:
                object.__setattr__(self, name, frozen_floats(values))
        for name in ("others", "slopes", "pose_slopes"):
            frozen = {key: frozen_floats(values) for key, values in getattr(self, name).items()}
            object.__setattr__(self, name, MappingProxyType(frozen))
        n = len(self.pose)
        shapes: dict[str, tuple[FloatArray, tuple[int, ...]]]
        shapes = {"wrench": (self.wrench, (n, 6)), "pose": (self.pose, (n, 6))}
        shapes |= {f"slopes in '{name}'": (values, (n, 6)) for name, values in self.slopes.items()}
        shapes |= {f"pose slopes in '{k}'": (values, (n, 6)) for k, values in self.pose_slopes.items()}
        shapes |= {f"'{name}'": (values, (n,)) for name, values in self.others.items()}
        shapes |= {TIME: (self.time_s, (n,))} if self.time_s is not None else {}
        for what, (values, shape) in shapes.items():
            if values.shape != shape:
                raise CurveError(f"equilibrium states: {what} of shape {values.shape}, expected {shape}")
        if taken := self.others.keys() & set(STATE_COLUMNS):
            raise CurveError(f"equilibrium states: column '{min(taken)}' is one of pose or wrench; rename it")

    @property
    def columns(self) -> dict[str, FloatArray]:
        """Every column (k,) by name."""
        return {**pose_columns(self.pose, self.time_s), **self._wrench_columns(self.wrench), **self.others}

    def observed(self, channels: Iterable[Channel]) -> Response:
        """Curves of the channels, each over the part of the path where its abscissa moves.

        A channel is left out where its abscissa does not move, or where a column is missing.
        """
        columns, curves = self.columns, {}
        rates = {
            name: self._wrench_columns(slope)
            | self._pose_columns(self.pose_slopes.get(name, np.zeros_like(slope)))
            for name, slope in self.slopes.items()
        }
        for channel in channels:
            if not channel.columns <= columns.keys():
                continue
            abscissa = columns[channel.abscissa]
            if len(abscissa) < 2 or not np.ptp(abscissa) > 0.0:
                continue
            # Only there it is observed: at rest a quotient of two columns has no value.
            rows = moving_span(abscissa)
            known = {name: columns[name][rows] for name in channel.columns}
            # There are no derivatives of the columns that a solver adds.
            slopes = {} if channel.columns & self.others.keys() else rates
            curves[channel.name] = Curve(
                channel=channel.name,
                abscissa=known[channel.abscissa],
                ordinate=_ordinate(channel, known),
                time_s=None if self.time_s is None else self.time_s[rows],
                slopes={name: _rate(channel, known, rate, rows) for name, rate in slopes.items()},
            )
        return Response(curves=curves)

    def cut(self, rows: slice) -> "EquilibriumStates":
        """Keep some of the states."""
        return EquilibriumStates(
            pose=self.pose[rows],
            wrench=self.wrench[rows],
            time_s=None if self.time_s is None else self.time_s[rows],
            others={name: values[rows] for name, values in self.others.items()},
            slopes={name: values[rows] for name, values in self.slopes.items()},
            pose_slopes={name: values[rows] for name, values in self.pose_slopes.items()},
        )

    def _pose_columns(self, pose: FloatArray) -> dict[str, FloatArray]:
        """Columns of a derivative (k, 6) of the pose."""
        along = {
            "slide_mm": pose[:, _SHIFT] @ _first_direction(self.pose[:, _SHIFT]),
            "tilt_deg": pose[:, _TILT] @ _first_direction(self.pose[:, _TILT]),
        }
        return dict(zip(POSE, pose.T, strict=True)) | along

    def _wrench_columns(self, wrench: FloatArray) -> dict[str, FloatArray]:
        """Columns of a wrench (k, 6), or of a derivative of it: they are linear in it."""
        along = {
            "lateral_force_N": wrench[:, _SHIFT] @ _first_direction(self.pose[:, _SHIFT]),
            "tilt_moment_Nmm": wrench[:, _TILT] @ _first_direction(self.pose[:, _TILT]),
        }
        return dict(zip(WRENCH, wrench.T, strict=True)) | along


def pose_columns(
    pose: FloatArray, time_s: FloatArray | None = None, without: BoolArray | None = None
) -> dict[str, FloatArray]:
    """Columns (k,) by name of poses (k, 6) and of times (k,), ``without`` some (6,) of the poses."""
    left = np.zeros(6, np.bool_) if without is None else without
    found = {name: pose[:, k] for k, name in enumerate(POSE) if not left[k]}
    for name, part in (("slide_mm", _SHIFT), ("tilt_deg", _TILT)):
        if not left[part].any():
            found[name] = pose[:, part] @ _first_direction(pose[:, part])
    return found if time_s is None else found | {TIME: time_s}


def _first_direction(parts: FloatArray) -> FloatArray:
    """Unit vector (2,) of the first row (k, 2) that moves; zeros where none does."""
    sizes = np.hypot(*parts.T)
    # Share of the largest shift, or tilt, up to which one is a remainder of Newton's method under loads.
    moved = np.flatnonzero(sizes > 1e-3 * sizes.max(initial=0.0))
    return parts[moved[0]] / sizes[moved[0]] if moved.size else np.zeros(2)


def _ordinate(channel: Channel, columns: Mapping[str, FloatArray]) -> FloatArray:
    if channel.observe is None:
        return columns[channel.ordinate]
    return np.asarray(channel.observe({name: columns[name] for name in channel.needs}), dtype=np.float64)


def _rate(
    channel: Channel, columns: Mapping[str, FloatArray], rates: Mapping[str, FloatArray], rows: slice
) -> FloatArray:
    """Derivative (k,) of the ordinate at a fixed abscissa, from ``rows`` of the derivatives of columns.

    Other columns are fixed.
    """
    rate = _own_rate(channel, columns, rates, rows)
    moved = rates.get(channel.abscissa)
    if moved is None or not moved[rows].any():
        return rate
    return rate - _steepness(columns[channel.abscissa], _ordinate(channel, columns)) * moved[rows]


def _steepness(abscissa: FloatArray, ordinate: FloatArray) -> FloatArray:
    """Derivative (k,) of a curve along itself, of second order; before a turning point of the branch."""
    steps, rises = np.diff(abscissa), np.diff(ordinate)
    still = np.abs(steps) <= 1e-9 * np.ptp(abscissa)
    slopes = np.where(still, 0.0, rises / np.where(still, 1.0, steps))
    before, after = np.append(slopes[:1], slopes), np.append(slopes, slopes[-1:])
    here, there = np.append(steps[:1], steps), np.append(steps, steps[-1:])
    turns = here * there <= 0.0
    total = np.where(turns, 1.0, here + there)
    return np.asarray(np.where(turns, before, (there * before + here * after) / total))


def _own_rate(
    channel: Channel, columns: Mapping[str, FloatArray], rates: Mapping[str, FloatArray], rows: slice
) -> FloatArray:
    """Derivative (k,) of the ordinate of each state."""
    names = channel.needs or (channel.ordinate,)
    moved = {n: rates[n][rows] if n in rates else np.zeros(len(columns[n])) for n in names}
    if channel.observe is None:
        return moved[channel.ordinate]
    import jax  # here: slow to import, and only a channel of several columns needs it

    jax.config.update("jax_enable_x64", True)  # type: ignore[no-untyped-call]
    held = {name: columns[name] for name in names}
    return np.asarray(jax.jvp(channel.observe, (held,), (moved,))[1], dtype=np.float64)
