"""Measured curves: read by the study's loader, and checked against its protocol."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np

from palpate import _core
from palpate.domain import (
    Channel,
    Curve,
    FloatArray,
    Indentation,
    Response,
    channel_of,
    moving_span,
    weighed_channels,
    weighed_phases,
)
from palpate.domain.equilibrium_states import POSE, TIME
from palpate.errors import CurveError, PalpateError, PluginError, StudyError
from palpate.experiment.curve_checks import LARGEST_BIAS, check_curve, check_gaps, check_sizes
from palpate.experiment.repeats import average, described
from palpate.experiment.stress_checks import check_modes, check_stress
from palpate.plugins.guard import answering_for
from palpate.plugins.interfaces import ExperimentLoader
from palpate.plugins.optional import LoadingDrawer
from palpate.study.reading import Study, StudySpot, relative
from palpate.units import convert

COVERED_SHARE = 0.98
"""Share of the protocol's travel that a measured curve must reach."""

TURN_SLACK = 0.1
"""Share of the protocol's travel by which a turning point may differ from the protocol's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Presses:
    """Curves of the files of one spot, each checked against the protocol.

    Parameters
    ----------
    warnings : tuple of str
        What is odd about them.
    """

    spot: StudySpot
    responses: Mapping[str, Response]
    warnings: tuple[str, ...] = ()

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that any file has, in the order in which they come."""
        return tuple(dict.fromkeys(name for response in self.responses.values() for name in response))

    def curves(self, channel: str) -> dict[str, Curve]:
        """Curves of one channel by file."""
        return {file: r[channel] for file, r in self.responses.items() if channel in r.curves}


def load_measured(study: Study, channels: Mapping[str, Channel]) -> dict[str, Response]:
    """Measured response of each spot: the mean of its presses, where there are several.

    Parameters
    ----------
    channels : mapping of name to Channel
        What each channel is measured over.

    Raises
    ------
    CurveError
        A file cannot be read, a channel that a scenario weights is missing at every spot, a curve
        does not cover the protocol, or repeated presses differ in their path.
    """
    return {name: mean(presses) for name, presses in load_presses(study, channels).items()}


def load_presses(study: Study, channels: Mapping[str, Channel]) -> dict[str, Presses]:
    """Read every file of each spot; raises as :func:`load_measured`."""
    every = {spot.spot.name: _load_spot(study, spot, channels) for spot in study.spots}
    of_file = dict[str, tuple[str, Response]]()
    for name, each in every.items():
        _check_apart(each.responses)
        for file, found in each.responses.items() if study.protocol_at(name) is None else ():
            spot, first = of_file.setdefault(file, (name, found))
            if spot != name:
                _check_apart({f"{file} of spot '{spot}'": first, f"{file} of spot '{name}'": found})
    _check_parametrisation(study, every)
    _check_phases(study, every, channels)
    return _checked_weights(study, every)


def read_first(study: Study, spot_number: int = 0) -> Response:
    """Curves of a spot's first file as its loader reads them; nothing is checked against the protocol."""
    spot = study.spots[spot_number]
    loader, (only, paths) = study.loader_at(spot.spot.name), next(iter(spot.measured.items()))
    with answering_for(loader, f"reading {paths[0]}"):
        return next(iter(_presses_of(loader, paths[0], only).values()))


def mean(presses: Presses) -> Response:
    """Average the presses of a spot channel by channel, with the rests and the record of each file.

    Raises
    ------
    CurveError
        The presses differ in their path.
    """
    curves: dict[str, Curve] = {}
    averages: dict[str, object] = {}
    for channel in presses.channels:
        repeats = presses.curves(channel)
        try:
            curves[channel] = average(repeats)
        except CurveError as error:
            raise CurveError(f"spot '{presses.spot.spot.name}': {error}") from None
        if len(repeats) > 1:
            averages[channel] = described(curves[channel], repeats)
    files = {file: response.record for file, response in presses.responses.items() if response.record}
    record = {"files": files, "averages": averages, "warnings": list(presses.warnings)}
    return Response(
        curves=curves,
        relaxations=[item for response in presses.responses.values() for item in response.relaxations],
        record={key: what for key, what in record.items() if what},
    )


