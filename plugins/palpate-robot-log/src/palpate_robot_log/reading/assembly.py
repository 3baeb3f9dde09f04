"""From the columns of a log, by the channel map, to a recording in palpate's units."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import correlate
from scipy.spatial.transform import Rotation, Slerp

from palpate.api import CurveError, FloatArray
from palpate.api.files import BASE_UNITS, Column, Kind, TextFormat, factor_to_base, kind_of
from palpate_robot_log.checks import check
from palpate_robot_log.measures import off_rotation, off_unit_length
from palpate_robot_log.reading.channel_map import NO_COLUMN, ChannelMap, LogFiles, Orientation, Time, Vector
from palpate_robot_log.reading.formats import ReadingLimits, read_log
from palpate_robot_log.reading.raw import RawLog, Series, Stream
from palpate_robot_log.recording import Recording, rotated

_STEP_S, _HELD = 0.01, 0.8  # the latter is the share of updates that come after the same number of rows


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reading:
    """A recording, and how it came out of its file: format, streams, rates, units; JSON-able."""

    recording: Recording
    record: Mapping[str, object]


def read_recording(
    path: Path,
    channels: ChannelMap,
    text: TextFormat | None = None,
    limits: ReadingLimits | None = None,
    files: LogFiles | None = None,
) -> Reading:
    """Recording of a robot's log that was read in a process of its own, checked for what needs no physics.

    Where ``files`` names a file of the wrench, ``path`` is the pose's. A CurveError names file, rows, time
    stamps and column.
    """
    is_fixed = channels.orientation.form == "fixed"
    sources = [s for s in _sources(channels).values() if s is not channels.orientation or not is_fixed]
    # All streams are read when the map leaves one open.
    named = [source.stream for source in sources if source.stream is not None]
    if files is not None:
        return assemble(read_both(path, files.wrench_of(path), text, limits), channels)
    streams = list(dict.fromkeys(named)) if len(named) == len(sources) else None
    return assemble(read_log(path, columns_of(channels), streams, text, limits), channels)


def columns_of(channels: ChannelMap) -> tuple[str, ...]:
    """Columns that the map names, each once."""
    sources = _sources(channels).values()
    times = [
        name for time in (channels.time, *(each.time for each in sources)) if time for name in time.columns
    ]
    columns = [name.removeprefix("-") for source in sources for name in source.columns if name != NO_COLUMN]
    return tuple(dict.fromkeys([*times, *columns]))


def _sources(channels: ChannelMap) -> dict[str, Vector | Orientation]:
    names = ("position", "orientation", "force", "moment")
    return {name: getattr(channels, name) for name in names}


def assemble(log: RawLog, channels: ChannelMap) -> Reading:
    """Recording from columns already read."""
    given = channels.orientation
    kinds: dict[str, Kind | None] = {"position": "length", "force": "force", "moment": "moment"}
    if given.form != "fixed":
        kinds["orientation"] = "angle" if given.form in ("euler", "axis_angle") else None
    series: dict[str, Series] = {}
    for name, kind in kinds.items():
        one = _picked(log, channels, name, kind)
        is_known = any(one.time_s is other.time_s for other in series.values())
        series[name] = one if is_known else _with_rising_time(one, channels)
    deviation = _checked_values(series, channels)
    series |= _updated(series["force"], series["moment"])
    offset_s = 0.0
    if channels.clocks == "own":
        offset_s = clock_offset_s(series["position"], series["force"])
        for name in ("force", "moment"):
            series[name] = replace(series[name], time_s=series[name].time_s - offset_s)
    if turned := series.get("orientation"):
        q = quaternions(given.form, turned.values, given.sequence)
        series["orientation"] = replace(
            turned, values=q * np.array([-1.0, -1.0, -1.0, 1.0]) if given.inverse else q
        )
    kept = series["force" if channels.common_time == "wrench" else "position"]
    apart = {name: one for name, one in series.items() if not np.array_equal(one.time_s, kept.time_s)}
    chosen = _overlap(kept, list(apart.values())) if apart else slice(None)
    time_s, values = kept.time_s[chosen], {name: one.values[chosen] for name, one in series.items()}
    for name, one in apart.items():
        if name == "orientation":  # at constant angular speed (Shoemake 1985)
            values[name] = Slerp(one.time_s, Rotation.from_quat(one.values))(time_s).as_quat()
        else:
            columns = [np.interp(time_s, one.time_s, column) for column in one.values.T]
            values[name] = np.column_stack(columns)
    pose_q = values["orientation"] if "orientation" in values else _fixed(given, time_s.size)
    sensor_q = pose_q
    if any(channels.sensor_turned):
        mount = Rotation.from_euler("xyz", channels.sensor_turned, degrees=True)
        sensor_q = (Rotation.from_quat(pose_q) * mount).as_quat()
    position, force, moment = values["position"], values["force"], values["moment"]
    if any(channels.tip):
        position = position + rotated(pose_q, np.array(channels.tip))
    if channels.wrench_frame == "base":
        force, moment = (rotated(sensor_q, each, inverse=True) for each in (force, moment))
    if channels.acts_on == "tissue":
        force, moment = -force, -moment
    recording = Recording(
        source=log.source,
        row_word=log.row_word,
        time_s=time_s,
        position_mm=position,
        quaternion=sensor_q,
        force_N=force,
        moment_Nmm=moment,
        rows=kept.rows[chosen],
        acts_on=channels.acts_on,
        wrench_frame=channels.wrench_frame,
    )
    record = {
        "format": log.format,
        "layout": dict(log.layout),
        "notes": [note for note in log.notes if "passed over" not in note],
        "channels": {
            name: {
                "columns": list(one.names),
                "stream": one.stream,
                "units": list(one.units),
                "n_rows": int(one.time_s.size),
                "rate_hz": float(1.0 / np.median(np.diff(one.time_s))),
            }
            for name, one in series.items()
        },
        "interpolated": list(apart),
        "clock_offset_s": offset_s,
        "n_rows": recording.n_rows,
        "rate_hz": recording.rate_hz,
        "orientation_deviation": deviation,
    }
    return Reading(recording=recording, record=record)


def _with_rising_time(series: Series, channels: ChannelMap) -> Series:
    """Series once its time is checked, without the rows that repeat a time where the map allows them."""
    check(series, "time", channels)
    if (steps := np.diff(series.time_s)).min() == 0.0:
        series = series.part(np.concatenate([[True], steps > 0.0]))
    check(series, "steps", channels)
    return series


def _updated(force: Series, moment: Series) -> dict[str, Series]:
    """Rows of a wrench that is new, where each is repeated a few times: what is held comes late."""
    if force.time_s.size != moment.time_s.size:
        return {}
    is_new = np.any(np.diff(np.hstack([force.values, moment.values]), axis=0), axis=1)
    starts = np.concatenate([[0], np.flatnonzero(is_new) + 1])
    n_rows = np.diff(starts)
    is_held = n_rows.size > 0 and (usual := np.median(n_rows)) > 1 and np.mean(n_rows == usual) > _HELD
    chosen = np.isin(np.arange(force.time_s.size), starts)
    return {one.what: one.part(chosen) for one in (force, moment)} if is_held else {}


_POSES = {"force": ("position",), "moment": ("position", "orientation")}
"""Motions without which a force or a moment stays as it is."""


def _checked_values(series: Mapping[str, Series], channels: ChannelMap) -> float:
    """Distance of the orientations from turns, once all numbers may belong to a press."""
    for name in ("force", "moment"):
        pose = [series[what] for what in _POSES[name] if what in series]
        for stage in ("sensor", "repeats", "range"):
            check(series[name], stage, channels, *([pose] if stage == "repeats" else []))
    for name in ("position", "force"):
        check(series[name], name, channels)
    check(series["moment"], "moment", channels, series["force"])
    if "orientation" not in series:
        return 0.0
    form = channels.orientation.form
    stage = form if form in ("quaternion", "rotation_matrix") else "angles"
    check(series["orientation"], stage, channels)
    measure = {"quaternion": off_unit_length, "rotation_matrix": off_rotation}.get(form)
    return next(measure(series["orientation"], channels)).value if measure else 0.0


def _picked(log: RawLog, channels: ChannelMap, what: str, kind: Kind | None) -> Series:
    """Columns of one quantity and their time, converted to the recording's units."""
    source = _sources(channels)[what]
    its_time = source.time or channels.time
    real = [name.removeprefix("-") for name in source.columns if name != NO_COLUMN]
    stream = log.stream_of([*its_time.columns, *real], source.stream)
    time_s, time_unit = seconds_of(log, stream, its_time, header_units=channels.header_units)
    # Column after column in memory: what is done to each axis of a long log takes a tenth of the time.
    table = np.zeros((len(source.columns), stream.rows.size)).T
    units = []
    for index, name in enumerate(source.columns):
        if name != NO_COLUMN:
            column, sign = stream.column(name.removeprefix("-")), -1.0 if name.startswith("-") else 1.0
            factor, unit = _factor(log, column, source.unit, kind, header_units=channels.header_units)
            np.multiply(column.values, sign * factor, out=table[:, index])
            units.append(unit)
    series = Series(
        log=log,
        what=what,
        names=tuple(source.columns),
        stream=stream.name,
        time_s=time_s,
        values=table,
        rows=stream.rows,
        units=(time_unit, units[0] if units else ""),
    )
    # A sum is finite only if all its terms are: one pass in the usual case.
    if np.isfinite(series.time_s.sum()) and np.isfinite(table.sum()):
        return series
    lacking = ~np.isfinite(table)
    bad_rows = lacking.any(axis=1) | ~np.isfinite(series.time_s)
    if not bad_rows.any():
        return series
    if channels.missing == "skip":
        return series.part(~bad_rows)
    first = int(np.argmax(bad_rows))
    name = series.names[int(np.argmax(lacking[first]))] if lacking[first].any() else its_time.column
    name = name.removeprefix("-")
    why = stream.column(name).note or "no value (NaN or empty)"
    raise CurveError(
        f"{log.source}: {series.at(first)}, column '{name}': {why}, as in "
        f'{int(bad_rows.sum())} rows in all; repair or remove them, or set missing = "skip" in the channel '
        "map to interpolate between the rows that have one"
    )


