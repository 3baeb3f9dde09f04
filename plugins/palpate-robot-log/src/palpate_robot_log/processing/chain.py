"""The steps in their order: from a recording to curves, with a record of each."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from pydantic_core import to_json

from palpate.api import FORCE, TORQUE, Curve, FloatArray, IntArray, Relaxation
from palpate.api.mesh import SpotWrench, spot_axes
from palpate_robot_log.checks import FEWEST_FREE_ROWS, check
from palpate_robot_log.processing.change_points import Transition
from palpate_robot_log.processing.contact import (
    SHARE,
    ContactRows,
    Normal,
    Onset,
    ToolMotion,
    described,
    find_onset,
    motion_about,
    rough_contact,
    spot_normal,
)
from palpate_robot_log.processing.corrections import (
    Bias,
    Drift,
    Lag,
    ToolLoad,
    estimate_lag,
    find_bias,
    find_drift,
    shifted,
    tool_of,
    without_drift,
    without_spikes,
    without_weight,
)
from palpate_robot_log.processing.curves import Signal, Smoothed, curve_of, relaxation
from palpate_robot_log.processing.settings import NormalChoice, OnsetChoice, ProcessingSettings
from palpate_robot_log.processing.strokes import (
    Phase,
    Slide,
    Strokes,
    contact_instants,
    find_slide,
    find_strokes,
    name_phases,
)
from palpate_robot_log.recording import (
    Recording,
    angle_between_deg,
    cross,
    mean_orientation,
    rotated,
    rows_between,
    thinned,
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Located:
    """A recording, its contact, normal, motion and strokes, the lag of its wrench and its slide."""

    recording: Recording
    contact: ContactRows
    normal: Normal
    motion: ToolMotion
    strokes: Strokes
    lag: Lag = field(default_factory=Lag)
    slide: Slide | None = None


def locate(recording: Recording, choice: NormalChoice, *, slides: bool = False) -> Located:
    """Contact, normal, motion and strokes, once they can belong to a press.

    Of a log that ``slides`` the path gives the normal only while the force rises.
    """
    contact = rough_contact(recording)
    check(recording, "gaps", contact)
    pressed = contact
    if slides:
        pushed = recording.force_N[contact.rows] - recording.force_N[: contact.first].mean(axis=0)
        force = np.linalg.norm(pushed, axis=1)
        close = int(np.argmax(force >= 0.9 * force.max()))
        pressed = replace(contact, last=contact.first + close)
    normal = path = spot_normal(recording, pressed)
    if choice.method != "path":
        given = None if choice.vector is None else np.array(choice.vector)
        normal = described(recording, pressed, given, 0.0)
        check(recording, "path", angle_between_deg(normal.vector, path.vector), contact.first)
    motion = motion_about(recording, contact, normal.vector)
    check(recording, "depth", float(np.ptp(motion.travel_mm[contact.rows])), contact.first)
    check(recording, "direction", contact, normal)
    strokes = find_strokes(recording, motion, contact)
    check(recording, "twist", motion, strokes.twists)
    return Located(recording=recording, contact=contact, normal=normal, motion=motion, strokes=strokes)


def aligned(located: Located, settings: ProcessingSettings) -> Located:
    """The press without the wrench's lag, the known one or the estimated one where it is significant."""
    choice = settings.alignment
    if not choice.enabled:
        return located
    if choice.lag is not None:
        lag = Lag(seconds=choice.lag, std_s=0.0, taken_out=choice.lag != 0.0)
    else:
        recording = located.recording
        torque = -rotated(recording.quaternion, recording.moment_Nmm) @ located.normal.vector
        lag = estimate_lag(recording.time_s, torque, located.strokes.twists)
        lag = replace(lag, taken_out=lag.significant)
    if not lag.taken_out:
        return replace(located, lag=lag)
    late = shifted(located.recording, lag.seconds)
    return replace(locate(late, settings.normal, slides=settings.slide.enabled), lag=lag)


def located_slide(located: Located) -> Located:
    """The press with the slide between it and the retract."""
    slide = find_slide(located.recording, located.motion, located.strokes, located.normal.vector)
    return replace(located, slide=slide, strokes=replace(located.strokes, slides=slide.strokes))


