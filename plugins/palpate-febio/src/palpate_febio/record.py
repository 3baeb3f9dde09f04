"""Reads the record of the rigid body: position, rotation, force and moment at every time that balanced."""

from dataclasses import dataclass

import numpy as np

from palpate.api import FloatArray, PalpateError


class RecordError(PalpateError):
    """A record that cannot be what FEBio writes."""


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """Blocks of a record in order.

    Parameters
    ----------
    times : (n,) array
        Rising.
    values : (n, n_columns) array
        Finite or not: that is for the reader to judge.
    """

    times: FloatArray
    values: FloatArray


def read_record(text: str, n_columns: int) -> Record:
    """Read a record with one item; a last block that was cut off is left out.

    Parameters
    ----------
    text : str
    n_columns : int
        Values in a row, after the item's number.

    Raises
    ------
    RecordError
        Naming the line.
    """
    lines = text.split("\n")
    whole = lines[:-1]  # what follows the last line end was cut off
    times: list[float] = []
    rows: list[list[float]] = []
    time: float | None = None
    for number, line in enumerate(whole, start=1):
        if line.startswith("*"):
            key, _, word = line[1:].partition("=")
            if key.strip() == "Time":
                time = _float(word, number)
        elif line.strip():
            if time is None:
                raise RecordError(f"line {number}: values before any time; this is not a record of FEBio")
            rows.append(_row(line, number, n_columns))
            times.append(time)
            time = None
    found = Record(np.array(times), np.array(rows).reshape(-1, n_columns))
    if (np.diff(found.times) <= 0.0).any():
        raise RecordError("times do not rise; two runs wrote into one record")
    return found


def _row(line: str, number: int, n_columns: int) -> list[float]:
    words = line.replace(",", " ").split()
    if len(words) != n_columns + 1:
        raise RecordError(f"line {number}: {len(words)} numbers and not {n_columns + 1}")
    return [_float(word, number) for word in words[1:]]


def _float(word: str, number: int) -> float:
    try:
        return float(word)
    except ValueError:
        raise RecordError(f"line {number}: '{word.strip()[:40]}' is no number") from None