def seconds_of(
    log: RawLog, stream: Stream, time: Time, *, header_units: bool = True
) -> tuple[FloatArray, str]:
    """Time [s] of the rows of a stream, and its unit in the file.

    Series that share a column of seconds are known by sharing the array.
    """
    column, factor, unit = stream.column(time.column), 1.0 / (time.rate or 1.0), "rows"
    if time.rate is None:
        factor, unit = _factor(log, column, time.unit, "time", header_units=header_units)
    elif (header_units and kind_of(column.shown_unit) == "time") or (column.values % 1.0 > 0.0).any():
        raise CurveError(f"{log.source}: column '{column.name}' counts no rows; leave its rate out")
    values = column.values if factor == 1.0 else factor * column.values
    if time.nanoseconds is not None:
        values = values + 1e-9 * stream.column(time.nanoseconds).values
    return values, unit


def _factor(
    log: RawLog, column: Column, unit: str | None, kind: Kind | None, *, header_units: bool
) -> tuple[float, str]:
    """Factor from the file's unit to the recording's, and the file's unit."""
    where = f"{log.source}: column '{column.name}'"
    if kind is None:
        return 1.0, ""
    found = column.shown_unit if header_units else ""
    if not unit and not found and kind == "time" and np.all(np.diff(column.values) == 1.0):
        of = f'time = {{ column = "{column.name}", rate = "… Hz" }}'
        raise CurveError(f"{where} counts rows; give the rate at which they were logged: {of}")
    if not unit and not found:
        raise CurveError(
            f"{where} shows no unit, and the channel map gives none; "
            f'write unit = "{BASE_UNITS[kind]}", or whatever it is, next to the columns'
        )
    if found and kind_of(found) in (None, "other"):
        why = f"is no unit of {kind}" if kind_of(found) else "is not known"
        raise CurveError(
            f"{where}: the file gives the unit '{found}', which {why}; calibrate the columns, write their "
            "units next to them, and header_units = false, in the channel map"
        )
    factor = factor_to_base(unit or found, kind, where)
    if unit and found and not np.isclose(factor, factor_to_base(found, kind, where), rtol=1e-9):
        raise CurveError(
            f"{where} is in {found} as the file shows, and in {unit} as the channel map gives; remove unit "
            "there, or set header_units = false if the file is wrong"
        )
    return factor, unit or found


