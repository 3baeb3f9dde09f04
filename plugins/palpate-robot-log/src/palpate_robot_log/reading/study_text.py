"""Tables of study.toml that read a log as it is proposed, ready to be pasted."""

from collections.abc import Iterable, Mapping

from palpate.api.files import toml_value
from palpate_robot_log.reading.proposal import Proposal
from palpate_robot_log.reading.raw import RawLog
from palpate_robot_log.reading.vectors import QUANTITIES, Guess


def channel_map(proposal: Proposal) -> dict[str, object]:
    """Proposed map as plain values, without the quantities that were not found."""
    time = _time(proposal)
    chosen: dict[str, object] = {}
    if time is not None and not time.is_counter:
        chosen["time"] = _time_entry(time)
    chosen |= {
        quantity: _entry(proposal.guesses[quantity], time, proposal)
        for quantity in QUANTITIES
        if quantity in proposal.guesses
    }
    if {"force", "moment"} <= {*chosen}:
        chosen |= {"acts_on": proposal.acts_on, "wrench_frame": proposal.wrench_frame}
    chosen |= {"missing": "skip"} if proposal.skips_missing else {}
    chosen |= {"repeated_time": "keep_first"} if proposal.repeats_time else {}
    return chosen | ({"clocks": proposal.clocks} if proposal.files else {})


def _time_entry(time: Guess) -> object:
    return time.names[0] if len(time.entry) == 1 else dict(time.entry)


def _time(proposal: Proposal) -> Guess | None:
    """Time of the first stream that guesses come from and that has one."""
    streams = [*proposal.used_streams(), *proposal.time]
    return next((proposal.time[stream] for stream in streams if stream in proposal.time), None)


def _entry(guess: Guess, time: Guess | None, proposal: Proposal) -> dict[str, object]:
    entry, own = dict(guess.entry), proposal.time.get(guess.stream)
    if "columns" in entry and guess.stream and len(proposal.used_streams()) > 1:
        entry["stream"] = guess.stream
    if "columns" in entry and own and not own.is_counter and time and own.entry != time.entry:
        entry["time"] = _time_entry(own)
    return entry


def is_machine(proposal: Proposal) -> bool:
    """Whether a proposal is that of a testing machine, whose tool never turns."""
    orientation = proposal.guesses.get("orientation")
    return orientation is not None and orientation.entry.get("form") == "fixed"


def study_text(log: RawLog, proposal: Proposal) -> str:
    """Tables of study.toml that read this file, ready to be pasted."""
    lines = ["[experiment]", 'loader = "robot_log"', ""]
    if log.layout:
        lines += ["[experiment.settings.text]", *_pairs(log.layout), ""]
    if proposal.files:
        lines += ["[experiment.settings.files]  # {} is what the names of each press have alike"]
        lines += [*_pairs(proposal.files), ""]
    lines.append("[experiment.settings.channels]")
    chosen = channel_map(proposal)
    time = _time(proposal)
    lines += _commented("time", chosen, time)
    for quantity in QUANTITIES:
        guess = proposal.guesses.get(quantity)
        lines += _commented(quantity, chosen, guess)
        for other in guess.also if guess else ():
            lines.append(f"# or {quantity} = {toml_value(_entry(other, time, proposal))}")
    lines += [f"# {proposal.wrench_reason}"] if is_machine(proposal) else _sides(proposal)
    if proposal.skips_missing:
        lines.append('missing = "skip"  # rows of one topic have no values of another')
    if proposal.repeats_time:
        lines.append('repeated_time = "keep_first"  # the clock is coarser than the rows')
    if proposal.files:
        clocks = {"own": '"common": one clock stamped both files', "common": '"own": each file has its clock'}
        lines.append(f'clocks = "{proposal.clocks}"  # or {clocks[proposal.clocks]}')
    if proposal.ends_in_contact:
        lines += [
            "",
            "[experiment.settings.drift]",
            "enabled = false  # no free air after the press shows it",
        ]
    if is_machine(proposal):
        return "\n".join(lines) + "\n"
    lines += [
        "",
        "[experiment.settings.gravity]",
        'method = "off"  # or "fit" from poses in air, or "known" with the weight that the sensor carries:',
        '# weight = "1 N"',
        '# centre = ["0 mm", "0 mm", "-30 mm"]',
    ]
    return "\n".join(lines) + "\n"


def _sides(proposal: Proposal) -> Iterable[str]:
    """Side and frame of the wrench, with the other ones."""
    other_side = {"tool": "tissue", "tissue": "tool"}[proposal.acts_on]
    other_frame = {"sensor": "base", "base": "sensor"}[proposal.wrench_frame]
    yield f"# check {proposal.wrench_reason or 'whose wrench it is, and in which frame: nothing tells'}"
    yield f'acts_on = "{proposal.acts_on}"  # or "{other_side}": tool is the wrench of the tissue on the tool'
    yield f'wrench_frame = "{proposal.wrench_frame}"  # or "{other_frame}"'


def _commented(quantity: str, chosen: Mapping[str, object], guess: Guess | None) -> Iterable[str]:
    if quantity not in chosen or guess is None:
        empty = ", ".join(['"…"'] * (4 if quantity == "orientation" else 3))
        form = f"{{ columns = [{empty}] }}" if quantity != "time" else '"…"'
        if guess is not None and guess.is_counter:
            form = f'{{ column = {toml_value(guess.names[0])}, rate = "… Hz" }}'
            yield f"# {quantity} = {form}  # {guess.to_check[0]}"
            return
        yield f"# {quantity} = {form}  # no column looks like it: name them"
        return
    for check in guess.to_check:
        yield f"# check {check}"
    yield f"{quantity} = {toml_value(chosen[quantity])}"


def _pairs(table: Mapping[str, object]) -> Iterable[str]:
    return (f"{key} = {toml_value(value)}" for key, value in table.items())
