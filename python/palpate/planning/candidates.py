"""Presses that may be made next: every combination of what the user allows."""

import itertools
import tempfile
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from palpate.domain import Channel
from palpate.errors import StudyError
from palpate.planning.presses import Press
from palpate.planning.study_text import with_press
from palpate.plugins.catalogue import Plugins
from palpate.study.reading import Study, read_study
from palpate.units import convert

SHARES = (0.5, 0.75, 1.0)
"""Depths that are tried, over that of the study, where the user names none."""

MOST_PRESSES = 500
"""Most candidates: each is simulated at several points."""


class Allowed(BaseModel):
    """What a file of candidates holds."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    spots: list[str] | None = Field(default=None, description="Names of spots; all if left out.")
    protocol: dict[str, list[Any]] = Field(
        default={},
        description='Alternatives for each key of [spot.protocol], such as depth = ["5 mm", "10 mm"]; every '
        "combination is a candidate.",
    )
    limits: dict[str, str] = Field(
        default={}, description='Most of each channel with its unit, such as force = "30 N".'
    )


def read_allowed(path: Path) -> Allowed:
    """Read a file of candidates.

    Raises
    ------
    StudyError
        Naming the file and the key.
    """
    try:
        return Allowed.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise StudyError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise StudyError(f"{path}: invalid TOML: {error}; fix the syntax") from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(map(str, first["loc"]))
        keys = ", ".join(Allowed.model_fields)
        raise StudyError(f"{path}: {key}: {first['msg']}; a file of candidates has {keys}") from None


def usual(study: Study) -> Allowed:
    """Without a file: the study's depth and shares of it, without a twist, with half of it and all of it."""
    table = _raw(study).get("protocol", {})
    protocol: dict[str, list[Any]] = {}
    if "depth" in table:
        depth = convert(table["depth"], "mm")
        protocol["depth"] = [f"{share * depth:g} mm" for share in SHARES]
    if twist := [convert(angle, "deg") for angle in table.get("twist", [])]:
        protocol["twist"] = [[f"{share * angle:g} deg" for angle in twist] for share in (0.0, 0.5, 1.0)]
        protocol["twist"][0] = []
    return Allowed(protocol=protocol)


def limits_of(allowed: Allowed, channels: Mapping[str, Channel]) -> dict[str, float]:
    """Most of each channel, in its unit.

    Raises
    ------
    StudyError
        An unknown channel, or a quantity that is none of its kind.
    """
    found = {}
    for name, given in allowed.limits.items():
        if name not in channels:
            raise StudyError(f"limits.{name}: no such channel (known: {', '.join(channels)})")
        try:
            found[name] = convert(given, channels[name].units[1].replace("Nmm", "N*mm"))
        except ValueError as error:
            raise StudyError(f"limits.{name}: {error}") from None
    return found


def candidates(study: Study, plugins: Plugins, allowed: Allowed) -> list[Press]:
    """Every press that is allowed, as the study would have it.

    Raises
    ------
    StudyError
        A spot that the study does not have, a key or quantity that it does not take, too many presses,
        or a study of homogeneous tests.
    """
    if study.protocol is None:
        raise StudyError(f"{study.file}: has no [protocol]; a further press needs one")
    spots = allowed.spots or list(study.spot_names)
    if unknown := [spot for spot in spots if spot not in study.spot_names]:
        raise StudyError(f"spots: no spot '{unknown[0]}' (known: {', '.join(study.spot_names)})")
    ways = list(_combinations(allowed.protocol))
    if not 0 < len(spots) * len(ways) <= MOST_PRESSES:
        raise StudyError(
            f"{len(spots) * len(ways)} candidates; allow 1 to {MOST_PRESSES} combinations of spots and keys"
        )
    named = [(spot, _free_name(study, spot, i), keys) for spot in spots for i, keys in enumerate(ways, 1)]
    text = study.file.read_text(encoding="utf-8-sig")
    for spot, name, keys in named:
        text = with_press(text, spot, name, keys, f"{name}.csv")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "study.toml"
        file.write_text(text, encoding="utf-8")
        extended = read_study(file, plugins, need_measured=False, copy_of=study.file)
    presses = []
    for spot, name, keys in named:
        protocol = extended.protocol_at(name)
        assert protocol is not None
        presses.append(Press(name=name, spot=spot, protocol=protocol, keys=keys))
    return presses


def described(press: Press) -> str:
    """What is done at a press, in words of the study file."""
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


def _free_name(study: Study, spot: str, number: int) -> str:
    name = f"{spot}-{number}"
    while name in study.spot_names:
        name += "b"
    return name


def _raw(study: Study) -> dict[str, Any]:
    return tomllib.loads(study.file.read_text(encoding="utf-8-sig"))
