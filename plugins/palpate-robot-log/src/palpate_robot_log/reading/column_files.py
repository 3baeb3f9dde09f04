"""Files of columns: NumPy's, MATLAB's and HDF5, Parquet and JSON by polars, and LabVIEW's TDMS by npTDMS.

Arrays of one length are the columns of one stream. TDMS gives one stream for each group, and for each length
or rate within it.
"""

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate.api import CurveError, FloatArray
from palpate.api.files import Column, check_columns, listed, unit_in
from palpate_robot_log.reading.raw import RawLog, Stream, or_damaged

if TYPE_CHECKING:
    import polars as pl

TIME = "time"  # column of a waveform's time, which a TDMS file gives as a start and an increment
UNSET = np.datetime64("1904-01-02")
"""LabVIEW counts from 1904-01-01; an earlier start is that of a clock which was not set."""

MOST_COLUMNS = 64  # widest matrix that counts as columns side by side; a wider one is an image or a result
_UNITS = ("unit", "units")
_NAMES = (
    *("columns", "column_names", "names", "labels", "colheaders", "header", "headers", "channels"),
    *("channel_names", "fields", "items", "name", "label"),
)
"""Attributes, or fields of a structure, in small letters, that describe the columns of an array."""
_DESCRIBING = frozenset((*_UNITS, *_NAMES))
_BARE = frozenset(("data", "value", "values", "signal", "y"))
"""Fields of a structure that describes itself, in small letters."""
_MOST_WORDS = 1000
_MATLAB_OWN = ("#refs#", "#subsystem#")
_MATLAB_TEXT = (b"char", b"cell")
_PER_SECOND = {"ns": 1e9, "us": 1e6, "ms": 1e3}

_Found = Iterator[tuple[str, np.ndarray]]
_MATLAB_NAME = "{}(:,{})"
_NUMPY_NAME = "{}[:,{}]"
_POLARS_NAME = "{}[{}]"


# ------------------------------------------------------------------------ named arrays


