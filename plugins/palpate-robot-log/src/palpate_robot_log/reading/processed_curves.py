"""Curves and homogeneous tests that are no log, recognised by their columns and proposed for their loader."""

import json
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from palpate.api import FORCE, Curve, ExperimentLoader, FloatArray
from palpate.api.files import Column, kind_of
from palpate_indentation.api import CsvLoader, problem_of, units_of
from palpate_robot_log.processing.contact import place_of_contact
from palpate_robot_log.reading.names import (
    ROLES,
    TITLES,
    WORDS,
    Picked,
    Test,
    has_role,
    pick,
    rivals,
    spread_of,
    test_of,
    unit_of,
    words_of,
)
from palpate_robot_log.reading.proposal import Entry, Proposal, validated
from palpate_robot_log.reading.raw import RawLog
from palpate_robot_log.reading.specimen import sizes_in
from palpate_robot_log.robot_log import ColumnsLoader

_ROLES = {"force": ("travel", "force"), "torque": ("angle", "moment")}
_FEWEST_OF_ROBOT = 7  # a time, a position and a force
_AT_REST, _FARTHEST = 0.02, 0.999
"""Shares of a range up to which a value is next to zero, and from which it is the farthest."""
_MOST = (10.0, 90.0)  # percentiles between which most rows are, without the begin of a creep test
_TRAVEL_MM = 10.0  # to which a travel of any unit is scaled where first contact is sought
_FEWEST_ROWS, _FEWEST_FREE = 20, 8
"""Rows of a curve, and of its approach, at least."""
_LEAST_APPROACH, _FREE, _SURE, _FLAT = 0.05, 0.8, 3.0, 1e-3
"""Shares of the travel that is an approach, and of the approach that is surely free; standard errors, and
share of the force, up to which it does not rise."""


def spans_of(curves: Mapping[str, Curve]) -> str:
    """Ranges of curves, in words."""
    spans = []
    for name, curve in curves.items():
        along, of = (
            f"{values.min():.4g} to {values.max():.4g} {'' if unit == '1' else unit}".rstrip()
            for values, unit in zip((curve.abscissa, curve.ordinate), units_of(name), strict=True)
        )
        spans.append(f"{name} {of} over {along} in {curve.abscissa.size} rows")
    return "; ".join(spans)


def curves_of(log: RawLog, *, has_place: bool = False) -> Proposal | None:
    """Settings for the curves of a press, or a homogeneous test, in a table; None where it has neither."""
    columns = [column for stream in log.streams for column in stream.columns.values()]
    words, sizes = words_of(log.preamble.replace("\n", " ")), sizes_in(log.preamble)
    stated = {*words, *map("".join, pairwise(words))}
    found = _homogeneous(columns, stated) or _curves(columns, _test_in(stated, sizes), sizes)
    found = found or (None if has_place else _unnamed(columns, sizes))
    if found is None:
        return None
    # The loader finds the separator by itself.
    layout = {key: value for key, value in log.layout.items() if key != "delimiter" and value != "."}
    what = "a homogeneous test" if found.test else "processed curves"
    loader = CsvLoader if log.row_word == "line" else ColumnsLoader
    kind = f"{what} and no log: the loader {loader.name} reads them; check names and units"
    return replace(
        found,
        loader=loader.name,
        entries=(*(Entry("", key, value) for key, value in layout.items()), *found.entries),
        remarks=(kind, *found.remarks),
    )


def _entries(channels: Mapping[str, Mapping[str, Any]]) -> tuple[Entry, ...]:
    """Entries of the fields of each channel."""
    return tuple(
        Entry(f"channels.{name}", key, value)
        for name, fields in channels.items()
        for key, value in fields.items()
    )


def curves_by(proposal: Proposal, path: Path) -> Mapping[str, Curve]:
    """Curves of a file by its proposal; a CurveError where there are none."""
    kind: type[ExperimentLoader[Any]] = CsvLoader if proposal.loader == CsvLoader.name else ColumnsLoader
    return kind(validated(kind.Settings, proposal.settings)).load(path, proposal.test or None).curves


