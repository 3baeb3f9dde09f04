"""Laws of Latin hypercubes, against the generator written out in Python."""

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate import _core
from palpate.errors import SamplingError

WORD = 2**64 - 1
SEEDS = st.integers(0, WORD)


def split_mix(state: int) -> Iterator[int]:
    """SplitMix64 of Vigna."""
    while True:
        state = (state + 0x9E3779B97F4A7C15) & WORD
        z = state
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & WORD
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & WORD
        yield z ^ (z >> 31)


def xoshiro(seed: int) -> Iterator[int]:
    """xoshiro256++ of Blackman and Vigna."""
    words = split_mix(seed)
    s = [next(words) for _ in range(4)]

    def rotated(x: int, k: int) -> int:
        return ((x << k) | (x >> (64 - k))) & WORD

    while True:
        yield (rotated((s[0] + s[3]) & WORD, 23) + s[0]) & WORD
        t = (s[1] << 17) & WORD
        s[2] ^= s[0]
        s[3] ^= s[1]
        s[1] ^= s[2]
        s[0] ^= s[3]
        s[2] ^= t
        s[3] = rotated(s[3], 45)


def by_python(n: int, d: int, seed: int) -> list[list[float]]:
    """The design by its documentation; rejection is too rare to occur here."""
    words = xoshiro(seed)
    columns = []
    for _ in range(d):
        strata = list(range(n))
        for last in range(n - 1, 0, -1):
            chosen = ((next(words) >> 32) * (last + 1)) >> 32
            strata[last], strata[chosen] = strata[chosen], strata[last]
        columns.append([(k + ((next(words) >> 12) + 0.5) / 2**52) / n for k in strata])
    return [list(row) for row in zip(*columns, strict=True)]


@given(st.integers(1, 80), st.integers(1, 4), SEEDS)
def test_a_design_has_the_bits_of_its_published_recipe(n, d, seed):
    np.testing.assert_array_equal(_core.latin_hypercube(n, d, seed), by_python(n, d, seed))


@given(st.integers(1, 300), st.integers(1, 6), SEEDS, st.booleans())
def test_every_stratum_of_every_column_holds_one_set(n, d, seed, centred):
    design = _core.latin_hypercube(n, d, seed, centred=centred)
    assert design.shape == (n, d)
    strata = np.sort(np.floor(design * n), axis=0)
    np.testing.assert_array_equal(strata, np.repeat(np.arange(n)[:, None], d, axis=1))
    if centred:
        np.testing.assert_allclose(design * n - np.floor(design * n), 0.5, atol=1e-9)


@given(st.integers(10, 60), st.integers(1, 4), SEEDS)
def test_another_seed_is_another_design(n, d, seed):
    design = _core.latin_hypercube(n, d, seed)
    assert (design != _core.latin_hypercube(n, d, seed ^ 1)).any()
    centred = _core.latin_hypercube(n, d, seed, centred=True)
    np.testing.assert_array_equal(np.floor(design * n), np.floor(centred * n))


def test_columns_are_uncorrelated():
    design = _core.latin_hypercube(20_000, 3, 1)
    correlation = np.corrcoef(design.T) - np.eye(3)
    assert np.abs(correlation).max() < 5 / np.sqrt(20_000)


@pytest.mark.parametrize(
    ("n", "d", "seed", "message"),
    [
        (0, 2, 1, "n = 0"),
        (2, 0, 1, "d = 0"),
        (-1, 2, 1, "n is -1"),
        (2, 2, 2**64, "seed is"),
        (2**40, 2**40, 1, "exceeds"),
        (2**29, 1, 1, "exceeds"),
    ],
)
def test_an_impossible_design_is_named(n, d, seed, message):
    with pytest.raises(SamplingError, match=message):
        _core.latin_hypercube(n, d, seed)


def test_a_fraction_of_a_set_is_a_type_error():
    with pytest.raises(TypeError, match=r"n is 2\.5"):
        _core.latin_hypercube(2.5, 1, 1)  # type: ignore[arg-type]