def measured_warnings(measured: Mapping[str, Response]) -> tuple[str, ...]:
    """Warnings about the measured curves, spot by spot."""
    return tuple(text for response in measured.values() for text in response.record.get("warnings", ()))


def _load_spot(study: Study, spot: StudySpot, channels: Mapping[str, Channel]) -> Presses:
    loader, responses = study.loader_at(spot.spot.name), dict[str, Response]()
    read_from: dict[str, str | None] = {}
    files, warnings = set[str](), list[str]()
    for only, paths in spot.measured.items():
        alike: dict[str, Response] = {}
        for path in paths:
            with answering_for(loader, f"reading {path}"):
                presses = _presses_of(loader, path, only)
            # Bare for a file in another folder, and one file may hold several channels.
            names = (relative(path, study.folder), str(path), f"{path}, {only}")
            files.add(file := next(name for name in names if name not in files))
            for press, response in presses.items():
                for name in response:
                    if read_from.setdefault(name, only) != only:
                        raise CurveError(
                            f"{path}: channel '{name}' of spot '{spot.spot.name}' is already read from "
                            "another file; name each channel once"
                        )
                found = _check_response(study, spot, path, response, channels)
                warnings += [f"{path.name}{press}: spot '{spot.spot.name}': {text}" for text in found]
                responses[f"{file}{press}"] = alike[f"{path}{press}"] = response
        _check_alike(spot, alike)
    if study.protocol_at(spot.spot.name) is None:
        first = {name: curve for response in responses.values() for name, curve in response.curves.items()}
        warnings += [f"spot '{spot.spot.name}': {text}" for text in check_modes(first, study.space)]
    return Presses(spot=spot, responses=responses, warnings=tuple(warnings))


def _presses_of(loader: ExperimentLoader, path: Path, only: str | None) -> dict[str, Response]:
    """Responses of a file by what is added to its name."""
    presses = dict(loader.load_presses(path, only))
    if not presses:
        raise TypeError("it returned no press")
    for response in presses.values():
        if not isinstance(response, Response):
            raise TypeError(f"it returned a {type(response).__name__} and not a Response")
    return {f", {name}" if name else "": response for name, response in presses.items()}


def draw_files(study: Study, spot: StudySpot, folder: Path) -> tuple[Path, ...]:
    """Let the loader draw its processing of each file of a spot, in one folder per file.

    Parameters
    ----------
    folder : Path
        Exists; gets a folder for each file, named after it.

    Raises
    ------
    CurveError
        A file cannot be loaded; the pictures up to there exist.
    """
    loader = study.loader_at(spot.spot.name)
    drawn: list[Path] = []
    if not isinstance(loader, LoadingDrawer):
        return ()
    for only, paths in spot.measured.items():
        for path in paths:
            own = _own_folder(folder, path.stem)
            with answering_for(loader, f"drawing {path}"):
                files = loader.draw(path, own, only)
                if strays := [str(file) for file in files if not file.is_relative_to(own)]:
                    raise ValueError(f"it wrote {', '.join(strays)} outside the folder {own}")
            drawn += files
    return tuple(drawn)


def _own_folder(folder: Path, name: str) -> Path:
    """Make a folder, with a number where files of two folders have one name."""
    taken = sum(1 for each in folder.iterdir() if each.name.rpartition("~")[0] == name or each.name == name)
    own = folder / (f"{name}~{taken + 1}" if taken else name)
    own.mkdir()
    return own


def _check_response(
    study: Study, spot: StudySpot, path: Path, response: Response, channels: Mapping[str, Channel]
) -> list[str]:
    """Refuse impossible curves; return warnings, the loader's first."""
    protocol = study.protocol_at(spot.spot.name)
    found = [str(text) for text in response.record.get("warnings", ())]
    try:
        for name, curve in response.curves.items():
            if name not in channels:
                raise CurveError(
                    f"channel '{name}' is not declared by any plugin "
                    f"(known: {', '.join(channels) or 'none'}); declare it in a palpate_channels hook"
                )
            if isinstance(protocol, Indentation):
                check_covers(curve, channels[name], protocol, study.scoring.minimum_coverage)
                if channels[name].abscissa in protocol.columns:
                    check_gaps(curve)
            else:
                found += check_stress(curve, channels[name], study.space)
            found += check_curve(curve, channels[name])
        if isinstance(protocol, Indentation):
            found += check_sizes(response, channels, protocol, study.space)
            found += _deeper(response, channels, protocol)
    except PluginError:
        raise  # a material that fails is no fault of the file
    except PalpateError as error:
        raise CurveError(f"{path}: spot '{spot.spot.name}': {error}") from error
    return found


