"""One press as a robot logged it, in palpate's units: what readers make and processing takes."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from palpate.api import CurveError, FloatArray, IntArray

UNIT_QUATERNION_TOLERANCE = 1e-3
"""Deviation of a quaternion's length from 1 that printing with few digits explains."""

_WIDTHS = {"time_s": 0, "position_mm": 3, "quaternion": 4, "force_N": 3, "moment_Nmm": 3, "rows": 0}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """Pose and wrench over time, all at the same instants.

    Parameters
    ----------
    source : str
        The file, for messages.
    time_s : (n,) array
        Strictly increasing.
    position_mm : (n, 3) array
        Tool tip in the base frame.
    quaternion : (n, 4) array
        x y z w, from the tool (and sensor) frame to the base frame, of length 1.
    force_N : (n, 3) array
        Tissue on tool, in the sensor frame.
    moment_Nmm : (n, 3) array
        About the sensor's origin, in the sensor frame.
    rows : (n,) array of int
        Line, row or message number in the file, for messages.
    row_word : str
        What messages call them.

    Raises
    ------
    CurveError
        Shapes differ, fewer than two rows, a value that is not finite, time that does
        not increase, or a quaternion whose length is not 1.
    """

    source: str
    time_s: FloatArray
    position_mm: FloatArray
    quaternion: FloatArray
    force_N: FloatArray
    moment_Nmm: FloatArray
    rows: IntArray
    row_word: str = "row"

    def __post_init__(self) -> None:
        for name in _WIDTHS:
            kind = np.int64 if name == "rows" else np.float64
            # A view, so that freezing it leaves the caller's array as it was.
            values = np.asarray(getattr(self, name), dtype=kind).view()
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        self._check_shapes()
        self._check_finite()
        self._check_time()
        self._check_quaternions()

    @property
    def n_rows(self) -> int:
        """Number of instants."""
        return int(self.time_s.size)

    @property
    def rate_hz(self) -> float:
        """Median sampling rate [Hz]."""
        return float(1.0 / np.median(np.diff(self.time_s)))

    def at(self, index: int) -> str:
        """A row, for messages: its number in the file and its time stamp."""
        return f"{self.row_word} {int(self.rows[index])} (t = {self.time_s[index]:.3f} s)"

    def fault(self, message: str, index: int | None = None) -> CurveError:
        """Error that names the file and, where given, the row and its time stamp."""
        where = "" if index is None else f"{self.at(index)}: "
        return CurveError(f"{self.source}: {where}{message}")

    def changed(self, **fields: FloatArray | IntArray) -> "Recording":
        """Copy with other fields, checked like a new one."""
        values: dict[str, Any] = fields
        return replace(self, **values)

    def less(self, force_N: FloatArray, moment_Nmm: FloatArray) -> "Recording":
        """Copy without a part of the wrench, of shapes (3,) or (n, 3)."""
        return self.changed(force_N=self.force_N - force_N, moment_Nmm=self.moment_Nmm - moment_Nmm)

    def part(self, chosen: slice | IntArray) -> "Recording":
        """Only some rows, in order."""
        return self.changed(**{name: getattr(self, name)[chosen] for name in _WIDTHS})

    def _check_shapes(self) -> None:
        n_rows = self.time_s.size
        for name, width in _WIDTHS.items():
            expected = (n_rows, width) if width else (n_rows,)
            shape = getattr(self, name).shape
            if shape != expected:
                raise self.fault(
                    f"{name} has shape {shape} where {expected} is needed; give every row a value"
                )
        if n_rows < 2:
            raise self.fault(f"{n_rows} row(s); a press needs many more, check that the file is complete")

    def _check_finite(self) -> None:
        for name, width in _WIDTHS.items():
            values = getattr(self, name)
            # A sum is finite only when all its terms are: one pass in the usual case.
            if name == "rows" or np.isfinite(values.sum()):
                continue
            bad = np.argwhere(~np.isfinite(values))
            if bad.size:
                which = f"{name}[{'xyzw'[bad[0, 1]]}]" if width else name
                number = values[tuple(bad[0])]
                raise self.fault(f"{which} is {number}; repair or remove the row", int(bad[0, 0]))

    def _check_time(self) -> None:
        steps = np.diff(self.time_s)
        if steps.min() <= 0.0:
            index = int(np.argmax(steps <= 0.0))
            raise self.fault(
                f"time does not increase: {self.time_s[index + 1]:.6f} s follows {self.time_s[index]:.6f} s; "
                "remove the repeated or misplaced row",
                index + 1,
            )

    def _check_quaternions(self) -> None:
        squares = np.einsum("ij,ij->i", self.quaternion, self.quaternion)
        off = np.abs(np.sqrt(squares) - 1.0)
        worst = int(np.argmax(off))
        if off[worst] > UNIT_QUATERNION_TOLERANCE:
            raise self.fault(
                f"the quaternion has length {np.sqrt(squares[worst]):.4f} and not 1; "
                "check that its four columns are x, y, z, w of one orientation",
                worst,
            )


def rows_between(time_s: FloatArray, start_s: float, stop_s: float) -> slice:
    """Rows among increasing time stamps (n,) from one instant up to, but not at, another."""
    return slice(*map(int, np.searchsorted(time_s, [start_s, stop_s])))
