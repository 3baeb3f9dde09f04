"""The steps in their order: from a recording to curves, with a record of each."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from pydantic_core import to_json

from palpate.api import FORCE, TORQUE, Curve, FloatArray, IntArray, Relaxation
from palpate.api.mesh import SpotWrench, spot_axes
from palpate_robot_log.checks import FEWEST_FREE_ROWS, check
from palpate_robot_log.processing.contact import Normal, Onset, ToolMotion
from palpate_robot_log.processing.corrections import (
    Bias,
    Drift,
    Lag,
    ToolLoad,
    find_bias,
    find_drift,
    tool_of,
    without_drift,
    without_spikes,
    without_weight,
)
from palpate_robot_log.processing.curves import Signal, Smoothed, curve_of, relaxation
from palpate_robot_log.processing.phases import Phase, Slide, find_slide, name_phases
from palpate_robot_log.processing.press import (
    Located,
    aligned,
    free_rows,
    locate,
    onset_of,
    wrench_at_spot,
)
from palpate_robot_log.processing.settings import ProcessingSettings
from palpate_robot_log.recording import Recording, mean_orientation, rotated, rows_between, thinned

UNITS = "mm, N, N·mm, s, degrees"  # units of all numbers in the record
_MOST_LISTED = 50
_COMPONENT = {TORQUE.name: TORQUE.name}
"""Part of the wrench whose zero drifts in a channel; the force in the other channels."""


class Processed:
    """One press, from its log to its curves: each step sets what later ones read.

    What a step found is None where it is switched off.
    """

    raw: Recording  # the rows that were used, after the lag was taken out
    block: int  # rows of the log that thinning averaged to one
    spiky_rows: IntArray  # rows in which spikes were replaced
    located: Located
    lag: Lag
    slide: Slide | None
    free: IntArray  # rows in free air
    tool: ToolLoad | None
    drift: Drift | None
    bias: Bias | None
    tared: Recording  # without weight, drift and bias
    wrench: SpotWrench  # in the spot's frame about the contact axis
    onset: Onset
    depth_mm: FloatArray  # (n,), travel from the onset
    phases: tuple[Phase, ...]  # in order, without gaps
    zero_std: Mapping[str, FloatArray]  # (n,), standard deviation of the zero of force [N], torque [N·mm]
    drift_std_per_s: Mapping[str, float]  # standard deviation of the drift of force [N/s], torque [N·mm/s]
    signals: Mapping[str, Signal]  # the rows that the curves come from
    curves: Mapping[str, Curve]  # force [N] over depth [mm], torque [N·mm] over rotation [degrees], and so on
    smoothings: Mapping[str, list[Smoothed]]  # of each channel's branches
    relaxations: tuple[Relaxation, ...]

    def __init__(self, recording: Recording, settings: ProcessingSettings) -> None:
        self.raw, self.settings = recording, settings
        for step in STEPS:
            step(self)

    @property
    def motion(self) -> ToolMotion:
        """Motion of the tool about the spot."""
        return self.located.motion

    @property
    def normal(self) -> Normal:
        """Outward normal of the spot."""
        return self.located.normal

    @property
    def has_moment(self) -> bool:
        """Whether the log has a moment."""
        return bool(self.raw.moment_Nmm.any())

    def phase(self, name: str) -> Phase:
        """The phase of a name, such as ``press`` or ``twist_1``."""
        return next(phase for phase in self.phases if phase.name == name)

    @property
    def lacks_torque(self) -> bool:
        """Whether the tool twists, and the log has no moment that answers it."""
        return "torque" not in self.curves and any(phase.name.startswith("twist") for phase in self.phases)

    @property
    def record(self) -> Mapping[str, Any]:
        """Every step's settings and findings, of plain values that JSON holds."""
        steps = [
            {
                "step": name,
                "settings": getattr(self.settings, name).model_dump(mode="json"),
                "found": each or {},
            }
            for name, each in self._found().items()
        ]
        phases = [
            {
                "name": phase.name,
                "start_s": phase.start.time_s,
                "stop_s": phase.stop.time_s,
                "start_std_s": phase.start.std_s,
                "stop_std_s": phase.stop.std_s,
            }
            for phase in self.phases
        ]
        uncertainty = {"depth_mm": self.onset.std_mm, "drift": self._drift_at_ends()}
        record = {"units": UNITS, "uncertainty": uncertainty, "steps": steps, "phases": phases}
        text = to_json(record, inf_nan_mode="null", fallback=lambda value: value.tolist())
        return dict(json.loads(text))

    def _found(self) -> dict[str, Any]:
        """Findings by step."""
        time, last, raw = self.raw.time_s, self.phases[-1], self.raw
        until_s = last.start.time_s if last.name == "departure" else time[-1]
        pressing = (time >= self.phase("press").start.time_s) & (time <= until_s)
        over_time = self.curves.get("force_over_time")
        return {
            "window": {
                "first_row": raw.rows[0],
                "last_row": raw.rows[-1],
                "from_s": time[0],
                "to_s": time[-1],
                "rate_hz": raw.rate_hz,
            },
            "thinning": {"rows_averaged": self.block},
            "spikes": {"rows": self.spiky_rows[:_MOST_LISTED], "count": self.spiky_rows.size},
            "alignment": asdict(self.lag),
            "normal": asdict(self.normal),
            "gravity": self.tool and asdict(self.tool),
            "drift": self.drift and asdict(self.drift),
            "tare": (asdict(self.bias) if self.bias else {}) | {"free_rows": self.free.size},
            "frame": {"farthest_from_axis_mm": self.motion.lateral_mm[pressing].max()},
            "onset": asdict(self.onset),
            "smoothing": {
                name: [
                    {"noise": s.noise, "bias": s.bias, "window_s": s.window_s, "largest_std": s.std.max()}
                    for s in each
                ]
                for name, each in self.smoothings.items()
            },
            "resampling": {"points": {name: curve.abscissa.size for name, curve in self.curves.items()}},
            "slide": {} if self.slide is None else {"along": self.slide.along},
            "over_time": {"duration_s": over_time.abscissa[-1]} if over_time else {},
            "relaxation": {"dwells": [asdict(item) | {"share": item.share} for item in self.relaxations]},
        }

    def _drift_at_ends(self) -> dict[str, float]:
        """Standard deviation of each channel where its curve ends, by the drift since the touch."""
        rates, touch_s = self.drift_std_per_s, self.phase("press").start.time_s
        return {
            channel: rates[_COMPONENT.get(channel, FORCE.name)] * (float(curve.time_s[-1]) - touch_s)
            for channel, curve in self.curves.items()
            if rates and curve.time_s is not None
        }