def _check_apart(presses: Mapping[str, Response]) -> None:
    """Refuse a press with the numbers of an earlier one: it would count twice."""
    for (file, one), (again, other) in combinations(presses.items(), 2):
        if {*one} == {*other} and all(
            np.array_equal(curve.abscissa, other[name].abscissa)
            and np.array_equal(curve.ordinate, other[name].ordinate)
            for name, curve in one.curves.items()
        ):
            raise CurveError(f"{again}: it has the numbers of {file} and would count twice; list one of them")


def _check_alike(spot: StudySpot, presses: Mapping[str, Response]) -> None:
    """Refuse repeats of which one lacks a channel: its mean would be of fewer presses than reported."""
    (first, usual), *others = presses.items()
    for path, response in others:
        if missing := sorted(set(usual) ^ set(response)):
            raise CurveError(
                f"{path}: spot '{spot.spot.name}': has channels {', '.join(response)}, and the first of its "
                f"{len(presses)} presses {Path(first).name} has {', '.join(usual)}; "
                f"measure '{missing[0]}' in each press or in none"
            )


def _check_parametrisation(study: Study, every: Mapping[str, Presses]) -> None:
    """Refuse to search what no curve shows, such as the gain of a channel that is not measured."""
    channels = weighed_channels(study.scenarios, (name for each in every.values() for name in each.channels))
    with answering_for(study.parametrisation, "checking its settings"):
        refused = list(study.parametrisation.unusable(channels, indents=study.protocol is not None))
    for key, reason in refused:
        raise StudyError(f"{study.place('fit', 'searched', *key)}: {reason}")


def _check_phases(study: Study, every: Mapping[str, Presses], channels: Mapping[str, Channel]) -> None:
    """Refuse phases of a compression: its stretch is 1 at rest, and phases go by the distance from 0."""
    for name in weighed_phases(study.scenarios):
        channel = channel_of(name)
        curves = [curve for presses in every.values() for curve in presses.curves(channel).values()]
        if channels[channel].abscissa == "stretch" and any(curve.abscissa.min() < 1.0 for curve in curves):
            raise CurveError(
                f"{study.place('selection', 'scenarios')}: a scenario weighs '{name}', but the stretch of "
                f"'{channel}' is below 1, where it falls under load; weigh the whole channel"
            )


def _checked_weights(study: Study, every: Mapping[str, Presses]) -> dict[str, Presses]:
    """Refuse a channel that a scenario weights and no spot measures; warn where one spot does not."""
    checked = dict(every)
    for scenario in study.scenarios:
        weighted = list(dict.fromkeys(map(channel_of, scenario.weighed)))
        for channel in weighted:
            without = [spot for spot, presses in every.items() if channel not in presses.channels]
            if len(without) == len(every):
                found = dict.fromkeys(name for presses in every.values() for name in presses.channels)
                raise CurveError(
                    f"{study.place('selection', 'scenarios')}: no spot has a channel '{channel}', which "
                    f"scenario '{scenario.name}' weights (found: {', '.join(found) or 'none'}); measure it "
                    "or leave the scenario out"
                )
            for spot in without:
                left = " + ".join(c for c in weighted if c in every[spot].channels) or "nothing"
                warning = f"spot '{spot}' has no channel '{channel}': '{scenario.name}' weighs {left} there"
                checked[spot] = replace(checked[spot], warnings=(*checked[spot].warnings, warning))
    return checked