def read_numpy(path: Path) -> RawLog:
    """Array of an .npy file, named ``array``, or every array of an .npz archive."""
    advice = "save plain arrays of numbers again"
    with or_damaged(path, "damaged, cut off, or not of plain numbers", advice), path.open("rb") as stream:
        loaded = np.load(stream, allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            found, file_format = {"array": loaded}, "NumPy array"
        else:
            found, file_format = {name: np.asarray(loaded[name]) for name in loaded}, "NumPy archive"
    return _log(path, file_format, found, _NUMPY_NAME)


def read_matlab5(path: Path) -> RawLog:
    """Vectors and matrices of a MATLAB 5 to 7.2 file, also those inside structures."""
    from scipy.io import loadmat

    with or_damaged(path, "the MATLAB file is damaged or cut off", "save it again"):
        found = loadmat(path, mat_dtype=True, struct_as_record=True, verify_compressed_data_integrity=True)
    variables = {name: value for name, value in found.items() if not name.startswith("__")}
    return _log(path, "MATLAB 5", variables, _MATLAB_NAME)


def read_hdf5(path: Path) -> RawLog:
    """Vectors and matrices of an HDF5 or MATLAB 7.3 file, also those inside groups.

    Links, virtual data sets and external storage are not followed: the run's record covers this file alone.
    """
    try:
        import h5py
    except ImportError:
        raise CurveError(
            f"{path}: MATLAB 7.3 and HDF5 files need h5py; run: pip install 'palpate-robot-log[matlab]', "
            "or save the file with MATLAB's -v7"
        ) from None
    with path.open("rb") as stream:
        is_matlab = stream.read(6) == b"MATLAB"
    notes, empty, arrays = list[str](), list[str](), dict[str, Any]()

    def visit(name: str, item: Any) -> None:  # noqa: ANN401 - h5py is untyped
        if is_matlab and name.split("/")[0] in _MATLAB_OWN:
            return
        name, kind = name.replace("/", "."), item.attrs.get("MATLAB_class", b"")
        arrays.update(
            {f"{name}.{key}": np.asarray(item.attrs[key]) for key in item.attrs if key.lower() in _DESCRIBING}
        )
        if not isinstance(item, h5py.Dataset):
            return
        if item.is_virtual or item.external:
            notes.append(f"'{name}' keeps its numbers in another file, which is not read")
        elif kind in _MATLAB_TEXT:
            cells = [item.file[one] for one in item[()].ravel() if one] if item.dtype.kind == "O" else [item]
            if {one.attrs.get("MATLAB_class") for one in cells} == {b"char"}:  # a cell may hold anything
                arrays[name] = np.array(["".join(map(chr, one[()].ravel())) for one in cells])
        elif item.dtype.kind in "SUO" or (item.dtype.kind in "fiubV" and item.shape and 0 not in item.shape):
            # MATLAB's files hold the dimensions in reverse.
            arrays[name] = np.asarray(item[()].T if is_matlab else item[()])
        else:
            empty.append(name)

    damage = or_damaged(path, "the HDF5 file is damaged or cut off", "save it again")
    with damage, h5py.File(path, "r", locking=False) as file:
        file.visititems(visit)
    notes += [f"without numbers: {listed(empty, 6)}"] if empty else []
    kind, pattern = ("MATLAB 7.3", _MATLAB_NAME) if is_matlab else ("HDF5", _NUMPY_NAME)
    return _log(path, kind, arrays, pattern, notes)


def _arrays_in(name: str, value: Any, notes: list[str], depth: int = 0) -> _Found:  # noqa: ANN401 - of any library
    """Arrays of numbers under a name: the value itself, or the fields of a structure."""
    if not isinstance(value, np.ndarray) or type(value).__name__ in ("MatlabOpaque", "MatlabFunction"):
        notes.append(f"'{name}' is a MATLAB object, which only MATLAB reads; save its numbers in a structure")
    elif value.dtype.names is None:
        yield name, value
    elif not value.dtype.hasobject:
        for field in value.dtype.names:
            yield from _arrays_in(f"{name}.{field}", value[field], notes, depth + 1)
    elif depth >= 8 or value.size > 32:
        notes.append(f"'{name}' is too deep or too long a structure to look into")
    else:
        for index, element in enumerate(value.reshape(-1), start=1):
            prefix = name if value.size == 1 else f"{name}({index})"
            for field in value.dtype.names:
                yield from _arrays_in(f"{prefix}.{field}", element[field], notes, depth + 1)


def _log(
    path: Path,
    file_format: str,
    values: Mapping[str, Any],
    pattern: str,
    notes: Iterable[str] = (),
    units: Mapping[str, str] | None = None,
) -> RawLog:
    """Log of the vectors and matrices of real numbers among the values, with the units of some."""
    by_length: dict[int, dict[str, Column]] = {}
    found, passed_over = [*notes], list[str]()
    arrays = [each for name, value in values.items() for each in _arrays_in(name, value, found)]
    texts = {name.lower(): text for name, array in arrays if (text := _text_of(array))}
    for name, array in arrays:
        matrix = _upright(array)
        if matrix is None:
            if name.lower() not in texts:
                passed_over.append(f"'{name}' {array.shape} of {array.dtype}")
            continue
        n_columns, first = matrix.shape[1], 1 if pattern is _MATLAB_NAME else 0
        is_many = n_columns > 1 or (array.ndim > 1 and pattern is _POLARS_NAME)
        names = [pattern.format(name, k) for k in range(first, first + n_columns)] if is_many else [name]
        shown = _described(name, texts, _UNITS, n_columns) or [(units or {}).get(name, "")]
        shown = shown if shown[0] or n_columns == 1 else [unit_in(name)[1]]
        # Of several that fit no count of columns none is sure.
        shown = shown * n_columns if len(shown) == 1 else shown
        shown = shown if len(shown) == n_columns else [", ".join(shown)] * n_columns
        columns = by_length.setdefault(len(matrix), {})
        labels = _described(name, texts, _NAMES, n_columns)
        if len({*labels} - {*columns}) == n_columns == len(labels):
            names = labels
        for one, column, unit in zip(names, matrix.T, shown, strict=True):
            columns[one] = Column(name=one, values=column, unit=unit)
    if not by_length:
        why = "; ".join([*found, listed(passed_over, 6)] if passed_over else found) or "it is empty"
        raise CurveError(f"{path}: no columns of numbers ({why}); save vectors or matrices of doubles")
    found += [f"no columns of numbers: {listed(passed_over, 6)}"] if passed_over else []
    streams = tuple(
        Stream.of(columns.values(), name=f"{n_rows} rows" if len(by_length) > 1 else "")
        for n_rows, columns in by_length.items()
    )
    alone = "\n".join(f"{name}: {array.item()}" for name, array in arrays if array.size == 1)
    log = RawLog(source=str(path), format=file_format, row_word="row", streams=streams, notes=tuple(found))
    return replace(log, preamble=alone)


def _text_of(array: np.ndarray) -> list[str]:
    """Words in an array of text, or in a MATLAB cell array of words; none where it holds something else."""
    cells = [each for cell in array.ravel()[:_MOST_WORDS] for each in np.asarray(cell).ravel()[:1]]
    if array.dtype.kind not in "SUO" or not all(isinstance(cell, bytes | str) for cell in cells):
        return []
    return [(c.decode("utf-8", "replace") if isinstance(c, bytes) else str(c)).strip() for c in cells]


def _described(name: str, texts: Mapping[str, list[str]], keys: Sequence[str], n_columns: int) -> list[str]:
    """Words of an attribute or a field of one of some keys that describes the columns of an array."""
    parent, own = (part.lower() for part in name.rpartition(".")[::2])
    places = [f"{name.lower()}.", f"{name.lower()}_"]
    if own in _BARE:
        places.append(f"{parent}." if parent else "")
    elif own.endswith("_values"):  # pandas
        places.append(f"{name.lower().removesuffix('values')}")
    # Units may be together in an object for all: header.units.force.
    ends = [f".{own}_{key}" for key in keys] + [f".{key}.{own}" for key in keys]
    together = {tuple(of) for path, of in texts.items() if f".{path}".endswith(tuple(ends))}
    words = next((texts[at + key] for at in places for key in keys if at + key in texts), [])
    words = words or (list(*together) if len(together) == 1 else [])
    parts = [part.strip() for part in re.split("[,;\t]", words[0])] if len(words) == 1 else []
    return parts if 1 < len(parts) == n_columns else words


def _upright(array: np.ndarray) -> FloatArray | None:
    """Matrix (n, k) of doubles with n ≥ k; None where the array is no such thing."""
    if array.dtype.kind not in "fiub" or array.dtype.itemsize > 8:
        return None
    shaped = array.reshape(-1, 1) if array.ndim == 1 else array
    # Rotation matrices or poses, one a row, each written row by row; MATLAB stacks them last.
    for size in (3, 4) if shaped.ndim == 3 and max(shaped.shape) > 4 else ():
        if shaped.shape[1:] in ((size, size), (size, 4)):
            shaped = shaped.reshape(len(shaped), -1)
        elif shaped.shape[:2] in ((size, size), (size, 4)):
            shaped = np.moveaxis(shaped, 2, 0).reshape(shaped.shape[2], -1)
    if shaped.ndim == 2 and shaped.shape[0] < shaped.shape[1]:
        shaped = shaped.T
    if shaped.ndim != 2 or shaped.shape[0] < 2 or shaped.shape[1] > MOST_COLUMNS:
        return None
    return np.asarray(shaped, dtype=np.float64)


# ----------------------------------------------------------------------------- Parquet


def read_parquet(path: Path, wanted: Sequence[str] | None = None) -> RawLog:
    """Columns of numbers and of time stamps; a list of fixed length counts as several.

    Time stamps and durations become seconds, stamps since the first row.
    """
    import polars as pl

    kinds = (pl.exceptions.PolarsError, pl.exceptions.PanicException)
    with or_damaged(path, "the Parquet file is damaged or cut off", "export it again", kinds):
        schema = pl.scan_parquet(path, glob=False).pipe(_flat).collect_schema()
        names = [name for name, dtype in schema.items() if _is_numeric(dtype)]
        if wanted is not None:
            held = {name if name in schema else name.split("[", 1)[0]: name for name in wanted}
            check_columns(path, [name for own, name in held.items() if own not in schema], schema)
            for own in held:
                if own not in names:
                    raise CurveError(
                        f"{path}: column '{own}' holds {schema[own]} and no numbers; choose another"
                    )
            names = list(held)
        # The path is taken as it is, not as a pattern of several files.
        frame = pl.scan_parquet(path, glob=False).pipe(_flat).select(names).collect()
        others = [f"{name} ({dtype})" for name, dtype in schema.items() if name not in names]
        return _of_frame(path, "Parquet", frame, others if wanted is None else [])


def _flat(frame: "pl.LazyFrame") -> "pl.LazyFrame":
    """Frame whose structures are columns, each named by its path."""
    import polars as pl

    while structs := [name for name, of in frame.collect_schema().items() if of == pl.Struct]:
        for name in structs:
            inner = frame.select(pl.col(name).struct.unnest()).collect_schema().names()
            fields = [pl.col(name).struct.field(each).alias(f"{name}.{each}") for each in inner]
            frame = frame.with_columns(fields).drop(name)
    return frame


def read_json(path: Path) -> RawLog:
    """Columns of JSON: an object a line, a list of objects, or one object of lists; fields of fields too."""
    import polars as pl

    advice = "write an object for each sample, with numbers or lists of numbers"
    with or_damaged(path, "the JSON is damaged, or no table of numbers", advice):
        text = path.read_text(encoding="utf-8-sig").strip()
        try:
            loaded = json.loads(text)
        except ValueError:  # an object a line, of which the first may describe the others
            loaded = [json.loads(line) for line in text.splitlines() if line]
        rows, head = loaded, dict[str, Any]()
        if isinstance(loaded, dict):
            head = dict(_fields(loaded))
            tables = [k for k, of in head.items() if isinstance(of, list) and of and isinstance(of[0], dict)]
            rows = head.pop(tables[0]) if len(tables) == 1 else None
        elif len(loaded) > 1 and {*loaded[0]}.isdisjoint(loaded[1]):
            head = dict(_fields(loaded.pop(0)))
        described = {name: np.asarray(of) for name, of in head.items()}
        if rows is None:
            return _log(path, "JSON", described, _NUMPY_NAME)
        flat = [
            {k: np.ravel(of).tolist() if _is_matrix(of) else of for k, of in _fields(row)} for row in rows
        ]
        frame = pl.DataFrame(flat, infer_schema_length=None)
        names = [name for name, dtype in frame.schema.items() if _is_numeric(dtype)]
        others = [f"{name} ({dtype})" for name, dtype in frame.schema.items() if name not in names]
        texts = [of for of in frame if of.dtype == pl.String and of.n_unique() == 1]  # a unit in each row
        described |= {of.name: np.asarray(of[:1]) for of in texts}
        return _of_frame(path, "JSON", frame.select(names), others, described)


def _is_matrix(value: object) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], list)