def process(recording: Recording, settings: ProcessingSettings | None = None) -> Processed:
    """Curves of one press, by the steps that the settings choose.

    Raises
    ------
    CurveError
        The log is no complete press: naming file, rows, time stamps and what to do.
    """
    return Processed(recording, settings or ProcessingSettings())


def windowed(recording: Recording, settings: ProcessingSettings) -> Recording:
    """Rows of a recording that ``window`` keeps."""
    window, time = settings.window, recording.time_s
    rows = rows_between(
        time,
        -np.inf if window.start is None else window.start,
        np.inf if window.stop is None else window.stop,
    )
    n_rows = max(rows.stop - rows.start, 0)
    words = {"start": window.start, "stop": window.stop, "begin": time[0], "end": time[-1]}
    check(recording, "window", n_rows, **words)
    return recording if n_rows == recording.n_rows else recording.part(rows)


def _window(press: Processed) -> None:
    press.raw = windowed(press.raw, press.settings)


def _thin(press: Processed) -> None:
    press.block, thinning = 1, press.settings.thinning
    if thinning.enabled:
        press.raw, press.block = thinned(press.raw, thinning.max_rows)


def _repair(press: Processed) -> None:
    press.spiky_rows = press.raw.rows[:0]
    if press.settings.spikes.enabled:
        press.raw, spikes = without_spikes(press.raw)
        press.spiky_rows = press.raw.rows[spikes]


def _locate(press: Processed) -> None:
    settings = press.settings
    located = locate(press.raw, settings.normal, slides=settings.slide.enabled)
    press.located, press.lag = aligned(located, settings)
    press.raw, press.slide = press.located.recording, None
    if settings.slide.enabled:
        press.slide = find_slide(press.raw, press.motion, press.located.strokes, press.normal.vector)
        strokes = replace(press.located.strokes, slides=press.slide.strokes)
        press.located = replace(press.located, strokes=strokes)


def _clean(press: Processed) -> None:
    """Take weight, drift and bias out, by the rows in free air."""
    located, settings, recording = press.located, press.settings, press.raw
    gravity, drifts, biased = settings.gravity, settings.drift.enabled, settings.tare.enabled
    weighed = gravity.method != "off"
    before, after = free_rows(located, *onset_of(located, settings.onset), any_orientation=weighed)
    press.free = np.concatenate([before, after]) if drifts else before
    fewest = FEWEST_FREE_ROWS if drifts or biased else 1
    check(recording, "free air", before.size / fewest, 0, n_rows=before.size)
    press.tool = tool_of(recording, press.free, gravity)
    if press.tool is not None:
        recording = without_weight(recording, press.tool, np.array(gravity.direction))
    press.drift = find_drift(recording, before, after) if drifts else None
    if press.drift is not None:
        recording = without_drift(recording, press.drift)
    press.bias = find_bias(recording, press.free) if biased else None
    if press.bias is not None:
        recording = recording.less(press.bias.force_N, press.bias.moment_Nmm)
    press.tared = recording


