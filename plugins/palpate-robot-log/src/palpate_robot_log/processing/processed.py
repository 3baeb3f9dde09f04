"""What processing returns: curves, everything that was found on the way, and the record of it all."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from palpate.api import Curve, FloatArray, IntArray, Relaxation, Response
from palpate.api.mesh import SpotWrench
from palpate_robot_log.processing.contact import Motion, Normal, Onset
from palpate_robot_log.processing.corrections import Bias, Drift, Lag, ToolLoad
from palpate_robot_log.processing.curves import Signal, Smoothed
from palpate_robot_log.processing.phases import Phase, Slide
from palpate_robot_log.processing.settings import ProcessingSettings
from palpate_robot_log.recording import Recording

UNITS = "mm, N, N·mm, s, degrees"  # units of all numbers in the record
_MOST_LISTED = 50


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Processed:
    """One press, from its log to its curves; what a step found is None where it is switched off.

    Parameters
    ----------
    curves : mapping of str to Curve
        ``force`` [N] over depth [mm] of the press; where there are such phases ``torque`` [N·mm] over
        rotation [degrees] of the twist and ``lateral_force`` [N] over shift [mm] of the slide. All
        carry standard deviations.
    signals : mapping of str to Signal
        The rows that the curves come from.
    phases : tuple of Phase
        In order, without gaps.
    raw : Recording
        The rows that were used, after the lag was taken out.
    tared : Recording
        Without weight, drift and bias.
    free : (n,) array of row indices
        In free air.
    depth_mm : (n,) array
        Travel from the onset.
    wrench : SpotWrench
        In the spot's frame about the contact axis.
    record : mapping
        Every step's settings and findings, of plain values that JSON holds.
    """

    curves: Mapping[str, Curve]
    signals: Mapping[str, Signal]
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
    record: Mapping[str, Any] = field(default_factory=dict)

    @property
    def response(self) -> Response:
        """The curves by channel, with what relaxed and the record."""
        return Response(curves=self.curves, relaxations=self.relaxations, record=self.record)

    def phase(self, name: str) -> Phase:
        """The phase of a name, such as ``press`` or ``twist_1``."""
        return next(phase for phase in self.phases if phase.name == name)


def with_record(
    processed: Processed,
    settings: ProcessingSettings,
    smoothings: Mapping[str, Sequence[Smoothed]],
    *,
    block: int,
    spiky_rows: IntArray,
    lag_taken: bool,
    drift_std_per_s: Mapping[str, float],
) -> Processed:
    """The same result with its record.

    It tells too how each channel's branches were smoothed, how many rows thinning averaged in a block,
    which rows had spikes, whether a lag is out, and the drift's standard deviation [N/s, N·mm/s].
    """
    raw, time, press = processed.raw, processed.raw.time_s, processed.phase("press")
    # Standard deviation of each channel where its curve ends, by the drift since the touch.
    rates = {**drift_std_per_s, "lateral_force": drift_std_per_s.get("force", 0.0)} if drift_std_per_s else {}
    kinds = {"force": "press", "torque": "twist", "lateral_force": "slide"}
    ends = {
        channel: [phase.stop.time_s for phase in processed.phases if phase.name.startswith(kind)]
        for channel, kind in kinds.items()
    }
    drift = {c: rate * (ends[c][-1] - press.start.time_s) for c, rate in rates.items() if ends[c]}
    last = processed.phases[-1]
    pressing = (time >= press.start.time_s) & (
        time <= (last.start.time_s if last.name == "departure" else time[-1])
    )
    found: dict[str, Any] = {
        "window": {
            "first_row": raw.rows[0],
            "last_row": raw.rows[-1],
            "from_s": time[0],
            "to_s": time[-1],
            "rate_hz": raw.rate_hz,
        },
        "thinning": {"rows_averaged": block},
        "spikes": {"rows": spiky_rows[:_MOST_LISTED], "count": spiky_rows.size},
        "alignment": {**asdict(processed.lag), "taken_out": lag_taken},
        "normal": asdict(processed.normal),
        "gravity": processed.tool and asdict(processed.tool),
        "drift": processed.drift and asdict(processed.drift),
        "tare": (asdict(processed.bias) if processed.bias else {}) | {"free_rows": processed.free.size},
        "frame": {"farthest_from_axis_mm": processed.motion.lateral_mm[pressing].max()},
        "onset": asdict(processed.onset),
        "smoothing": {
            name: [
                {"noise": s.noise, "bias": s.bias, "window_s": s.window_s, "largest_std": s.std.max()}
                for s in each
            ]
            for name, each in smoothings.items()
        },
        "resampling": {"points": {name: curve.abscissa.size for name, curve in processed.curves.items()}},
        "slide": {} if processed.slide is None else {"along": processed.slide.along},
        "relaxation": {"dwells": [asdict(item) | {"share": item.share} for item in processed.relaxations]},
    }
    about = {
        "units": UNITS,
        "uncertainty": {"depth_mm": processed.onset.std_mm, "drift": drift},
        "steps": [
            {"step": name, "settings": getattr(settings, name).model_dump(mode="json"), "found": each or {}}
            for name, each in found.items()
        ],
        "phases": [
            {
                "name": phase.name,
                "start_s": phase.start.time_s,
                "stop_s": phase.stop.time_s,
                "start_std_s": phase.start.std_s,
                "stop_std_s": phase.stop.std_s,
            }
            for phase in processed.phases
        ],
    }
    return replace(processed, record=plain(about))


def plain(value: Any) -> Any:  # noqa: ANN401 - whatever a finding holds
    """The value in what JSON holds: arrays as lists, numbers that are not finite as None."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else value