def _by_name(value: object) -> dict[str, Any]:
    """Objects of a list by their names; empty where not each has a name of its own."""
    rows = value if isinstance(value, list) else []
    named = {row["name"]: row for row in rows if isinstance(row, dict) and isinstance(row.get("name"), str)}
    return named if len(named) == len(rows) else {}


def _fields(value: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Fields of an object and of those in it, by their path: a list of named objects is an object of them."""
    for name, of in value.items():
        if named := _by_name(of):
            yield from _fields(named, prefix)
        elif isinstance(of, dict) and of and [*of] == [*map(str, range(len(of)))]:  # a column of pandas
            yield f"{prefix}{name}", [*of.values()]
        elif isinstance(of, dict):
            yield from _fields(of, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", of


def _of_frame(
    path: Path,
    file_format: str,
    frame: "pl.DataFrame",
    others: Sequence[str],
    described: Mapping[str, np.ndarray] = MappingProxyType({}),
) -> RawLog:
    """Log of a frame's columns with arrays that describe them; ``others`` are columns without numbers."""
    import polars as pl

    if frame.height < 2 or not frame.width:
        raise CurveError(
            f"{path}: {frame.height} rows and {frame.width} columns of numbers; export the log again"
        )
    values, units = dict[str, FloatArray](), dict[str, str]()
    for series in frame:
        dtype = series.dtype
        if dtype.is_nested():
            lengths = series.cast(pl.List(pl.Float64)).list.len().unique().to_list()
            if len(lengths) != 1 or lengths[0] is None or not 0 < int(lengths[0]) <= 16:
                raise CurveError(
                    f"{path}: the lists of column '{series.name}' have {len(lengths)} lengths; "
                    "give each number its own column"
                )
            series = series.cast(pl.Array(pl.Float64, int(lengths[0])))
        elif isinstance(dtype, pl.Datetime | pl.Duration):
            # A stamp's own count is since 1970.
            counts = series.to_physical()
            start = counts.drop_nulls().first() if isinstance(dtype, pl.Datetime) else 0
            series = (counts - (start or 0)).cast(pl.Float64) / _PER_SECOND[dtype.time_unit or "us"]
            units[series.name] = "s"
        else:
            series = series.cast(pl.Float64)
        values[series.name] = series.to_numpy()
    notes = [f"columns passed over: {listed(others)}"] if others else []
    return _log(path, file_format, {**described, **values}, _POLARS_NAME, notes, units)


def _is_numeric(dtype: "pl.DataType") -> bool:
    """Whether a column of this type gives numbers; a list of numbers gives several."""
    import polars as pl

    if isinstance(dtype, pl.Array | pl.List):
        return isinstance(dtype.inner, pl.DataType) and dtype.inner.is_numeric()
    return dtype.is_numeric() or isinstance(dtype, pl.Datetime | pl.Duration | pl.Boolean)


# -------------------------------------------------------------------------------- TDMS


def read_tdms(path: Path) -> RawLog:
    """Channels of numbers and of time stamps, scaled as LabVIEW shows them.

    Units are from the property ``unit_string``. Waveforms have a column ``time`` [s]. It and time stamps
    are seconds since the earliest stamp of the file, so that streams have one clock. Streams have the
    group's name; it is empty if there is one stream.
    """
    try:
        from nptdms import TdmsFile
    except ImportError:
        raise CurveError(
            f"{path}: TDMS files need npTDMS; run: pip install 'palpate-robot-log[tdms]', "
            "or export the file as CSV"
        ) from None
    streams: list[Stream] = []
    passed_over: list[str] = []
    with or_damaged(path, "the TDMS file is damaged or cut off", "export it again"):
        file = TdmsFile.read(path)
        if file.file_status.incomplete_final_segment:
            raise CurveError(f"{path}: the TDMS file is cut off in its last segment; export it again")
        origin = min((s for g in file.groups() for c in g.channels() for s in _stamps(c)), default=None)
        for group in file.groups():
            streams.extend(_streams(group, origin, passed_over))
    if not streams:
        raise CurveError(f"{path}: no channels of numbers; export channels of at least two numbers")
    if len(streams) == 1:
        streams = [replace(streams[0], name="")]
    notes = (f"channels without numbers: {listed(passed_over)}",) if passed_over else ()
    return RawLog(source=str(path), format="TDMS", row_word="row", streams=tuple(streams), notes=notes)


def _stamps(channel: Any) -> Iterator[np.datetime64]:  # noqa: ANN401 - npTDMS is untyped
    """Stamps that a channel starts at; a waveform whose start nobody set starts at LabVIEW's epoch."""
    values, start = channel[:1], channel.properties.get("wf_start_time")
    if values.size and values.dtype.kind == "M":
        yield values[0]
    if start is not None and np.datetime64(start) > UNSET:
        yield np.datetime64(start)


def _seconds(stamps: NDArray[np.datetime64] | np.datetime64, origin: np.datetime64) -> FloatArray:
    since = np.asarray(stamps - origin, dtype="timedelta64[ns]")
    return np.asarray(since.astype(np.float64) * 1e-9)


def _streams(
    group: Any,  # noqa: ANN401 - npTDMS is untyped
    origin: np.datetime64 | None,
    passed_over: list[str],
) -> Iterator[Stream]:
    """The channels of a group by their length, time step and start."""
    # Columns by number of rows, and time step and start [s] of waveforms.
    by_clock: dict[tuple[int, float | None, float], list[Column]] = {}
    for channel in group.channels():
        column = _column(channel, origin)
        if column is None:
            passed_over.append(f"{group.name}.{channel.name}")
            continue
        given, step, start_s = channel.properties, channel.properties.get("wf_increment"), 0.0
        if step is not None:
            step, start = float(step), given.get("wf_start_time")
            start_s = float(given.get("wf_start_offset", 0.0))
            if origin is not None and start is not None and np.datetime64(start) > UNSET:
                start_s += float(_seconds(np.datetime64(start), origin))
        by_clock.setdefault((column.values.size, step, start_s), []).append(column)
    # Names have as much of the clocks as they differ in.
    parts = [(f"{n} rows", f"every {step_s} s", f"from {start_s} s") for n, step_s, start_s in by_clock]
    named = [[", ".join([group.name, *each[:n]]) for each in parts] for n in range(4)]
    names = next((names for names in named if len(set(names)) == len(parts)), named[-1])
    for name, ((n_rows, step_s, start_s), columns) in zip(names, by_clock.items(), strict=True):
        if step_s is not None and TIME not in [column.name for column in columns]:
            seconds = start_s + step_s * np.arange(n_rows, dtype=np.float64)
            columns.append(Column(name=TIME, values=seconds, unit="s"))
        yield Stream.of(columns, name)


def _column(channel: Any, origin: np.datetime64 | None) -> Column | None:  # noqa: ANN401 - npTDMS is untyped
    """Numbers of a channel; None where it has none."""
    values, unit = channel[:], str(channel.properties.get("unit_string", ""))
    if values.ndim != 1 or values.size < 2:
        return None
    if values.dtype.kind == "M":
        values, unit = _seconds(values, values[0] if origin is None else origin), "s"
    if values.dtype.kind not in "fiub" or values.dtype.itemsize > 8:
        return None
    return Column(name=channel.name, values=np.asarray(values, dtype=np.float64), unit=unit)