def quaternions(form: str, values: FloatArray, sequence: str = "xyz") -> FloatArray:
    """Unit quaternions (n, 4) of orientations (n, k) as robots log them, with angles in radians.

    A sequence of Euler angles in small letters is about fixed axes.
    """
    if form == "quaternion":
        return values / np.sqrt(np.einsum("ij,ij->i", values, values))[:, None]
    if form == "euler":
        rotation = Rotation.from_euler(sequence, values)
    elif form == "axis_angle":
        rotation = Rotation.from_rotvec(values)
    else:
        rotation = Rotation.from_matrix(values.reshape(-1, 3, 3))
    return rotation.as_quat()


def _overlap(kept: Series, others: Sequence[Series]) -> slice:
    """Rows of ``kept`` at which all the others have values."""
    begin = max(float(other.time_s[0]) for other in others)
    end = min(float(other.time_s[-1]) for other in others)
    first = int(np.searchsorted(kept.time_s, begin, side="left"))
    last = int(np.searchsorted(kept.time_s, end, side="right"))
    spans = "; ".join(f"{s.what} {s.time_s[0]:.3f} to {s.time_s[-1]:.3f} s" for s in (kept, *others))
    check(kept, "overlap", (last - first) / kept.time_s.size, spans=spans)
    return slice(first, last)


