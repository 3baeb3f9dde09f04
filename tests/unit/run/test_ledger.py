"""The ledger: what it took is on the disk, what is damaged is named."""

import errno
import io
import os
import shutil
import sqlite3
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from palpate.domain import Curve, Response, Status
from palpate.errors import LedgerError
from palpate.run.atomic_files import write_atomically
from palpate.run.ledger import Entry, Ledger, Writer
from palpate.run.ledger.curve_files import pack, unpack

from .stored import finished, job, read, response, same, write


def test_stored_results_are_read_back_to_the_last_bit(tmp_path):
    write(tmp_path, *(finished(i) for i in range(5)), finished(5, Status.CRASHED, quarantined=2))
    found = read(tmp_path, *range(7))
    assert list(found) == [f"key{i}" for i in range(6)]
    for i in range(5):
        simulation = found[f"key{i}"]
        assert (simulation.status, simulation.message, simulation.seconds) == (Status.OK, f"set {i}", 0.5 + i)
        same(simulation.response, response(1.0 + i))
    assert found["key5"].response is None
    with Ledger(tmp_path) as ledger:
        assert ledger.entries()["key5"] == Entry(Status.CRASHED, 5.5, quarantined=2)


def test_curves_of_many_keys_share_a_file_and_stay_apart():
    std = np.linspace(0.1, 1.0, 50)
    every = {
        "a": response(2.0, std=std),
        "none": Response(curves={}),
        "b": Response(curves={"torque": response(3.0)["torque"]}),
    }
    found = unpack(pack(every), ["b", "none", "a"])
    for key, expected in every.items():
        same(found[key], expected)
    assert np.array_equal(found["a"]["torque"].std, std)
    assert unpack(pack({}), []) == {}


NAMES = st.lists(st.sampled_from(["tissue.c1", "skin.E", "d_", "friction", "std"]), unique=True)


@given(st.lists(NAMES, min_size=1, max_size=3), st.data())
def test_slopes_are_read_back_to_the_last_bit(names_of_each, data):
    """Of curves with different parameters in one file; a file without slopes has no column for them."""
    finite = arrays(np.float64, 5, elements=st.floats(allow_nan=False, allow_infinity=False))
    curve = Curve(channel="force", abscissa=np.arange(5.0), ordinate=np.ones(5))
    every = {
        f"key{k}": Response(curves={"force": replace(curve, slopes={n: data.draw(finite) for n in names})})
        for k, names in enumerate(names_of_each)
    }
    content = pack(every)
    for key, found in unpack(content, list(every)).items():
        expected = every[key]["force"].slopes
        assert found["force"].slopes.keys() == expected.keys()
        for name, values in expected.items():
            assert found["force"].slopes[name].tobytes() == values.tobytes()
    columns = set(pl.read_parquet(io.BytesIO(content)).columns[6:])
    assert columns == {f"d_{name}" for names in names_of_each for name in names}


def test_rows_that_cannot_be_used_are_unreadable_and_block_nothing(tmp_path):
    bad = {}
    for set_id, values in ((1, [0.0, np.nan]), (2, [0.0, 0.0])):
        curve = Curve(channel="force", abscissa=[0.0, 1.0], ordinate=[0.0, 1.0])
        object.__setattr__(curve, "ordinate", np.array(values))
        bad[set_id] = Response(curves={"force": curve})
    bad[3] = None
    rows = [finished(0)]
    rows += [
        replace(finished(i), simulation=replace(finished(i).simulation, response=r)) for i, r in bad.items()
    ]
    write(tmp_path, *rows)
    found = read(tmp_path, 0, 1, 2, 3)
    assert [s.status for s in found.values()] == [Status.OK] + [Status.UNREADABLE] * 3
    same(found["key0"].response, response(1.0))
    assert "ordinate[1] is nan" in found["key1"].message
    assert "no contact" in found["key2"].message
    assert "ok without a curve" in found["key3"].message


def test_each_attempt_stays_on_record_and_the_last_counts(tmp_path):
    write(tmp_path, finished(1, Status.DIVERGED))
    write(tmp_path, finished(1, Status.OK))
    with Ledger(tmp_path) as ledger:
        (row,) = ledger.frame("simulations").to_dicts()
        attempts = ledger.frame("attempts").sort("attempt")
    assert (row["state"], row["n_attempts"]) == ("ok", 2)
    assert attempts["state"].to_list() == ["diverged", "ok"]
    assert pl.read_parquet(tmp_path / "curves" / row["curves"]).height == 100
    assert pl.read_parquet(tmp_path / "curves" / "*.parquet").height == 200


