"""What a plugin's section puts into the cells of its tables can be shown, or is refused by its place."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate.errors import PluginError
from palpate.plugins.sections import Fold, Lines, Section, Table, Word
from palpate_report.data.showable import checked
from palpate_report.page.html import template


class Extra(Section):
    name, title, summary = "extra", "More", "a table"

    def blocks(self, data, report):
        return ()


@pytest.mark.parametrize(
    ("cell", "said"),
    [
        ([1, 2], "[1, 2] is no cell; give a number, a text, None, Word or Lines"),
        (Lines([1, Lines([])]), "is one of several lines; give values and words"),
        (Lines([1, {}]), "{} is no cell"),
        (Word(3), "a word is 3; give a text"),
    ],
)
@pytest.mark.parametrize("folded", [False, True])
def test_a_cell_that_cannot_be_shown_is_refused_by_its_place(cell, said, folded):
    table = Table("Sums", ["a", "b"], [[1, 2], [1, cell]])
    with pytest.raises(PluginError) as refused:
        checked(Extra(), [Fold("more", [table])] if folded else [table])
    assert "section 'extra', table 'Sums', column 'b', row 1: " in str(refused.value)
    assert said in str(refused.value)


values = (
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=9) | st.builds(Word, st.text())
)
cells = st.one_of(
    values,
    st.builds(Lines, st.lists(values, max_size=3)),
    st.floats(0.0, 1.0).map(np.float64),
    st.integers(0, 9).map(np.int64),
)


@given(st.lists(cells, min_size=1, max_size=4))
def test_every_other_cell_is_shown(row):
    table = Table("Sums", [f"column {k}" for k in range(len(row))], [row])
    (block,) = checked(Extra(), [table])
    page = template("index.html.jinja")
    shown = page.environment.get_template("blocks.html.jinja").make_module().table(block)
    assert shown.count("</td>") + shown.count("</th>") == 2 * len(row)


def test_a_column_is_of_numbers_if_most_of_its_cells_are():
    rows = [["a", 1.0, "x", None], ["b", "fit", 3, None], ["c", Lines([2.0, "1 to 3"]), "y", None]]
    assert Table("Values", ["name", "value", "setting", "none"], rows).is_number == (
        False,
        True,
        False,
        False,
    )
