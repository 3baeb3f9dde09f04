"""The sweep: the same sets everywhere, a key of what decides, nothing computed twice."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.domain import HomogeneousTests, Indentation, Limb, Mesh, ParameterSpace, Spot, Status, Tie
from palpate.errors import MeshError, ParameterError, PluginError, StudyError
from palpate.experiment.measured import load_measured
from palpate.fit.parametrisation import StandardParametrisation
from palpate.run import keys
from palpate.sampling.drawing import draw_design
from palpate.simulation import jobs as simulation


@pytest.fixture
def sweep(make_study, plugins, tissue, tmp_path):
    """Run a sweep and say which jobs were simulated."""
    log = tmp_path / "log.txt"

    def run(solver="Analytic", offset=0.0, **changes):
        cls = getattr(tissue, solver) if isinstance(solver, str) else solver
        study = make_study(solver=cls(cls.Settings(log=str(log), offset=offset)), **changes)
        measured = load_measured(study, plugins.channels)
        design = draw_design(study.space, study.sampler, study.n_sets, study.seed)
        log.write_text("")
        found = simulation.simulate(study, design, {}, measured, tmp_path / "run")
        return found, [tuple(line.split()[:2]) for line in log.read_text().splitlines()]

    return run


def test_the_same_sets_at_every_spot_in_order(make_study, plugins):
    study = make_study()
    measured = load_measured(study, plugins.channels)
    design = draw_design(study.space, study.sampler, 5, seed=1)
    jobs = simulation.jobs(study, design, measured)
    assert [(j.spot, j.set_id) for j in jobs] == [(s, i) for s in ("p1", "p2") for i in range(5)]
    for first, second in zip(jobs[:5], jobs[5:], strict=True):
        assert np.array_equal(first.thetas["soft_tissue"], second.thetas["soft_tissue"])
        assert np.array_equal(first.thetas["soft_tissue"], design.values[first.set_id])


def test_without_a_protocol_the_measured_abscissae_are_the_tests(make_study, plugins):
    study = make_study(protocol=None)
    measured = load_measured(study, plugins.channels)
    design = draw_design(study.space, study.sampler, 1, seed=1)
    protocol = simulation.jobs(study, design, measured)[0].protocol
    assert isinstance(protocol, HomogeneousTests)
    assert np.array_equal(protocol.paths["force"], measured["p1"]["force"].abscissa)


def test_a_second_run_computes_nothing_and_gives_the_same(sweep):
    first, computed = sweep()
    # Without a mesh the two spots ask for the same tests: one simulation serves both.
    assert computed == [("p1", str(i)) for i in range(12)]
    second, again = sweep()
    assert again == []
    for a, b in zip(first, second, strict=True):
        assert (a.job.spot, a.job.set_id, a.status) == (b.job.spot, b.job.set_id, b.status)
        assert np.array_equal(a.response["torque"].ordinate, b.response["torque"].ordinate)


def test_more_sets_of_another_seed_are_computed_and_returned_in_order(sweep):
    sweep()
    found, computed = sweep(n_sets=15, seed=4)
    assert len(computed) == 15
    assert [(s.job.spot, s.job.set_id) for s in found] == [(p, i) for p in ("p1", "p2") for i in range(15)]


def test_another_setting_of_the_solver_is_another_simulation(sweep):
    sweep()
    assert len(sweep(offset=1.0)[1]) == 12


def test_an_interrupted_sweep_continues(sweep, tissue):
    class Interrupted(tissue.Analytic):
        def behave(self, job):
            if (job.spot, job.set_id) == ("p1", 7) and not resumed:
                raise KeyboardInterrupt
            return super().behave(job)

    resumed = []
    with pytest.raises(KeyboardInterrupt):
        sweep(solver=Interrupted)
    resumed.append(True)
    found, computed = sweep(solver=Interrupted)
    assert computed == [("p1", str(i)) for i in range(7, 12)]
    assert {s.status for s in found} == {Status.OK}


def test_failures_keep_their_partial_curves_and_crashes_are_tried_again(sweep, tissue):
    class Sickly(tissue.Faulty):
        def behave(self, job):
            return super().behave(replace(job, set_id=job.set_id if job.set_id > 2 else 0))

        def simulate(self, job, limb):
            return replace(super().simulate(job, limb), job=job)

    first, _ = sweep(solver=Sickly)
    assert [s.status for s in first[:6]] == [
        Status.OK, Status.OK, Status.OK, Status.CRASHED, Status.DIVERGED, Status.UNREADABLE,
    ]  # fmt: skip
    second, again = sweep(solver=Sickly)
    assert again == [("p1", "3")]
    assert second[4].message == "negative Jacobian"
    assert second[4].response["force"].abscissa.size == 8


def test_unusual_diagnostics_are_kept_as_text(sweep, tissue):
    class Wordy(tissue.Analytic):
        def behave(self, job):
            diagnostics = {"n": np.int64(3), "x": np.array([1.0, np.nan]), "o": object, "t": (1, None)}
            return replace(super().behave(job), diagnostics=diagnostics)

    sweep(solver=Wordy)
    found, _ = sweep(solver=Wordy)
    kept = {name: value for name, value in found[0].diagnostics.items() if name != "processor_s"}
    assert kept == {"n": 3, "x": [1.0, "nan"], "o": repr(object), "t": [1, None]}


def test_a_value_outside_the_physical_range_is_refused_before_anything_runs(sweep, space, tmp_path):
    region = space.regions[0]
    unphysical = tuple(
        replace(p, lower=-1.0, physical_lower=-np.inf) if p.name == "stiffness" else p
        for p in region.searched
    )
    with pytest.raises(ParameterError, match="'stiffness' = -"):
        sweep(space=replace(space, regions=(replace(region, searched=unphysical),)))
    assert not (tmp_path / "run").exists()


def test_what_the_solver_refuses_is_raised_before_anything_runs(sweep, tissue, tmp_path):
    class Picky(tissue.Analytic):
        def check(self, job, limb):
            raise MeshError(f"spot {job.spot}: element 7 is tet4; use tet10")

    with pytest.raises(MeshError, match="element 7"):
        sweep(solver=Picky)
    assert not (tmp_path / "run").exists()


# ------------------------------------------------------------------------- keys


def cube_limb(shift=0.0):
    points = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
    points[0, 0] += shift
    mesh = Mesh(
        points_mm=points,
        cells={"hex8": [[0, 1, 3, 2, 4, 5, 7, 6]]},
        cell_regions={"hex8": [0]},
        regions=("soft_tissue",),
        node_sets={"fixed": [0, 1], "contact": [4, 5]},
    )
    return Limb(spot=Spot(name="p1"), mesh=mesh)


def test_everything_that_decides_a_result_is_in_its_key(make_study, plugins, tissue):
    study = make_study()
    design = draw_design(study.space, study.sampler, 2, seed=1)
    job = simulation.jobs(study, design, {})[0]
    protocol = job.protocol
    assert isinstance(protocol, Indentation)
    limb = cube_limb()
    mesh = limb.mesh

    class Newer(tissue.Analytic):
        def version(self):
            return "2"

    class Other(tissue.Spongy):
        name = "other"

    def key(job=job, limb=limb, solver=study.solver):
        return keys.job_key(job, limb, solver)

    moved = replace(limb, mesh=replace(mesh, node_sets={"fixed": [0, 1], "contact": [4, 5, 6]}))
    tilted = replace(limb, spot=Spot(name="p1", normal=[0.0, 0.1, 1.0]))
    changed = {
        "thetas": key(replace(job, thetas={"soft_tissue": job.thetas["soft_tissue"] * (1 + 1e-15)})),
        "material": key(replace(job, materials={"soft_tissue": Other()})),
        "region": key(
            replace(job, materials={"a": tissue.Spongy()}, thetas={"a": job.thetas["soft_tissue"]})
        ),
        "friction": key(replace(job, protocol=replace(protocol, friction=0.9))),
        "path": key(replace(job, protocol=replace(protocol, path=[(0, 0), (9, 0)]))),
        "mesh": key(limb=cube_limb(1e-12)),
        "node sets": key(limb=moved),
        "spot": key(limb=tilted),
        "no limb": key(limb=None),
        "slopes": key(replace(job, slopes=True)),
        "version": key(solver=Newer()),
        "settings": key(solver=tissue.Analytic(tissue.AnalyticSettings(offset=1.0))),
    }
    assert len({key(), *changed.values()}) == len(changed) + 1
    assert key(replace(job, set_id=99)) == key()


def test_a_search_for_what_the_solver_cannot_see_is_refused(make_study, tissue):
    class Blind(tissue.Analytic):
        def ignored(self, material):
            return (material.parameters[0].name,)

    study = make_study(solver=Blind())
    simulation.check_jobs(make_study(), [], {})
    with pytest.raises(
        StudyError, match=r'study.toml: region.soft_tissue.parameters.(\w+): is .* e.g. \1 = "[\d.]+ MPa"$'
    ):
        simulation.check_jobs(study, [], {})


def test_what_the_solver_uses_through_a_tie_may_be_searched(make_study, tissue, space):
    class SeesGrip(tissue.Analytic):
        def ignored(self, material):
            return ("stiffness",)

    (region,) = space.regions
    (stiffness, _) = region.searched
    tied = replace(
        region, searched=(stiffness,), tied={"grip": Tie(source="soft_tissue.stiffness", factor=50.0)}
    )
    simulation.check_jobs(make_study(solver=SeesGrip(), space=ParameterSpace(regions=(tied,))), [], {})


def test_a_parametrisation_that_names_a_value_twice_is_refused(make_study):
    class Twice(StandardParametrisation):
        def parameters(self, space, spots):
            return (*space.parameters, *space.parameters)

    with pytest.raises(PluginError, match=r"searches soft_tissue.grip, soft_tissue.stiffness twice"):
        simulation.check_jobs(make_study(parametrisation=Twice()), [], {})