def test_others_read_it_without_palpate(tmp_path):
    write(tmp_path, finished(0), finished(1))
    with sqlite3.connect(tmp_path / "ledger.sqlite") as connection:
        rows = pl.read_database("SELECT key, state, seconds FROM simulations ORDER BY key", connection)
    connection.close()
    assert rows.rows() == [("key0", "ok", 0.5), ("key1", "ok", 1.5)]
    curves = pl.scan_parquet(tmp_path / "curves" / "*.parquet").filter(pl.col("key") == "key1").collect()
    assert curves.columns == ["key", "channel", "point", "abscissa", "ordinate", "std"]
    assert curves.height == 100


def test_a_reader_sees_whole_groups_while_a_writer_writes(tmp_path):
    with Writer(tmp_path) as writer:
        writer.store(finished(0))
        writer.flush()
        assert list(read(tmp_path, 0, 1)) == ["key0"]
        writer.store(finished(1))
        writer.flush()
        assert list(read(tmp_path, 0, 1)) == ["key0", "key1"]


def test_a_folder_of_which_nothing_may_be_written_is_read(tmp_path, monkeypatch):
    """SQLite reads a journalled file only where it can write next to it; root can everywhere."""

    class Refusing(sqlite3.Connection):
        def execute(self, *_):
            raise sqlite3.OperationalError("unable to open database file")

    connect = sqlite3.connect

    def refuse(location, **options):
        kind = sqlite3.Connection if "immutable" in location else Refusing
        return connect(location, factory=kind, **options)

    write(tmp_path, finished(0))
    monkeypatch.setattr(sqlite3, "connect", refuse)
    assert list(read(tmp_path, 0)) == ["key0"]
    (tmp_path / "ledger.sqlite-wal").write_bytes(b"groups that only a writer can bring in")
    with pytest.raises(LedgerError, match="unable to open"):
        read(tmp_path, 0)


def test_the_sweep_is_planned_and_counted(tmp_path):
    with Writer(tmp_path) as writer:
        writer.plan(["key0", "key1", "key0"], [job(0), job(1), job(0, "p2")])
        writer.store(finished(0))
    with Ledger(tmp_path) as ledger:
        assert ledger.counts() == {"left": 1, "ok": 1}
    with Writer(tmp_path) as writer:
        writer.plan(["key1"], [job(1)])
    with Ledger(tmp_path) as ledger:
        assert ledger.counts() == {"left": 1}


# ----------------------------------------------------------------------- damage


def test_a_flipped_bit_of_a_row_is_named(tmp_path):
    write(tmp_path, *(finished(i) for i in range(3)))
    with sqlite3.connect(tmp_path / "ledger.sqlite") as connection:
        connection.execute("UPDATE simulations SET seconds = 0.25 WHERE key = 'key1'")
    connection.close()
    assert list(read(tmp_path, 0, 2)) == ["key0", "key2"]
    with pytest.raises(LedgerError, match=r"ledger\.sqlite: damaged: the row of simulation key1 .*Restore"):
        read(tmp_path, 0, 1)


def test_flipped_bytes_are_refused_or_harmless_but_never_read_as_other_numbers(tmp_path):
    write(tmp_path, *(finished(i) for i in range(40)))
    path = tmp_path / "ledger.sqlite"
    whole, expected = path.read_bytes(), {f"key{i}": 0.5 + i for i in range(40)}
    n_refused = 0
    for place in np.random.default_rng(1).integers(0, len(whole), 60):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0x10]) + whole[place + 1 :])
        try:
            found = read(tmp_path, *range(40))
            with Writer(tmp_path):
                pass
        except LedgerError as error:
            n_refused += 1
            assert "ledger.sqlite" in str(error)  # noqa: PT017 - it may also be read
        else:
            assert all(s.seconds == expected[key] for key, s in found.items())
    assert n_refused > 5


@pytest.mark.parametrize("where", [30, 0.5, -20])
def test_a_flipped_bit_of_the_curves_is_named(tmp_path, where):
    write(tmp_path, finished(0))
    path = tmp_path / "curves" / "000001.parquet"
    content = bytearray(path.read_bytes())
    content[int(where * len(content)) if isinstance(where, float) else where] ^= 1
    path.write_bytes(content)
    with pytest.raises(
        LedgerError, match=r"000001\.parquet: not as it was written.*delete the file to have its 1 sim"
    ):
        read(tmp_path, 0)


