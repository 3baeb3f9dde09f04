"""Reads what FEBio said: its log, and the last of what it printed."""

import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.resources import files

GOOD_BANNER = "N O R M A L   T E R M I N A T I O N"
BAD_BANNER = "E R R O R   T E R M I N A T I O N"

LONGEST_LINE = 1000
"""Characters of a line that are looked at: patterns that take quadratic time stay fast on them."""

_REASONS = tuple(
    (re.compile(each["pattern"], re.IGNORECASE | re.MULTILINE), each["name"], each["remedy"])
    for each in tomllib.loads(files(__package__).joinpath("reasons.toml").read_text("utf-8"))["reason"]
)
"""Patterns, names and remedies of the reasons why a run fails, a cause before its consequences."""


@dataclass(frozen=True, slots=True)
class Reason:
    """Reason why a run failed: its name, FEBio's own words, and what to try."""

    name: str
    words: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.name} ({self.words}); {self.remedy}"


@dataclass(frozen=True, slots=True, kw_only=True)
class LogSummary:
    """Summary of a log.

    ``finished`` is True after the good banner, False after the bad one, None
    without any (FEBio was cut off) or with both (two runs, or a forgery).
    """

    version: str | None
    finished: bool | None
    reason: Reason | None
    converged: tuple[float, ...]
    failed_at: float | None
    warnings: tuple[str, ...]


def read_log(text: str) -> LogSummary:
    """Summary of a log or of what FEBio printed; any text is taken, garbled or cut off."""
    text = _cut(text)
    good, bad = GOOD_BANNER in text, BAD_BANNER in text
    version = re.search(r"(?m)^[ \t]*version[ \t]+(\d+\.\d+\S*)", text)
    converged = re.findall(r"(?m)^-+ converged at time : (\S+)", text)
    failed = re.findall(r"(?m)^-+ failed to converge at time : (\S+)", text)
    return LogSummary(
        version=version.group(1) if version else None,
        finished=None if good == bad else good,
        reason=None if good and not bad else last_reason(text),
        converged=tuple(t for t in map(_time, converged) if t is not None),
        failed_at=_time(failed[-1]) if failed else None,
        warnings=tuple(dict.fromkeys(body for kind, body in _boxes(text) if kind == "WARNING")),
    )


def last_reason(text: str) -> Reason | None:
    """The cause of failure that comes last, where a consequence counts less than its cause."""
    text = _cut(text)
    found = []
    for rank, (pattern, name, remedy) in enumerate(_REASONS):
        if matches := list(pattern.finditer(text)):
            words = " ".join(matches[-1].group(0).strip(" *\n").split())[:200]
            reason = Reason(name, words, remedy)
            # Reasons that FEBio gives after the one that led to them.
            found.append((name in ("too many retries", "model refused"), -matches[-1].start(), rank, reason))
    if found:
        return min(found, key=lambda row: row[:3])[3]
    errors = [body for kind, body in _boxes(text) if kind == "ERROR"]
    if errors:
        return Reason("error", errors[-1][:200], "read FEBio's own words for the cause")
    return None


def _cut(text: str) -> str:
    return "\n".join(line[:LONGEST_LINE] for line in text.split("\n"))


def _boxes(text: str) -> Iterator[tuple[str, str]]:
    """Kind and words of each frame of asterisks that is closed: ``* ERROR *``, lines, a row of asterisks."""
    kind, body = "", list[str]()
    for line in map(str.strip, text.split("\n")):
        words = line.split()
        if body and line.startswith("*" * 10):
            yield kind, " ".join(word for word in body if word)
            kind, body = "", []
        elif kind and len(line) > 1 and line.startswith("*") and line.endswith("*"):
            body.append(line.strip("*").strip())
        elif len(words) == 3 and words[0] == words[2] == "*" and words[1] in ("ERROR", "WARNING"):
            kind, body = words[1], []
        else:
            kind, body = "", []


def _time(word: str) -> float | None:
    try:
        return float(word)
    except ValueError:
        return None
