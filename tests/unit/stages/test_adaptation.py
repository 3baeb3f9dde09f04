"""A run refines the meshes that are much of the variance of what it finds, and no others."""

import shutil
from dataclasses import replace

import pytest

import palpate
from palpate.errors import StudyError
from palpate.limb.loading import load_limbs
from palpate.run.directory import RunDirectory
from palpate.run.ledger import Ledger
from palpate.stages import pipeline


@pytest.fixture
def run(tmp_path, pressed_meshes, notes):
    """Run a study of true curves, whose meshes err, with settings of its fit; its folder, and its notes."""

    def made(**fit):
        (tmp_path / "true").mkdir()
        pressed_meshes(tmp_path / "true", solver={"name": "half_space_on_mesh"})
        study, plugins = pressed_meshes(
            tmp_path,
            solver={"name": "errs_by_the_mesh"},
            fit={"search": "least_squares", **fit},
            budget={"gain": 0.02, "discrepancy": 1e-4},
        )
        shutil.copy(tmp_path / "true/p1.txt", tmp_path / "p1.txt")
        directory = RunDirectory(tmp_path / "run")
        pipeline.run_study(study, directory.folder, plugins, notes)
        return study, plugins, directory, [text for text in notes.texts if "the mesh is" in text]

    return made


def share(directory):
    """Largest share of the mesh in a variance."""
    return directory.table("budget").filter(cause="mesh")["share"].max()


def n_simulated(directory):
    with Ledger(directory.folder) as ledger:
        return len(ledger.seconds())


def test_meshes_are_refined_until_they_are_little_of_every_variance(run):
    study, plugins, directory, notes = run(fine_nodes=50_000)
    limb = load_limbs(study)["p1/fine"]
    (mesh,) = directory.table("fine_meshes").to_dicts()
    assert limb.mesh.n_nodes < mesh["n_nodes"] <= study.fine_nodes
    assert len(notes) == 2, "one refinement does not do"
    assert notes[-1].endswith(f": refined to edges of {mesh['edge_mm']:.2g} mm at p1, and fitted again")
    assert share(directory) < 0.2
    # A stage alone, and the run again, find the same with the simulations at hand.
    tables, n_known = (
        {name: directory.table(name) for name in ("fit", "intervals", "fine_meshes")},
        n_simulated(directory),
    )
    for again in (
        lambda: pipeline.run_stage("fit", study, directory.folder, plugins),
        lambda: pipeline.run_stage("intervals", study, directory.folder, plugins),
        lambda: pipeline.run_study(study, directory.folder, plugins),
    ):
        again()
        assert all(directory.table(name).equals(table) for name, table in tables.items())
        assert n_simulated(directory) == n_known


@pytest.mark.parametrize("limit", [0, 5000])
def test_meshes_become_no_larger_than_the_study_lets_them(run, limit):
    study, _, directory, notes = run(fine_nodes=limit)
    assert directory.table("fine_meshes")["n_nodes"].to_list() == [load_limbs(study)["p1/fine"].mesh.n_nodes]
    assert len(notes) == 1
    assert f"nodes, and may have {limit:,}: set `fine_nodes`" in notes[0]
    assert share(directory) > 0.2


def test_edges_that_the_study_states_are_kept(run):
    _, _, directory, notes = run(fine_edge="1.4 mm")
    assert directory.table("fine_meshes")["edge_mm"].to_list() == [1.4]
    assert notes == []
    assert share(directory) > 0.2


def test_an_optimiser_of_ones_own_has_the_fopt_of_the_report(run):
    study, plugins, directory, _ = run(fine_edge="1.4 mm")
    found = directory.fit()
    (row,) = found.ends.filter(scenario=study.generalise_by).to_dicts()
    assert found.mesh["coarse"].to_list() != pytest.approx(found.mesh["corrected"].to_list(), rel=1e-3)
    with palpate.open_problem(study, folder=directory.folder, plugins=plugins) as problem:
        fopt = problem.fopt([row[name] for name in problem.names])
    assert fopt == pytest.approx(row["fopt"], rel=1e-9)
    with palpate.open_problem(study, folder=directory.folder.parent / "other", plugins=plugins) as bare:
        assert bare.fopt([row[name] for name in bare.names]) != pytest.approx(fopt, rel=0.05)


def test_a_problem_is_not_corrected_by_the_fit_of_another_study(run):
    study, plugins, directory, _ = run(fine_edge="1.4 mm")
    other = replace(study, noise=2.0 * study.noise)
    with pytest.raises(StudyError), palpate.open_problem(other, folder=directory.folder, plugins=plugins):
        pass
