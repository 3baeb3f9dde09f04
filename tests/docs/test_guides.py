"""The guides are true: every command is called, every table read, every link followed."""

import re
import shlex
import shutil
import tomllib
from functools import partial
from importlib.resources import files
from pathlib import Path

import meshio
import numpy as np
import polars as pl
import pytest
from typer.main import get_command

from palpate.answer.words import AT_END, EFFECTIVE, REFUSED, TIED, UNCLEAR, WORDS, mark_of, verdict_of
from palpate.cli.app import COMMANDS, STAGES, build_app, main
from palpate.cli.options import name_of
from palpate.cli.stages import add_stage
from palpate.domain import Scenario, weighed_phases
from palpate.experiment.curve_checks import (
    BIAS,
    LARGEST_BIAS,
    LARGEST_GAP,
    LARGEST_ONSET,
    LARGEST_WORK_BACK,
    LEAST_POINTS,
    LEVERS,
    ODD_LEVERS,
    SIZES,
)
from palpate.limb.loading import load_limbs
from palpate.mesh.specimens import block
from palpate.plugins.catalogue import Plugins
from palpate.plugins.registry import add_commands
from palpate.study.reading import read_study
from palpate_indentation import CsvLoader, CsvSettings
from palpate_report.data.tables import TITLES

ROOT = Path(__file__).parents[2]
GUIDES = [
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted(ROOT.glob("*/palpate-*/README.md")),
    *sorted(ROOT.glob("*.md")),
]
ROBOT_LOG = files("palpate_robot_log") / "studies" / "robot-log"


def text_of(guide: Path) -> str:
    return guide.read_text(encoding="utf-8")


def commands_of(guide: Path) -> list[str]:
    """Indented calls of palpate, without their comments."""
    lines = re.findall(r"^ {4}(?:\.venv/bin/)?(palpate .*)$", text_of(guide), flags=re.MULTILINE)
    return [re.split(r" +#", line)[0].strip() for line in lines]


