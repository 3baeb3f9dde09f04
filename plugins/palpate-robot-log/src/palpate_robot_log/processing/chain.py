"""The steps in their order: from a recording to curves, with a record of each."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from pydantic_core import to_json

from palpate.api import FORCE, TORQUE, Curve, FloatArray, IntArray, Relaxation
from palpate.api.mesh import SpotWrench, spot_axes
from palpate_robot_log.processing.contact import Normal, Onset, ToolMotion
from palpate_robot_log.processing.corrections import (
    FEWEST_FREE_ROWS,
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
    check_torque,
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
    smoothings : mapping of str to sequence of Smoothed
        How each channel's branches were smoothed.
    phases : tuple of Phase
        In order, without gaps.
    block : int
        Rows of the log that thinning averaged to one.
    spiky_rows : array of int
        Rows in which spikes were replaced.
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
    drift_std_per_s : mapping of str to float
        Standard deviation of the drift of force [N/s] and torque [N·mm/s].
    """

    settings: ProcessingSettings
    curves: Mapping[str, Curve]
    signals: Mapping[str, Signal]
    smoothings: Mapping[str, Sequence[Smoothed]]
    slide: Slide | None
    phases: tuple[Phase, ...]
    block: int
    spiky_rows: IntArray
    raw: Recording
    tared: Recording
    free: IntArray
    motion: ToolMotion
    depth_mm: FloatArray
    wrench: SpotWrench
    lag: Lag
    normal: Normal
    onset: Onset
    relaxations: tuple[Relaxation, ...]
    tool: ToolLoad | None
    drift: Drift | None
    bias: Bias | None
    drift_std_per_s: Mapping[str, float]

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
    settings = settings or ProcessingSettings()
    used, block = windowed(recording, settings), 1
    if settings.thinning.enabled:
        used, block = thinned(used, settings.thinning.max_rows)
    calm, spikes = without_spikes(used) if settings.spikes.enabled else (used, np.array([], dtype=np.int64))
    located = locate(calm, settings.normal, slides=settings.slide.enabled)
    located, lag = aligned(located, settings)
    raw, motion, normal, slide = located.recording, located.motion, located.normal, None
    if settings.slide.enabled:
        slide = find_slide(raw, motion, located.strokes, normal.vector)
        located = replace(located, strokes=replace(located.strokes, slides=slide.strokes))
    tared, free, tool, drift, bias = _cleaned(located, settings)
    # About the tip itself where it leaves the contact axis.
    spot = motion.origin_mm if slide is None else tared.position_mm
    wrench = wrench_at_spot(tared, spot, normal.vector, np.array(settings.frame.sensor_to_tip))
    has_moment = bool(raw.moment_Nmm.any())
    if has_moment:
        check_torque(calm, located, wrench, weighed=tool is not None)
    onset, touch, leave = onset_of(located, settings.onset, wrench.pressing)
    time, depth = raw.time_s, motion.travel_mm - onset.travel_mm
    phases = name_phases(time, located.strokes, touch, leave)
    zero_std, drift_std_per_s = _zero_std(located, free, drift, bias)

    def named(kind: str, among: Sequence[Phase] = phases) -> list[slice]:
        return [phase.rows(time) for phase in among if phase.name.startswith(kind)]

    found = {
        "force": Signal(depth, wrench.pressing, named("press")),
        "torque": Signal(motion.turn_deg, wrench.twisting, named("twist") if has_moment else []),
    }
    if slide is not None:
        lateral_force = -wrench.force_N @ (spot_axes(normal.vector).T @ slide.along)
        found["lateral_force"] = Signal(slide.shift_mm, lateral_force, named("slide"))
    if settings.over_time.enabled:  # approach and press come first
        rows = [*named("press"), *named("dwell", phases[2:3])]
        found["force_over_time"] = Signal(time - touch.time_s, wrench.pressing, rows)
    signals = {channel: signal for channel, signal in found.items() if signal.branches}
    curves = dict[str, Curve]()
    smoothings: dict[str, list[Smoothed]] = {channel: [] for channel in found}
    along_std_mm = {FORCE.name: onset.std_mm}
    for channel, signal in signals.items():
        zero, shift_std = zero_std[_COMPONENT.get(channel, FORCE.name)], along_std_mm.get(channel)
        curves[channel], smoothings[channel] = curve_of(channel, time, signal, zero, settings, shift_std)
    relaxations = [
        relaxation(phase.name, channel, time[rows], values[rows], drift_std_per_s.get(channel, 0.0))
        for phase in phases
        for rows in [phase.rows(time)]
        if settings.relaxation.enabled and phase.name.startswith("dwell")
        # Before the twist there is no torque that could relax.
        for channel, values, can_relax in (
            (FORCE.name, wrench.pressing, True),
            (
                TORQUE.name,
                wrench.twisting,
                has_moment and phase.start.time_s > located.strokes.press.stop.time_s,
            ),
        )
        if can_relax
    ]
    return Processed(
        settings=settings,
        curves=curves,
        signals=signals,
        smoothings=smoothings,
        slide=slide,
        phases=phases,
        block=block,
        spiky_rows=used.rows[spikes],
        raw=raw,
        tared=tared,
        free=free,
        motion=motion,
        depth_mm=depth,
        wrench=wrench,
        lag=lag,
        normal=normal,
        onset=onset,
        relaxations=tuple(item for item in relaxations if item is not None),
        tool=tool,
        drift=drift,
        bias=bias,
        drift_std_per_s=drift_std_per_s,
    )