def test_curves_cut_short_are_to_be_done_again(tmp_path):
    write(tmp_path, finished(0))
    write(tmp_path, finished(1))
    path = tmp_path / "curves" / "000001.parquet"
    path.write_bytes(path.read_bytes()[:-1])
    with Ledger(tmp_path) as ledger:
        assert ledger.without_curves() == {"key0"}
    assert list(read(tmp_path, 0, 1)) == ["key1"]


@pytest.fixture
def killed(tmp_path):
    """Make copies of a ledger whose writer was killed after six groups, with what is made of its journal."""
    with Writer(tmp_path / "run") as writer:
        for i in range(6):
            writer.store(finished(i))
            writer.flush()
        whole = tmp_path / "whole"
        shutil.copytree(tmp_path / "run", whole)

    def copy(name, damage):
        folder = tmp_path / name
        shutil.copytree(whole, folder)
        path = folder / "ledger.sqlite-wal"
        path.write_bytes(damage(path.read_bytes()))
        return folder

    return copy


def flipped(content, place):
    return content[:place] + bytes([content[place] ^ 0x04]) + content[place + 1 :]


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        ("cut in a page", lambda wal: wal[:-1000]),
        ("cut between frames", lambda wal: wal[:-4120]),
        ("a bit of the end", lambda wal: flipped(wal, len(wal) - 50)),
    ],
)
def test_a_torn_journal_costs_its_last_group_and_is_reported(killed, name, damage):
    """What a power cut leaves of the journal."""
    folder = killed("copy", damage)
    assert list(read(folder, *range(6))) == [f"key{i}" for i in range(5)]
    with Writer(folder) as writer:
        assert "the last group of simulations was not written completely" in writer.repaired
        writer.store(finished(5))
    assert len(read(folder, *range(6))) == 6


def test_a_log_that_lost_more_than_the_last_group_is_refused_by_reader_and_writer(killed):
    """SQLite drops in silence what follows a damaged frame, a damaged header, or a log that was removed."""
    whole = killed("untouched", lambda wal: wal)
    assert Writer(whole).__enter__().repaired == ""
    for place in (9, 20, 32 + 3, 32 + 4120 * 2 + 500, None):
        damage = (lambda wal: b"") if place is None else (lambda wal, place=place: flipped(wal, place))
        folder = killed(f"flipped {place}", damage)
        damaged = (folder / "ledger.sqlite-wal").read_bytes()
        for use in (write, read):
            with pytest.raises(
                LedgerError, match=r"ledger\.sqlite: damaged: .*000006\.parquet.*Restore a copy"
            ):
                use(folder)
        assert (folder / "ledger.sqlite-wal").read_bytes() == damaged
    for path in sorted((folder / "curves").iterdir())[int(place is None) :]:
        path.unlink()
    write(folder, *(finished(i) for i in range(6)))
    assert len(read(folder, *range(6))) == 6


def test_failures_are_missed_too_when_the_log_loses_them(tmp_path):
    with Writer(tmp_path / "run") as writer:
        for i in range(4):
            writer.store(finished(i, Status.TIMED_OUT))
            writer.flush()
        shutil.copytree(tmp_path / "run", tmp_path / "copy")
    (tmp_path / "copy" / "ledger.sqlite-wal").unlink()
    with pytest.raises(LedgerError, match=r"files up to 000004\.parquet"):
        read(tmp_path / "copy")


@pytest.mark.parametrize("table", ["simulations", "attempts"])
def test_a_row_that_is_gone_is_missed(tmp_path, table):
    write(tmp_path, *(finished(i) for i in range(3)))
    with sqlite3.connect(tmp_path / "ledger.sqlite") as connection:
        connection.execute(f"DELETE FROM {table} WHERE key = 'key1'")
    connection.close()
    for use in (write, read):
        with pytest.raises(LedgerError, match="damaged: 3 attempts were written, "):
            use(tmp_path)


@pytest.mark.parametrize("name", ["../../.bashrc", "/etc/passwd", "..", "x.parquet", "000001.parquet/../x"])
def test_a_ledger_that_names_any_other_file_is_refused(tmp_path, name):
    write(tmp_path / "run", finished(0))
    (tmp_path / ".bashrc").write_text("mine")
    with sqlite3.connect(tmp_path / "run" / "ledger.sqlite") as connection:
        connection.execute("UPDATE curve_files SET name = ?", (name,))
    connection.close()
    with Ledger(tmp_path / "run") as ledger:
        for use in (ledger.without_curves, lambda: ledger.copy_to(tmp_path / "home" / "fork")):
            with pytest.raises(LedgerError, match="is not a name of a file of curves"):
                use()
    assert (tmp_path / ".bashrc").read_text() == "mine"


