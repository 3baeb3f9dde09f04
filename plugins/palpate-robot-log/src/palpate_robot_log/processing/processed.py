"""What processing returns: curves, and everything that was found on the way."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from palpate.api import Curve, FloatArray, IntArray, Relaxation, Response
from palpate.mesh.spot_frame import SpotWrench
from palpate_robot_log.processing.alignment import Lag
from palpate_robot_log.processing.drift import Drift
from palpate_robot_log.processing.gravity import ToolLoad
from palpate_robot_log.processing.motion import Motion
from palpate_robot_log.processing.normal import Normal
from palpate_robot_log.processing.onset import Onset
from palpate_robot_log.processing.phases import Phase
from palpate_robot_log.processing.slides import Slide
from palpate_robot_log.processing.spot_frame import lateral_force
from palpate_robot_log.processing.tare import Bias
from palpate_robot_log.recording import Recording


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Processed:
    """One press, from its log to its curves.

    Parameters
    ----------
    force, torque, lateral_force : Curve
        Force [N] over depth [mm] of the press; torque [N·mm] over rotation [degrees] of the
        twist, and lateral force [N] over shift [mm] of the slide, None without one. All carry standard
        deviations.
    phases : tuple of Phase
        In order, without gaps.
    raw : Recording
        The rows that were used, after the lag was taken out.
    tared : Recording
        Without weight, drift and bias.
    free : (n,) array of row indices
        In free air.
    motion : Motion
    depth_mm : (n,) array
        Travel from the onset.
    wrench : SpotWrench
        In the spot's frame about the contact axis.
    lag, normal, onset, slide, relaxations
        What those steps found.
    tool, drift, bias
        Likewise; None where the step is switched off.
    record : mapping
        Every step's settings and findings, of plain values that JSON holds.
    """

    force: Curve
    torque: Curve | None
    lateral_force: Curve | None
    slide: Slide | None
    phases: tuple[Phase, ...]
    raw: Recording
    tared: Recording
    free: IntArray
    motion: Motion
    depth_mm: FloatArray
    wrench: SpotWrench
    lag: Lag
    normal: Normal
    onset: Onset
    relaxations: tuple[Relaxation, ...]
    tool: ToolLoad | None
    drift: Drift | None
    bias: Bias | None
    record: Mapping[str, Any]

    def __post_init__(self) -> None:
        object.__setattr__(self, "record", MappingProxyType(dict(self.record)))

    @property
    def response(self) -> Response:
        """The curves by channel, with what relaxed and the record."""
        found = {"force": self.force, "torque": self.torque, "lateral_force": self.lateral_force}
        curves = {channel: curve for channel, curve in found.items() if curve is not None}
        return Response(curves=curves, relaxations=self.relaxations, record=self.record)

    @property
    def sliding(self) -> FloatArray:
        """Force (n,) [N] of the tool on the tissue along the slide; zeros without one."""
        if self.slide is None:
            return np.zeros(len(self.depth_mm))
        return lateral_force(self.wrench, self.slide, self.normal.vector)

    def phase(self, name: str) -> Phase:
        """The phase of a name, such as ``press`` or ``twist_1``."""
        return next(phase for phase in self.phases if phase.name == name)