def _unnamed(columns: Sequence[Column], sizes: Mapping[str, float]) -> Proposal | None:
    """Question for what a few columns lack to be a curve; a robot's log has more columns."""
    if not 2 <= len(columns) < _FEWEST_OF_ROBOT:
        return None
    names = [column.name for column in columns]
    every = {word for name in names for word in words_of(name)}
    for words, are in (("oscillation", "amplitudes of an oscillation are"), ("inflation", "an inflation is")):
        if WORDS[words] & every and pick(columns, "force") is None:
            return Proposal(questions=(f"{', '.join(names)}: {are} no curve; give a test of loading",))
    if (specimen := _specimen(columns, sizes)) is not None:
        return specimen
    unread = [c for c in columns if c.note and has_role(words_of(c.name)) and not np.isfinite(c.values).any()]
    if unread:
        return Proposal(questions=tuple(f"{column.name}: {column.note}" for column in unread))
    ask = f"{', '.join(names)}: which is the depth, and which the force? name them, with factors to mm and N"
    if (stress := pick(columns, "stress")) is not None:
        known = {"ratio", None}
        free = [c.name for c in columns if c != stress.column and kind_of(c.shown_unit) in known]
        which = f"is it {' or '.join(free)}? name it" if free else "add its column"
        ask = f"{stress.column.name}: a test needs strain or stretch next to stress; {which}"
    elif all(WORDS["time"] & {*words} or has_role(words, "travel") for words in map(words_of, names)):
        ask = f"{', '.join(names)}: a curve needs depth and force at each time; log both"
    fields = zip(("abscissa", "ordinate"), names[-2:], ("mm", "N"), strict=True)
    channels = {key: {"name": name, "scale": f"factor to {unit}"} for key, name, unit in fields}
    return Proposal(entries=_entries({"force": channels}), questions=(ask,))


# ------------------------------------------------------------------------ a press


_PLAUSIBLE = {"travel": (0.02, 500.0), "force": (2e-3, 5e3), "moment": (0.5, 1e5)}
"""Ranges of a travel [mm], a force [N] and a moment [N·mm] beyond which a column is not in these units."""


def _unit_of(one: Picked, role: str) -> tuple[str, str]:
    """Question for the unit of a column, or a remark on the one that is assumed."""
    if one.factor is not None or one.column.shown_unit:
        return one.question(role), ""
    least, most = _PLAUSIBLE.get(role, (0.0, np.inf))
    span = float(np.ptp(one.column.values[np.isfinite(one.column.values)]))
    if least <= span <= most:
        return "", f"check the unit of {one.column.name}: {unit_of(role)} is assumed"
    ask = f"spans {span:.4g} and shows no unit; give scale, the factor to {unit_of(role)}"
    return f"{one.column.name} {ask}", ""


def _test_in(stated: Set[str], sizes: Mapping[str, float]) -> str:
    """Test other than a press in the words above the names, also by two sizes of a specimen."""
    if stated & WORDS["press"]:
        return ""
    if stated & WORDS["compressive"]:
        return "compression" if len(sizes) > 1 or stated & {"confined", "unconfined"} else ""
    found = [size for size in WORDS["sizes"] if any(word.endswith(size) for word in stated)]
    tests = [test for test in ("shear", "tensile_test", "bending_test") if stated & WORDS[test]]
    return [*tests, *["tensile_test"] * (len(found) > 1), ""][0]


def _curves(columns: Sequence[Column], stated: str, sizes: Mapping[str, float]) -> Proposal | None:
    channels, remarks, questions = dict[str, dict[str, Any]](), list[str](), list[str]()
    for channel, roles in _ROLES.items():
        along, of = (pick(columns, role) for role in roles)
        if channel != FORCE.name and along is not None and not np.ptp(along.column.values) > 0.0:
            continue
        if along is None or of is None:
            alike = [rivals(columns, role) for role in roles]
            if any(alike) and all(one or several for one, several in zip((along, of), alike, strict=True)):
                asked = ", and ".join(" or ".join(names) for names in alike if names)
                questions.append(f"{channel}: {asked}? name one")
            continue
        remarks += [*along.remarks, *of.remarks]
        for role, one in zip(roles, (along, of), strict=True):
            question, remark = _unit_of(one, role)
            questions += filter(None, [question])
            remarks += filter(None, [remark])
        questions += _bent(along.column, columns)
        if channel == FORCE.name:
            channels[channel], placed = _placed(along, of)
            remarks += placed
            questions += _stepped(along.column)
            begin, end = abs(of.column.values[[0, -1]]) / max(np.nanmax(abs(of.column.values)), 1e-300)
            if end < _AT_REST and begin > 1.0 - _AT_REST:
                questions.append(f"{of.column.name} falls from its largest value to 0: reverse the rows")
        else:
            turn = _column(along, float(np.degrees(1.0)) if along.factor else 1.0)
            radians = along.factor or (0.0 if along.column.shown_unit else np.radians(1.0))
            if np.nanmax(np.abs(np.diff(along.column.values))) * radians > np.pi:
                questions.append(f"{along.column.name} jumps by a full turn: unwrap it, so that it is steady")
            channels[channel] = {"abscissa": turn, "ordinate": _column(of)}
        if (spread := spread_of(columns, roles[1])) is not None:
            channels[channel]["std"] = _column(spread)
    if not channels:
        return Proposal(questions=tuple(questions)) if questions else None
    if stated == "bending_test":
        ask = "the file states a bending test: give a press, or stress and strain of a specimen"
        return Proposal(test="uniaxial", questions=(ask,))
    if FORCE.name in channels and (mode := _mode_of(columns, stated)):
        return _specimen(columns, sizes, mode, is_pushed=stated == "compression")
    return Proposal(entries=_entries(channels), remarks=tuple(remarks), questions=tuple(questions))


