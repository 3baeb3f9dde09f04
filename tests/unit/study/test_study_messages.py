"""Mistakes of a whole study file: all at once, in its order, in plain lines."""

from pathlib import Path

import pytest

from palpate.errors import StudyError
from palpate.plugins.catalogue import Plugins
from palpate.study.reading import read_study

from .test_study_errors import CASES
from .toy_study import TEXT, TOY, messages


def test_all_mistakes_are_reported_at_once_in_the_order_of_the_file(tmp_path: Path, plugins: Plugins) -> None:
    text = TEXT
    for case in ("data", "file missing", "loader", "unit unknown", "n_sets 1", "solver", "generalise_by"):
        text = text.replace(*CASES[case][:2], 1)
    found = messages(tmp_path, plugins, text)
    keys = [line.split(": ")[1] for line in found]
    assert keys == [
        "study.data",
        "spot 's2', measured.pull",
        "experiment.loader",
        "region.rubber.parameters.k.lower",
        "sampling.n_sets",
        "solver.name",
        "selection.generalise_by",
    ]


def test_missing_tables_are_named(tmp_path: Path, plugins: Plugins) -> None:
    found = messages(tmp_path, plugins, "")
    for table in ("study", "spot", "experiment", "region", "sampling", "solver", "selection"):
        assert f"1: missing table [{table}]; add it" in found


def test_a_table_in_comments_repeats_its_question(tmp_path: Path, plugins: Plugins) -> None:
    asked = "# answer first: which is the depth? name it\n# answer first: give scale\n# or not\n"
    asked = f'# a remark\n{asked}# [experiment]\n# loader = "csv"\n'
    shown = "[experiment] is in comments; answer first: which is the depth? name it; give scale; then remove"
    assert any(shown in line for line in messages(tmp_path, plugins, asked))
    remark = "# a study of mine\n# [experiment]\n"
    assert any("missing table [experiment]; add it" in line for line in messages(tmp_path, plugins, remark))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"[study]\nname = \n", "line 2"),
        (b"[study]\nname = '\xff'\n", "is not UTF-8"),
        (None, "`palpate init` makes a study"),
    ],
)
def test_a_file_that_cannot_be_read(
    tmp_path: Path, plugins: Plugins, content: bytes | None, message: str
) -> None:
    path = tmp_path / "study.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(StudyError) as caught:
        read_study(path, plugins)
    assert str(caught.value).startswith(str(path))
    assert message in str(caught.value)


def test_a_broken_plugin_is_named_where_its_entry_is_missed(tmp_path: Path) -> None:
    bad = tmp_path / "bad.py"
    bad.write_text("import nowhere_at_all\n")
    plugins = Plugins.load([TOY / "toy_plugin.py", bad], entry_points=False)
    (found,) = messages(tmp_path, plugins, TEXT.replace('"spring"', '"yeoh"'))
    assert "No module named 'nowhere_at_all'" in found


def test_a_key_of_two_kinds_of_values_is_named_alone(tmp_path: Path, plugins: Plugins) -> None:
    found = messages(tmp_path, plugins, TEXT.replace("[truth]", "[fit]\nfine_edge = 7\n[truth]"))
    assert [line.split(": ", 1)[1] for line in found] == [
        'fit.fine_edge: 7 has no unit; write "7 mm"',
        "fit.fine_edge: 7 is not one of 'auto'",
    ]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("= 20", "= 2.5", "sampling.n_sets: 2.5: not a whole number"),
        ("= 20", "= -1", "sampling.n_sets: -1: must be greater than or equal to 0"),
        ('"lines"', "5", "experiment.loader: 5: not a text; put it in quotation marks"),
        ('name = "s2"', 'name = "s2"\nnormal = ["a", 0, 0]', "spot 's2', normal[0]: 'a': not a number"),
        ('name = "s2"', 'name = "s2"\nnormal = 5', "spot 's2', normal: 5: not a list; write [ … ]"),
        ('name = "s2"', 'name = "s2"\nsettings = 5', "spot 's2', settings: 5: not a table; write { … }"),
    ],
)
def test_the_common_mistakes_are_one_plain_line(
    tmp_path: Path, plugins: Plugins, old: str, new: str, message: str
) -> None:
    (found,) = messages(tmp_path, plugins, TEXT.replace(old, new, 1))
    assert found.endswith(message)
