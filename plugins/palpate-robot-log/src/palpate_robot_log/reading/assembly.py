"""From the columns of a log, by the channel map, to a recording in palpate's units."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from palpate.api import CurveError, FloatArray, IntArray
from palpate.delimited import Kind, TextFormat
from palpate_robot_log.reading import checks, orientation
from palpate_robot_log.reading.channel_map import NO_COLUMN, ChannelMap, Orientation, Source, bare
from palpate_robot_log.reading.formats import ReadingLimits, Request, read_log
from palpate_robot_log.reading.raw import RawLog
from palpate_robot_log.reading.series import Series, pick
from palpate_robot_log.reading.time_checks import checked_time
from palpate_robot_log.recording import Recording, rotated

_LEAST_OVERLAP = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reading:
    """A recording, and how it came out of its file.

    Parameters
    ----------
    recording : Recording
    record : mapping
        Format, streams, rates, units and what was done to the rows; JSON-able.
    """

    recording: Recording
    record: Mapping[str, object]


def read_recording(
    path: Path, channels: ChannelMap, text: TextFormat | None = None, limits: ReadingLimits | None = None
) -> Reading:
    """Read a robot's log, in a process of its own, and check what needs no physics.

    Parameters
    ----------
    path : Path
        Delimited text, Parquet, MATLAB, HDF5, NumPy, or a bag of ROS 1 or 2.
    channels : ChannelMap
    text : TextFormat, optional
        How delimited text is laid out; guessed where left out.
    limits : ReadingLimits, optional

    Raises
    ------
    CurveError
        Naming the file, rows, time stamps and column.
    """
    request = Request(
        columns=columns_of(channels),
        streams=_streams_of(channels),
        text=text or TextFormat(),
        limits=limits or ReadingLimits(),
    )
    return assemble(read_log(path, request), channels)


def columns_of(channels: ChannelMap) -> tuple[str, ...]:
    """Columns that the map names, each once."""
    sources = (channels.position, channels.orientation, channels.force, channels.moment)
    times = [channels.time.column, *(source.time for source in sources if source.time)]
    columns = [bare(name) for source in sources for name in source.columns if name != NO_COLUMN]
    return tuple(dict.fromkeys([*times, *columns]))


def _streams_of(channels: ChannelMap) -> tuple[str, ...] | None:
    """Streams that the map names; None when it leaves one open, so that all are read."""
    sources: list[Source] = [channels.position, channels.force, channels.moment]
    if channels.orientation.form != "fixed":
        sources.append(channels.orientation)
    named = [source.stream for source in sources if source.stream is not None]
    return tuple(dict.fromkeys(named)) if len(named) == len(sources) else None


def assemble(log: RawLog, channels: ChannelMap) -> Reading:
    """Recording from columns already read.

    Raises
    ------
    CurveError
        Naming the file, rows, time stamps and column.
    """
    series = _picked(log, channels)
    deviation = _check(series, channels)
    given = channels.orientation
    if "orientation" in series:
        q = orientation.quaternions(given.form, series["orientation"].values, given.sequence)
        if given.inverse:
            q = q * np.array([-1.0, -1.0, -1.0, 1.0])
        series["orientation"] = replace(series["orientation"], values=q)
    time_s, rows, values, resampled = _at_common_time(series, channels)
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
        rows=rows,
    )
    return Reading(recording=recording, record=_record(log, series, resampled, deviation, recording))


def _picked(log: RawLog, channels: ChannelMap) -> dict[str, Series]:
    """Series by quantity, whose time increases; of those that share a column of time one is checked."""
    kinds: dict[str, Kind | None] = {"position": "length", "force": "force", "moment": "moment"}
    form = channels.orientation.form
    if form != "fixed":
        kinds["orientation"] = "angle" if form in ("euler", "axis_angle") else None
    result: dict[str, Series] = {}
    for name, kind in kinds.items():
        series = pick(log, channels, name, kind)
        is_known = any(series.time_s is other.time_s for other in result.values())
        result[name] = series if is_known else checked_time(series, channels)
    return result


def _check(series: Mapping[str, Series], channels: ChannelMap) -> float:
    """Check the numbers as they are; returns how far the orientations are from turns."""
    bounds = channels.plausible
    checks.check_sensor(series["force"], channels)
    checks.check_sensor(series["moment"], channels)
    checks.check_range(series["force"], channels.force_limit, "force_limit, N")
    checks.check_range(series["moment"], channels.moment_limit, "moment_limit, N·mm")
    checks.check_position(series["position"], bounds)
    checks.check_wrench(series["force"], series["moment"], bounds)
    checks.check_frozen(series["position"], channels.stuck)
    if "orientation" not in series:
        return 0.0
    match channels.orientation.form:
        case "quaternion":
            return checks.check_quaternions(series["orientation"])
        case "rotation_matrix":
            return checks.check_matrices(series["orientation"])
        case _:
            checks.check_angles(series["orientation"], bounds)
            return 0.0


def _at_common_time(
    series: Mapping[str, Series], channels: ChannelMap
) -> tuple[FloatArray, IntArray, dict[str, FloatArray], list[str]]:
    """Time, rows and values of everything at the instants of one series, and what was interpolated."""
    kept = series["force" if channels.common_time == "wrench" else "position"]
    apart = {name: one for name, one in series.items() if not _are_together(kept, one)}
    chosen = _overlap(kept, list(apart.values())) if apart else slice(None)
    time_s = kept.time_s[chosen]
    values = {name: one.values[chosen] for name, one in series.items() if name not in apart}
    for name, one in apart.items():
        if name == "orientation":  # at constant angular speed (Shoemake 1985)
            values[name] = Slerp(one.time_s, Rotation.from_quat(one.values))(time_s).as_quat()
        else:
            columns = [np.interp(time_s, one.time_s, column) for column in one.values.T]
            values[name] = np.column_stack(columns)
    return time_s, kept.rows[chosen], values, list(apart)


def _are_together(first: Series, other: Series) -> bool:
    """Whether both have the very same instants, so that nothing is interpolated."""
    return other.time_s is first.time_s or np.array_equal(other.time_s, first.time_s)


def _overlap(kept: Series, others: Sequence[Series]) -> slice:
    """Rows of ``kept`` at which all the others have values."""
    begin = max(float(other.time_s[0]) for other in others)
    end = min(float(other.time_s[-1]) for other in others)
    first = int(np.searchsorted(kept.time_s, begin, side="left"))
    last = int(np.searchsorted(kept.time_s, end, side="right"))
    if last - first < _LEAST_OVERLAP * kept.time_s.size:
        spans = "; ".join(f"{s.what} {s.time_s[0]:.3f} to {s.time_s[-1]:.3f} s" for s in (kept, *others))
        raise kept.fault(
            f"pose and wrench hardly overlap in time ({spans}): their clocks differ, or one stopped; choose "
            "another column of time (received in a bag), or record again"
        )
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


def _record(
    log: RawLog, series: Mapping[str, Series], resampled: list[str], deviation: float, recording: Recording
) -> dict[str, object]:
    return {
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
        "interpolated": resampled,
        "n_rows": recording.n_rows,
        "rate_hz": recording.rate_hz,
        "orientation_deviation": deviation,
    }