def _bent(along: Column, columns: Sequence[Column]) -> Iterator[str]:
    """Question for a length of an atomic force microscope, of which none alone is a depth."""
    named = [(column.name, words_of(column.name)) for column in columns]
    bent = [n for n, words in named if WORDS["cantilever"] & {*words} and not has_role(words, "travel")]
    if along.name in bent and len(bent) > 1:
        ask = "depth is the way less the deflection of the cantilever"
        yield f"{', '.join(bent)}: {ask}; add a column of it"


def _mode_of(columns: Sequence[Column], stated: str) -> str:
    """Mode of a test of a specimen, also by a size that grows with the travel; empty for a press."""
    names, way = {word for column in columns for word in words_of(column.name)}, pick(columns, "travel")
    if stated == "shear" or names & WORDS["shear"]:
        return "simple_shear"
    is_pulled = bool(names & WORDS["tensile"])
    if way is not None and not names & WORDS["depth"]:
        unit, far = way.column.shown_unit, np.nanmax(abs(way.column.values - way.column.values[0]))
        alike = [c for c in columns if unit and c.shown_unit == unit and "size" in words_of(c.name)]
        sizes = [np.nanmax(column.values - column.values[0]) for column in alike]
        is_pulled |= stated in ("tensile_test", "compression") or any(
            far / 2.0 < size < 2.0 * far for size in sizes
        )
    return "uniaxial" if is_pulled else ""


def _specimen(
    columns: Sequence[Column], sizes: Mapping[str, float], mode: str = "uniaxial", *, is_pushed: bool = False
) -> Proposal | None:
    """Test of a specimen by strain and stress, or by travel and force with the sizes of the specimen.

    Sizes that the file does not state are asked for.
    """
    channels, unknown, remarks = dict[str, Any](), list[str](), list[str]()
    roles = {"abscissa": ("strain", "travel", "length", "mm"), "ordinate": ("stress", "force", "area", "mm²")}
    for key, (role, instead, size, unit) in roles.items():
        offset = 1.0 if key == "abscissa" and mode == "uniaxial" else 0.0
        if role == "strain" and (found := pick(columns, "stretch")) is not None:
            load = pick(columns, "stress") or pick(columns, "force")
            channels[key] = _column(found, offset=0.0 if load and _is_stretch(found, load) else offset)
        elif (found := pick(columns, role)) is not None:
            channels[key] = _column(found, offset=offset)
        elif (found := pick(columns, instead)) is not None and found.factor is not None:
            if size in sizes and mode == "uniaxial":
                x = found.column.values[np.isfinite(found.column.values)]
                sense = (
                    np.sign(x[np.argmax(abs(x - x[0]))] - x[0]) * (-1.0 if is_pushed else 1.0) / sizes[size]
                )
                channels[key] = _column(found, sense, offset - offset * sense * found.factor * float(x[0]))
                of = f"the {size} of {sizes[size]:g} {unit} that the file states"
                remarks.append(f"check {found.column.name}: it is divided by {of}")
                continue
            channels[key] = {"name": found.column.name, "scale": f"1 / {size} in {unit}"}
            channels[key] |= {"offset": offset} if offset else {}
            unknown.append(size)
    if len(channels) < len(roles):
        return None
    scales = "both scales" if len(unknown) > 1 else "scale"
    ask = f"a test of a specimen: give {scales}, by the {' and the '.join(unknown)} of the specimen"
    rows, more = _loading(way.column) if remarks and (way := pick(columns, "travel")) else ({}, [])
    return Proposal(
        entries=_entries({mode: channels | rows}),
        test=mode,
        remarks=(*remarks, *more),
        questions=(ask,) if unknown else (),
    )


