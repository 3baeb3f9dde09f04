"""Table of all that may be wrong with a log or its press, and the one runner of its rows.

A row has a measure, its limits, a message and a remedy. A mistake that would leave curves which look fine is
refused by what gives it away; where real logs differ from what is assumed, the remedy names the setting.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from palpate.api import CurveError
from palpate_robot_log import measures as of, press_measures as of_press
from palpate_robot_log.measures import Found, given

if TYPE_CHECKING:
    from palpate_robot_log.reading.channel_map import ChannelMap

_INF = float("inf")
_NONE = (0.0, 0.0)
"""Limits of a count of what must not be."""
FEWEST_FREE_ROWS = 10
"""Rows in free air that are needed before, and for a drift after the press."""
NOISE_MULTIPLE = 12.0
"""A change of force below this multiple of its noise is no contact."""
LARGEST_TURN_AXIS_ANGLE_DEG = 15.0
"""Of the twist's axis to the normal; curves are then off by 4 %."""
LEAST_TWIST_DEG = 1.0
"""Turns smaller than this are no twist."""
LEAST_SLIDE_MM = 0.5
"""Shifts smaller than this are no slide."""

Limits = tuple[float, float]


def _plausible(setting: str) -> Callable[..., Limits]:
    """Limits that the channel map gives under ``plausible``; a single one is the largest."""

    def limits(_: object, channels: "ChannelMap", *others: object) -> Limits:
        given = getattr(channels.plausible, setting)
        return given if isinstance(given, tuple) else (0.0, given)

    return limits


def _stuck(_: object, channels: "ChannelMap", __: object) -> Limits:
    return 0.0, channels.stuck


class Check(NamedTuple):
    """Row of the table: in its stage, values of the measure from the least to the most pass.

    Limits may follow from what the measure is called with. Message and remedy are patterns of the found
    value, of the limits ``least`` and ``most``, and of the words that the measure found.
    """

    stage: str
    measure: Callable[..., float | Iterable[Found]]
    limits: Limits | Callable[..., Limits]
    message: str
    remedy: str


class Subject(Protocol):
    """Series or recording: it names itself in an error."""

    @property
    def fault(self) -> Callable[..., CurveError]:
        """Error of a message that names the file, and the row and the column that are given."""


def check(subject: Subject, stage: str, *args: object, **words: object) -> None:
    """Refuse a subject by the first row of a stage whose measure is beyond its limits."""
    for error in errors_of(subject, stage, *args, **words):
        raise error


def errors_of(subject: Subject, stage: str, *args: object, **words: object) -> Iterator[CurveError]:
    """Errors by the rows of a stage, each for all that its measure finds beyond its limits."""
    for text, found in _broken(subject, stage, *args, **words):
        place = (each for each in (found.row, found.column) if each is not None)
        yield subject.fault(text, *place)


def warnings_of(subject: Subject, *args: object, **words: object) -> list[str]:
    """Messages of what the curves of a press may suffer from."""
    return [text for text, _ in _broken(subject, "warnings", *args, **words)]


def _broken(subject: Subject, stage: str, *args: object, **words: object) -> Iterator[tuple[str, Found]]:
    for each in (row for row in CHECKS if row.stage == stage):
        limits = each.limits(subject, *args) if callable(each.limits) else each.limits
        values = each.measure(subject, *args, **words)
        for found in values if isinstance(values, Iterable) else given(subject, values):
            if not limits[0] <= found.value <= limits[1]:
                known = {"value": found.value, "least": limits[0], "most": limits[1], **found.words}
                yield f"{each.message}; {each.remedy}".format_map(known), found