def check_covers(
    curve: Curve, channel: Channel, protocol: Indentation, minimum_coverage: float = 0.0
) -> None:
    """Refuse a measured curve that does not follow the protocol.

    It must cover ``COVERED_SHARE`` of the protocol's travel, turn where the protocol
    does and as often, and be within it for at least ``minimum_coverage`` of its points. A curve over
    time may end with any move. Only channels over what the protocol prescribes are checked.

    Raises
    ------
    CurveError
        With the covered and the required travel.
    """
    asked, unit = protocol.columns.get(channel.abscissa), channel.units[0]
    if asked is None:
        if channel.abscissa == TIME and protocol.time_s is None:
            raise CurveError(
                f"channel '{curve.channel}' is measured over time, and the protocol's motion has no times; "
                "name a motion that has them, or leave the channel out"
            )
        return
    if not np.ptp(asked) > 0.0:
        raise CurveError(
            f"channel '{curve.channel}' is measured over {channel.abscissa}, which the protocol does not "
            "move; add it to the protocol's path or leave the channel out"
        )
    if channel.abscissa == TIME:
        is_behind = asked < curve.abscissa.max() / (2.0 - COVERED_SHARE)
        asked = asked[: int(is_behind.sum()) + 1]
    for problem in _departures(curve, channel, asked, unit, minimum_coverage):
        raise CurveError(f"channel '{curve.channel}' {problem}")


def _placed(curve: Curve, asked: FloatArray, slack: float) -> str:
    """Remedy of an abscissa whose sign or zero is not the protocol's; empty where neither helps."""
    x, begin, end = curve.abscissa, float(asked[0]), float(asked[-1])
    unloaded = abs(float(curve.ordinate[0])) <= LARGEST_BIAS * float(np.abs(curve.ordinate).max())
    for sign, offset in ((-1.0, 0.0), (1.0, begin - float(x[0])), (-1.0, begin + float(x[0]))):
        placed = sign * x + offset
        is_covered = placed.min() <= asked.min() + slack and placed.max() >= asked.max() - slack
        # An abscissa of another zero begins at rest: what begins under load lacks its first part.
        if is_covered and abs(placed[0] - begin) <= slack and (offset == 0.0 or unloaded):
            what = f"begins at {x[0]:g} and {'falls' if end < begin or sign < 0.0 else 'rises'}"
            settings = [*["scale = -1"] * (sign < 0.0), *[f"offset = {offset:.6g}"] * (offset != 0.0)]
            also = offset == 0.0 and curve.ordinate.max() < -curve.ordinate.min()
            return (
                f"the abscissa {what if offset else 'has the other sign'}: with loader csv, set "
                f"{', '.join(settings)} in channels.{curve.channel}.abscissa of [experiment.settings]"
                f"{' and scale = -1 in its ordinate' if also else ''}"
            )
    return ""


def _as_measured(curve: Curve, abscissa: str, asked: FloatArray, slack: float) -> str:
    """Remedy of a protocol that was not written for these curves, by their depth; else empty."""
    least, most, depth_mm = float(curve.abscissa.min()), float(curve.abscissa.max()), float(asked.max())
    if abscissa != POSE[0] or abs(least) > slack or asked.min() < 0.0 or most <= 0.0:
        return ""
    step_mm = min(0.1, 10.0 ** (math.floor(math.log10(most)) - 1))
    shown_mm = step_mm * (math.ceil(most / step_mm - 0.01) if most > depth_mm else round(most / step_mm))
    return (
        f"the curve goes {most:.3g} mm deep and [protocol] says {depth_mm:g} mm: "
        f'write depth = "{shown_mm:.4g} mm" there'
    )


def _deeper(response: Response, channels: Mapping[str, Channel], protocol: Indentation) -> Iterator[str]:
    """Sentences on a press that goes deeper than the protocol, at whose depth its twist is simulated."""
    if not any(channels[name].abscissa == "rotation_deg" for name in response):
        return
    asked = protocol.path[:, 0]
    depth_mm = float(asked.max())
    for name, curve in response.curves.items():
        if channels[name].abscissa != POSE[0] or curve.abscissa.max() <= depth_mm / COVERED_SHARE:
            continue
        if remedy := _as_measured(curve, POSE[0], asked, (1.0 - COVERED_SHARE) * depth_mm):
            yield f"{remedy}, since the twist is simulated at that depth"