def wrench_at_spot(
    recording: Recording, spot_mm: FloatArray, normal: FloatArray, tip_mm: FloatArray
) -> SpotWrench:
    """Wrench rotated into the spot's frame, with its moment moved: M(c) = M(o) + (o - c) × F.

    Parameters
    ----------
    spot_mm : (3,) array
        A point of the contact axis, in the base frame; or (n, 3), one for each row.
    normal : (3,) array
        Unit outward normal in the base frame.
    tip_mm : (3,) array
        Tool tip in the sensor's frame; zero where the sensor reports about the tip.
    """
    axes = spot_axes(normal)
    force = rotated(recording.quaternion, recording.force_N)
    sensor = recording.position_mm - rotated(recording.quaternion, tip_mm)
    moment = rotated(recording.quaternion, recording.moment_Nmm) + cross(sensor - spot_mm, force)
    return SpotWrench(force_N=force @ axes, moment_Nmm=moment @ axes)


def onset_of(
    located: Located, choice: OnsetChoice, pressing_N: FloatArray | None = None
) -> tuple[Onset, Transition, Transition | None]:
    """Onset from the pressing force (n,) or at a given time stamp, and when the tool touches and leaves.

    Without ``pressing_N`` the force along the normal is from the log.
    """
    recording, contact, motion = located.recording, located.contact, located.motion
    if choice.time is not None:
        travel = float(np.interp(choice.time, recording.time_s, motion.travel_mm))
        n_free = int(np.searchsorted(recording.time_s, choice.time))
        onset = Onset(travel_mm=travel, std_mm=0.0, spread_mm=0.0, baseline_rows=n_free)
    else:
        if pressing_N is None:
            pressing_N = rotated(recording.quaternion, recording.force_N) @ located.normal.vector
            pressing_N = pressing_N - _clear_drift(pressing_N, contact)
        # From where the tool comes nearer for the last time as it is oriented in contact.
        turned = ~_oriented_alike(motion)[: contact.first + 1]
        start = int(np.flatnonzero(turned).max(initial=-1)) + 1
        stop = int(np.searchsorted(recording.time_s, located.strokes.press.stop.time_s)) + 1
        onset = find_onset(recording, motion.travel_mm, pressing_N, slice(start, stop), choice.exponent)
    return onset, *contact_instants(motion, contact, located.strokes, onset)


