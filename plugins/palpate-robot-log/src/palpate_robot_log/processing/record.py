"""The record of processing: each step's settings and findings in plain values, for the manifest."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from palpate.api import IntArray
from palpate_robot_log.processing.processed import Processed
from palpate_robot_log.processing.settings import ProcessingSettings
from palpate_robot_log.processing.smoothing import Smoothed

UNITS = "mm, N, N·mm, s, degrees"
"""Units of all numbers in the record."""

_MOST_LISTED = 50


@dataclass(frozen=True, slots=True)
class Counts:
    """What is not in the result itself.

    Rows that thinning averaged, numbers of rows that had spikes, whether a lag was taken out, and the
    standard deviation of the drift of each channel [N/s, N·mm/s].
    """

    block: int
    spiky_rows: IntArray
    lag_taken: bool
    drift_std_per_s: Mapping[str, float]


def with_record(
    processed: Processed,
    settings: ProcessingSettings,
    counts: Counts,
    smoothings: Mapping[str, Sequence[Smoothed]],
) -> Processed:
    """The same result with its record; ``smoothings`` are those of each channel's branches."""
    raw = processed.raw
    found: dict[str, Any] = {
        "window": {
            "first_row": raw.rows[0],
            "last_row": raw.rows[-1],
            "from_s": raw.time_s[0],
            "to_s": raw.time_s[-1],
            "rate_hz": raw.rate_hz,
        },
        "thinning": {"rows_averaged": counts.block},
        "spikes": {"rows": counts.spiky_rows[:_MOST_LISTED], "count": counts.spiky_rows.size},
        "alignment": {**asdict(processed.lag), "taken_out": counts.lag_taken},
        "normal": asdict(processed.normal),
        "gravity": processed.tool and asdict(processed.tool),
        "drift": processed.drift and asdict(processed.drift),
        "tare": (asdict(processed.bias) if processed.bias else {}) | {"free_rows": processed.free.size},
        "frame": {"farthest_from_axis_mm": _farthest(processed)},
        "onset": asdict(processed.onset),
        "smoothing": {name: [_of_smoothing(s) for s in each] for name, each in smoothings.items()},
        "resampling": {"points": {n: c.abscissa.size for n, c in processed.response.curves.items()}},
        "slide": {} if processed.slide is None else {"along": processed.slide.along},
        "relaxation": {"dwells": [asdict(item) | {"share": item.share} for item in processed.relaxations]},
    }
    steps = [
        {"step": name, "settings": getattr(settings, name).model_dump(mode="json"), "found": each or {}}
        for name, each in found.items()
    ]
    phases = [
        {
            "name": phase.name,
            "start_s": phase.start.time_s,
            "stop_s": phase.stop.time_s,
            "start_std_s": phase.start.std_s,
            "stop_std_s": phase.stop.std_s,
        }
        for phase in processed.phases
    ]
    uncertainty = {"depth_mm": processed.onset.std_mm, "drift": _drift(processed, counts.drift_std_per_s)}
    about = {"units": UNITS, "uncertainty": uncertainty, "steps": steps, "phases": phases}
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


def _drift(processed: Processed, std_per_s: Mapping[str, float]) -> dict[str, float]:
    """Standard deviation of each channel where its curve ends, by the drift since the touch [N, N·mm]."""
    press = processed.phase("press")
    ends = {"force": press.stop.time_s}
    if twists := [phase for phase in processed.phases if phase.name.startswith("twist")]:
        ends["torque"] = twists[-1].stop.time_s
    rates = dict(std_per_s)
    if (slides := [phase for phase in processed.phases if phase.name.startswith("slide")]) and rates:
        ends["lateral_force"], rates["lateral_force"] = slides[-1].stop.time_s, rates["force"]
    return {c: rate * (ends[c] - press.start.time_s) for c, rate in rates.items() if c in ends}


def _farthest(processed: Processed) -> float:
    """Largest distance of the tip from the contact axis while it presses [mm]."""
    press, last = processed.phase("press"), processed.phases[-1]
    stop = processed.motion.time_s[-1] if last.name != "departure" else last.start.time_s
    time = processed.motion.time_s
    during = (time >= press.start.time_s) & (time <= stop)
    return float(processed.motion.lateral_mm[during].max())


def _of_smoothing(smooth: Smoothed) -> dict[str, float]:
    return {
        "noise": smooth.noise,
        "bias": smooth.bias,
        "window_s": smooth.window_s,
        "largest_std": float(smooth.std.max()),
    }