def anchors(text: str) -> set[str]:
    """Targets of links to the headings of a Markdown text."""
    headings = re.findall(r"^#+ (.+)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("guide", GUIDES, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(guide):
    for target in re.findall(r"\]\(([^)]+)\)", text_of(guide)):
        path, _, anchor = target.partition("#")
        if path.startswith("https:"):
            continue
        linked = guide.parent / path if path else guide
        assert linked.exists(), target
        assert not anchor or anchor in anchors(text_of(linked)), target


@pytest.mark.parametrize("guide", GUIDES, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_row_of_a_table_has_its_columns(guide):
    plain = re.sub(r"`[^`\n]*`", "", text_of(guide)).replace("\\|", "")
    for table in re.findall(r"(?:^\|.*\n)+", plain, flags=re.MULTILINE):
        assert len({row.count("|") for row in table.splitlines()}) == 1, table


@pytest.fixture(scope="module")
def group():
    """The commands of the core, of every plugin, and of the repository's plugins of one file."""
    app = build_app()
    files = [ROOT / "benchmarks" / "certify.py", ROOT / "examples" / "paper" / "reproduce.py"]
    assert add_commands(app, files, add_stage=partial(add_stage, app, "Stages")) == ()
    return get_command(app)


@pytest.mark.parametrize("guide", GUIDES, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_call_is_one_that_palpate_understands(guide, group):
    for line in commands_of(guide):
        name, *rest = shlex.split(re.sub(r"\[[^]]*\]", "", line))
        parent, command = None, group
        while hasattr(command, "commands"):
            parent = command.make_context(name, list(rest), parent=parent, resilient_parsing=True)
            name, command, rest = command.resolve_command(parent, [*parent._protected_args, *parent.args])
        command.make_context(name, list(rest), parent=parent)


def commands_named(text: str) -> set[str]:
    return set(re.findall(r"(?:`| {4}|bin/)palpate ([a-z][a-z-]*)", text))


def test_the_commands_of_the_guides_exist_and_those_of_the_core_are_listed(group):
    texts = [text_of(guide) for guide in GUIDES if guide.name != "CHANGELOG.md"]
    assert commands_named("".join(texts)) <= set(group.commands)
    listed = text_of(ROOT / "docs" / "runs.md").split("\n## Commands\n")[1].split("\n## ")[0]
    assert commands_named(listed) >= {name_of(command) for command in (*COMMANDS, *STAGES)}


def test_every_make_target_that_a_guide_names_exists():
    targets = set(re.findall(r"^([a-z-]+):", text_of(ROOT / "Makefile"), flags=re.MULTILINE))
    named = {name for guide in GUIDES for name in re.findall(r"(?:`| {4})make ([a-z-]+)", text_of(guide))}
    assert {"demo", "test", "dist", "docs"} <= named <= targets


def call(line: str) -> int:
    return main(shlex.split(line)[1:])


def write_block(path: Path) -> None:
    """Write a block as a mesh in the form that the guide asks for."""
    mesh = block("hex8", n_across=6, n_down=3, width_mm=60.0, height_mm=30.0).mesh
    sets = {name: np.isin(np.arange(mesh.n_nodes), mesh.node_sets[name]) for name in ("fixed", "contact")}
    meshio.Mesh(
        mesh.points_mm,
        {"hexahedron": mesh.cells["hex8"]},
        point_data={name: each.astype(int) for name, each in sets.items()},
        cell_data={"region": [np.zeros(mesh.n_cells, int)]},
    ).write(path)


@pytest.mark.slow
@pytest.mark.usefixtures("one_figure")
def test_the_first_study_runs_from_log_to_report(tmp_path, monkeypatch, capsys):
    """All its commands in order, on a simulated log; a block, coarse steps, no finer mesh."""
    guide = ROOT / "docs" / "first-study.md"
    (study,) = re.findall(r"```toml\n(.*?)```", text_of(guide), flags=re.DOTALL)
    monkeypatch.chdir(tmp_path)
    pl.read_parquet(Path(str(ROBOT_LOG / "logs" / "simulated_p1.parquet"))).write_csv("press.csv")
    write_block(Path("limb.vtu"))
    steps = 'name = "jax"\nsettings = { depth_steps = 4, rotation_step_deg = 11.25 }'
    study = study.replace('fine_edge = "3 mm"', "fine_runs = 0").replace('name = "jax"', steps)
    here = '\n[executor]\nname = "in_process"\n'
    calls = commands_of(guide)
    assert len(calls) >= 6
    for line in calls:
        assert call(line.replace("--sets 12", "--sets 2")) == 0, (line, capsys.readouterr().err)
        if line.startswith("palpate init") or " init " in line:
            Path("arm/study.toml").write_text(study + here, encoding="utf-8")  # as the guide asks
    out = capsys.readouterr().out
    proposed = tomllib.loads(study)["experiment"]["settings"]["channels"]
    for column in (*proposed["position"]["columns"], *proposed["force"]["columns"], proposed["time"]):
        assert f'"{column}"' in out
    assert Path("runs/arm/report/index.html").is_file()
    assert list(Path("runs/arm/measured/plots").rglob("5_curves*"))


@pytest.mark.slow
@pytest.mark.usefixtures("one_figure")
def test_the_tutorial_runs_as_printed(tmp_path, monkeypatch, capsys):
    """Every command and the study are as in the text; only steps and meshes are coarser."""
    guide = ROOT / "docs" / "tutorial.md"
    (study,) = re.findall(r"```toml\n(.*?)```", text_of(guide), flags=re.DOTALL)
    steps = 'name = "jax"\nsettings = { depth_steps = 4, rotation_step_deg = 11.25 }'
    study = study.replace('search = "least_squares"', "fine_runs = 0").replace('name = "jax"', steps)
    monkeypatch.chdir(tmp_path)
    for line in commands_of(guide):
        assert call(line) == 0, (line, capsys.readouterr().err)
        if "--measured" in line:
            Path("arm/study.toml").write_text(f'{study}\n[executor]\nname = "in_process"\n', encoding="utf-8")
    for written in re.findall(r"`(?:runs/arm/)?(report/(?!figures)[\w/.]+)`", text_of(guide)):
        assert (tmp_path / "runs" / "arm" / written).is_file(), written


def test_every_ready_study_has_its_expected_answer():
    listed = set(re.findall(r"^\| \[([\w-]+)\]", text_of(ROOT / "docs" / "studies.md"), flags=re.MULTILINE))
    assert listed == set(Plugins.load().studies)


@pytest.fixture
def nothing_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the simulation that `palpate check` times; the first study's guide has one."""
    monkeypatch.setattr("palpate.simulation.cost.timed", lambda *_: 1.0)


@pytest.mark.slow
@pytest.mark.usefixtures("nothing_timed")
def test_the_layered_guide_is_the_layered_study(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for line in commands_of(ROOT / "docs" / "layers.md"):
        assert call(line) == 0, capsys.readouterr().err
    tables, *_ = re.findall(r"```toml\n(.*?)```", text_of(ROOT / "docs" / "layers.md"), flags=re.DOTALL)
    shipped = tomllib.loads((tmp_path / "layered" / "study.toml").read_text())
    for name, table in tomllib.loads(tables).items():
        assert table.items() <= shipped[name].items()
    space = read_study(tmp_path / "layered", Plugins.load()).space
    assert [p.name for p in space.parameters] == ["skin.E", "soft_tissue.c1"]


@pytest.mark.slow
@pytest.mark.usefixtures("nothing_timed")
def test_the_guide_on_curves_is_so(tmp_path, monkeypatch, capsys):
    text = text_of(ROOT / "docs" / "curves.md")
    monkeypatch.chdir(tmp_path)
    assert call("palpate init --study forearm-demo arm") == 0
    shutil.copy("arm/measured/p1.csv", "p1.csv")
    for line in commands_of(ROOT / "docs" / "curves.md"):
        assert call(line.replace("--sets 12", "--sets 2")) == 0, (line, capsys.readouterr().err)
    out = capsys.readouterr().out
    assert 'loader = "csv"' in out
    assert "channels.<name>.ordinate.scale" in out
    tables = [tomllib.loads(each) for each in re.findall(r"```toml\n(.*?)```", text, flags=re.DOTALL)]
    settings = CsvSettings.model_validate(tables[0]["experiment"]["settings"])
    assert settings.channels["torque"].ordinate.scale == 1000.0
    (scenarios,) = (table["scenario"] for table in tables if "scenario" in table)
    assert weighed_phases([Scenario(**scenarios[0])]) == ("torque/unload",)
    (example,) = re.findall(r"```\n(depth_mm.*?)```", text, flags=re.DOTALL)
    Path("example.csv").write_text(example)
    assert len(CsvLoader().load(Path("example.csv"))["torque"].branches) == 3


def test_the_block_of_the_guide_on_meshes_is_a_limb_to_press(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (recipe,) = re.findall(r"```python\n(.*?)```", text_of(ROOT / "docs" / "meshes.md"), flags=re.DOTALL)
    exec(recipe, {})
    assert call("palpate init --study forearm-demo arm") == 0
    assert call("palpate init silicone --measured arm/measured/p1.csv --mesh block.vtu") == 0
    limb = load_limbs(read_study(tmp_path / "silicone", Plugins.load()))["block"]
    size = np.ptp(limb.mesh.points_mm, axis=0)
    assert (size.tolist(), limb.mesh.regions) == ([120.0, 120.0, 60.0], ("soft_tissue",))
    heights = {name: {*limb.mesh.points_mm[nodes, 2]} for name, nodes in limb.mesh.node_sets.items()}
    assert heights == {"fixed": {-60.0}, "contact": {0.0}}


def test_the_limits_in_the_guide_on_curves_are_those_of_the_checks():
    text = text_of(ROOT / "docs" / "curves.md")
    for message in (
        f"below −{BIAS:.1%} of the peak".replace("%", " %"),
        f"above {BIAS:.1%} of the peak | above {LARGEST_BIAS:.0%}".replace("%", " %"),
        f"{LARGEST_ONSET:.0%} of the depth".replace("%", " %"),
        f"{LARGEST_WORK_BACK:.0%} more returned".replace("%", " %"),
        f"below 1/{1 / SIZES[0]:.0f} or above {SIZES[1]:.0f} times |",
        f"below 1/{1 / ODD_LEVERS[0]:.0f} or above {ODD_LEVERS[1]:.0f} times the indenter's",
        f"below 1/{1 / LEVERS[0]:.0f} or above {LEVERS[1]:.0f} times |",
        f"fewer than {LEAST_POINTS}, or a gap above {LARGEST_GAP:.0%} of the branch".replace("%", " %"),
    ):
        assert message in text, message


def test_the_words_of_the_guide_are_those_of_the_report():
    table = re.findall(
        r"^\| ([\w ]+) \| ([^|]+) \|", text_of(ROOT / "docs" / "identifiability.md"), re.MULTILINE
    )
    table = table[: len(WORDS) + 2]  # the first of its tables
    assert [word for word, _ in table[1:]] == [*(verdict_of(word) for _, word in WORDS), UNCLEAR]
    shares = {"well": "a tenth", "roughly": "three tenths", "poorly": "eight tenths"}
    assert {word: share for share, word in WORDS if share < 1.0} == {
        "well": 0.1,
        "roughly": 0.3,
        "poorly": 0.8,
    }
    for word, interval in table:
        assert shares.get(word, "") in interval


def test_the_guide_on_papers_has_every_verdict_with_its_mark_and_names_what_is_written():
    text = text_of(ROOT / "docs" / "write-it-up.md")
    rows = re.findall(r"^\| ([\w ]+) \| ([†‡¶]?) ?\| ", text, flags=re.MULTILINE)
    verdicts = {verdict: mark for verdict, mark in rows if verdict != "verdict"}
    assert set(verdicts) == {
        *(verdict_of(word) for _, word in WORDS),
        UNCLEAR,
        REFUSED,
        EFFECTIVE,
        AT_END,
        TIED,
    }
    assert verdicts == {verdict: mark_of(verdict) for verdict in verdicts}
    tables = {name.removesuffix(".tex") for name in re.findall(r"`(?:tables/)?(\w+\.tex)`", text)}
    papers = {name for name in tables if name.startswith("paper_")}
    assert papers == {"paper_table1", "paper_table1_wide", "paper_table2"}
    assert tables - papers == {"budget", "parameter_combinations", "inadequate"}
    assert tables - papers <= set(TITLES)


def test_the_citation_names_this_version():
    from palpate import __version__

    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"version: {__version__}\n" in text