def _fixed(given: Orientation, n_rows: int) -> FloatArray:
    """The one quaternion of the map in every row (n, 4)."""
    q = np.array(given.value)
    length = float(np.linalg.norm(q))
    if abs(length - 1.0) > 0.01:
        raise CurveError(
            f"channel map: the quaternion orientation.value has length {length:.4g} and not 1; correct it"
        )
    return np.tile(q / length, (n_rows, 1))


# ------------------------------------------------- two files: pose and wrench with their own clocks


def read_both(
    pose: Path, wrench: Path, text: TextFormat | None = None, limits: ReadingLimits | None = None
) -> RawLog:
    """One log of the streams of both files; the one stream of a table is called pose or wrench."""
    logs = [read_log(path, text=text, limits=limits) for path in (pose, wrench)]
    streams = [
        replace(stream, name=stream.name or name)
        for name, log in zip(("pose", "wrench"), logs, strict=True)
        for stream in log.streams
    ]
    return replace(
        logs[0],
        source=f"{pose} and {wrench.name}",
        format=" and ".join(dict.fromkeys(log.format for log in logs)),
        streams=tuple(streams),
        notes=tuple(note for log in logs for note in log.notes),
        layout=logs[0].layout if logs[0].layout == logs[1].layout else {},
    )


def share_clock(spans_s: Sequence[tuple[float, float]]) -> bool:
    """Whether times [s] are of one clock: all count since 1970, and half of the shortest is common."""
    shared = min(end for _, end in spans_s) - max(begin for begin, _ in spans_s) if spans_s else 0.0
    shortest = min((end - begin for begin, end in spans_s), default=0.0)
    # Seconds since 1970 that no clock that began with the log has counted.
    return min((begin for begin, _ in spans_s), default=0.0) > 1e9 and shared >= 0.5 * shortest


def clock_offset_s(position: Series, force: Series) -> float:
    """Time [s] by which the force's clock is ahead of the position's.

    At this shift the speed of the tip along its main direction and the rate of the push go up and down
    together: both are large while the tool presses and retracts, and the push changes most where a press
    ends and a retraction begins.

    Raises
    ------
    CurveError
        They do not agree at any shift.
    """
    away = position.values - position.values[0]
    along = np.linalg.svd(away - away.mean(axis=0), full_matrices=False)[2][0]
    speed = _rates(position, away @ along)
    push = _rates(force, np.linalg.norm(force.values - np.median(force.values[:5], axis=0), axis=1))
    agreement = correlate(push, speed, method="fft") / (np.linalg.norm(push) * np.linalg.norm(speed))
    best = int(np.argmax(agreement))
    check(force, "clocks", float(agreement[best]))
    left, middle, right = agreement[[max(best - 1, 0), best, min(best + 1, agreement.size - 1)]]
    bend = left - 2.0 * middle + right
    fraction = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    shift = (best - (speed.size - 1) + fraction) * _STEP_S
    return float(force.time_s[0] - position.time_s[0] + shift)


def _rates(series: Series, values: FloatArray) -> FloatArray:
    """Size of the rate of a value (n,) on a grid of steps, smoothed."""
    duration = min(float(series.time_s[-1] - series.time_s[0]), 3600.0)
    grid = series.time_s[0] + np.arange(0.0, duration, _STEP_S)
    smooth = gaussian_filter1d(np.interp(grid, series.time_s, values), 5.0, order=1)
    return np.abs(smooth)
