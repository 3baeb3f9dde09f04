"""Damaged and odd files: no code is run, no other file is read, memory and time are limited."""

import os
import pickle
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.errors import CurveError
from palpate_robot_log.reading.formats import ReadingLimits, read_here, read_log

from . import log_writers as write

h5py = pytest.importorskip("h5py")
pytest.importorskip("rosbags")


class Bomb:
    """What runs code when it is unpickled."""

    def __init__(self, marker: Path) -> None:
        self.marker = marker

    def __reduce__(self) -> tuple[Any, ...]:
        return (os.mkdir, (str(self.marker),))


# -------------------------------------------------------------------------- code


def test_nothing_is_unpickled(tmp_path: Path) -> None:
    marker = tmp_path / "ran"
    np.savez(tmp_path / "log.npz", a=np.array([Bomb(marker)], dtype=object))
    np.save(tmp_path / "log.npy", np.array([Bomb(marker)], dtype=object))
    (tmp_path / "log.dat").write_bytes(pickle.dumps(Bomb(marker)))
    for name in ("log.npz", "log.npy", "log.dat"):
        with pytest.raises(CurveError, match=r"allow_pickle=False|is a pickle, which could run code"):
            read_here(tmp_path / name)
    assert not marker.exists()


# ------------------------------------------------------------------- other files


def _secret(tmp_path: Path) -> Path:
    secret = tmp_path / "elsewhere"
    secret.mkdir()
    write.write_hdf5(secret / "secret.h5", write.press(60))
    np.arange(60.0).tofile(secret / "secret.bin")
    return secret


def test_arrays_of_other_files_are_not_read(tmp_path: Path) -> None:
    secret = _secret(tmp_path)
    layout = h5py.VirtualLayout(shape=(60,), dtype="f8")
    layout[:] = h5py.VirtualSource(str(secret / "secret.h5"), "log/x_m", shape=(60,))
    path = tmp_path / "log.h5"
    write.write_hdf5(path, write.press(60))
    raw = [(str(secret / "secret.bin"), 0, h5py.h5f.UNLIMITED)]
    with h5py.File(path, "a") as file:
        file["link"] = h5py.ExternalLink(str(secret / "secret.h5"), "/log")
        file["again"] = h5py.SoftLink("/log")
        file["log/circle"] = file["log"]
        file.create_virtual_dataset("virtual", layout)
        file.create_dataset("raw", (60,), "f8", external=raw)
    log = read_here(path)
    assert set(log.streams[0].columns) == {f"log.{name}" for name in write.COLUMNS}
    assert [note for note in log.notes if "another file" in note] == [
        f"'{name}' keeps its numbers in another file, which is not read" for name in ("raw", "virtual")
    ]


def test_the_metadata_of_a_bag_cannot_name_files_elsewhere(tmp_path: Path) -> None:
    write.write_bag2(tmp_path / "other", write.press(60))
    write.write_bag2(tmp_path / "log", write.press(60))
    (tmp_path / "log" / "log.db3").unlink()
    metadata = tmp_path / "log" / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("log.db3", "../other/other.db3"))
    with pytest.raises(CurveError, match="damaged or cut off"):
        read_here(tmp_path / "log")


# ------------------------------------------------------------------------- bombs


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory are kept on Linux")
def test_archives_that_unpack_to_more_than_the_memory_are_an_error(tmp_path: Path) -> None:
    write.npz_bomb(tmp_path / "log.npz", 1 << 30)
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file.create_dataset("a", (1 << 40,), "f8", chunks=(1 << 20,), compression="gzip")
    for name in ("log.npz", "log.h5"):
        with pytest.raises(CurveError, match=r"reading failed|damaged"):
            read_log(tmp_path / name, limits=ReadingLimits.model_validate({"memory": "1 GB"}))


@pytest.mark.parametrize("text", ["root:$6$hash:19000\nbin:*:18000\n", "secret,other\nkey,word\n"])
def test_the_words_of_a_file_that_is_no_log_are_not_repeated(tmp_path: Path, text: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text)
    with pytest.raises(CurveError, match="no cell holds a number, so this is no table") as caught:
        read_here(path, columns=("time",))
    assert not any(word in str(caught.value).removeprefix(str(path)) for word in ("hash", "secret"))


def test_large_files_are_not_opened(tmp_path: Path) -> None:
    with (tmp_path / "log.csv").open("wb") as stream:
        stream.truncate(3_000_000_000)
    with pytest.raises(CurveError, match="3000 MB where at most 2000 MB are read"):
        read_log(tmp_path / "log.csv")


@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory are kept on Linux")
def test_a_reader_with_too_much_memory_is_an_error(tmp_path: Path) -> None:
    write.write_text(tmp_path / "log.csv", write.press(30_000))
    limits = ReadingLimits.model_validate({"memory": "300 MB"})
    with pytest.raises(CurveError, match=r"log\.csv: reading failed"):
        read_log(tmp_path / "log.csv", limits=limits)


def test_a_reader_that_takes_too_long_is_an_error(tmp_path: Path) -> None:
    write.write_text(tmp_path / "log.csv", write.press(30))
    with pytest.raises(CurveError, match=r"stopped after 0.01 s.*raise memory and time_limit"):
        read_log(tmp_path / "log.csv", limits=ReadingLimits.model_validate({"time_limit": "10 ms"}))
