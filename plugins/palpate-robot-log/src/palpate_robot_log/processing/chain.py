"""The steps in their order: from a recording to curves, with a record of each."""

from dataclasses import replace

import numpy as np

from palpate.api import Curve, FloatArray, IntArray
from palpate.api.mesh import SpotWrench, spot_axes
from palpate_robot_log.processing.corrections import (
    Bias,
    Drift,
    ToolLoad,
    find_bias,
    find_drift,
    tool_of,
    without_drift,
    without_spikes,
    without_weight,
)
from palpate_robot_log.processing.curves import Signal, Smoothed, curve_of, relaxation
from palpate_robot_log.processing.phases import find_slide, name_phases
from palpate_robot_log.processing.press import (
    Located,
    aligned,
    check_torque,
    free_rows,
    locate,
    onset_of,
    wrench_at_spot,
)
from palpate_robot_log.processing.processed import Processed, with_record
from palpate_robot_log.processing.settings import ProcessingSettings
from palpate_robot_log.recording import Recording, mean_orientation, rotated, rows_between, thinned


def process(recording: Recording, settings: ProcessingSettings | None = None) -> Processed:
    """Curves of one press, by the steps that the settings choose.

    Raises
    ------
    CurveError
        The log is no complete press: naming file, rows, time stamps and what to do.
    """
    settings = settings or ProcessingSettings()
    used, block = _windowed(recording, settings), 1
    if settings.thinning.enabled:
        used, block = thinned(used, settings.thinning.max_rows)
    calm, spikes = without_spikes(used) if settings.spikes.enabled else (used, np.array([], dtype=np.int64))
    located = locate(calm, settings.normal, slides=settings.slide.enabled)
    located, lag, lag_taken = aligned(located, settings)
    raw, motion, normal, slide = located.recording, located.motion, located.normal, None
    if settings.slide.enabled:
        slide = find_slide(raw, motion, located.strokes, normal.vector)
        located = replace(located, strokes=replace(located.strokes, slides=slide.strokes))
    tared, free, tool, drift, bias = _cleaned(located, settings)
    if settings.frame.rotate:
        # About the tip itself where it leaves the contact axis.
        spot = motion.origin_mm if slide is None else tared.position_mm
        tip, transport = np.array(settings.frame.sensor_to_tip), settings.frame.transport
        wrench = wrench_at_spot(tared, spot, normal.vector, tip, transport=transport)
    else:  # the sensor's axes are the spot's already
        wrench = SpotWrench(force_N=tared.force_N, moment_Nmm=tared.moment_Nmm)
    check_torque(calm, located, wrench, weighed=tool is not None)
    onset, touch, leave = onset_of(located, settings.onset, wrench.pressing)
    time, depth = raw.time_s, motion.travel_mm - onset.travel_mm
    phases = name_phases(time, located.strokes, touch, leave)
    zero_std, drift_std_per_s = _zero_std(located, free, drift, bias)

    ordinates = {
        "force": ("press", depth, wrench.pressing),
        "torque": ("twist", motion.turn_deg, wrench.twisting),
    }
    if slide is not None:
        lateral_force = -wrench.force_N @ (spot_axes(normal.vector).T @ slide.along)
        ordinates["lateral_force"] = ("slide", slide.shift_mm, lateral_force)
    signals, curves = dict[str, Signal](), dict[str, Curve]()
    smoothings: dict[str, list[Smoothed]] = {channel: [] for channel in ordinates}
    for channel, (kind, abscissa, ordinate) in ordinates.items():
        branches = [phase.rows(time) for phase in phases if phase.name.startswith(kind)]
        if branches:
            signals[channel] = Signal(abscissa, ordinate, branches)
            curves[channel], smoothings[channel] = curve_of(
                channel,
                time,
                signals[channel],
                zero_std["torque" if channel == "torque" else "force"],
                settings,
                onset.std_mm if channel == "force" else None,
            )
    relaxations = [
        relaxation(phase.name, channel, time[rows], values[rows], drift_std_per_s.get(channel, 0.0))
        for phase in phases
        for rows in [phase.rows(time)]
        if settings.relaxation.enabled and phase.name.startswith("dwell")
        for channel, values in (("force", wrench.pressing), ("torque", wrench.twisting))
        # Before the twist there is no torque that could relax.
        if channel == "force" or phase.start.time_s > located.strokes.press.stop.time_s
    ]
    processed = Processed(
        curves=curves,
        signals=signals,
        slide=slide,
        phases=phases,
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
    )
    return with_record(
        processed,
        settings,
        smoothings,
        block=block,
        spiky_rows=used.rows[spikes],
        lag_taken=lag_taken,
        drift_std_per_s=drift_std_per_s,
    )


def _windowed(recording: Recording, settings: ProcessingSettings) -> Recording:
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
    if free.size == 0:
        raise recording.fault("no row in free air before the press; start the log earlier", 0)
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
