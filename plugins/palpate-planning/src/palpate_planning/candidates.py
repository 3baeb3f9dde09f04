"""Presses that may be made next, every combination of what the user allows; and a study with one more."""

import itertools
import os
import re
import tempfile
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomlkit
from pydantic import BaseModel, ConfigDict, Field, PrivateAttr
from tomlkit.items import AoT

from palpate.api import AnisotropicMaterial, Channel, Indentation, Protocol, StudyError, convert
from palpate.api.experiment import POSE, TIME
from palpate.api.files import write_atomically
from palpate.api.runs import Plugins, RunDirectory, Study, read_study


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CandidatePress:
    """A press that could be made: a spot of the study once more, under a name that no spot has.

    Parameters
    ----------
    keys : mapping
        Keys of ``[spot.protocol]`` that state it in a study: what is done otherwise than in ``[protocol]``.
    protocol : Protocol, optional
        As the study reads these keys.
    measured : str
        File of its measured curves, relative to the study file; default: its name.
    """

    name: str
    spot: str
    keys: Mapping[str, Any] = field(default_factory=dict)
    protocol: Protocol | None = None
    measured: str = ""


def extended_study(run: Path, study: Path, press: str | None, measured: Path) -> tuple[str, Path]:
    """Write the study with a proposed press next to the study file.

    Parameters
    ----------
    run : Path
        A run directory with a proposal.
    study : Path
        Its study file.
    press : str, optional
        Name of a candidate of the proposal; the best one when left out.
    measured : Path
        File of the measured curves.

    Returns
    -------
    tuple of str and Path
        Name of the press, and the file of the study, ``<study>-<press>.toml``.

    Raises
    ------
    StudyError
        There is no such candidate, no file of measured curves, or a file where the study would go.
    """
    known = RunDirectory(run).proposal()
    spots = {row["press"]: row["spot"] for row in known["ranking"]}
    name = press or known["presses"][0]["press"]
    if name not in spots:
        raise StudyError(f"{run}: no candidate '{name}' was proposed (known: {', '.join(spots)})")
    if not measured.is_file():
        raise StudyError(f"{measured}: no such file; give the measured curves of the press")
    file = study.with_name(f"{study.stem}-{name}.toml")
    if file.exists():
        raise StudyError(f"{file}: exists and is not overwritten; move it, or run it as it is")
    path = Path(os.path.relpath(measured.resolve(), file.parent.resolve())).as_posix()
    added = CandidatePress(name=name, spot=spots[name], keys=known["protocols"][name], measured=path)
    text = with_presses(study.read_text(encoding="utf-8-sig"), [added])
    write_atomically(file, text.encode())
    return name, file


def with_presses(text: str, presses: Iterable[CandidatePress]) -> str:
    """Add presses to the text (TOML) of a study.

    Raises
    ------
    StudyError
        There is no such spot, or one of that name.
    """
    document = tomlkit.parse(text)
    tables = document.get("spot", [])
    known = {str(table.get("name")): table.unwrap() for table in tables}
    names = set(known)
    for press in presses:
        if press.spot not in known:
            raise StudyError(f"no spot '{press.spot}' (known: {', '.join(known)}); correct the name")
        if press.name in names:
            raise StudyError(f"a spot '{press.name}' already exists; give the press another name")
        names.add(press.name)
        like = known[press.spot]
        own = {**like.get("protocol", {}), **press.keys}
        measured = press.measured or f"{press.name}.csv"
        added = {**like, "name": press.name, "measured": measured, **({"protocol": own} if own else {})}
        tables.append(_table(added) if isinstance(tables, AoT) else tomlkit.item(added, _parent=tables))
    return tomlkit.dumps(document)


def _table(values: Mapping[str, Any]) -> tomlkit.items.Table:
    table = tomlkit.table()
    for key, value in values.items():
        table.add(key, _inline(value) if isinstance(value, dict) else value)
    return table


def _inline(values: Mapping[str, Any]) -> tomlkit.items.InlineTable:
    table = tomlkit.inline_table()
    for key, value in values.items():
        table.append(key, _inline(value) if isinstance(value, dict) else value)
    return table


MOST_PRESSES = 500
"""Most candidates: each is simulated at several points."""


USUAL_PLACES = 2
"""Least number of places of the chosen presses: what the model leaves out at one would decide the fit."""

PRESSURE = "pressure"
"""Largest contact pressure, which is limited like a channel."""


class Limit(NamedTuple):
    """Most of something."""

    most: float
    unit: str


