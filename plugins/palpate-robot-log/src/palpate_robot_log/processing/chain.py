"""The steps in their order: from a recording to curves, with a record of each."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from palpate.api import Curve, FloatArray, IntArray, Relaxation
from palpate.mesh.spot_frame import SpotWrench
from palpate_robot_log.processing import checks, record
from palpate_robot_log.processing.curves import Branch, branch, joined, with_shift_std
from palpate_robot_log.processing.drift import Drift, find_drift, without_drift
from palpate_robot_log.processing.gravity import (
    ToolLoad,
    check_plausible,
    check_shown,
    fit_tool,
    without_weight,
)
from palpate_robot_log.processing.located import (
    Located,
    aligned,
    free_rows,
    instants,
    locate,
    onset_of,
    raw_pressing,
)
from palpate_robot_log.processing.onset import Onset
from palpate_robot_log.processing.phases import Phase, name_phases
from palpate_robot_log.processing.processed import Processed
from palpate_robot_log.processing.relaxation import relaxation
from palpate_robot_log.processing.rotation import mean_orientation, unrotated
from palpate_robot_log.processing.settings import ProcessingSettings, Window
from palpate_robot_log.processing.slides import Slide, find_slide
from palpate_robot_log.processing.smoothing import Smoothed, smoothed
from palpate_robot_log.processing.spikes import without_spikes
from palpate_robot_log.processing.spot_frame import lateral_force, wrench_at_spot
from palpate_robot_log.processing.tare import Bias, find_bias, tared
from palpate_robot_log.processing.thinning import thinned
from palpate_robot_log.recording import Recording, rows_between

_ABSCISSA = 0.1
"""What smoothing may do to depth and rotation, over what it may do to force and torque."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Clean:
    """A recording without weight, drift and bias, and what these were."""

    recording: Recording
    free: IntArray
    tool: ToolLoad | None
    drift: Drift | None
    bias: Bias | None


def process(recording: Recording, settings: ProcessingSettings | None = None) -> Processed:
    """Curves of one press.

    Parameters
    ----------
    recording : Recording
    settings : ProcessingSettings, optional
        Which steps are done, and how.

    Raises
    ------
    CurveError
        The log is no complete press: naming file, rows, time stamps and what to do.
    """
    settings = settings or ProcessingSettings()
    used, block = _used(recording, settings)
    calm, spikes = without_spikes(used) if settings.spikes.enabled else (used, np.array([], dtype=np.int64))
    located, lag, lag_taken = aligned(_located(calm, settings), settings)
    slide = _slide(located) if settings.slide.enabled else None
    if slide is not None:
        located = replace(located, strokes=replace(located.strokes, slides=slide.strokes))
    clean = _cleaned(located, settings)
    wrench = _at_spot(located, clean.recording, settings)
    checks.check_torque(calm, located.motion, wrench, located.strokes, weighed=clean.tool is not None)
    onset = onset_of(located, wrench.pressing, settings.onset)
    touch, leave = instants(located, onset)
    phases = name_phases(located.motion.time_s, located.strokes, touch, leave)
    depth = located.motion.travel_mm - onset.travel_mm
    drift_std_per_s = _drift_std_per_s(located, clean)
    spread = _zero_std(located, clean, drift_std_per_s)
    force, force_smoothed = _force(located, settings, phases, depth, wrench.pressing, spread[0], onset)
    turning = located.motion.turn_deg, wrench.twisting, spread[1]
    torque, torque_smoothed = _branches("torque", "twist", located, settings, phases, *turning)
    lateral, lateral_smoothed = None, list[Smoothed]()
    if slide is not None:
        sliding = slide.shift_mm, lateral_force(wrench, slide, located.normal.vector), spread[0]
        lateral, lateral_smoothed = _branches("lateral_force", "slide", located, settings, phases, *sliding)
    processed = Processed(
        force=force,
        torque=torque,
        lateral_force=lateral,
        slide=slide,
        phases=phases,
        raw=located.recording,
        tared=clean.recording,
        free=clean.free,
        motion=located.motion,
        depth_mm=depth,
        wrench=wrench,
        lag=lag,
        normal=located.normal,
        onset=onset,
        relaxations=_relaxations(located, settings, phases, wrench, drift_std_per_s),
        tool=clean.tool,
        drift=clean.drift,
        bias=clean.bias,
        record={},
    )
    smoothings = {"force": [force_smoothed], "torque": torque_smoothed}
    smoothings |= {"lateral_force": lateral_smoothed} if slide is not None else {}
    counts = record.Counts(block, used.rows[spikes], lag_taken, drift_std_per_s)
    return record.with_record(processed, settings, counts, smoothings)


