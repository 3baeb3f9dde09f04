"""Lines of TOML keys."""

import tomllib

import pytest
from hypothesis import given, strategies as st

from palpate.study.source_positions import Key, KeyLines, dotted

TEXT = '''\
# a comment = [with]
[study]
name = "x" # [no.header]
about = """long
[fake]
b = 1 \\""" still
"""
raw = \'\'\'
c = 2\'\'\'
quoted = """she said "no""""
[[spot]]
name = "p1"
a.b = 3

[[spot]]
"name" = 'p2'
position = [
  "0 mm",  # first, with ] and }
  "1 mm",
]
[spot.files]
force = { path = "a.csv", more = { z = 1 } }
[region."soft tissue".parameters]
c1 = { lower = "0.1 MPa", upper = "]" }
"d.e" = 2
[[spot]]
[[spot.twist]]
k = 1
'''

EXPECTED: dict[Key, int] = {
    (): 1,
    ("study",): 2,
    ("study", "name"): 3,
    ("study", "about"): 4,
    ("study", "raw"): 8,
    ("spot",): 11,
    ("spot", 0): 11,
    ("spot", 0, "name"): 12,
    ("spot", 0, "a", "b"): 13,
    ("spot", 1): 15,
    ("spot", 1, "name"): 16,
    ("spot", 1, "position"): 17,
    ("spot", 1, "position", 1): 17,
    ("spot", 1, "files"): 21,
    ("spot", 1, "files", "force", "more", "z"): 22,
    ("region",): 23,
    ("region", "soft tissue"): 23,
    ("region", "soft tissue", "parameters"): 23,
    ("region", "soft tissue", "parameters", "c1", "upper"): 24,
    ("region", "soft tissue", "parameters", "d.e"): 25,
    ("spot", 2): 26,
    ("spot", 2, "twist", 0, "k"): 28,
}


@pytest.mark.parametrize(("key", "line"), EXPECTED.items(), ids=map(dotted, EXPECTED))
def test_a_key_is_found_on_its_line(key: Key, line: int) -> None:
    tomllib.loads(TEXT)
    assert KeyLines(TEXT).line(key) == line


@pytest.mark.parametrize(
    ("key", "line"),
    [
        (("spot", 1, "mesh"), 15),
        (("spot", 7, "mesh"), 11),
        (("study", "name", "deeper"), 3),
        (("nothing", "here"), 1),
    ],
)
def test_an_absent_key_takes_the_line_of_what_would_hold_it(key: Key, line: int) -> None:
    assert KeyLines(TEXT).line(key) == line


def test_an_empty_text_has_a_first_line() -> None:
    assert KeyLines("").line(("a",)) == 1


def test_keys_are_written_as_in_toml() -> None:
    assert dotted(("spot", 0, "measured", "force")) == "spot[0].measured.force"
    assert dotted(()) == ""


names = st.text("abcdefgh_-", min_size=1, max_size=6)
values = st.sampled_from(
    ["1", "-2.5e3", "true", '"te]xt"', "'li}teral'", "[1, [2, 3]]", '{ x = 1, y = "a" }', "[]", "{}"]
)


@given(st.dictionaries(names, st.dictionaries(names, values, max_size=4), min_size=1, max_size=5))
def test_tables_of_any_content_keep_their_lines(tables: dict[str, dict[str, str]]) -> None:
    lines, expected = [], {}
    for table, pairs in tables.items():
        lines.append(f"[{table}]")
        expected[table,] = len(lines)
        for key, value in pairs.items():
            lines.append(f"{key} = {value}")
            expected[table, key] = len(lines)
    text = "\n".join(lines)
    tomllib.loads(text)
    found = KeyLines(text)
    assert {key: found.line(key) for key in expected} == expected