class Allowed(BaseModel):
    """Content of a file of candidates."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    spots: list[str] | None = Field(default=None, description="Names of spots; all if left out.")
    protocol: dict[str, list[Any]] = Field(
        default={},
        description='Alternatives for each key of [spot.protocol], such as depth = ["5 mm", "10 mm"]; every '
        "combination is a candidate.",
    )
    limits: dict[str, str] = Field(
        default={}, description='Most of each channel, and pressure, with its unit, such as force = "30 N".'
    )
    places: int = Field(
        default=USUAL_PLACES,
        ge=1,
        description="Least number of places of the chosen presses, where the spots are at so many.",
    )

    _file: Path | None = PrivateAttr(None)

    def model_post_init(self, context: Mapping[str, Any] | None, /) -> None:
        """Keep the file that :func:`palpate.api.runs.read_options` reads."""
        self._file = context["file"] if context else None

    @property
    def place(self) -> str:
        """Beginning of a message about it."""
        return f"{self._file}: " if self._file else ""


def usual(study: Study) -> list[tuple[str, dict[str, Any]]]:
    """Spots and keys of their protocols where nothing is said: shares of what each spot has.

    That is half of the depth, three quarters and all of it, without a twist, with half of it and with all. Of
    moves, where the tissue relaxes, these, with rests that are longer, and slower and faster; where it has
    fibres, these with their slides turned.
    """
    raw = tomllib.loads(study.file.read_text(encoding="utf-8-sig"))
    has_fibres = any(isinstance(region.material, AnisotropicMaterial) for region in study.space.regions)
    found = []
    for table in raw["spot"]:
        own = {**raw.get("protocol", {}), **table.get("protocol", {})}
        keys: dict[str, list[Any]] = {}
        if "depth" in own:
            depth = convert(own["depth"], "mm")
            # Depths that are tried, over the study's depth, where the user names none.
            keys["depth"] = [f"{share * depth:g} mm" for share in (0.5, 0.75, 1.0)]
        if twist := [convert(angle, "deg") for angle in own.get("twist", [])]:
            keys["twist"] = [[], *([f"{share * angle:g} deg" for angle in twist] for share in (0.5, 1.0))]
        if "moves" in own and (study.relaxes or has_fibres):
            moves = timed(own["moves"]) if study.relaxes else [own["moves"]]
            keys["moves"] = [each for one in moves for each in (turned(one) if has_fibres else [one])]
        found += [(table["name"], each) for each in _combinations(keys)]
    return found


def timed(moves: Sequence[Mapping[str, Any]]) -> Iterator[list[dict[str, Any]]]:
    """Moves of a study as they are, with longer rests, and of other rates."""
    # Durations of rests and of what moves, over the study's, that are tried where the tissue relaxes.
    found = [
        [_lasting(move, *factors) for move in moves]
        for factors in ((1.0, 1.0), (10.0, 1.0), (1.0, 5.0), (1.0, 0.2))
    ]
    yield from (each for i, each in enumerate(found) if each not in found[:i])


def turned(moves: Sequence[Mapping[str, Any]]) -> Iterator[list[dict[str, Any]]]:
    """Moves of a study as they are, and with their slides in other directions."""
    # Where a tissue has fibres, slides are tried at these angles from the study's.
    found = [[_turned(move, np.deg2rad(angle)) for move in moves] for angle in (0.0, 45.0, 90.0)]
    yield from (each for i, each in enumerate(found) if each not in found[:i])


def _turned(move: Mapping[str, Any], angle_rad: float) -> dict[str, Any]:
    """A move whose slide is turned about the normal, and the slides of the moves that it repeats."""
    found = dict(move)
    if "moves" in move:
        found["moves"] = [_turned(each, angle_rad) for each in move["moves"]]
    for key, unit in (("slide", "mm"), ("slide_force", "N")):
        if key in move and angle_rad:
            x, y = (convert(part, unit) for part in move[key])
            cos, sin = np.cos(angle_rad), np.sin(angle_rad)
            parts = (cos * x - sin * y, sin * x + cos * y)
            found[key] = [f"{round(part, 6) + 0.0:g} {unit}" for part in parts]
    return found


def _lasting(move: Mapping[str, Any], of_rests: float, of_others: float) -> dict[str, Any]:
    """A move whose duration is multiplied, and the durations of the moves that it repeats."""
    found = dict(move)
    if "moves" in move:
        found["moves"] = [_lasting(each, of_rests, of_others) for each in move["moves"]]
    if "duration" in move:
        factor = of_rests if move.keys() == {"duration"} else of_others
        found["duration"] = f"{factor * convert(move['duration'], 's'):g} s"
    return found


def limits_of(allowed: Allowed | None, study: Study, channels: Mapping[str, Channel]) -> dict[str, Limit]:
    """Most of each channel, and of the pressure.

    Raises
    ------
    StudyError
        An unknown channel, a quantity that is none of its kind, or a solver that does not compute it.
    """
    found: dict[str, Limit] = {}
    if allowed is None:
        return found
    units = {name: channel.units[1].replace("Nmm", "N*mm") for name, channel in channels.items()}
    units[PRESSURE] = "MPa"
    for name, given in allowed.limits.items():
        if name not in units:
            raise StudyError(f"{allowed.place}limits.{name}: no such channel (known: {', '.join(units)})")
        if name == PRESSURE and not study.solver.provides.surface:
            raise StudyError(
                f"{allowed.place}limits.{name}: solver '{study.solver.name}' does not give the states of the "
                "skin; use 'jax', or limit the force"
            )
        if name != PRESSURE and not study.solver.provides.computes(channels[name]):
            raise StudyError(
                f"{allowed.place}limits.{name}: solver '{study.solver.name}' does not compute this channel; "
                "leave it out, or limit another one"
            )
        try:
            found[name] = Limit(convert(given, units[name]), units[name])
        except ValueError as error:
            raise StudyError(f"{allowed.place}limits.{name}: {error}") from None
    return found


def limited_curves(study: Study, limits: Mapping[str, Limit]) -> dict[str, tuple[Channel, ...]]:
    """Channels that a job observes for each limit: the ordinate along every part of a motion.

    The curve of a channel has the states where its own abscissa moves: the curve of the force ends where
    a twist begins. An ordinate of several columns may have no value elsewhere, and is limited there alone.
    """
    found = {}
    for name in (each for each in limits if each != PRESSURE):
        channel = study.channels[name]
        along = (channel.abscissa,) if channel.observe else (*POSE, TIME)
        every = [replace(channel, name=f"{name} by {each}", abscissa=each) for each in along]
        found[name] = tuple(each for each in every if study.solver.provides.computes(each))
    return found


def candidates(study: Study, plugins: Plugins, allowed: Allowed | None) -> list[CandidatePress]:
    """Every press that is allowed, as the study would have it; by itself shares of its own.

    Raises
    ------
    StudyError
        A spot that the study does not have, a key or quantity that it does not take, too many presses,
        or a study of homogeneous tests.
    """
    if study.protocol is None:
        raise StudyError(f"{study.file}: has no [protocol]; a further press needs one")
    ways = usual(study) if allowed is None else list(_allowed_ways(study, allowed))
    place = "" if allowed is None else allowed.place
    if not 0 < len(ways) <= MOST_PRESSES:
        raise StudyError(
            f"{place}{len(ways)} candidates; allow 1 to {MOST_PRESSES} combinations of spots and keys"
        )
    names = _free_names(study, [spot for spot, _ in ways])
    added = [
        CandidatePress(name=name, spot=spot, keys=keys)
        for name, (spot, keys) in zip(names, ways, strict=True)
    ]
    text = with_presses(study.file.read_text(encoding="utf-8-sig"), added)
    try:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "study.toml"
            file.write_text(text, encoding="utf-8")
            extended = read_study(file, plugins, need_measured=False, copy_of=study.file)
    except StudyError as error:
        wrong = dict.fromkeys(re.findall(r"protocol(?:\.| ).*", str(error)))
        raise StudyError("\n".join(f"{place}{each}" for each in wrong or [str(error)])) from None
    return [replace(each, protocol=extended.protocol_at(each.name)) for each in added]


def is_repeat(study: Study, press: CandidatePress) -> bool:
    """True if a press is the one that the study already has at its spot."""
    made, planned = study.protocol_at(press.spot), press.protocol
    if not (isinstance(made, Indentation) and isinstance(planned, Indentation)) or "indenter" in press.keys:
        return False
    pairs = [
        (each.waypoints.pose, each.loads, each.time_s, each.friction, each.tilt_deg)
        for each in (made, planned)
    ]
    return all(_equal(one, other) for one, other in zip(*pairs, strict=True))


def _equal(one: Any, other: Any) -> bool:  # noqa: ANN401 - numbers, arrays or nothing
    if one is None or other is None:
        return one is other
    return np.array_equal(one, other, equal_nan=True)


def _allowed_ways(study: Study, allowed: Allowed) -> Iterator[tuple[str, dict[str, Any]]]:
    for spot in allowed.spots or study.spot_names:
        if spot not in study.spot_names:
            raise StudyError(f"{allowed.place}spots: no spot '{spot}' (known: {', '.join(study.spot_names)})")
        for keys in _combinations(allowed.protocol):
            yield spot, keys


def described(press: CandidatePress) -> str:
    """Description of a press, in words of the study file."""
    return ", ".join(f"{key} {_written(value)}" for key, value in press.keys.items()) or "as in the study"


def _written(value: object) -> str:
    if isinstance(value, list):
        return "/".join(map(_written, value)) or "none"
    if isinstance(value, dict):
        return " ".join(_written(each) for each in value.values())
    return str(value)


def _combinations(protocol: Mapping[str, Sequence[Any]]) -> Iterator[dict[str, Any]]:
    for values in itertools.product(*protocol.values()):
        yield dict(zip(protocol, values, strict=True))


def _free_names(study: Study, spots: Sequence[str]) -> list[str]:
    """Name of each press: its spot and a number, none of them the name of a spot."""
    taken, names = set(study.spot_names), []
    for spot in spots:
        number = itertools.count(1)
        name = next(name for i in number if (name := f"{spot}-{i}") not in taken)
        taken.add(name)
        names.append(name)
    return names
