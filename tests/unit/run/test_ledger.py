"""The ledger: what it took is on the disk, what is damaged is named."""

import sqlite3
import subprocess
import sys

import numpy as np
import polars as pl
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from palpate.domain import Curve, Response, Simulation, Status, SurfaceStates
from palpate.errors import LedgerError
from palpate.run import ledger as ledgers
from palpate.run.atomic_files import write_atomically
from palpate.run.ledger import Ledger, Writer

from .stored import finished, job, read, response, same, write


def test_stored_results_are_read_back_to_the_last_bit(tmp_path):
    std = np.linspace(0.1, 1.0, 50)
    crashed = finished(5, Status.CRASHED, n_crashes=2, diagnostics={"n": [1, 0.1], "text": "µ"})
    write(tmp_path, *(finished(i) for i in range(4)), finished(4, response=response(5.0, std=std)), crashed)
    found = read(tmp_path, *range(7))
    assert list(found) == [f"key{i}" for i in range(6)]
    for i in range(5):
        simulation = found[f"key{i}"]
        assert (simulation.status, simulation.message, simulation.seconds) == (Status.OK, f"set {i}", 0.5 + i)
        same(simulation.response, response(1.0 + i, std=std if i == 4 else None))
    assert np.array_equal(found["key4"].response["torque"].std, std)
    assert found["key5"].response is None
    assert (found["key5"].status, found["key5"].n_crashes) == (Status.CRASHED, 2)
    assert found["key5"].diagnostics == crashed[1].diagnostics


NAMES = st.lists(st.sampled_from(["tissue.c1", "skin.E", "d_", "friction", "std"]), unique=True)
FINITE = arrays(np.float64, 5, elements=st.floats(allow_nan=False, allow_infinity=False))


@given(NAMES, st.data())
def test_slopes_are_read_back_to_the_last_bit(names, data):
    slopes = {name: data.draw(FINITE) for name in names}
    curve = Curve(channel="force", abscissa=np.arange(5.0), ordinate=data.draw(FINITE), slopes=slopes)
    simulation = Simulation(job=job(), status=Status.OK, response=Response(curves={"force": curve}))
    found = ledgers._simulation(job(), ["key", "p1", 0, "ok", "", 0.0, 0, "{}"], ledgers._arrays(simulation))
    assert found.response["force"].slopes.keys() == slopes.keys()
    for name, values in {"ordinate": curve.ordinate, **slopes}.items():
        read_back = found.response["force"]
        assert (read_back.slopes | {"ordinate": read_back.ordinate})[name].tobytes() == values.tobytes()


def test_states_of_the_skin_are_read_back_to_the_last_bit(tmp_path):
    n, k = 4, 3
    shapes = {
        "points_mm": (n, 3), "depth_mm": (k,), "rotation_deg": (k,), "positions_mm": (k, 3),
        "rotations": (k, 3, 3), "displacements_mm": (k, n, 3), "areas_mm2": (k, n), "touching": (k, n),
        "pressures_MPa": (k, n), "shears_MPa": (k, n, 3), "tractions_MPa": (k, n, 3),
    }  # fmt: skip
    draw = np.random.default_rng(2).normal
    states = SurfaceStates(
        triangles=[[0, 1, 2]], **{name: draw(size=shape) for name, shape in shapes.items()}
    )
    write(tmp_path, finished(0, surface=states), finished(1, Status.DIVERGED, response=None, surface=states))
    found = read(tmp_path, 0, 1)
    same(found["key0"].response, response(1.0))
    assert found["key1"].response is None
    for each in found.values():
        for name in (*shapes, "triangles"):
            assert getattr(each.surface, name).tobytes() == getattr(states, name).tobytes()


def test_the_last_attempt_counts(tmp_path):
    write(tmp_path, finished(1, Status.DIVERGED, response=response(9.0, std=np.ones(50))))
    write(tmp_path, finished(1, Status.OK))
    with Ledger(tmp_path) as ledger:
        (row,) = ledger.frame().to_dicts()
    assert (row["state"], row["n_attempts"]) == ("ok", 2)
    same(read(tmp_path, 1)["key1"].response, response(2.0))


def test_more_time_or_attempts_give_another_chance(tmp_path):
    late, crashed = finished(1, Status.TIMED_OUT, seconds=60.5), finished(2, Status.CRASHED, n_crashes=2)
    write(tmp_path, finished(0), late, crashed, finished(3, Status.CRASHED))
    with Ledger(tmp_path) as ledger:
        assert ledger.final(60.0, 2) == {"key0", "key1", "key2"}
        assert ledger.final(120.0, 2) == {"key0", "key2"}
        assert ledger.final(60.0, 3) == {"key0", "key1"}


def test_others_read_it_without_palpate(tmp_path):
    write(tmp_path, finished(0), finished(1))
    with sqlite3.connect(tmp_path / "ledger.sqlite") as connection:
        rows = pl.read_database("SELECT key, state, seconds FROM simulations ORDER BY key", connection)
        query = "SELECT data FROM arrays WHERE key = 'key1' AND channel = 'force' AND name = 'ordinate'"
        ((force,),) = connection.execute(query)
    connection.close()
    assert rows.rows() == [("key0", "ok", 0.5), ("key1", "ok", 1.5)]
    assert np.array_equal(np.frombuffer(force), response(2.0)["force"].ordinate)


