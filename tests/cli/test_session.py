"""How results are printed."""

import json
import math
from pathlib import Path

import polars as pl
import pytest

from palpate.cli.progress import StageProgress
from palpate.cli.session import MAX_ROWS, Session


@pytest.fixture
def printed(capsys: pytest.CaptureFixture[str]) -> "Printed":
    return Printed(capsys)


class Printed:
    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys
        self.session = Session()

    def lines(self) -> list[list[str]]:
        return [line.split() for line in self._capsys.readouterr().out.splitlines() if line.split()]


def test_a_frame_has_four_digits_and_dashes(printed: Printed) -> None:
    printed.session.frame("Things", pl.DataFrame({"name": ["a", None], "value": [math.pi, 1e-9]}))
    title, head, _, first, second = printed.lines()
    assert title == ["Things"]
    assert head == ["name", "value"]
    assert first == ["a", "3.142"]
    assert second == ["–", "1e-09"]


def test_a_wide_frame_of_few_rows_is_transposed(printed: Printed) -> None:
    printed.session.frame("Wide", pl.DataFrame({f"a_long_name_{i}": [i, i + 100] for i in range(20)}))
    lines = printed.lines()
    assert lines[1] == ["a", "long", "name", "0", "0", "100"]
    assert lines[-1] == ["a", "long", "name", "19", "19", "119"]


def test_heads_of_a_frame_are_words(printed: Printed) -> None:
    columns = ("n_parameters", "difference_aicc", "r2_force", "press_s", "soft_tissue.c1", "value")
    printed.session.frame("Laws", pl.DataFrame(dict.fromkeys(columns, [1] * 7)))
    head = printed.lines()[1]
    assert " ".join(head) == "parameters difference AICc R² force press (s) soft_tissue.c1 value"


def test_a_long_frame_is_cut_with_a_note(printed: Printed) -> None:
    printed.session.frame("Long", pl.DataFrame({"n": list(range(MAX_ROWS + 7))}))
    assert printed.lines()[-1] == ["…", "7", "more", "rows"]


def test_brackets_are_text_not_markup(printed: Printed) -> None:
    printed.session.table("Units", ["stress [MPa]"], [["[red]1[/red]"]])
    assert "[MPa]" in printed.lines()[1]
    printed.session.say("value [bold]")
    assert printed.lines() == [["value", "[bold]"]]


def test_json_has_no_numbers_that_json_lacks(capsys: pytest.CaptureFixture[str]) -> None:
    Session().json({"a": [math.nan, -math.inf, 1.5, True], "b": Path("x"), "c": (None, "µ")})
    assert json.loads(capsys.readouterr().out) == {"a": [None, None, 1.5, True], "b": "x", "c": [None, "µ"]}


def test_control_characters_are_spelt_out_wherever_text_is_printed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    session, steering = Session(), "a\x1b[31mb\x9b2Jc\rd\x7f"
    session.say(steering)
    session.table(steering, [steering], [[steering]])
    session.frame("Names", pl.DataFrame({"name": [steering]}))
    session.json({"name": steering})
    with StageProgress(session) as progress:
        progress.begin(steering, 1)
        progress.note(steering)
        progress.step(steering)
    session.next(steering)
    printed = capsys.readouterr()
    for text in (printed.out, printed.err):
        assert not set("\x1b\x9b\r\x7f") & set(text)
        assert r"a\u001b[31mb\u009b2Jc" in text
    assert json.loads(printed.out[printed.out.index("{") :])["name"] == steering


def test_commands_of_a_message_are_on_the_study_that_was_read() -> None:
    session = Session([Path("my tissue.py")], ["slow"])
    text = "run `palpate fit STUDY --out STUDY_A/run` first; results of `palpate score`"
    assert session.addressed(text) == text
    session.asked = Path("my arm")
    assert session.addressed(text) == (
        "run `palpate --plugin 'my tissue.py' --no-plugin slow fit 'my arm' --out STUDY_A/run` first; "
        "results of `palpate score`"
    )
    assert session.addressed("`palpate synthesise STUDY`").endswith("synthesise 'my arm'`")
