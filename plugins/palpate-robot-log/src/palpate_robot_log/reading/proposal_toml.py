"""A proposal as text for study.toml, with comments on what has to be checked."""

import json
from collections.abc import Iterable, Mapping

from palpate_robot_log.reading.proposal import QUANTITIES, Guess, Proposal
from palpate_robot_log.reading.raw import RawLog

_N_SHOWN = {"position": 3, "orientation": 4, "force": 3, "moment": 3}


def channel_map(proposal: Proposal) -> dict[str, object]:
    """Proposed map as plain values, without the quantities that were not found."""
    time = _time(proposal)
    chosen: dict[str, object] = {}
    if time is not None:
        chosen["time"] = {"column": time.columns[0], "unit": time.unit} if time.unit else time.columns[0]
    for quantity in QUANTITIES:
        if (guess := proposal.guesses.get(quantity)) is not None:
            chosen[quantity] = _entry(guess, time, proposal)
    return chosen


def _time(proposal: Proposal) -> Guess | None:
    """Time of the first stream that guesses come from and that has one."""
    streams = [*proposal.used_streams(), *proposal.time]
    return next((proposal.time[stream] for stream in streams if stream in proposal.time), None)


def _entry(guess: Guess, time: Guess | None, proposal: Proposal) -> dict[str, object]:
    entry: dict[str, object] = {}
    if guess.form and guess.form != "quaternion":
        entry["form"] = guess.form
    entry["columns"] = list(guess.columns)
    if guess.form == "euler":
        entry["sequence"] = "xyz"
    if guess.unit:
        entry["unit"] = guess.unit
    if guess.stream and len(proposal.used_streams()) > 1:
        entry["stream"] = guess.stream
    own = proposal.time.get(guess.stream)
    if own is not None and time is not None and own.columns != time.columns:
        entry["time"] = own.columns[0]
    return entry


def study_text(log: RawLog, proposal: Proposal) -> str:
    """Tables of study.toml that read this file, ready to be pasted."""
    lines = ["[experiment]", 'loader = "robot_log"', ""]
    if log.layout:
        lines += ["[experiment.settings.text]", *_pairs(log.layout), ""]
    lines.append("[experiment.settings.channels]")
    chosen = channel_map(proposal)
    time = _time(proposal)
    lines += _commented("time", chosen, time)
    for quantity in QUANTITIES:
        lines += _commented(quantity, chosen, proposal.guesses.get(quantity))
    lines += [
        'acts_on = "tool"  # or "tissue": the wrench is that of the tissue on the tool, or its reaction',
        'wrench_frame = "sensor"  # or "base"',
    ]
    return "\n".join(lines) + "\n"


def _commented(quantity: str, chosen: Mapping[str, object], guess: Guess | None) -> Iterable[str]:
    if quantity not in chosen or guess is None:
        empty = ", ".join(['"…"'] * _N_SHOWN.get(quantity, 1))
        form = f"{{ columns = [{empty}] }}" if quantity != "time" else '"…"'
        yield f"# {quantity} = {form}  # no column looks like it: name them"
        return
    for check in guess.to_check:
        yield f"# check {check}"
    yield f"{quantity} = {_value(chosen[quantity])}"


def _pairs(table: Mapping[str, object]) -> Iterable[str]:
    return (f"{key} = {_value(value)}" for key, value in table.items())


def _value(value: object) -> str:
    match value:
        case Mapping():
            return f"{{ {', '.join(_pairs(value))} }}"
        case list():
            return f"[{', '.join(map(_value, value))}]"
        case _:
            return json.dumps(value, ensure_ascii=False)