def _column(one: Picked, times: float = 1.0, offset: float = 0.0) -> str | dict[str, Any]:
    """Entry of a column: its name alone where nothing is scaled."""
    scale = float(f"{(one.factor or 1.0) * times:.12g}")
    entry: dict[str, Any] = {"name": one.column.name}
    entry |= {"scale": scale} if scale != 1.0 else {}
    entry |= {"offset": float(f"{offset:.6g}")} if offset else {}
    return one.column.name if len(entry) == 1 else entry


def _or_specimen(travel: Picked, force: Picked) -> str:
    """Remark on an assumed press, with the settings that read the file as a tension test of a specimen."""
    names = (json.dumps(one.column.name, ensure_ascii=False) for one in (travel, force))
    factors = (f"{one.factor or 1.0:g}" for one in (travel, force))
    (abscissa, ordinate), (way, load) = names, factors
    return (
        "a press is assumed, as the file states no test; of a specimen of length L mm and cross-section "
        f"A mm², write under [experiment.settings.channels.uniaxial] abscissa = {{ name = {abscissa}, "
        f"scale = {way}/L, offset = 1 }} and ordinate = {{ name = {ordinate}, scale = {load}/A }}, "
        "each quotient as a number"
    )


def _placed(depth: Picked, force: Picked) -> tuple[dict[str, Any], list[str]]:
    """Columns of the force over a depth that begins at 0 and grows, and of a force that pushes back."""
    is_there = np.isfinite(depth.column.values) & np.isfinite(force.column.values)
    x, y = depth.column.values[is_there], force.column.values[is_there]
    is_depth = bool(WORDS["depth"] & {*words_of(depth.column.name)})
    remarks = [] if is_depth else [f"check {depth.column.name}: {_or_specimen(depth, force)}"]
    if x.size < 2 or not np.ptp(x) or not np.ptp(y):
        return {"abscissa": _column(depth), "ordinate": _column(force)}, remarks
    farthest = int(np.argmax(np.abs(x - x[0])))
    sense = -1.0 if x[farthest] < x[0] else 1.0
    approach = _approach(sense * (x - x[0])[: farthest + 1], y[: farthest + 1])
    # What begins under load is a part of a curve, whose zero the file does not show.
    unloaded = approach > 0.0 or abs(float(y[0])) <= _AT_REST * float(np.abs(y).max())
    shift = -sense * float(x[0]) - approach if unloaded else 0.0
    shift = shift if abs(shift) > _AT_REST * np.ptp(x) else 0.0
    is_deep = np.abs(x - x[0]) > np.abs(x[farthest] - x[0]) / 2.0
    free = float(np.median(y[sense * (x - x[0]) < _FREE * approach])) if approach else 0.0
    free = free if abs(free) > _AT_REST * np.ptp(y) else 0.0
    push = -1.0 if np.median(y[is_deep]) < free else 1.0
    if sense < 0.0 or shift:
        way = f"begins at {x[0]:.6g} and {'falls' if sense < 0.0 else 'rises'}"
        way += f", with first contact at {x[0] + sense * approach:.4g}" if approach else ""
        zero = f", offset = {shift * (depth.factor or 1.0):.6g}" if shift else ""
        turned = "its sign is turned" if sense < 0.0 else "depth is 0 there"
        remarks.append(f"{depth.column.name} {way}: {turned}{zero}")
    if push < 0.0:
        remarks.append(f"{force.column.name} falls under load: its sign is turned")
    if free:
        remarks.append(f"{force.column.name} is {free:.4g} in free air, which is subtracted")
    settings: dict[str, Any] = {
        "abscissa": _column(depth, sense, shift * (depth.factor or 1.0)),
        "ordinate": _column(force, push, -push * free * (force.factor or 1.0)),
    }
    if approach:
        settings["rows"] = "loading"
        remarks.append("the rows before first contact are left out")
    rows, more = _loading(depth.column)
    return settings | rows, [*remarks, *more]