def _used(recording: Recording, settings: ProcessingSettings) -> tuple[Recording, int]:
    part = _windowed(recording, settings.window)
    return thinned(part, settings.thinning.max_rows) if settings.thinning.enabled else (part, 1)


def _windowed(recording: Recording, window: Window) -> Recording:
    time = recording.time_s
    start = -np.inf if window.start is None else window.start
    stop = np.inf if window.stop is None else window.stop
    rows = rows_between(time, start, stop)
    n_rows = max(rows.stop - rows.start, 0)
    if n_rows < 2:
        raise recording.fault(
            f"the window from {window.start} to {window.stop} s holds {n_rows} rows of "
            f"a log from {time[0]:.3f} to {time[-1]:.3f} s; correct window.start and window.stop"
        )
    return recording if n_rows == recording.n_rows else recording.part(rows)


def _cleaned(located: Located, settings: ProcessingSettings) -> _Clean:
    """Weight, drift and bias taken out, in this order."""
    recording = located.recording
    onset = onset_of(located, raw_pressing(located), settings.onset)
    weighed = settings.gravity.method != "off"
    before, after = free_rows(located, onset, *instants(located, onset), any_orientation=weighed)
    free = np.concatenate([before, after]) if settings.drift.enabled else before
    if free.size == 0:
        raise recording.fault("no row in free air before the press; start the log earlier", 0)
    tool = _tool(recording, free, settings)
    if tool is not None:
        recording = without_weight(recording, tool, np.array(settings.gravity.direction))
    drift = find_drift(recording, before, after) if settings.drift.enabled else None
    if drift is not None:
        recording = without_drift(recording, drift)
    bias = find_bias(recording, free) if settings.tare.enabled else None
    if bias is not None:
        recording = tared(recording, bias)
    return _Clean(recording=recording, free=free, tool=tool, drift=drift, bias=bias)


def _tool(recording: Recording, free: IntArray, settings: ProcessingSettings) -> ToolLoad | None:
    gravity = settings.gravity
    if gravity.method == "off":
        return None
    if gravity.weight is None:
        return fit_tool(recording, free, np.array(gravity.direction))
    tool = ToolLoad(weight_N=gravity.weight, centre_mm=np.array(gravity.centre))
    check_plausible(recording, tool)
    check_shown(recording, free, tool)
    return tool


def _at_spot(located: Located, clean: Recording, settings: ProcessingSettings) -> SpotWrench:
    frame = settings.frame
    if not frame.rotate:  # the sensor's axes are the spot's already
        return SpotWrench(force_N=clean.force_N, moment_Nmm=clean.moment_Nmm)
    return wrench_at_spot(
        clean,
        # About the tip itself where it leaves the contact axis.
        clean.position_mm if settings.slide.enabled else located.motion.origin_mm,
        located.normal.vector,
        np.array(frame.sensor_to_tip),
        transport=frame.transport,
    )


def _along_normal(located: Located, std: FloatArray) -> float:
    """Standard deviation along the contact normal, of that (3,) in the sensor's frame."""
    pressing = slice(located.contact.first, located.contact.last + 1)
    orientation = mean_orientation(located.recording.quaternion[pressing])
    normal = unrotated(orientation[None, :], located.normal.vector)[0]
    return float(np.linalg.norm(normal * std))


def _drift_std_per_s(located: Located, clean: _Clean) -> dict[str, float]:
    """Standard deviation of the drift of force and torque [N/s, N·mm/s]; empty without a drift."""
    if clean.drift is None:
        return {}
    rates = {"force": clean.drift.force_std_N_per_s, "torque": clean.drift.moment_std_Nmm_per_s}
    return {channel: _along_normal(located, rate) for channel, rate in rates.items()}