def _clear_drift(pressing_N: FloatArray, contact: ContactRows) -> FloatArray:
    """Line (n,) through a force in free air before and after the press; zero where it is no clear drift."""
    n_rows, after = max(contact.first // 4, 1), pressing_N[contact.last + 1 :]
    is_seen = after.size > 0 and not contact.ends_in_contact
    change = float(np.median(after[-n_rows:]) - np.median(pressing_N[:n_rows])) if is_seen else 0.0
    is_clear = abs(change) > SHARE * float(np.ptp(pressing_N))
    return np.linspace(0.0, change * is_clear, pressing_N.size)


def free_rows(
    located: Located, onset: Onset, touch: Transition, leave: Transition | None, *, any_orientation: bool
) -> tuple[IntArray, IntArray]:
    """Rows in free air before and after the press.

    Without ``any_orientation`` (the weight is unknown) only those in which the tool is as it
    does when it touches.
    """
    motion = located.motion
    clear = motion.travel_mm < onset.travel_mm - max(3.0 * onset.std_mm, 0.05)
    if not any_orientation:
        clear &= _oriented_alike(motion)
    before = np.flatnonzero(clear & (motion.time_s < touch.time_s))
    if leave is None:
        return before, np.array([], dtype=np.int64)
    return before, np.flatnonzero(clear & (motion.time_s > leave.time_s))


def _oriented_alike(motion: ToolMotion) -> np.ndarray:
    """Whether the tool is oriented in each row as when the press begins."""
    return np.hypot(motion.turn_deg, motion.tilt_deg) < 2.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cleaned:
    """A recording without weight, drift and bias, the rows in free air that gave these, and each of them."""

    recording: Recording
    free: IntArray
    tool: ToolLoad | None
    drift: Drift | None
    bias: Bias | None


def cleaned(located: Located, settings: ProcessingSettings) -> Cleaned:
    """The press without weight, drift and bias, by the rows in free air."""
    gravity, drifts, biased = settings.gravity, settings.drift.enabled, settings.tare.enabled
    recording, weighed = located.recording, gravity.method != "off"
    before, after = free_rows(located, *onset_of(located, settings.onset), any_orientation=weighed)
    free = np.concatenate([before, after]) if drifts else before
    fewest = FEWEST_FREE_ROWS if drifts or biased else 1
    check(recording, "free air", before.size / fewest, 0, n_rows=before.size)
    if (tool := tool_of(recording, free, gravity)) is not None:
        recording = without_weight(recording, tool, np.array(gravity.direction))
    if (drift := find_drift(recording, before, after) if drifts else None) is not None:
        recording = without_drift(recording, drift)
    if (bias := find_bias(recording, free) if biased else None) is not None:
        recording = recording.less(bias.force_N, bias.moment_Nmm)
    return Cleaned(recording=recording, free=free, tool=tool, drift=drift, bias=bias)


# ------------------------------------------------------------------------------------------- the chain

UNITS = "mm, N, N·mm, s, degrees"  # units of all numbers in the record


def _component(channel: str) -> str:
    """Part of the wrench whose zero drifts in a channel."""
    return TORQUE.name if channel == TORQUE.name else FORCE.name


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Processed:
    """One press, from its log to its curves. What a step found is None where it is switched off."""

    settings: ProcessingSettings
    raw: Recording  # the rows that were used, after the lag was taken out
    block: int  # rows of the log that thinning averaged to one
    spiky_rows: IntArray  # rows in which spikes were replaced
    located: Located
    cleaned: Cleaned
    wrench: SpotWrench  # in the spot's frame about the contact axis
    onset: Onset
    depth_mm: FloatArray  # (n,), travel from the onset
    phases: tuple[Phase, ...]  # in order, without gaps
    drift_std_per_s: Mapping[str, float]  # standard deviation of the drift of force [N/s], torque [N·mm/s]
    signals: Mapping[str, Signal]  # the rows that the curves come from
    curves: Mapping[str, Curve]  # force [N] over depth [mm], torque [N·mm] over rotation [degrees], and so on
    smoothings: Mapping[str, list[Smoothed]]  # of each channel's branches
    relaxations: tuple[Relaxation, ...]

    @property
    def motion(self) -> ToolMotion:
        """Motion of the tool about the spot."""
        return self.located.motion

    @property
    def normal(self) -> Normal:
        """Outward normal of the spot."""
        return self.located.normal

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
        time, last, raw, clean = self.raw.time_s, self.phases[-1], self.raw, self.cleaned
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
            "spikes": {"rows": self.spiky_rows[:50], "count": self.spiky_rows.size},
            "alignment": asdict(self.located.lag),
            "normal": asdict(self.normal),
            "gravity": clean.tool and asdict(clean.tool),
            "drift": clean.drift and asdict(clean.drift),
            "tare": (asdict(clean.bias) if clean.bias else {}) | {"free_rows": clean.free.size},
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
            "slide": {} if self.located.slide is None else {"along": self.located.slide.along},
            "over_time": {"duration_s": over_time.abscissa[-1]} if over_time else {},
            "relaxation": {"dwells": [asdict(item) | {"share": item.share} for item in self.relaxations]},
        }

    def _drift_at_ends(self) -> dict[str, float]:
        """Standard deviation of each channel where its curve ends, by the drift since the touch."""
        rates, touch_s = self.drift_std_per_s, self.phase("press").start.time_s
        return {
            channel: rates[_component(channel)] * (float(curve.time_s[-1]) - touch_s)
            for channel, curve in self.curves.items()
            if rates and curve.time_s is not None
        }


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


def process(recording: Recording, settings: ProcessingSettings | None = None) -> Processed:
    """Curves of one press, by the steps that the settings choose, in their order.

    Raises
    ------
    CurveError
        The log is no complete press: naming file, rows, time stamps and what to do.
    """
    settings = settings or ProcessingSettings()
    log, thinning = windowed(recording, settings), settings.thinning
    log, block = thinned(log, thinning.max_rows) if thinning.enabled else (log, 1)
    repaired, spikes = without_spikes(log) if settings.spikes.enabled else (log, np.array([], dtype=int))
    located = aligned(locate(repaired, settings.normal, slides=settings.slide.enabled), settings)
    located = located_slide(located) if settings.slide.enabled else located
    raw, clean = located.recording, cleaned(located, settings)
    # About the tip itself where it leaves the contact axis.
    spot_mm = located.motion.origin_mm if located.slide is None else clean.recording.position_mm
    tip_mm = np.array(settings.frame.sensor_to_tip)
    wrench = wrench_at_spot(clean.recording, spot_mm, located.normal.vector, tip_mm)
    if raw.moment_Nmm.any():
        check(raw, "torque", located, wrench, clean.tool is not None)
    onset, touch, leave = onset_of(located, settings.onset, wrench.pressing)
    depth_mm = located.motion.travel_mm - onset.travel_mm
    phases = name_phases(raw.time_s, located.strokes, touch, leave)
    zero_std, drift_std_per_s = _zero_stds(located, clean)
    found = _signals(located, wrench, depth_mm, phases, settings)
    curves, smoothings = _curves(raw.time_s, found, zero_std, onset, settings)
    relaxes = settings.relaxation.enabled
    return Processed(
        settings=settings,
        raw=raw,
        block=block,
        spiky_rows=log.rows[spikes],
        located=located,
        cleaned=clean,
        wrench=wrench,
        onset=onset,
        depth_mm=depth_mm,
        phases=phases,
        drift_std_per_s=drift_std_per_s,
        signals={channel: found[channel] for channel in curves},
        curves=curves,
        smoothings=smoothings,
        relaxations=tuple(_relaxations(located, wrench, phases, drift_std_per_s)) if relaxes else (),
    )