def _loading(along: Column) -> tuple[dict[str, Any], list[str]]:
    """Setting and remark where rows follow the farthest value: of a rest, or of a way back."""
    x = along.values[np.isfinite(along.values)]
    away = np.abs(x - x[0])
    behind = x[int(np.argmax(away >= _FARTHEST * away.max())) :]
    if behind.size <= max(2, _AT_REST * x.size):
        return {}, []
    kept = f"the rows up to {behind[0]:.4g} are kept"
    if np.ptp(behind) <= _AT_REST * np.ptp(x):
        return {"rows": "loading"}, [f"{along.name} rests there, as in relaxation: {kept}"]
    more = 'to use all, remove rows = "loading"; a [protocol] has to have the way back'
    return {"rows": "loading"}, [f"{along.name} has a way back: {kept}; {more}"]


def _stepped(along: Column) -> Iterator[str]:
    """Question for a motion that rests at several places on its way, as in stepwise relaxation."""
    away = np.abs(along.values[np.isfinite(along.values)] - along.values[0])
    most = np.nanmax(away, initial=0.0)
    way = away[: int(np.argmax(away >= _FARTHEST * most))]
    way = way[way > _AT_REST * most]  # without the wait before it
    n_apart = 2 + way.size // 25  # rows of a rest; in fewer the value may be recorded in coarse steps
    flat = way[n_apart:][np.abs(way[n_apart:] - way[:-n_apart]) < _FLAT * most]
    n_rests = 1 + np.count_nonzero(np.diff(np.sort(flat)) > _AT_REST * most)
    if n_rests > 2 and flat.size + n_rests * n_apart > way.size / 2:
        yield f"{along.name} rests {n_rests} times on its way, as in stepwise relaxation: keep a row of each"


def _approach(travel: FloatArray, force: FloatArray) -> float:
    """Travel in free air before first contact, at constant force; 0 where the curve begins at contact."""
    force, length = (force if force[-1] > force[0] else -force), float(travel.max())
    if force.size < _FEWEST_ROWS or not np.median(force[-_FEWEST_FREE:]) > np.median(force[:_FEWEST_FREE]):
        return 0.0
    found = place_of_contact(_TRAVEL_MM / length * travel, force)
    if not found.at > max(_LEAST_APPROACH * _TRAVEL_MM, 3.0 * found.std):
        return 0.0
    free = travel < _FREE * found.at / _TRAVEL_MM * length
    if free.sum() < _FEWEST_FREE or not np.ptp(travel[free]):
        return 0.0
    # A force that grows from the first row on is one of a contact, whatever its law.
    slope, error = np.polyfit(travel[free], force[free], 1, cov=True)
    rise = abs(float(slope[0])) * float(np.ptp(travel[free]))
    noise = _SURE * float(np.sqrt(error[0, 0])) * float(np.ptp(travel[free]))
    is_flat = rise < max(noise, _FLAT * float(np.ptp(force)))
    return found.at / _TRAVEL_MM * length if is_flat else 0.0


# ------------------------------------------------------------------ a homogeneous test


def _open(along: Picked, stress: Picked, columns: Sequence[Column], *, is_stretch: bool) -> Iterator[str]:
    """Questions for units that a test does not show, and for a test that is not one of loading."""
    yield from filter(None, (stress.question("stress"), along.question("strain")))
    yield from _stepped(along.column)
    spread = np.ptp(np.nanpercentile(stress.column.values, _MOST))
    if not spread > _AT_REST * np.nanmax(abs(stress.column.values)):
        yield f"{stress.column.name} hardly changes, as in creep or fatigue: give a test of loading"
    if stress.factor is None and not stress.column.shown_unit:
        yield f"{stress.column.name} shows no unit of stress: give scale, the factor to MPa"
    largest = float(np.nanmax(np.abs(along.column.values), initial=0.0))
    if along.factor is None and not along.column.shown_unit and largest > 10.0:
        yield f"{along.column.name} goes to {largest:.4g}: in percent? give scale, 0.01 or 1"
    size, load = abs(_true_values(along) - is_stretch), abs(stress.column.values)
    is_named = bool({*ROLES["stretch"].words} & {*words_of(along.column.name)})
    if is_named > is_stretch and np.nanmin(load) > _AT_REST * np.nanmax(load):
        yield f"{along.column.name}: stretch, or strain λ - 1? no row is at rest; give offset, 0 or 1"
    if 0.1 < size[0] / np.nanmax(size) < 0.9 and load[0] < _AT_REST * np.nanmax(load):
        ask = "is it zeroed there? subtract it by offset, or add the rows before"
        yield f"{along.column.name} is {along.column.values[0]:.4g} where the stress begins: {ask}"
    if WORDS["oscillation"] & {word for column in columns for word in words_of(column.name)}:
        yield f"{stress.column.name}: amplitudes of an oscillation are no curve; give a test of loading"


