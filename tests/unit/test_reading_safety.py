"""Files from strangers: no code, no other files, bounded memory and time."""

import json
import os
import pickle
import subprocess
import sys
import textwrap
import time
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate import sandbox
from palpate.errors import CurveError
from palpate_experiments.reading import Limits, Request, read_log
from palpate_experiments.reading.formats import read_here

from . import log_writers as write

h5py = pytest.importorskip("h5py")
pytest.importorskip("rosbags")

SMALL = Request(limits=Limits(values=1_000_000))


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
        with pytest.raises(CurveError, match=r"pickle.*could run code"):
            read_here(tmp_path / name, SMALL)
    assert not marker.exists()


def test_definitions_that_a_bag_carries_are_not_turned_into_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rosbags.typesys import store

    write.write_bag1(tmp_path / "log.bag", write.press(30))

    def generated(*_: object) -> None:
        raise AssertionError("code was generated")

    monkeypatch.setattr(store, "generate_python_code", generated, raising=False)
    for name in ("register", "deserialize_ros1", "deserialize_cdr"):
        monkeypatch.setattr(store.Typestore, name, generated)
    assert len(read_here(tmp_path / "log.bag", SMALL).streams) == 2


# ------------------------------------------------------------------- other files


def _secret(tmp_path: Path) -> Path:
    secret = tmp_path / "elsewhere"
    secret.mkdir()
    write.write_hdf5(secret / "secret.h5", write.press(60))
    np.arange(60.0).tofile(secret / "secret.bin")
    return secret


def test_hdf5_that_points_elsewhere_is_refused(tmp_path: Path) -> None:
    secret = _secret(tmp_path)
    folder = tmp_path / "given"
    folder.mkdir()
    layout = h5py.VirtualLayout(shape=(60,), dtype="f8")
    layout[:] = h5py.VirtualSource(str(secret / "secret.h5"), "log/x_m", shape=(60,))
    makers = {
        "a link to another place": (
            lambda file: file.__setitem__("a", h5py.ExternalLink(str(secret / "secret.h5"), "/log")),
            lambda file: file.__setitem__("a", h5py.SoftLink("/b")),
            lambda file: file.create_group("g").__setitem__("a", h5py.SoftLink("/g")),
        ),
        "keeps its numbers in another file": (
            lambda file: file.create_virtual_dataset("a", layout),
            lambda file: file.create_dataset(
                "a", (60,), "f8", external=[(str(secret / "secret.bin"), 0, h5py.h5f.UNLIMITED)]
            ),
        ),
    }
    for message, ways in makers.items():
        for index, make in enumerate(ways):
            path = folder / f"{index}.h5"
            write.write_hdf5(path, write.press(60))
            with h5py.File(path, "a") as file:
                make(file)
            with pytest.raises(CurveError, match=message):
                read_here(path, SMALL)


def test_groups_that_hold_themselves_are_walked_once(tmp_path: Path) -> None:
    path = tmp_path / "log.h5"
    write.write_hdf5(path, write.press(60))
    with h5py.File(path, "a") as file:
        file["log/again"] = file["log"]
    assert "'log.again' is another name" in read_here(path, SMALL).notes[0]


def test_a_bag_that_leads_out_of_its_folder_is_refused(tmp_path: Path) -> None:
    write.write_bag2(tmp_path / "other", write.press(60))
    write.write_bag2(tmp_path / "log", write.press(60))
    (tmp_path / "log" / "log.db3").unlink()
    (tmp_path / "log" / "log.db3").symlink_to(tmp_path / "other" / "other.db3")
    with pytest.raises(CurveError, match="links to a place outside of the bag"):
        read_here(tmp_path / "log", SMALL)


def test_the_metadata_of_a_bag_cannot_name_files_elsewhere(tmp_path: Path) -> None:
    write.write_bag2(tmp_path / "other", write.press(60))
    write.write_bag2(tmp_path / "log", write.press(60))
    (tmp_path / "log" / "log.db3").unlink()
    metadata = tmp_path / "log" / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("log.db3", "../other/other.db3"))
    with pytest.raises(CurveError, match="damaged or cut off"):
        read_here(tmp_path / "log", SMALL)


GUARDED = """
    import os, subprocess, socket, pickle, shutil, sys
    from pathlib import Path
    from palpate.sandbox import NotAllowedError, allow_only
    folder, scratch, other = map(Path, sys.argv[1:4])
    allow_only([folder], scratch)
    (scratch / "w").write_text("may be written")
    (scratch / "w").unlink()
    (folder / "log.csv").read_text()
    import csv, fractions  # modules still load
    tries = {
        "read": lambda: (other / "secret").read_text(),
        "dots": lambda: (folder / ".." / other.name / "secret").read_text(),
        "link": lambda: (folder / "link").read_text(),
        "write": lambda: (folder / "new").write_text("no"),
        "remove": lambda: (folder / "log.csv").unlink(),
        "tree": lambda: shutil.rmtree(folder),
        "rename": lambda: (folder / "log.csv").rename(folder / "b"),
        "program": lambda: subprocess.run(["true"]),
        "shell": lambda: os.system("true"),
        "fork": os.fork,
        "net": lambda: socket.socket(),
        "pickle": lambda: pickle.loads(b"cos\\nsystem\\n(S'true'\\ntR."),
    }
    for name, attempt in tries.items():
        try:
            attempt()
        except NotAllowedError:
            continue
        print("allowed:", name)
    print("done")
"""


