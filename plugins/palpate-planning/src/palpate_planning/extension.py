"""A study with one more press: what was written by hand stays as it is."""

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.items import AoT

from palpate.api import Protocol, StudyError
from palpate.api.files import write_atomically
from palpate.api.runs import RunDirectory


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