def _departures(
    curve: Curve, channel: Channel, asked: FloatArray, written_unit: str, minimum_coverage: float
) -> Iterator[str]:
    unit = "degrees" if written_unit == "deg" else written_unit
    low, high = float(asked.min()), float(asked.max())
    least, most = float(curve.abscissa.min()), float(curve.abscissa.max())
    covered = f"covers {least:g} to {most:g} {unit} where the protocol runs from {low:g} to {high:g} {unit}"
    slack = (1.0 - COVERED_SHARE) * (high - low)
    times = float(np.abs(asked).max() / np.abs(curve.abscissa).max())
    mistaken = {"mm": ("m", "cm", "inch", "µm"), "deg": ("rad",), "s": ("ms", "min")}
    for other in mistaken.get(written_unit, ()):
        factor = convert(f"1 {other}", written_unit)
        # Relative difference of the protocol's travel over the measured one from a ratio of units, at most.
        if abs(times / factor - 1.0) < 0.03:
            if high > {"mm": 200.0, "deg": 720.0}.get(written_unit, math.inf):  # no tool goes so far
                yield f"{covered}, {times:.3g} times as far; correct the unit in [protocol]"
            is_open = written_unit != "mm" or most > 0.05  # less is no depth of a limb
            yield (
                f"{covered}, {times:.3g} times as far, as if the file were in {other}: with loader csv, set "
                f"scale = {factor:g} in channels.{curve.channel}.abscissa of [experiment.settings]"
                f"{', or check the unit in [protocol]' * is_open}"
            )
    if least > low + slack or most < high - slack:
        remedy = _placed(curve, asked, slack) or _as_measured(curve, channel.abscissa, asked, slack)
        yield f"{covered}; {remedy or 'measure the whole path or shorten the protocol'}"
    outside = (curve.abscissa < low - slack) | (curve.abscissa > high + slack)
    if 1.0 - outside.mean() < minimum_coverage:
        remedy = _as_measured(curve, channel.abscissa, asked, slack)
        yield f"{covered}; {remedy or 'cut the curve or extend the protocol'}"
    yield from _turns(curve, asked, unit)


def _turns(curve: Curve, asked: FloatArray, unit: str) -> Iterator[str]:
    """Departures of the turning points of a curve from the turning points of its protocol."""
    span = float(asked.max() - asked.min())
    path = np.ascontiguousarray(asked[moving_span(asked)])
    planned = [float(path[stop - 1]) for _, stop in _core.branches(path)]
    travelled = [float(curve.abscissa[stop - 1]) for _, stop in curve.branches]
    turns, allowed = len(travelled) - 1, len(planned) - 1
    is_back = min(abs(end - curve.abscissa[0]) for end in travelled) <= TURN_SLACK * span
    way = np.sign(planned[0] - path[0]) * curve.abscissa
    is_back &= bool(np.max(np.maximum.accumulate(way) - way) > TURN_SLACK * span)
    if turns > allowed == 0 and (is_back or abs(travelled[0] - planned[0]) <= TURN_SLACK * span):
        yield (
            f"goes to {max(travelled, key=abs):g} {unit} and has a way back, which the protocol has not; "
            f'to keep the last rows up to there, set rows = "loading" in channels.{curve.channel} of '
            'the loader csv, or give [protocol] a way back (motion = "moves")'
        )
    if turns > allowed:
        turning_point = curve.branches[allowed + 1][0]
        yield (
            f"turns {turns} times where the protocol turns {allowed} times (first at row {turning_point}, "
            f"{curve.abscissa[turning_point]:g} {unit}); put its rows in order, or smooth its abscissa"
        )
    for k, (end, goal) in enumerate(zip(travelled[:-1], planned[:-1], strict=False)):
        if abs(end - goal) > TURN_SLACK * span:
            yield (
                f"goes to {end:g} {unit} {'then' if k else 'first'} where the protocol goes to {goal:g} "
                f"{unit}; give [protocol] the order and signs of the measured path, or turn the sign of "
                "the column"
            )
    if turns < allowed:
        yield (
            f"turns {turns} times where the protocol turns {allowed} times; measure the whole path "
            "or shorten the protocol"
        )