def test_two_writers_share_a_cache(tmp_path):
    """Each waits for the other."""
    with Writer(tmp_path) as one, Writer(tmp_path) as other:
        for i in range(0, 20, 2):
            one.store(*finished(i))
            other.store(*finished(i + 1))
        other.store(*finished(0))
        one.flush()
        other.flush()
        assert len(read(tmp_path, *range(20))) == 20


def test_a_reader_sees_whole_groups_while_a_writer_writes(tmp_path):
    with Writer(tmp_path) as writer:
        writer.store(*finished(0))
        writer.flush()
        assert list(read(tmp_path, 0, 1)) == ["key0"]
        writer.store(*finished(1))
        writer.flush()
        assert list(read(tmp_path, 0, 1)) == ["key0", "key1"]


def test_the_sweep_is_planned_and_counted(tmp_path):
    with Writer(tmp_path) as writer:
        writer.plan(["key0", "key1", "key0"], [job(0), job(1), job(0, "p2")])
        writer.store(*finished(0))
    with Ledger(tmp_path) as ledger:
        assert ledger.counts() == {"left": 1, "ok": 1}
    with Writer(tmp_path) as writer:
        writer.plan(["key1"], [job(1)])
    with Ledger(tmp_path) as ledger:
        assert ledger.counts() == {"left": 1}


# ----------------------------------------------------------------------- damage


DAMAGES = (
    "UPDATE simulations SET seconds = 0.25 WHERE key = 'key1'",
    "UPDATE arrays SET data = zeroblob(400) WHERE key = 'key1' AND channel = 'force' AND name = 'ordinate'",
    "DELETE FROM arrays WHERE key = 'key1' AND channel = 'force'",
)


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_changed_simulation_is_named(tmp_path, damage):
    write(tmp_path, *(finished(i) for i in range(3)))
    with sqlite3.connect(tmp_path / "ledger.sqlite") as connection:
        connection.execute(damage)
    connection.close()
    assert list(read(tmp_path, 0, 2)) == ["key0", "key2"]
    with pytest.raises(LedgerError, match=r"ledger\.sqlite: damaged: simulation key1 .*Restore"):
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
            for i in range(40):
                same(found[f"key{i}"].response, response(1.0 + i))
    assert n_refused > 5


KILLED = """
import os, signal, sqlite3, sys
connection = sqlite3.connect(sys.argv[1], isolation_level=None)
connection.execute("PRAGMA cache_size = 1")  # pages are written before the commit
connection.execute("BEGIN IMMEDIATE")
connection.execute("UPDATE arrays SET data = zeroblob(4000)")
connection.execute("UPDATE simulations SET seconds = 9.0, message = 'half'")
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_writer_that_is_killed_in_a_commit_loses_only_what_it_had_in_hand(tmp_path):
    """Its journal is there, and the next to read undoes the half-written pages."""
    write(tmp_path, *(finished(i) for i in range(20)))
    path = tmp_path / "ledger.sqlite"
    before = path.read_bytes()
    subprocess.run([sys.executable, "-c", KILLED, path], check=False)
    assert (tmp_path / "ledger.sqlite-journal").stat().st_size > 0
    assert path.read_bytes() != before
    assert len(read(tmp_path, *range(20))) == 20
    assert path.read_bytes() == before
    write(tmp_path, finished(20))
    assert len(read(tmp_path, *range(21))) == 21


def test_a_link_in_place_of_a_written_file_is_not_followed(tmp_path, monkeypatch):
    victim = tmp_path / "victim"
    victim.write_text("mine")
    monkeypatch.setattr("palpate.run.atomic_files.temporary_name", lambda name: f".{name}.palpate")
    (tmp_path / ".a.json.palpate").symlink_to(victim)
    with pytest.raises(FileExistsError):
        write_atomically(tmp_path / "a.json", b"theirs")
    assert victim.read_text() == "mine"


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
        with pytest.raises(LedgerError, match="of version 99, while this palpate reads version 4"):
            use(tmp_path)


# -------------------------------------------------------------- a full disk


def test_a_full_database_stops_the_sweep(tmp_path):
    write(tmp_path, finished(0))
    with pytest.raises(LedgerError, match="no space is left"), Writer(tmp_path) as writer:  # noqa: PT012
        (pages,) = writer._connection.execute("PRAGMA page_count").fetchone()
        writer._connection.execute(f"PRAGMA max_page_count = {pages}")
        for i in range(1, 100):
            writer.store(*finished(i, Status.CRASHED))
    found = read(tmp_path, *range(100))
    assert "key0" in found
    assert len(found) < 100


def test_the_caller_hears_of_a_failure_at_the_next_store(tmp_path):
    def lost():
        raise LedgerError("lock lost")

    with pytest.raises(LedgerError, match="lock lost"), Writer(tmp_path, lost) as writer:  # noqa: PT012
        writer.store(*finished(0))
        writer.flush()
    assert not read(tmp_path, 0)


def test_a_copy_during_writes_is_consistent(tmp_path):
    with Writer(tmp_path / "run") as writer:
        for i in range(30):
            writer.store(*finished(i))
            if i == 15:
                with Ledger(tmp_path / "run") as ledger:
                    ledger.copy_to(tmp_path / "copy")
    with Ledger(tmp_path / "copy") as ledger:
        keys = ledger.seconds().keys()
        found = ledger.simulations({key: job() for key in keys})
    assert found.keys() == keys <= {f"key{i}" for i in range(16)}
    write(tmp_path / "copy", *(finished(i) for i in range(16, 30)))
    with Ledger(tmp_path / "run") as ledger, pytest.raises(LedgerError, match="already there"):
        ledger.copy_to(tmp_path / "copy")
