"""Reads what FEBio said: its log, and the last of what it printed."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

GOOD_BANNER = "N O R M A L   T E R M I N A T I O N"
BAD_BANNER = "E R R O R   T E R M I N A T I O N"

LONGEST_LINE = 1000
"""Characters of a line that are looked at: patterns that take quadratic time stay fast on them."""

_REASONS: tuple[tuple[re.Pattern[str], str, str], ...] = tuple(
    (re.compile(pattern, re.IGNORECASE | re.MULTILINE), name, remedy)
    for pattern, name, remedy in (
        (
            r"negative jacobian[^\n]*",
            "negative Jacobian",
            "an element turned inside out: smaller steps, a finer mesh at the spot, or a stabler material",
        ),
        (
            r"NAN detected in (?:residual|solution)[^\n]*",
            "not a number",
            "the material or the contact broke down: smaller steps",
        ),
        (
            r"max(?:\.|imum)? ?(?:nr|number) of reformations reached[^\n]*",
            "too many reformations",
            "the step did not balance: another of the fallbacks, or smaller steps",
        ),
        (
            r"^[^\n]*(?:invalid|missing|unknown|unrecognized|duplicate)[^\n]*"
            r"(?:tag|attribute|value|version|section)[^\n]*",
            "deck refused",
            "FEBio does not know something in the deck: compare its version with the deck's",
        ),
        (
            r"(?:fatal error|xml error|syntax error|unmatched|failed (?:opening|reading))[^\n]*",
            "deck not read",
            "this FEBio cannot read the deck: compare its version with the deck's",
        ),
        (
            r"(?:license|licence)[^\n]*",
            "licence",
            "FEBio or one of its plugins has no licence: start it by hand to see which",
        ),
        (
            r"(?:failed (?:to )?load(?:ing)?|error loading)[^\n]*plugin[^\n]*|plugin[^\n]*(?:failed|not "
            r"found)[^\n]*",
            "plugin",
            "FEBio could not load a plugin: palpate starts it with -noconfig, so look at the deck",
        ),
        (
            r"linear solver[^\n]*(?:failed|error|not)[^\n]*|(?:unknown|invalid) (?:linear )?solver "
            r"type[^\n]*",
            "linear solver",
            "name a linear solver that this FEBio was built with, in the setting linear_solver",
        ),
        (
            r"memory allocation failure[^\n]*|failed allocating[^\n]*|bad_alloc",
            "out of memory",
            "fewer jobs at once, or a coarser mesh",
        ),
        (
            r"model initialization failed[^\n]*|no step defined[^\n]*|zero diagonal[^\n]*",
            "model refused",
            "FEBio read the deck and could not start: look at the deck and log that keep_folder keeps",
        ),
        (
            r"max\.? nr of retries reached[^\n]*",
            "too many retries",
            "the step did not balance however short: another of the fallbacks, or a finer mesh",
        ),
    )
)


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