def test_a_link_in_place_of_a_written_file_is_not_followed(tmp_path, monkeypatch):
    victim = tmp_path / "victim"
    victim.write_text("mine")
    monkeypatch.setattr("palpate.run.atomic_files.temporary_name", lambda name: f".{name}.palpate")
    (tmp_path / ".a.json.palpate").symlink_to(victim)
    with pytest.raises(FileExistsError):
        write_atomically(tmp_path / "a.json", b"theirs")
    assert victim.read_text() == "mine"


def test_an_emptied_ledger_next_to_its_curves_is_refused(tmp_path):
    for i in range(3):
        write(tmp_path, finished(i))
    (tmp_path / "ledger.sqlite").write_bytes(b"")
    with pytest.raises(LedgerError, match=r"curves/ has files up to 000003\.parquet.*Restore"):
        write(tmp_path)
    assert len(list((tmp_path / "curves").iterdir())) == 3


def test_what_is_no_ledger_or_another_version_is_refused(tmp_path):
    (tmp_path / "ledger.sqlite").write_text("not a database, and long enough to be none " * 5)
    for use in (write, read):
        with pytest.raises(LedgerError, match=r"ledger\.sqlite: damaged: file is not a database"):
            use(tmp_path)
    (tmp_path / "ledger.sqlite").unlink()
    with sqlite3.connect(tmp_path / "ledger.sqlite") as connection:
        connection.execute("CREATE TABLE birds (name)")
    connection.close()
    with pytest.raises(LedgerError, match="not a ledger of palpate"):
        read(tmp_path)
    (tmp_path / "ledger.sqlite").unlink()
    write(tmp_path)
    with sqlite3.connect(tmp_path / "ledger.sqlite") as connection:
        connection.execute("PRAGMA user_version = 99")
    connection.close()
    for use in (write, read):
        with pytest.raises(LedgerError, match="of version 99, while this palpate reads version 3"):
            use(tmp_path)


# -------------------------------------------------------------- a full disk


@pytest.mark.parametrize(
    ("code", "reported"),
    [
        (errno.ENOSPC, r"no space is left on the disk \(No space left on device\); make room"),
        (errno.EIO, r"cannot be written or read \(Input/output error\); check the disk"),
        (errno.EROFS, "give write permission"),
    ],
)
@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_disk_that_fails_stops_the_sweep_and_keeps_what_was(tmp_path, monkeypatch, code, reported, call):
    write(tmp_path, finished(0))

    def failing(*_):
        raise OSError(code, os.strerror(code))

    with monkeypatch.context() as broken:
        broken.setattr(os, call, failing)
        with pytest.raises(LedgerError, match=rf"{reported}.*; everything finished before is kept"):
            write(tmp_path, finished(1))
    assert list(read(tmp_path, 0, 1)) == ["key0"]
    assert [path.suffix for path in (tmp_path / "curves").iterdir()].count(".palpate") == 0
    write(tmp_path, finished(1))
    assert list(read(tmp_path, 0, 1)) == ["key0", "key1"]


def test_a_full_database_stops_the_sweep(tmp_path):
    write(tmp_path, finished(0))
    with pytest.raises(LedgerError, match="no space is left"), Writer(tmp_path) as writer:  # noqa: PT012
        (pages,) = writer._connection.execute("PRAGMA page_count").fetchone()
        writer._connection.execute(f"PRAGMA max_page_count = {pages}")
        for i in range(1, 100):
            writer.store(finished(i, Status.CRASHED))
    found = read(tmp_path, *range(100))
    assert "key0" in found
    assert len(found) < 100


def test_the_caller_hears_of_a_failure_at_the_next_store(tmp_path):
    def lost():
        raise LedgerError("lock lost")

    with pytest.raises(LedgerError, match="lock lost"), Writer(tmp_path, lost) as writer:  # noqa: PT012
        writer.store(finished(0))
        writer.flush()
    assert not read(tmp_path, 0)


def test_a_copy_during_writes_is_consistent(tmp_path):
    with Writer(tmp_path / "run") as writer:
        for i in range(30):
            writer.store(finished(i))
            if i == 15:
                with Ledger(tmp_path / "run") as ledger:
                    ledger.copy_to(tmp_path / "copy")
    with Ledger(tmp_path / "copy") as ledger:
        entries = ledger.entries()
        found = ledger.simulations({key: job() for key in entries})
    assert set(found) == set(entries) <= {f"key{i}" for i in range(16)}
    write(tmp_path / "copy", *(finished(i) for i in range(16, 30)))
    with Ledger(tmp_path / "run") as ledger, pytest.raises(LedgerError, match="already there"):
        ledger.copy_to(tmp_path / "copy")