def windowed(recording: Recording, settings: ProcessingSettings) -> Recording:
    """Rows of a recording that ``window`` keeps."""
    window, time = settings.window, recording.time_s
    rows = rows_between(
        time,
        -np.inf if window.start is None else window.start,
        np.inf if window.stop is None else window.stop,
    )
    n_rows = max(rows.stop - rows.start, 0)
    if n_rows < 2:
        raise recording.fault(
            f"the window from {window.start} to {window.stop} s holds {n_rows} rows of "
            f"a log from {time[0]:.3f} to {time[-1]:.3f} s; correct window.start and window.stop"
        )
    return recording if n_rows == recording.n_rows else recording.part(rows)


def _cleaned(
    located: Located, settings: ProcessingSettings
) -> tuple[Recording, IntArray, ToolLoad | None, Drift | None, Bias | None]:
    """Recording without weight, drift and bias, the rows in free air that gave them, and what they were."""
    recording, weighed = located.recording, settings.gravity.method != "off"
    before, after = free_rows(located, *onset_of(located, settings.onset), any_orientation=weighed)
    free = np.concatenate([before, after]) if settings.drift.enabled else before
    if before.size < (FEWEST_FREE_ROWS if settings.drift.enabled or settings.tare.enabled else 1):
        raise recording.fault(
            f"{before.size} rows in free air before the press; start the log earlier, so that the sensor's "
            "drift and bias can be determined, or give drift.enabled = false and tare.enabled = false",
            0,
        )
    tool = tool_of(recording, free, settings.gravity)
    if tool is not None:
        recording = without_weight(recording, tool, np.array(settings.gravity.direction))
    drift = find_drift(recording, before, after) if settings.drift.enabled else None
    if drift is not None:
        recording = without_drift(recording, drift)
    bias = find_bias(recording, free) if settings.tare.enabled else None
    if bias is not None:
        recording = recording.less(bias.force_N, bias.moment_Nmm)
    return recording, free, tool, drift, bias


def _zero_std(
    located: Located, free: IntArray, drift: Drift | None, bias: Bias | None
) -> tuple[dict[str, FloatArray], dict[str, float]]:
    """Standard deviations of the zero of force and torque (n,), and of their drift [N/s, N·mm/s]."""
    recording = located.recording
    orientation = mean_orientation(recording.quaternion[located.contact.rows])
    normal = rotated(orientation[None, :], located.normal.vector, inverse=True)[0]

    def along_normal(force: FloatArray, moment: FloatArray) -> dict[str, float]:
        stds = {"force": force, "torque": moment}
        return {channel: float(np.linalg.norm(normal * std)) for channel, std in stds.items()}

    rates = {} if drift is None else along_normal(drift.force_std_N_per_s, drift.moment_std_Nmm_per_s)
    zero = np.zeros(3)
    fixed = along_normal(*((zero, zero) if bias is None else (bias.force_std_N, bias.moment_std_Nmm)))
    elapsed = np.abs(recording.time_s - recording.time_s[free].mean())
    return {name: np.hypot(std, elapsed * rates.get(name, 0.0)) for name, std in fixed.items()}, rates
