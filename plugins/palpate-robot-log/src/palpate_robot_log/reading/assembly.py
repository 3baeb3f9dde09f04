"""From the columns of a log, by the channel map, to a recording in palpate's units."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.api import CurveError, FloatArray, IntArray
from palpate.delimited import Kind, TextFormat
from palpate_robot_log.processing.rotation import rotated, unrotated
from palpate_robot_log.reading import checks, orientation
from palpate_robot_log.reading.channel_map import NO_COLUMN, ChannelMap, Source, bare
from palpate_robot_log.reading.common_time import are_together, interpolated, overlap
from palpate_robot_log.reading.formats import ReadingLimits, Request, read_log
from palpate_robot_log.reading.raw import RawLog
from palpate_robot_log.reading.series import Series, pick
from palpate_robot_log.reading.time_checks import checked_time
from palpate_robot_log.recording import Recording


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
        streams=streams_of(channels),
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


def streams_of(channels: ChannelMap) -> tuple[str, ...] | None:
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
    """
    series = _with_checked_time(_picked(log, channels), channels)
    deviation = _check(series, channels)
    series = _with_quaternions(series, channels)
    time_s, rows, values, resampled = _at_common_time(series, channels)
    pose_q = values.get("orientation", _fixed(channels, time_s.size))
    q = _sensor_turns(pose_q, channels)
    force, moment = _wrench(values["force"], values["moment"], q, channels)
    recording = Recording(
        source=log.source,
        row_word=log.row_word,
        time_s=time_s,
        position_mm=values["position"] + rotated(pose_q, np.array(channels.tip))
        if any(channels.tip)
        else values["position"],
        quaternion=q,
        force_N=force,
        moment_Nmm=moment,
        rows=rows,
    )
    return Reading(recording=recording, record=_record(log, series, resampled, deviation, recording))


def _picked(log: RawLog, channels: ChannelMap) -> dict[str, Series]:
    turned = channels.orientation
    kind: Kind | None = "angle" if turned.form in ("euler", "axis_angle") else None
    picked = {
        "position": pick(log, channels, "position", channels.position, channels.position.columns, "length"),
        "force": pick(log, channels, "force", channels.force, channels.force.columns, "force"),
        "moment": pick(log, channels, "moment", channels.moment, channels.moment.columns, "moment"),
    }
    if turned.form != "fixed":
        picked["orientation"] = pick(log, channels, "orientation", turned, turned.columns, kind)
    return picked


def _with_checked_time(picked: Mapping[str, Series], channels: ChannelMap) -> dict[str, Series]:
    """Series whose time increases; of those that share one column of time the first is checked."""
    checked: list[Series] = []
    result = {}
    for name, series in picked.items():
        is_known = any(series.time_s is other.time_s for other in checked)
        result[name] = series if is_known else checked_time(series, channels)
        checked.append(result[name])
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


def _with_quaternions(series: Mapping[str, Series], channels: ChannelMap) -> dict[str, Series]:
    """Series with the orientation as quaternions, which can be interpolated."""
    if "orientation" not in series:
        return dict(series)
    given, form = series["orientation"], channels.orientation
    q = orientation.quaternions(form.form, given.values, form.sequence)
    if form.inverse:
        q = q * np.array([-1.0, -1.0, -1.0, 1.0])
    return {**series, "orientation": given.with_values(q)}


def _at_common_time(
    series: Mapping[str, Series], channels: ChannelMap
) -> tuple[FloatArray, IntArray, dict[str, FloatArray], list[str]]:
    """Time, rows and values of everything at the instants of one series, and what was interpolated."""
    if are_together(list(series.values())):
        kept = series["force"]
        return kept.time_s, kept.rows, {name: s.values for name, s in series.items()}, []
    kept = series["force" if channels.common_time == "wrench" else "position"]
    others = [s for s in series.values() if not are_together([kept, s])]
    kept_rows = overlap(kept, others)
    time_s = kept.time_s[kept_rows]
    values, resampled = {}, []
    for name, one in series.items():
        if are_together([kept, one]):
            values[name] = one.values[kept_rows]
            continue
        resampled.append(name)
        values[name] = (
            orientation.interpolated_turns(one.time_s, one.values, time_s)
            if name == "orientation"
            else interpolated(one, time_s)
        )
    return time_s, kept.rows[kept_rows], values, resampled


def _fixed(channels: ChannelMap, n_rows: int) -> FloatArray:
    if channels.orientation.form != "fixed":
        return np.empty((0, 4))
    q = np.array(channels.orientation.value)
    length = float(np.linalg.norm(q))
    if abs(length - 1.0) > 0.01:
        raise CurveError(
            f"channel map: the quaternion orientation.value has length {length:.4g} and not 1; correct it"
        )
    return np.tile(q / length, (n_rows, 1))


def _sensor_turns(pose_q: FloatArray, channels: ChannelMap) -> FloatArray:
    """Turns of the sensor's frame into the base."""
    if not any(channels.sensor_turned):
        return pose_q
    mount = Rotation.from_euler("xyz", channels.sensor_turned, degrees=True)
    turned: FloatArray = (Rotation.from_quat(pose_q) * mount).as_quat()
    return turned


def _wrench(
    force: FloatArray, moment: FloatArray, q: FloatArray, channels: ChannelMap
) -> tuple[FloatArray, FloatArray]:
    """Force and moment of the tissue on the tool, in the sensor's frame."""
    if channels.wrench_frame == "base":
        force, moment = unrotated(q, force), unrotated(q, moment)
    return (-force, -moment) if channels.acts_on == "tissue" else (force, moment)


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
