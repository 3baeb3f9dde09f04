"""``palpate explain``: each term can be found, and what it points to is there."""

import json
from pathlib import Path

import pytest
from typer.main import get_command

from palpate.cli.app import build_app, main
from palpate.cli.glossary import Glossary, UnknownTermError
from palpate.plugins.registry import add_commands

ROOT = Path(__file__).parents[2]
GLOSSARY = Glossary.load()


def test_no_two_terms_share_a_word():
    words = [word.casefold() for term in GLOSSARY.values() for word in (term.name, *term.aliases)]
    assert len(words) == len(set(words))


@pytest.mark.parametrize("word", ["NMSE", "nmse", "Shear-Modulus", "shear  modulus", "LHS", "timed_out"])
def test_a_term_is_found_by_any_of_its_words_in_any_case(word):
    assert (
        word.casefold().replace("-", " ").split()[0][:3]
        in " ".join((GLOSSARY[word].name, *GLOSSARY[word].aliases)).casefold()
    )


@pytest.mark.slow
@pytest.mark.parametrize("term", GLOSSARY.values(), ids=lambda term: term.name)
def test_what_a_term_points_to_is_there(term):
    commands = app_commands()
    for target in term.see:
        if target.startswith("palpate "):
            command, *rest = target.removeprefix("palpate ").split()
            assert command in commands, target
            if command == "explain":
                assert " ".join(rest) in GLOSSARY
        else:
            assert (ROOT / target).is_file(), target
    assert 60 < len(term.text) < 700


def app_commands():
    app = build_app()
    add_commands(app)
    return get_command(app).commands


def test_an_unknown_term_offers_close_ones():
    with pytest.raises(UnknownTermError, match=r"no term 'nsme'; did you mean 'nmse' .*\(known: spot,"):
        GLOSSARY["nsme"]
    assert "nsme" not in GLOSSARY


def test_the_command(capsys):
    assert main(["explain", "shear", "modulus"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("shear modulus: The stiffness at rest [MPa]")
    assert max(map(len, out.split("see:")[0].splitlines())) <= 80
    assert main(["explain"]) == 0
    assert "Drucker" in capsys.readouterr().out
    assert main(["explain", "Drucker", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["name"] == "Drucker"
    assert main(["explain", "nonsense"]) == 2


def test_an_unknown_word_that_a_text_has_names_the_terms():
    with pytest.raises(
        UnknownTermError, match=r"no term 'sphere'; the word is in the text of spot, indentation"
    ):
        GLOSSARY["sphere"]


@pytest.mark.parametrize(
    "word",
    [
        "fit",
        "R²",
        "R2",
        "well",
        "poorly",
        "not",
        "verification",
        "solver comparison",
        "torque",
        "depth",
        "Sobol",
        "FEBio",
    ],
)
def test_the_words_of_the_report_and_the_commands_are_explained(word):
    assert word in GLOSSARY
