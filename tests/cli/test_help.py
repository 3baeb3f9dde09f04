"""Help that teaches: headings, examples that can be called, and lines that fit."""

import shlex

import pytest
from typer.main import get_command

from palpate.cli.app import COMMANDS, STAGES, build_app, main
from palpate.cli.experiment import STAGE
from palpate.cli.options import EXAMPLES, name_of
from palpate.plugins.registry import add_commands
from palpate.run.ownership import MARKER

CORE = [name_of(command) for command in (*COMMANDS, *STAGES)]


@pytest.fixture(scope="module")
def group():
    app = build_app()
    assert add_commands(app) == ()
    return get_command(app)


def test_every_core_command_has_an_example():
    assert set(EXAMPLES) == set(CORE)
    for name, lines in EXAMPLES.items():
        assert lines
        assert all(line.startswith(f"palpate {name}") for line in lines)


def leaves(command, *names):
    """Every command by its words, those of plugins too; a stage is listed as its default command."""
    for name, inner in getattr(command, "commands", {}).items():
        if name != STAGE:
            yield (*names, name), inner
            yield from leaves(inner, *names, name)


def test_every_command_ends_with_examples_that_can_be_called(group):
    found = dict(leaves(group))
    assert {("next",), ("predict",), ("experiment", "inspect"), ("limb", "scan")} <= set(found)
    for words, command in found.items():
        lines = [line.strip() for line in (command.epilog or "").splitlines()[2:]]
        assert lines, words
        for line in lines:
            assert line.startswith(f"palpate {words[0]}")
            be_called(group, line)


def be_called(group, line):
    words = shlex.split(line.split(" > ")[0])[1:]
    context = group.make_context("palpate", list(words), resilient_parsing=True)
    name, command, rest = group.resolve_command(context, words)
    while hasattr(command, "commands"):
        inner = command.make_context(name, list(rest), parent=context, resilient_parsing=True)
        rest = [*inner._protected_args, *inner.args]
        name, command, rest = command.resolve_command(inner, rest)
        context = inner
    command.make_context(name, rest, parent=context)


@pytest.mark.parametrize("name", ["", *CORE, "next", "predict-press"])
def test_help_fits_into_80_columns_and_ends_with_the_examples(name, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert main([*([name] if name else []), "--help"]) == 0
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 80
    if name in EXAMPLES:
        assert out.rstrip().endswith(f"  {EXAMPLES[name][-1]}")
        assert "Examples:" in out


def test_the_list_of_commands_says_how_to_mesh_a_scan_and_look_into_a_log(capsys):
    assert main(["--help"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "`palpate limb SCAN`" in out
    assert "`palpate experiment inspect FILE`" in out


def test_out_is_a_run_directory_and_other_files_go_into(group):
    for words, command in leaves(group):
        for option in command.params:
            assert "--out" not in option.opts or option.help.startswith("Run directory"), words


def test_commands_are_under_headings_in_the_order_of_a_study(capsys):
    assert main(["--help"]) == 0
    out = capsys.readouterr().out
    places = [out.index(f"\n{heading}") for heading in ("Start:", "Run:", "Stages, each")]
    assert places == sorted(places)
    stages = [out.index(f"\n  {name_of(stage)} ") for stage in STAGES]
    assert stages == sorted(stages)


@pytest.mark.parametrize(
    ("words", "number", "offered"),
    [
        ("palpate ru", 1, "run"),
        ("palpate pre", 1, "predict-press"),
        ("palpate plugins mat", 2, "materials"),
        ("palpate run arm --go", 3, "--go-on"),
        ("palpate card runs/arm --for fe", 4, "febio"),
        ("palpate init --study forearm-d", 3, "forearm-demo"),
        ("palpate plugins materials yeo", 3, "yeoh"),
        ("palpate new-plugin fib", 2, "fibres"),
        ("palpate check ar", 2, "arm"),
        ("palpate run ", 2, "runs/arm-2"),
        ("palpate status ", 2, "runs/arm-2"),
        ("palpate compare runs/arm-1 runs/", 3, "runs/arm-2"),
        ("palpate card old/a", 2, "old/arm-3"),
    ],
)
def test_the_shell_completes(words, number, offered, capsys, monkeypatch, tmp_path):
    (tmp_path / "arm").mkdir()
    (tmp_path / "arm" / "study.toml").touch()
    for run in ("runs/arm-1", "runs/arm-2", "old/arm-3"):
        (tmp_path / run).mkdir(parents=True)
        (tmp_path / run / MARKER).touch()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("_PALPATE_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(number))
    main([])
    assert offered in capsys.readouterr().out.split()
