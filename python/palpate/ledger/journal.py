"""What a killed writer has left in SQLite's journal, ``ledger.sqlite-wal``.

SQLite reads a journal up to its first frame that does not fit its checksum, and drops the rest in
silence. After a kill or a power cut that is right: only the last transaction can be torn, since
every one before it was flushed. But a bit that flips in the middle costs, in the same silence,
whatever was finished after it. Both are told apart here, before SQLite opens the file.

The format: https://www.sqlite.org/fileformat2.html#walformat. The checksum of pairs of words
(x, y) is s ← s + x + t, t ← t + y + s modulo 2³², so that frames can be summed all at once.
"""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import LedgerError

HEADER, FRAME_HEADER = 32, 24
"""Bytes before the first frame, and before the page of each."""

_MAGIC = 0x377F0682

Words = NDArray[np.uint64]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Frames:
    """The frames of one journal that belong to it, in order; those of an earlier use are left out.

    Parameters
    ----------
    ends : (n,) bool array
        Whether a frame is the last of its transaction.
    n_sound : int
        Frames before the first that does not fit its checksum.
    n_torn : int
        Bytes after the last whole frame.
    """

    ends: NDArray[np.bool_]
    n_sound: int
    n_torn: int


def torn_end(path: Path) -> str:
    """What SQLite will drop of the journal of a ledger, for people; empty where that is nothing.

    Parameters
    ----------
    path : Path
        The ledger.

    Raises
    ------
    LedgerError
        The journal is damaged before its last transaction.
    """
    journal = path.with_name(f"{path.name}-wal")
    content = journal.read_bytes() if journal.exists() else b""
    if len(content) <= HEADER:
        return ""
    frames = _frames(content)
    places = np.flatnonzero(frames.ends)
    n_lost = int((places >= frames.n_sound).sum())
    if n_lost > 1:
        raise LedgerError(
            f"{journal}: damaged: frame {frames.n_sound + 1} is not as written, and {n_lost} groups of "
            "finished simulations follow it; the disk may be failing. Restore a copy, or delete this file to "
            "have what it holds done again"
        )
    n_kept = int(places[places < frames.n_sound][-1]) + 1 if n_lost < places.size else 0
    n_dropped = frames.ends.size - n_kept
    if n_dropped == 0 and frames.n_torn == 0:
        return ""
    return f"{journal.name}: the last group was cut short and is dropped; what it held is done again"


def _frames(content: bytes) -> _Frames:
    magic, _, page, _, salt, pepper, *sums = struct.unpack(">8I", content[:HEADER])
    size = FRAME_HEADER + (page if 512 <= page <= 65536 else 4096)
    n_whole, n_rest = divmod(len(content) - HEADER, size)
    frames = np.frombuffer(content, np.uint8, n_whole * size, HEADER).reshape(n_whole, size)
    heads = frames[:, :FRAME_HEADER].copy().view(">u4")
    is_sound_header = magic & ~1 == _MAGIC and _sums(content[:24], magic, (0, 0)) == tuple(sums)
    if not is_sound_header and n_whole:
        salt, pepper = (int(word) for word in heads[0, 2:4])
    is_own = (heads[:, 2] == salt) & (heads[:, 3] == pepper)
    n_own = n_whole if is_own.all() else int(np.argmin(is_own))
    n_sound = _n_sound(frames[:n_own], heads[:n_own], magic, (sums[0], sums[1])) if is_sound_header else 0
    return _Frames(ends=heads[:n_own, 1] != 0, n_sound=n_sound, n_torn=n_rest if n_own == n_whole else 0)


def _n_sound(frames: NDArray[np.uint8], heads: NDArray[Any], magic: int, sums: tuple[int, int]) -> int:
    """Count the frames before the first whose checksum, which goes on from frame to frame, is not its own."""
    if not len(frames):
        return 0
    summed = np.concatenate([frames[:, :8], frames[:, FRAME_HEADER:]], axis=1)
    words = summed.view(_order(magic)).astype(np.uint64).reshape(len(frames), -1, 2)
    (a, b), (c, d), of_words = _powers(words)
    s, t = sums
    for i in range(len(frames)):
        s, t = (
            (a * s + b * t + int(of_words[i, 0])) & 0xFFFFFFFF,
            (c * s + d * t + int(of_words[i, 1])) & 0xFFFFFFFF,
        )
        if (s, t) != (int(heads[i, 4]), int(heads[i, 5])):
            return i
    return len(frames)


def _sums(content: bytes, magic: int, sums: tuple[int, int]) -> tuple[int, int]:
    words = np.frombuffer(content, _order(magic)).astype(np.uint64).reshape(1, -1, 2)
    (a, b), (c, d), of_words = _powers(words)
    s, t = sums
    return (a * s + b * t + int(of_words[0, 0])) & 0xFFFFFFFF, (
        c * s + d * t + int(of_words[0, 1])
    ) & 0xFFFFFFFF


def _powers(words: Words) -> tuple[tuple[int, int], tuple[int, int], Words]:
    """How the sums before a frame, and its words (n_frames, n_pairs, 2), enter the sums after it.

    One pair maps the sums v to A v + B w with A = (1 1; 1 2) and B = (1 0; 1 1), so n pairs map
    them to Aⁿ v + Σ Aⁿ⁻¹⁻ᵏ B wₖ. Numbers wrap modulo 2⁶⁴, which 2³² divides.
    """
    step, entry = np.array([[1, 1], [1, 2]], np.uint64), np.array([[1, 0], [1, 1]], np.uint64)
    power, weights = np.eye(2, dtype=np.uint64), []
    for _ in range(words.shape[1]):
        weights.append(power @ entry)
        power = power @ step
    weight = np.stack(weights[::-1])
    mixed: Words = np.einsum("fkj,kij->fi", words, weight)
    (a, b), (c, d) = ([int(x) for x in row] for row in power)
    return (a, b), (c, d), mixed


def _order(magic: int) -> str:
    return ">u4" if magic & 1 else "<u4"
