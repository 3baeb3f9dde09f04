"""The cache of results: shared where they end alike, and corrupt files are as none."""

import hashlib

import pytest

from palpate.domain import Status
from palpate.run.ledger.cache import ResultCache

from .stored import finished, job, response, same


def test_studies_share_what_would_end_the_same_way_again(tmp_path):
    cache = ResultCache(tmp_path)
    for i, status in enumerate(Status):
        cache.store(f"key{i}", finished(i, status).simulation)
    found = {status: cache.load(f"key{i}", job(9)) for i, status in enumerate(Status)}
    assert {s for s, simulation in found.items() if simulation} == {
        Status.OK, Status.DIVERGED, Status.UNREADABLE,
    }  # fmt: skip
    same(found[Status.DIVERGED].response, response(2.0))
    assert found[Status.OK].job.set_id == 9


def test_a_corrupt_file_of_the_cache_is_as_none(tmp_path):
    cache = ResultCache(tmp_path)
    cache.store("key0", finished(0).simulation)
    (path,) = tmp_path.rglob("*.simulation")
    whole = path.read_bytes()
    other_head = [whole.replace(b'"status"', b'"stbtus"'), whole.replace(b'"ok"', b'"nk"'), b"[]\n"]
    for corrupt in (b"", whole[:20], whole[:-1], whole[:-9] + b"x" + whole[-8:], *other_head):
        path.write_bytes(corrupt)
        assert cache.load("key0", job()) is None
        cache.store("key0", finished(0).simulation)
        assert path.read_bytes() == whole


def test_two_files_of_the_cache_that_were_exchanged_are_as_none(tmp_path):
    cache = ResultCache(tmp_path)
    for key in ("key0", "key1"):
        cache.store(key, finished(int(key[-1])).simulation)
    one, two = sorted(tmp_path.rglob("*.simulation"))
    first, second = one.read_bytes(), two.read_bytes()
    one.write_bytes(second)
    two.write_bytes(first)
    assert cache.load("key0", job()) is cache.load("key1", job()) is None
    cache.store("key0", finished(0).simulation)
    assert one.read_bytes() == first


HEAD = b'{"status": "ok", "message": "", "seconds": 1.0, "diagnostics": {}}'


@pytest.mark.parametrize(
    "content",
    [
        HEAD + b"\nno Parquet",
        HEAD + b"\n",
        HEAD.replace(b"1.0", b'"x"') + b"\n",
        HEAD.replace(b"{}", b"3") + b"\n",
        HEAD.replace(b"{}", b"[" * 100_000) + b"\n",
        HEAD,
    ],
)
def test_a_file_of_the_cache_with_a_right_checksum_and_no_simulation_is_as_none(tmp_path, content):
    path = tmp_path / "ke" / "key0.simulation"
    path.parent.mkdir()
    path.write_bytes(hashlib.sha256(b"key0\n" + content).hexdigest().encode() + b"\n" + content)
    cache = ResultCache(tmp_path)
    assert cache.load("key0", job()) is None
    cache.store("key0", finished(0).simulation)
    same(cache.load("key0", job()).response, response(1.0))
