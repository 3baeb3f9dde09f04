"""The command that repeats the paper, with a solver in closed form: both channels scale with the moduli."""

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate import Curve, Response, Simulation, Solver, Status
from palpate.cli.app import main
from palpate.errors import NothingSelectableError, StoppedError, StudyError
from palpate.executors import InProcess
from palpate.fit.searches import BestSet
from palpate.mechanics import initial_moduli
from palpate.plugins.catalogue import Plugins
from palpate.plugins.provides import Provides
from palpate.progress import Progress
from papers_study import reproduction
from papers_study.comparison import compare, errata, write
from papers_study.paper_tables import GENERALISED, GENERALISED_FOPT, table1, table2
from papers_study.reproduction import REGIONS, Reproduction, prepare

pytestmark = pytest.mark.usefixtures("no_pictures")

REPRODUCE = ("--plugin", reproduction.COMMAND, "reproduce")
SETS = 9


class Failing(Solver):
    """Never gets anywhere."""

    name = "failing"
    summary = "diverges"
    provides = Provides(body="layers")

    def simulate(self, job, limb):
        return Simulation(job=job, status=Status.DIVERGED, response=None, message="no step", seconds=0.1)


class Scaled(Solver):
    """Half a millimetre of everything: force = μ·depth^1.5, torque = a loop of μ."""

    name = "scaled"
    summary = "closed form"
    provides = Provides(body="layers")

    def simulate(self, job, limb):
        material, theta = job.materials["soft_tissue"], job.thetas["soft_tissue"]
        mu = initial_moduli(material, theta)[0]
        depth, turn = job.protocol.path.T
        x = np.linspace(0.0, depth.max(), 41)
        angle = turn[depth == depth.max()]
        curves = {
            "force": Curve(channel="force", abscissa=x, ordinate=20.0 * mu * x**1.5),
            "torque": Curve(channel="torque", abscissa=angle, ordinate=900.0 * mu * np.tanh(angle / 10.0)),
        }
        return Simulation(job=job, status=Status.OK, response=Response(curves=curves), seconds=0.5)