def _zero_std(
    located: Located, clean: _Clean, drift_std_per_s: Mapping[str, float]
) -> tuple[FloatArray, FloatArray]:
    """Standard deviation (n,) of the zero of force and of torque, from bias and drift."""
    time, bias = located.recording.time_s, clean.bias
    elapsed = np.abs(time - time[clean.free].mean())
    fixed = (0.0, 0.0) if bias is None else (bias.force_std_N, bias.moment_std_Nmm)
    force, torque = (
        np.hypot(_along_normal(located, np.asarray(std)), elapsed * drift_std_per_s.get(channel, 0.0))
        for channel, std in zip(("force", "torque"), fixed, strict=True)
    )
    return force, torque


def _branch(
    settings: ProcessingSettings,
    time: FloatArray,
    abscissa: FloatArray,
    ordinate: FloatArray,
    zero_std: FloatArray,
    *,
    span: float,
    peak: float,
    start: float = -np.inf,
) -> tuple[Branch, Smoothed]:
    """Smoothed rows (n,) of one branch; ``span`` and ``peak`` are those of the whole curve."""
    choice = settings.smoothing
    smooth = partial(smoothed, time, method=choice.method, window_s=choice.window, order=choice.order)
    level, values = smooth(abscissa, peak=_ABSCISSA * span).values, smooth(ordinate, peak=peak)
    points = settings.resampling.points if settings.resampling.enabled else None
    return branch(time, level, values, zero_std, points, start), values


def _force(
    located: Located,
    settings: ProcessingSettings,
    phases: tuple[Phase, ...],
    depth: FloatArray,
    pressing: FloatArray,
    zero_std: FloatArray,
    onset: Onset,
) -> tuple[Curve, Smoothed]:
    """Force over depth of the press."""
    time = located.recording.time_s
    rows = next(phase for phase in phases if phase.name == "press").rows(time)
    x, y = depth[rows], pressing[rows]
    span, peak = float(np.ptp(x)), float(np.abs(y).max())
    part, smooth = _branch(settings, time[rows], x, y, zero_std[rows], span=span, peak=peak, start=0.0)
    return joined("force", [with_shift_std(part, onset.std_mm)]), smooth


def _branches(
    channel: str,
    phase: str,
    located: Located,
    settings: ProcessingSettings,
    phases: tuple[Phase, ...],
    abscissa: FloatArray,
    ordinate: FloatArray,
    zero_std: FloatArray,
) -> tuple[Curve | None, list[Smoothed]]:
    """Curve of all branches of a phase's kind: torque over rotation, or lateral force over shift (n,)."""
    time = located.recording.time_s
    moves = [each.rows(time) for each in phases if each.name.startswith(phase)]
    if not moves:
        return None, []
    whole = slice(moves[0].start, moves[-1].stop)
    peak, span = float(np.abs(ordinate[whole]).max()), float(np.ptp(abscissa[whole]))
    found = [
        _branch(settings, time[rows], abscissa[rows], ordinate[rows], zero_std[rows], span=span, peak=peak)
        for rows in moves
    ]
    return joined(channel, [part for part, _ in found]), [smooth for _, smooth in found]


def _located(recording: Recording, settings: ProcessingSettings) -> Located:
    return locate(recording, settings.normal, slides=settings.slide.enabled)


def _slide(located: Located) -> Slide:
    return find_slide(located.recording, located.motion, located.strokes, located.normal.vector)


def _relaxations(
    located: Located,
    settings: ProcessingSettings,
    phases: tuple[Phase, ...],
    wrench: SpotWrench,
    drift_std_per_s: Mapping[str, float],
) -> tuple[Relaxation, ...]:
    if not settings.relaxation.enabled:
        return ()
    time = located.recording.time_s
    signals = {"force": wrench.pressing, "torque": wrench.twisting}
    found = [
        relaxation(phase.name, channel, time[rows], values[rows], drift_std_per_s.get(channel, 0.0))
        for phase in phases
        for rows in [phase.rows(time)]
        if phase.name.startswith("dwell")
        for channel, values in signals.items()
        # Before the twist there is no torque that could relax.
        if channel == "force" or phase.start.time_s > located.strokes.press.stop.time_s
    ]
    return tuple(item for item in found if item is not None)