def test_the_reading_process_can_reach_nothing_else(tmp_path: Path) -> None:
    folder, scratch, other = (tmp_path / name for name in ("folder", "scratch", "other"))
    for place in (folder, scratch, other):
        place.mkdir()
    (other / "secret").write_text("secret")
    (folder / "log.csv").write_text("a,b\n")
    (folder / "link").symlink_to(other / "secret")
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(GUARDED), str(folder), str(scratch), str(other)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout == "done\n", done.stderr
    assert (folder / "log.csv").exists()


# ------------------------------------------------------------------------- bombs


def test_archives_are_measured_before_they_are_unpacked(tmp_path: Path) -> None:
    write.npz_bomb(tmp_path / "log.npz", 64 << 20)
    write.matlab_bomb(tmp_path / "log.mat", 64 << 20)
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file.create_dataset("a", (1 << 40,), "f8", chunks=(1 << 20,), compression="gzip")
    with h5py.File(tmp_path / "chunk.h5", "w") as file:
        file.create_dataset("a", (10,), "f8", maxshape=(None,), chunks=(1 << 24,), compression="gzip")
    for name in ("log.npz", "log.mat", "log.h5", "chunk.h5"):
        assert (tmp_path / name).stat().st_size < 100_000
        with pytest.raises(CurveError, match=r"unpacks to \d+ bytes where at most 8000000 are read"):
            read_here(tmp_path / name, SMALL)


def test_a_header_that_promises_more_than_the_file_holds_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "log.npz", "w") as archive, archive.open("a.npy", "w") as member:
        np.lib.format.write_array_header_1_0(
            member, {"descr": "<f8", "fortran_order": False, "shape": (1 << 50,)}
        )
    with pytest.raises(CurveError, match=r"needs .* bytes and 128 are there"):
        read_here(tmp_path / "log.npz", SMALL)


def test_rows_of_parquet_are_counted_before_they_are_read(tmp_path: Path) -> None:
    import polars as pl

    pl.DataFrame({name: np.zeros(600_000) for name in "ab"}).write_parquet(tmp_path / "log.parquet")
    assert (tmp_path / "log.parquet").stat().st_size < 100_000
    with pytest.raises(CurveError, match="600000 rows of 2 columns would be 1200000 numbers"):
        read_here(tmp_path / "log.parquet", SMALL)


@pytest.mark.parametrize("text", ["root:$6$hash:19000\nbin:*:18000\n", "secret,other\nkey,word\n"])
def test_the_words_of_a_file_that_is_no_log_are_not_repeated(tmp_path: Path, text: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text)
    with pytest.raises(CurveError, match="no cell holds a number, so this is no log") as caught:
        read_here(path, replace(SMALL, columns=("time",)))
    assert not any(word in str(caught.value).removeprefix(str(path)) for word in ("hash", "secret"))


def test_large_files_are_not_opened(tmp_path: Path) -> None:
    with (tmp_path / "log.csv").open("wb") as stream:
        stream.truncate(3_000_000_000)
    with pytest.raises(CurveError, match="3000 MB where at most 2000 MB are read"):
        read_log(tmp_path / "log.csv", Request())


@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory are kept on Linux")
def test_a_reader_that_asks_for_too_much_memory_is_an_error(tmp_path: Path) -> None:
    write.write_text(tmp_path / "log.csv", write.press(30_000))
    limits = Limits(memory_mb=300)
    with pytest.raises(CurveError, match=r"log\.csv: (reading needs more memory|its reader ended)"):
        read_log(tmp_path / "log.csv", Request(limits=limits))


@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("import time; time.sleep(60)", "took longer than 0.2 s and was stopped"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", r"ended without an answer \(signal 11\)"),
        ("raise SystemExit('broken')", r"ended without an answer \(broken\)"),
        ("print('{')", "ended without an answer"),
        ('print(\'{"streams": [{"n_rows": 9000000000, "columns": []}]}\')', "would be 9000000000 numbers"),
    ],
)
def test_a_reader_that_hangs_or_dies_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, message: str
) -> None:
    write.write_text(tmp_path / "log.csv", write.press(30))
    popen = subprocess.Popen
    monkeypatch.setattr(sandbox, "_START_S", 0.0)
    monkeypatch.setattr(
        sandbox.subprocess, "Popen", lambda command, **how: popen([sys.executable, "-c", code], **how)
    )
    begun = time.monotonic()
    with pytest.raises(CurveError, match=message):
        read_log(tmp_path / "log.csv", Request(limits=Limits(time_s=2.0 if "sleep" not in code else 0.2)))
    assert time.monotonic() - begun < 30.0


def test_a_module_beside_the_log_is_not_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "numpy.py").write_text("raise SystemExit('imported')")
    write.write_text(tmp_path / "log.csv", write.press(30))
    monkeypatch.chdir(tmp_path)
    assert read_log(Path("log.csv"), Request()).streams[0].rows.size == 30


def test_a_reader_whose_caller_was_killed_leaves_no_folder(tmp_path: Path) -> None:
    write.write_text(tmp_path / "log.csv", write.press(30))
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    request = Request()
    asked = {
        "path": str(tmp_path / "log.csv"),
        "scratch": str(scratch),
        "columns": request.columns,
        "streams": request.streams,
        "text": request.text.model_dump(),
        "limits": request.limits.model_dump(),
    }
    command = [sys.executable, "-c", "from palpate_experiments.reading.child import main; main()"]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as process:
        process.stdout.close()
        process.stdin.write(json.dumps(asked).encode())
        process.stdin.close()
        process.wait(timeout=60.0)
    assert not scratch.exists()