def _zero_stds(located: Located, clean: Cleaned) -> tuple[Mapping[str, FloatArray], Mapping[str, float]]:
    """Standard deviations of the zero of force and torque (n,), and of its drift per second.

    They are along and about the normal.
    """
    raw, zero, drift, bias = located.recording, np.zeros(3), clean.drift, clean.bias
    orientation = mean_orientation(raw.quaternion[located.contact.rows])
    normal = rotated(orientation[None, :], located.normal.vector, inverse=True)[0]

    def along_normal(force: FloatArray, moment: FloatArray) -> dict[str, float]:
        stds = {"force": force, "torque": moment}
        return {channel: float(np.linalg.norm(normal * std)) for channel, std in stds.items()}

    rates = {} if drift is None else along_normal(drift.force_std_N_per_s, drift.moment_std_Nmm_per_s)
    fixed = along_normal(*((zero, zero) if bias is None else (bias.force_std_N, bias.moment_std_Nmm)))
    elapsed = np.abs(raw.time_s - raw.time_s[clean.free].mean())
    return {name: np.hypot(std, elapsed * rates.get(name, 0.0)) for name, std in fixed.items()}, rates


def _signals(
    located: Located,
    wrench: SpotWrench,
    depth_mm: FloatArray,
    phases: Sequence[Phase],
    settings: ProcessingSettings,
) -> dict[str, Signal]:
    """Signals by channel, without branches where the log has none."""
    raw, time = located.recording, located.recording.time_s

    def named(kind: str, among: Sequence[Phase] = phases) -> list[slice]:
        return [phase.rows(time) for phase in among if phase.name.startswith(kind)]

    twists = named("twist") if raw.moment_Nmm.any() else []
    found = {
        "force": Signal(depth_mm, wrench.pressing, named("press")),
        "torque": Signal(located.motion.turn_deg, wrench.twisting, twists),
    }
    if (slide := located.slide) is not None:
        lateral_force = -wrench.force_N @ (spot_axes(located.normal.vector).T @ slide.along)
        found["lateral_force"] = Signal(slide.shift_mm, lateral_force, named("slide"))
    if settings.over_time.enabled:  # approach and press come first
        press_and_rest = [*named("press"), *named("dwell", phases[2:3])]
        found["force_over_time"] = Signal(time - phases[1].start.time_s, wrench.pressing, press_and_rest)
    return found


def _curves(
    time_s: FloatArray,
    signals: Mapping[str, Signal],
    zero_std: Mapping[str, FloatArray],
    onset: Onset,
    settings: ProcessingSettings,
) -> tuple[dict[str, Curve], dict[str, list[Smoothed]]]:
    """Curves of the signals that have branches, and how each branch was smoothed."""
    curves, smoothings = dict[str, Curve](), {channel: list[Smoothed]() for channel in signals}
    for channel, signal in signals.items():
        std, shift_std = zero_std[_component(channel)], onset.std_mm if channel == FORCE.name else None
        if signal.branches:
            curved = curve_of(channel, time_s, signal, std, settings, shift_std)
            curves[channel], smoothings[channel] = curved
    return curves, smoothings


def _relaxations(
    located: Located, wrench: SpotWrench, phases: Sequence[Phase], drift_std_per_s: Mapping[str, float]
) -> Iterator[Relaxation]:
    """Falls of force and torque in the dwells."""
    raw, time = located.recording, located.recording.time_s
    for phase in (each for each in phases if each.name.startswith("dwell")):
        values, rows = {FORCE.name: wrench.pressing}, phase.rows(time)
        # Before the twist there is no torque that could relax.
        if raw.moment_Nmm.any() and phase.start.time_s > located.strokes.press.stop.time_s:
            values[TORQUE.name] = wrench.twisting
        for channel, each in values.items():
            std_per_s = drift_std_per_s.get(channel, 0.0)
            found = relaxation(phase.name, channel, time[rows], each[rows], std_per_s)
            yield from [found] if found else []