CHECKS: tuple[Check, ...] = (
    # a log as it was read, by the channel map
    Check("time", lambda series, _: series.time_s.size, (20, _INF),
         "{value} rows with values where a press needs at least {least}",
         "check that the log is complete"),
    Check("time", of.steps_back, _NONE,
         "time goes back, to {to:.4f} s from {before:.4f} s ({value} times in all)",
         "two logs in one file, or rows out of order: separate or sort them"),
    Check("time", of.repeated_times, _NONE,
         "the time of the row before once more ({value} such rows in all)",
         'remove them, or set repeated_time = "keep_first" in the channel map'),
    Check("steps", of.usual_step,
         lambda _, channels: (channels.plausible.shortest_step, channels.plausible.longest_step),
         "rows are {value:g} s apart with time in {unit}, which no log of a press has",
         "correct the unit of time, or widen plausible.shortest_step and longest_step in the channel map"),
    Check("steps", of.long_steps, _NONE,
         "no rows for {seconds:.4f} s from here to {to}, with {usual:.4g} s as the usual step ({value} "
         "gaps longer than {longest:.3g} s in all)",
         "record again, or raise max_gap in the channel map if nothing happened meanwhile"),
    Check("sensor", of.changing_rows, (1, _INF),
         "{number:g} in every row: the axis is dead, or the column another",
         'repair it, or write "0" for an axis that the sensor has not'),
    Check("repeats", of.stuck_s, _stuck,
         "the same to the last digit in all axes for {value:.3f} s, until {until}: the sensor is stuck or "
         "its driver stopped",
         "record again, or raise stuck in the channel map for a log without noise"),
    Check("repeats", of.plateau_rows, _NONE,
         "{number:.6g} in {value} rows on end, until {until}, and never beyond: the sensor is saturated",
         "press less deep, or take another sensor"),
    Check("repeats", of.axis_stuck_s, _stuck,
         "{number:.6g} to the last digit for {value:.3f} s, until {until}, with noise at other times: the "
         "axis is stuck",
         "record again, or raise stuck in the channel map"),
    Check("range", of.rows_beyond_range, _NONE,
         "{number:g} reaches the sensor's range of {limit:g} ({name}_limit, {unit}), as in {value} rows in "
         "all",
         "press less deep, or take another sensor"),
    Check("position", of.noise_of_rest_mm, _NONE,
         "the tip moves {value:.2g} mm in all, as by noise: the tool rests in all rows",
         "log a press, or check the position's columns"),
    Check("position", of.span, _plausible("travel"),
         "the tip moves {value:.4g} mm in all with columns in {unit}, plausible is {least:g} to {most:g} "
         "mm{hint}",
         "correct unit, or widen plausible.travel"),
    Check("position", of.reach_mm, _plausible("reach"),
         "the tip is {value:.4g} mm from the base with columns in {unit}, plausible is up to {most:g} mm",
         "correct unit, or raise plausible.reach"),
    Check("position", of.jump_after_stop_mm, (0.0, 0.5),
         "the pose does not change for {seconds:.3f} s and then jumps by {value:.2f} mm at {to}: its "
         "stream was interrupted",
         "record again"),
    Check("position", of.jump_mm, _NONE,
         "the tip jumps by {value:.3g} mm within one step: the pose was interrupted, or its frame changed",
         "log the press again"),
    Check("force", of.span, _plausible("force"),
         "it varies by {value:.4g} N with columns in {unit}, plausible is {least:g} to {most:g} N{hint}",
         "correct unit, or widen plausible.force"),
    Check("moment", of.lever_mm, _plausible("lever"),
         "it varies by {moment:.4g} N·mm with columns in {unit}, which with a force of {force:.4g} N is a "
         "lever of {value:.3g} mm, plausible is {least:g} to {most:g} mm{hint}",
         "correct unit, or widen plausible.lever"),
    Check("quaternion", of.off_unit_length, (0.0, of.LARGEST_DEVIATION),
         "the quaternion has length {length:.4f} and not 1, as in {n_rows} rows in all",
         "check that the columns are x, y, z, w of one orientation, and form"),
    Check("rotation_matrix", of.off_rotation, (0.0, of.LARGEST_DEVIATION),
         "the nine numbers are no rotation (rows are {value:.3g} from unit length and right angles)",
         "check that they are the matrix row by row"),
    Check("rotation_matrix", of.determinant, (0.0, _INF),
         "the matrix mirrors: its determinant is -1, so one of its axes points the wrong way",
         "turn the sign of that axis's columns"),
    Check("angles", lambda series, _: np.abs(series.values).max(), (0.0, 2.0 * of.TWO_PI),
         "angles up to {value:.4g} rad",
         "they are likely degrees: correct unit"),
    Check("angles", of.angles_like_radians, _NONE,
         "all angles are below {largest:.3g} degrees, so they may be radians",
         "correct unit, or set plausible.small_angles = true"),
    Check("overlap", given, (0.5, _INF),
         "pose and wrench hardly overlap in time ({spans}): their clocks differ, or one stopped",
         "choose another column of time (received in a bag), or record again"),
    Check("clocks", given, (0.5, _INF),
         "at no shift of the clocks the push follows the press (agreement {value:.2f})",
         "check that both files are of one press"),
    # contact and path
    Check("window", given, (2, _INF),
         "the window from {start} to {stop} s holds {value} rows of a log from {begin:.3f} to {end:.3f} s",
         "correct window.start and window.stop"),
    Check("spikes", given, (0.0, 0.01),
         "{hit} of {n_rows} rows have a spike in force or moment",
         "check the sensor's cable and range, or give spikes.enabled = false"),
    Check("zero", of_press.jump_of_zero, (0.0, of_press.LARGEST_JUMP_SHARE),
         "the force jumps by {jump_N:.3g} N while the tip {moves}{off}: the sensor was zeroed in contact",
         "zero it in free air, and log the press again"),
    Check("contact", given, (NOISE_MULTIPLE, _INF),
         "a press without contact: the force changes by {peak:.3g} N at most, with a noise of {noise:.2g} N",
         "check that the tool reached the limb, and that these are the wrench's columns"),
    Check("start", given, (3, _INF),
         "the log starts in contact, so the sensor's bias cannot be determined",
         "start it in free air"),
    Check("presses", given, (1, 1),
         "{value} presses in one log ({spans})",
         "give window.start and window.stop of one of them; a log must not start in contact"),
    Check("gaps", of_press.longest_step, (0.0, 1.0),
         "a gap of {seconds:.3f} s while the tool presses (rows come every {usual:.4f} s)",
         "log the press again without dropped rows"),
    Check("movement", given, (1e-300, _INF),
         "the tool never moves while the force changes",
         "check the position columns"),
    Check("line", given, (0.0, of_press.LARGEST_ACROSS),
         "the tool leaves its line by {value:.0%} of its travel while it presses, so the path gives no "
         "normal",
         "check the position columns, or give slide.enabled if it slides after the press"),
    Check("path", given, (0.0, 30.0),
         "the tool presses {value:.0f} degrees off the normal that is given",
         "correct normal.vector (outward, in the base frame), or give normal.method = 'path'"),
    Check("depth", given, (0.02, 300.0),
         "the tool travels {value:.3g} mm while it presses, which is no depth of a limb ({least:g} to "
         "{most:g} mm)",
         "check the unit of the position"),
    # 45 degrees where a tool sticks at friction 1
    Check("direction", of_press.other_side_deg, (0.0, of_press.LARGEST_FRICTION_ANGLE_DEG),
         "the force {way} ({value:.0f} degrees from the outward normal): {cause}",
         "set {setting} in the channel map"),
    Check("direction", of_press.off_normal_deg, (0.0, of_press.LARGEST_FRICTION_ANGLE_DEG),
         "the contact force is {value:.0f} degrees off the normal of the path, where friction explains "
         "{most:g} at most: axes are swapped, or the quaternion turns the other way. In the sensor's frame "
         "the force goes along {axes[0]} and the normal along {axes[1]}",
         "correct the column map"),
    Check("rising", given, (1e-300, _INF),
         "the normal force goes from {low:.3g} to {top:.3g} N over the press and does not rise",
         "check the sign and the axes of the wrench"),
    Check("onset", given, (8, _INF),
         "{value} rows in free air before contact",
         "start the log earlier, so that the sensor's bias and the onset can be determined"),
    # strokes and phases
    Check("strokes", of_press.n_into_limb, (1, 1),
         "{n} strokes into the limb in one contact ({spans}) where a press is one",
         "lift the tool off between presses, or give window.start and window.stop of one press"),
    Check("strokes", of_press.is_cut, _NONE,
         "the log stops half-way: the tool still presses deeper at its end",
         "log the whole press"),
    Check("rest", of_press.moved_at_end, (0.0, 1.0),
         "the log stops half-way: at its end the tool still {moves} at {slope:.3g} {unit}/s and presses",
         "log until the tool is clear of the limb"),
    Check("rate", given, _NONE,
         "too few rows where the tool starts or stops in contact ({n_rows} in all, {rate_hz:.3g} Hz)",
         "log the press at a higher rate, with its rests, and check that the force is logged throughout"),
    Check("order", of_press.early_s, (-_INF, 0.0),
         "the twist begins at {begin_s:.3f} s, before the press ends at {end_s:.3f} s",
         "press first and twist then"),
    Check("twist", of_press.turn_axis_deg, (0.0, LARGEST_TURN_AXIS_ANGLE_DEG),
         "the tool twists about an axis {value:.0f} degrees off the normal (more than {most:g} is refused)",
         "check the order of the position's columns, and order and sense (tool to base) of the "
         "quaternion's; where the press is oblique on purpose, give normal.method = 'tool_axis'"),
    Check("slide", of_press.largest_shift_mm, (LEAST_SLIDE_MM, _INF),
         "the tool shifts by {value:.2g} mm after the press, and a slide is at least {least:g} mm",
         "log a slide, or leave slide.enabled out"),
    Check("slide", of_press.off_line, (0.0, 0.1),
         "the slide leaves its line by {lateral:.2g} mm of {length:.3g} mm",
         "slide to and fro on one line, or give window.start and window.stop"),
    Check("slide rate", given, _NONE,
         "too few rows where the slide starts or stops",
         "log it at a higher rate, with its rests"),
    Check("slide or twist", of_press.n_both, _NONE,
         "the tool twists from {begin_s:.2f} s on while it slides",
         "do one after the other"),
    # corrections of the wrench
    Check("lag", given, (-of_press.LARGEST_LAG_S, of_press.LARGEST_LAG_S),
         "the wrench comes {value:.3f} s after the pose",
         "correct the clock of one of them, or give alignment.lag"),
    Check("free air", given, (1.0, _INF),
         "{n_rows} rows in free air before the press",
         "start the log earlier, so that the sensor's drift and bias can be determined, or give "
         "drift.enabled = false and tare.enabled = false"),
    Check("tool", lambda _, tool: tool.weight_N, (0.0, 100.0),
         "a tool of {value:.4g} N is not plausible (0 to {most:g} N)",
         "check the units of the force and of gravity.weight, and the direction of gravity"),
    Check("tool", lambda _, tool: float(np.linalg.norm(tool.centre_mm)), (0.0, 500.0),
         "a tool whose centre is {value:.4g} mm from the sensor is not plausible (up to {most:g} mm)",
         "check the units of the moment and of gravity.centre"),
    Check("weight", of_press.weight_over_shown, (0.0, 2.0),
         "in free air the sensor shows {shown:.3g} N, but gravity gives the tool {weight:.4g} N: heavier "
         "than plausible",
         "check gravity.weight (in N, 9.81 times the mass in kg)"),
    Check("orientations", given, (0.0, 1.0),
         "{n_rows} rows in free air give no weight of the tool, since its orientation hardly changes there",
         "give gravity.weight and gravity.centre, or log a few orientations in free air"),
    Check("drift", given, (FEWEST_FREE_ROWS, _INF),
         "the log stops before the tool is clear of the limb ({value} rows in free air after the press), "
         "so the sensor's drift cannot be determined",
         "log until the tool is clear, or give drift.enabled = false"),
    Check("torque", of_press.torque_at_rest, (0.0, 1.0),
         "the torque goes up and down by {torque:.3g} N·mm while the tool rests in its logged pose: the "
         "orientation is stuck, or not the tool's",
         "check channels.orientation"),
    Check("torque", of_press.likeness, (-of_press.LEAST_CORRELATION, 1.0),
         "torque and rotation are out of phase (correlation {value:.2f}): one of them is left-handed",
         "turn the sign of the moment about the tool's axis, or the sense of the quaternion, in the column "
         "map"),
    Check("torque", of_press.silent_moment, _NONE,
         "no moment answers the twist ({largest:.2g} N·mm at most), so the log has none",
         'write "0" for the three columns of the moment, and weigh the force alone'),
    Check("torque", of_press.other_moments, (0.0, 1.0),
         "the torque about the normal answers the rotation by {torque:.3g} N·mm (correlation "
         "{likeness:.2f}), tangential moments by {others:.3g} N·mm: axes of the moment are swapped, or "
         "gravity has another weight of the tool",
         "check the order of the moment's columns"),
    # cycles of one log
    Check("cycle", given, (-_INF, 0.0),
         "cycle = {cycle}, but the log has {n_cycles}",
         "choose one that it has, 'last' or 'all'"),
    Check("one onset", given, (1, 1),
         "onset.time is for one first contact, and the log has {value} cycles",
         "give window.start and window.stop of one of them"),
    Check("one spot", given, (0.0, 1.0),
         "cycle {cycle} presses {value:.3g} mm from cycle {counted} (more than {most:g} mm is refused), so "
         "the log has several spots",
         "give window.start and window.stop of one of them"),
    # Warnings: nothing is refused.
    Check("warnings", lambda _, press: press.lacks_torque, _NONE,
         "the log has no moment, so the twist gives no torque",
         "weigh the force alone"),
    Check("warnings", of_press.drift_share, (0.0, 0.1),
         "the sensor's zero drifts by {change_N:.2g} N over the log ({value:.0%} of the peak), and a "
         "straight line is taken out",
         "let the sensor warm up, and zero it before each press"),
    Check("warnings", of_press.weight_share, (0.0, 0.01),
         "the force in free air is {offset_N:.2g} N ({offset_share:.0%} of the peak) and the tool tilts by "
         "{tilt_deg:.0f} degrees; if it is the tool's weight, up to {left_N:.2g} N of it stay in the curves",
         "give gravity.method"),
)  # fmt: skip
"""Rows of each stage, in the order in which they are tried."""