@pytest.fixture(scope="module")
def no_pictures():
    """Leave the drawing to the tests of the report."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("palpate_report.from_run.write_figures", lambda content, folder: ())
        yield


@pytest.fixture(scope="module")
def plugins():
    return Plugins.load()


def scaled(made: Reproduction, failing: str = "") -> Reproduction:
    """In closed form, and without the fits, of which the comparison reads nothing."""
    studies = {
        name: replace(
            study,
            solver=Failing() if name == failing else Scaled(),
            executor=InProcess(),
            search=BestSet(),
        )
        for name, study in made.studies.items()
    }
    return replace(made, studies=studies)


@pytest.fixture(scope="module")
def made(tmp_path_factory, plugins):
    return scaled(prepare(tmp_path_factory.mktemp("paper") / "all", plugins, tuple(REGIONS), SETS))


@pytest.fixture(scope="module")
def outcome(made, plugins, no_pictures):
    return reproduction.run(made, plugins)


@pytest.fixture(scope="module")
def results(outcome):
    return outcome.results


def test_the_studies_are_the_papers(made):
    for name, study in made.studies.items():
        assert [p.name for p in study.space.parameters] == [
            f"soft_tissue.{p}"
            for p in table1().filter(material=name)["parameter"].unique(maintain_order=True)
        ] or name == "ogden"
        assert len(study.spots) == 4
        assert [s.name for s in study.scenarios] == ["I", "II", "III"]
        assert study.protocol.friction == 1.0
        assert study.protocol.path[:, 0].max() == 10.0
    for material, found in table1().group_by("material"):
        ranges = {p.name.split(".")[1]: p for p in made.studies[material[0]].space.parameters}
        for row in found.iter_rows(named=True):
            parameter = ranges[row["parameter"]]
            assert parameter.lower <= row["value"] <= parameter.upper, row


@pytest.mark.slow
def test_tables_are_next_to_the_papers(results, outcome):
    found = compare(outcome)
    assert found.tables["table1"].height == table1().height
    assert found.tables["table2"].height == table2().height
    for table in ("table1", "table2"):
        assert found.tables[table].null_count().sum_horizontal().item() == 0
    row = (
        found.tables["table1"]
        .filter(material="yeoh", spot="p2", scenario="I", parameter="c1")
        .row(0, named=True)
    )
    assert row["paper"] == 0.010383
    assert row["here"] == results["yeoh"].selected.selection.row(3, named=True)["soft_tissue.c1"]
    kept = dict(found.tables["sets"].select("material", "kept_here").iter_rows())
    assert kept["ogden"] == kept["neo_hookean"] == SETS
    assert 0 < kept["yeoh"] <= SETS
    general = found.tables["generalised"].filter(material="yeoh", quantity="mean Fopt").row(0, named=True)
    assert general["paper"] == GENERALISED_FOPT[0]
    each_alone = found.tables["table2"].filter(material="yeoh", scenario="I")["here"].mean()
    assert general["here"] >= each_alone * (1.0 - 1e-12)


def test_errata_are_what_the_printed_tables_say():
    found = {erratum["where"]: erratum["found"] for erratum in errata({})}
    general = next(each["paper"] for each in errata({}) if each["where"] == "the generalised Yeoh set")
    assert general == "mean Fopt {} ± {}".format(*GENERALISED_FOPT)
    errors = table2().pivot("scenario", index=["material", "point"], values="nmse")
    least = " and ".join(
        f"{row[name]:g} for {name} ({row['material']}, point {row['point']})"
        for name in ("II", "III")
        for row in errors.sort(name).head(1).iter_rows(named=True)
    )
    assert found["table 2 and the text"].endswith(least)
    assert (errors["I"] >= errors["II"] + errors["III"]).sum() == errors.height == 12
    of_one = {(m, point): nmse for m, point, nmse in errors.select("material", "point", "I").iter_rows()}
    less = [p for p in (1, 3, 4) if of_one["yeoh", p] < of_one["neo_hookean", p]]
    assert less == [3]
    text = f"{of_one['yeoh', 3]:g} is less than neo-Hookean's {of_one['neo_hookean', 3]:g}"
    assert text in found["the text on the Yeoh model"]

    rows = table1().sort("parameter").group_by("material", "point", "scenario", maintain_order=True)
    sets = {key: tuple(found["value"]) for key, found in rows}
    seen = Counter((material, values) for (material, _, _), values in sets.items())
    n_shared = sum(count for count in seen.values() if count > 1)
    assert found["table 1"] == f"only {len(seen)} are different; {n_shared} rows share a set with another row"
    equal = {
        f"{material} at point {point} (I = {scenario})"
        for (material, point, scenario), values in sets.items()
        if scenario != "I" and sets[material, point, "I"] == values
    }
    assert set(found["curves that coincide"].partition("only ")[2].split(", ")) == equal

    mean = table2().filter(material="yeoh", scenario="I")["nmse"].mean()
    assert f"average {mean:.4f}, " in found["the generalised Yeoh set"]
    near = [
        (point, scenario)
        for (material, point, scenario), values in sets.items()
        if material == "yeoh"
        and np.allclose(values, [GENERALISED[n] for n in sorted(GENERALISED)], rtol=2e-3)
    ]
    assert near == [(1, "II")]


@pytest.mark.slow
def test_errata_state_what_the_runs_found(outcome):
    by_place = {erratum["where"]: erratum for erratum in compare(outcome).errata}
    assert f"of {SETS} yeoh" in by_place["Drucker's criterion"]["here"]
    assert by_place["a check that table 2 passes"]["here"] == "holds in every row"


@pytest.mark.slow
def test_files_have_all_of_it(outcome, made):
    file = write(compare(outcome), outcome.results, made.folder)
    text = file.read_text()
    assert "**The curves are simulated.**" in text
    assert "| yeoh | p1 | II | c1 | MPa | 0.01292 |" in text
    assert "(yeoh/report/index.html)" in text
    assert (
        (made.folder / "tables" / "table2.csv").read_text().startswith("material,spot,scenario,paper,here\n")
    )


@pytest.mark.slow
def test_more_sets_keep_the_first(made, plugins, results):
    """Of the material of which filters refuse some sets."""
    more = made.extended(2 * SETS)
    more = replace(more, studies={"yeoh": more.studies["yeoh"]})
    before = results["yeoh"].design.values
    after = reproduction.run(more, plugins).results["yeoh"].design.values
    np.testing.assert_array_equal(after[: len(before)], before)
    assert len(after) > len(before)
    with pytest.raises(StudyError, match=f"has {SETS} sets already, which cannot become 5"):
        made.extended(5)


@pytest.mark.slow
def test_a_material_that_fails_does_not_stop_the_others(tmp_path, plugins):
    announced = []
    both = scaled(prepare(tmp_path / "both", plugins, ["ogden", "neo_hookean"], 3), failing="ogden")
    outcome = reproduction.run(both, plugins, announce=announced.append)
    assert list(outcome.results) == ["neo_hookean"]
    assert "ogden …" in announced
    assert any(line.startswith("ogden: none") and "no step" in line for line in announced)
    text = write(compare(outcome), outcome.results, both.folder).read_text()
    assert "**Nothing of ogden:**" in text
    with pytest.raises(NothingSelectableError, match=r"ogden: .*no step"):
        reproduction.run(replace(both, studies={"ogden": both.studies["ogden"]}), plugins)


def test_stopping_names_the_command_to_continue(tmp_path, plugins):
    class Stopping(Progress):
        def should_continue(self):
            return False

    made = scaled(prepare(tmp_path / "my runs", plugins, ["ogden"], 3))
    with pytest.raises(StoppedError, match=r"stopped in ogden; .*\.py reproduce '.*my runs'` goes on"):
        reproduction.run(made, plugins, Stopping())


def test_a_folder_that_cannot_be_used_is_refused(tmp_path, plugins):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "study").mkdir()
    (tmp_path / "mine" / "study" / "thesis.tex").touch()
    with pytest.raises(StudyError, match="holds no reproduction"):
        prepare(tmp_path / "mine", plugins, ["yeoh"], SETS)
    with pytest.raises(StudyError, match="'gent' is not in the paper; it has ogden, yeoh, neo_hookean"):
        prepare(tmp_path / "new", plugins, ["gent"], SETS)
    prepare(tmp_path / "new", plugins, ["yeoh"], SETS)
    with pytest.raises(StudyError, match="was made with the coarse phantom; leave out --fine"):
        prepare(tmp_path / "new", plugins, ["yeoh"], SETS, "fine")


def test_a_copy_that_was_cut_off_is_made_again(tmp_path, plugins, monkeypatch):
    def cut_off(*given, **more):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", cut_off)
        with pytest.raises(KeyboardInterrupt):
            prepare(tmp_path, plugins, ["ogden"], SETS)
    assert not (tmp_path / "study").exists()
    prepare(tmp_path, plugins, ["ogden"], SETS)
    assert [path.name for path in tmp_path.iterdir()] == ["study"]


def test_a_changed_study_stays_changed(tmp_path, plugins):
    prepare(tmp_path, plugins, ["ogden"], SETS)
    file = tmp_path / "study" / "ogden.toml"
    file.write_text(file.read_text().replace("seed = 1", "seed = 7"))
    assert prepare(tmp_path, plugins, ["ogden"], SETS).studies["ogden"].seed == 7


def test_a_call_that_cannot_work_is_refused(capsys, tmp_path):
    (tmp_path / "thesis.tex").touch()
    assert main([*REPRODUCE, str(tmp_path)]) == 2
    assert "holds no reproduction" in capsys.readouterr().err
    assert main([*REPRODUCE, str(tmp_path / "new"), "--material", "yeho"]) == 2
    assert "it has ogden, yeoh" in capsys.readouterr().err


@pytest.mark.slow
def test_the_command_runs_and_prints_json(monkeypatch, capsys, tmp_path):
    extended = Reproduction.extended
    monkeypatch.setattr(Reproduction, "extended", lambda self, n_sets: scaled(extended(self, n_sets)))
    folder = tmp_path / "here"
    assert main([*REPRODUCE, str(folder), "--sets", "6", "--material", "ogden", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert Path(printed["file"]) == folder / "comparison.md"
    assert {row["material"] for row in printed["tables"]["table2"]} == {"ogden"}
    assert len(printed["not_shared"]) == 4
    manifest = json.loads((folder / "ogden" / "manifest.json").read_text())
    assert manifest["plugin_files"] == [], "a run is opened without the file of the command"
    assert main([*REPRODUCE, str(folder), "--sets", "8", "--material", "ogden"]) == 0
    out, _ = capsys.readouterr()
    assert max(len(line) for line in out.split("isochoric")[1].split("Comparison:")[0].splitlines()) <= 80
    assert main([*REPRODUCE, str(folder), "--material", "ogden", "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["tables"]["sets"][0]["n_drawn"] == 8
    assert "continuing with 8 sets" in err
    assert main([*REPRODUCE, str(folder), "--sets", "3", "--material", "ogden"]) == 2
    assert "cannot become 3" in capsys.readouterr().err


def test_without_a_number_sets_are_those_there_are_or_the_papers(tmp_path, plugins):
    from palpate.cli.session import Session
    from reproduce import size_of

    prepare(tmp_path / "started", plugins, ["ogden"], 40)
    for folder, size in (("started", 40), ("new", 250)):
        assert size_of(Session(), plugins, tmp_path / folder, ["ogden"]) == size
