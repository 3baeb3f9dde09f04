"""Orders of elimination are searched once for a pattern, damaged files cost a search."""

import numpy as np
import pytest

from palpate.api.mechanics import SparseFactor
from palpate_jax import compiled as kept_orders
from palpate_jax.sparse import LinearSolver, Pattern

ELEMENTS = np.arange(24).reshape(2, 12)
PATTERN = Pattern([ELEMENTS, np.concatenate([ELEMENTS[:, :6], ELEMENTS[::-1, 6:]], axis=1)], 24)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(kept_orders.platformdirs, "user_cache_path", lambda name: tmp_path / name)
    return tmp_path / "palpate" / "orders"


def searched():
    return SparseFactor(PATTERN.indptr, PATTERN.indices, precision="single").order


def test_a_kept_order_is_the_searched_one(folder):
    LinearSolver(PATTERN)
    (file,) = folder.iterdir()
    assert np.array_equal(kept_orders.kept_order(file), searched())
    written = file.stat().st_mtime_ns
    LinearSolver(PATTERN)
    assert file.stat().st_mtime_ns == written


@pytest.mark.parametrize("damage", [lambda c: c[:40], lambda c: b"", lambda c: c[:-1] + bytes([c[-1] ^ 1])])
def test_a_damaged_file_is_replaced(folder, damage):
    LinearSolver(PATTERN)
    (file,) = folder.iterdir()
    content = file.read_bytes()
    file.write_bytes(damage(content))
    assert kept_orders.kept_order(file) is None
    LinearSolver(PATTERN)
    assert [f.read_bytes() for f in folder.iterdir()] == [content]


def test_a_folder_that_cannot_be_made_costs_a_search(tmp_path, monkeypatch):
    (tmp_path / "palpate").write_text("")
    monkeypatch.setattr(kept_orders.platformdirs, "user_cache_path", lambda name: tmp_path / name)
    assert LinearSolver(PATTERN).n_factorisations == 0


def test_another_pattern_has_another_file():
    other = Pattern([ELEMENTS], 24)
    names = {kept_orders.order_file(p.indptr, p.indices).name for p in (PATTERN, other)}
    assert len(names) == 2