def _turn_into_spot(press: Processed) -> None:
    # About the tip itself where it leaves the contact axis.
    spot = press.motion.origin_mm if press.slide is None else press.tared.position_mm
    tip = np.array(press.settings.frame.sensor_to_tip)
    press.wrench = wrench_at_spot(press.tared, spot, press.normal.vector, tip)
    if press.has_moment:
        check(press.raw, "torque", press.located, press.wrench, press.tool is not None)


def _touch(press: Processed) -> None:
    press.onset, touch, leave = onset_of(press.located, press.settings.onset, press.wrench.pressing)
    press.depth_mm = press.motion.travel_mm - press.onset.travel_mm
    press.phases = name_phases(press.raw.time_s, press.located.strokes, touch, leave)


def _weigh_zero(press: Processed) -> None:
    """Set the standard deviations of the zero and of its drift, along and about the normal."""
    orientation = mean_orientation(press.raw.quaternion[press.located.contact.rows])
    normal = rotated(orientation[None, :], press.normal.vector, inverse=True)[0]
    zero, drift, bias = np.zeros(3), press.drift, press.bias

    def along_normal(force: FloatArray, moment: FloatArray) -> dict[str, float]:
        stds = {"force": force, "torque": moment}
        return {channel: float(np.linalg.norm(normal * std)) for channel, std in stds.items()}

    rates = {} if drift is None else along_normal(drift.force_std_N_per_s, drift.moment_std_Nmm_per_s)
    fixed = along_normal(*((zero, zero) if bias is None else (bias.force_std_N, bias.moment_std_Nmm)))
    elapsed = np.abs(press.raw.time_s - press.raw.time_s[press.free].mean())
    press.zero_std = {name: np.hypot(std, elapsed * rates.get(name, 0.0)) for name, std in fixed.items()}
    press.drift_std_per_s = rates


def _draw_curves(press: Processed) -> None:
    """Signals of the channels that the log has, and their curves."""
    time, wrench, settings = press.raw.time_s, press.wrench, press.settings

    def named(kind: str) -> list[slice]:
        return [phase.rows(time) for phase in press.phases if phase.name.startswith(kind)]

    found = {
        "force": Signal(press.depth_mm, wrench.pressing, named("press")),
        "torque": Signal(press.motion.turn_deg, wrench.twisting, named("twist") if press.has_moment else []),
    }
    if (slide := press.slide) is not None:
        lateral_force = -wrench.force_N @ (spot_axes(press.normal.vector).T @ slide.along)
        found["lateral_force"] = Signal(slide.shift_mm, lateral_force, named("slide"))
    if settings.over_time.enabled:  # approach and press come first
        rest = [phase.rows(time) for phase in press.phases[2:3] if phase.name.startswith("dwell")]
        since_s = time - press.phase("press").start.time_s
        found["force_over_time"] = Signal(since_s, wrench.pressing, [*named("press"), *rest])
    press.signals = {channel: signal for channel, signal in found.items() if signal.branches}
    curves, smoothings = dict[str, Curve](), {channel: list[Smoothed]() for channel in found}
    for channel, signal in press.signals.items():
        zero_std = press.zero_std[_COMPONENT.get(channel, FORCE.name)]
        shift_std = press.onset.std_mm if channel == FORCE.name else None
        curves[channel], smoothings[channel] = curve_of(channel, time, signal, zero_std, settings, shift_std)
    press.curves, press.smoothings = curves, smoothings


def _relax(press: Processed) -> None:
    time, found = press.raw.time_s, list[Relaxation | None]()
    for phase in press.phases:
        if not press.settings.relaxation.enabled or not phase.name.startswith("dwell"):
            continue
        values = {FORCE.name: press.wrench.pressing}
        # Before the twist there is no torque that could relax.
        if press.has_moment and phase.start.time_s > press.located.strokes.press.stop.time_s:
            values[TORQUE.name] = press.wrench.twisting
        rows = phase.rows(time)
        for channel, each in values.items():
            std_per_s = press.drift_std_per_s.get(channel, 0.0)
            found.append(relaxation(phase.name, channel, time[rows], each[rows], std_per_s))
    press.relaxations = tuple(item for item in found if item is not None)


STEPS: Sequence[Callable[[Processed], None]] = (
    _window,
    _thin,
    _repair,
    _locate,
    _clean,
    _turn_into_spot,
    _touch,
    _weigh_zero,
    _draw_curves,
    _relax,
)
"""Steps in the order in which they are done."""