def _true_values(along: Picked) -> FloatArray:
    """Strains or stretches of a column, in percent where it has no unit and no tissue is stretched so far."""
    values = along.column.values
    return values * (along.factor or (0.01 if np.nanmax(abs(values), initial=0.0) > 10.0 else 1.0))


def _is_stretch(along: Picked, load: Picked) -> bool:
    """Whether a column is a stretch by its name, and not the strain λ - 1 by its value at rest."""
    if not {*ROLES["stretch"].words} & {*words_of(along.column.name)}:
        return False
    values, loads = _true_values(along), load.column.values
    at_rest = values[np.argmin(np.where(np.isfinite(values), abs(loads), np.inf))]
    is_pushed = bool(np.nanmax(loads) < 0.0 < np.nanmin(values))
    return bool(at_rest > 0.5 or np.nanmin(values) <= -1.0 or is_pushed)


def _homogeneous(columns: Sequence[Column], stated: Set[str]) -> Proposal | None:
    """Stress of a homogeneous test over its stretch, strain or shear; None without both."""
    stress, along = pick(columns, "stress"), pick(columns, "stretch") or pick(columns, "strain")
    if stress is None or along is None:
        of, ways = rivals(columns, "stress"), rivals(columns, "stretch") or rivals(columns, "strain")
        alike = [*of, *ways]
        if alike and (stress or along or (of and ways)):
            ask = f"{' or '.join(alike)}? name one pair of strain and stress"
            return Proposal(test="uniaxial", questions=(ask,))
        return None
    test = test_of(along.column, stress.column, columns, stated)
    is_stretch = _is_stretch(along, stress)
    signs, remarks = _signs(along.column.values, stress.column.values, test, is_stretch=is_stretch)
    is_nominal = not test.strain and not is_stretch and test.mode != "simple_shear"
    columns_of: dict[str, Any] = {
        "abscissa": _column(along, signs[0], 1.0 if is_nominal else 0.0),
        "ordinate": _column(stress, signs[1]),
    }
    columns_of |= {key: of for key, of in (("strain", test.strain), ("stress", test.stress)) if of}
    rows, rests = _loading(along.column)
    questions = [*test.questions, *_open(along, stress, columns, is_stretch=is_stretch)]
    if test.stress and is_nominal:
        remarks = [*remarks, f"check {along.column.name}: a nominal strain is assumed"]
    size, span = ((one.factor or 1.0) * float(np.ptp(one.column.values)) for one in (stress, along))
    if stress.factor and not 1e-5 < size / max(span, 1e-300) < 50.0:
        stiff = f"a stiffness of {size / span:.3g} MPa is of no soft tissue"
        remarks.append(f"check the units of {stress.column.name} and {along.column.name}: {stiff}")
    measures: Any = (test.strain or "stretch", test.stress or "nominal")
    if problem := problem_of(test.mode, *measures):
        questions.append(f"{along.column.name}, {stress.column.name}: {problem}")
    converted = [
        f"{one.column.name}: {TITLES[measure]} is converted to {to}"
        for one, measure, to in ((along, test.strain, "stretch"), (stress, test.stress, "nominal"))
        if measure
    ]
    return Proposal(
        entries=_entries({test.mode: columns_of | rows}),
        test=test.mode,
        remarks=(*along.remarks, *stress.remarks, *test.remarks, *remarks, *converted, *rests),
        questions=tuple(questions),
    )


def _signs(
    strain: FloatArray, stress: FloatArray, test: Test, *, is_stretch: bool
) -> tuple[tuple[float, float], list[str]]:
    """Signs of strain and stress: both are negative in a compression, and its strain is below 0."""
    if not test.is_compressive:
        return (1.0, 1.0), []
    signs = [
        -1.0 if np.nanmax(values, initial=0.0) > -np.nanmin(values, initial=0.0) else 1.0
        for values in (strain, stress)
    ]
    signs[0] = 1.0 if is_stretch else signs[0]
    turned = [name for name, sign in zip(("strain", "stress"), signs, strict=True) if sign < 0.0]
    remark = f"a compression: the sign of {' and '.join(turned)} is turned"
    return (signs[0], signs[1]), [remark] if turned else []
