"""Characters of a text file: its encoding, and the files that are no text by their first bytes."""

import re
import zipfile
from codecs import BOM_UTF8, BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from palpate.errors import CurveError

Encoding = Literal["utf-8", "utf-16", "latin-1", "cp1252", "cp1251", "shift_jis", "gb18030"]

_ASCII = bytes(range(128))
_MARKS: Mapping[bytes, Encoding] = {BOM_UTF8: "utf-8", BOM_UTF16_LE: "utf-16", BOM_UTF16_BE: "utf-16"}
_USUAL_PAIRS: Mapping[Encoding, bytes] = {
    "shift_jis": rb"[\x81-\x83\x88-\x97][\x40-\x7e\x80-\xfc]",
    "gb18030": rb"[\xa1-\xa3\xb0-\xd7][\xa1-\xfe]",
    "cp1251": rb"[\xc0-\xff]{3,}",
}
"""Two bytes of the most frequent characters of Japanese and Chinese text, and words of Russian text."""
_NEVER_READ = (
    (b"\x1f\x8b", "is compressed by gzip; unpack it first"),
    (b"BZh", "is compressed by bzip2; unpack it first"),
    (b"\x28\xb5\x2f\xfd", "is compressed by zstd; unpack it first"),
    (b"\xfd7zXZ", "is compressed by xz; unpack it first"),
    (b"\x80", "is a pickle, which could run code and is never read; save plain numbers"),
    (b"\xd0\xcf\x11\xe0", "is a spreadsheet or document; save the table as CSV"),
    (b"TDSh", "is the index of a LabVIEW TDMS file; give the .tdms file itself"),
    (b"\x05\x00", "is a binary wave of Igor Pro; save it as delimited text (Data > Save Waves)"),
    (b"\x00\x05", "is a binary wave of Igor Pro; save it as delimited text (Data > Save Waves)"),
    (b"%PDF", "is a PDF document; save the table as CSV"),
    (b"xl/", "is a spreadsheet of Excel; save the table as CSV"),
    (b"content.xml", "is a spreadsheet of OpenDocument; save the table as CSV"),
    (b"word/", "is a document of Word; save the table as CSV"),
    (b"header.properties", "is a force curve of JPK; export it as text with the JPK software"),
)
"""First bytes of files, or of names in a zip archive, and what to do."""
_COLUMNS = (
    (b"MATLAB", "a MATLAB file"),
    (b"\x89HDF", "an HDF5 file"),
    (b"PAR1", "a Parquet file"),
    (b"\x93NUMPY", "a NumPy file"),
    (b"PK\x03\x04", "an archive"),
    (b"TDSm", "a TDMS file"),
)
"""First bytes of files that hold columns and are no text."""


def refuse_binary(path: Path) -> None:
    """Refuse a file that is no log and no text, with its kind and what to save instead."""
    with path.open("rb") as stream:
        heads = [stream.read(16)]
    if heads[0].startswith(b"PK\x03\x04"):
        try:
            heads = [name.encode() for name in zipfile.ZipFile(path).namelist()]
        except (zipfile.BadZipFile, OSError, ValueError):
            heads = []
    for magic, why in _NEVER_READ:
        if any(head.startswith(magic) for head in heads):
            raise CurveError(f"{path}: the file {why}")


def decoded(path: Path, given: Encoding | None) -> tuple[str, Encoding]:
    """Text of a file without a byte order mark, and its encoding: as given, or the first that fits."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise CurveError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    if not raw or raw.isspace():
        raise CurveError(f"{path}: the file is empty; export it again")
    refuse_binary(path)
    if kind := next((kind for magic, kind in _COLUMNS if raw.startswith(magic)), ""):
        raise CurveError(
            f"{path}: is {kind}, and this loader reads text alone; see "
            "'palpate experiment inspect' for the loader that reads it, or save its columns as CSV"
        )
    marked = given or next((encoding for mark, encoding in _MARKS.items() if raw.startswith(mark)), None)
    guesses: tuple[Encoding, ...] = ("utf-8", *_of_pairs(raw[:100_000]), "cp1252", "latin-1")
    for encoding in (marked,) if marked else guesses:
        try:
            text = raw.decode("utf-8-sig" if encoding == "utf-8" else encoding)
        except UnicodeDecodeError as error:
            bad = error.start
            continue
        if "\0" in text:
            raise CurveError(
                f"{path}: byte {raw.index(0)} is zero, so this is no text; give a CSV or TSV file, or "
                "another format that 'palpate experiment inspect' knows"
            )
        return text if "\n" in text else text.replace("\r", "\n"), encoding
    raise CurveError(
        f"{path}: byte {bad} is not {marked} text; leave encoding out of the loader's settings, "
        "or save the file as UTF-8"
    )


def _of_pairs(raw: bytes) -> tuple[Encoding, ...]:
    """Encoding of Japanese or Chinese text, where most bytes outside of ASCII are in its usual pairs."""
    n_others = len(raw.translate(None, _ASCII))
    paired = {encoding: b"".join(re.findall(pairs, raw)) for encoding, pairs in _USUAL_PAIRS.items()}
    return tuple(key for key, part in paired.items() if 0.7 * n_others < len(part.translate(None, _ASCII)))
