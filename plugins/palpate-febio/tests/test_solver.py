"""The solver against a stand-in for FEBio: fallbacks, verification, conventions, litter."""

import tempfile
from dataclasses import replace

import numpy as np
import pytest

from palpate.api import relaxing
from palpate.domain import EquilibriumStates, HomogeneousTests, Indentation, Job, Status
from palpate.domain.indenter import Sphere
from palpate.errors import MaterialError, MeshError, PluginError, StudyError
from palpate.mesh.specimens import block
from palpate.mesh.spot_frame import pose_of
from palpate.run.keys import solver_key
from palpate.testing import SolverContract
from palpate_febio.conventions import Fit, remembered
from palpate_febio.log import read_log
from palpate_febio.outcome import Verdict, check_torque
from palpate_febio.settings import FebioSettings
from palpate_febio.solver import FebioSolver, FebioWarning
from palpate_febio.steps import Steps
from palpate_materials import Demiray, NeoHookean, Ogden, Yeoh
from palpate_materials.relaxation import FORCE_OVER_TIME

PATH = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, -20.0), (2.0, 20.0), (2.0, 0.0)])
LIMB = block(n_across=2, n_down=1)
YEOH = np.array([0.0129, -1e-3, 9.2e-5, 0.6])


@pytest.fixture
def fake(tmp_path, monkeypatch, fake_febio):
    """Say how FEBio behaves; what it leaves in the temporary folder and the cache stays in the test's."""
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))

    def behave(words="", **settings):
        monkeypatch.setenv("FAKE_FEBIO", words)
        given = {"depth_steps": 4, "rotation_step_deg": 5.0, "facet_mm": 1.5, "executable": str(fake_febio)}
        return FebioSolver(FebioSettings(**(given | settings)))

    return behave


def job_of(material=None, theta=YEOH, path=PATH, friction=1.0):
    protocol = Indentation(indenter=Sphere(radius_mm=7.5), path=path, friction=friction)
    return Job(
        spot="p1",
        set_id=7,
        materials={"soft_tissue": material or Yeoh()},
        thetas={"soft_tissue": np.asarray(theta)},
        protocol=protocol,
    )


@pytest.mark.slow
class TestFebioSolver(SolverContract):
    # The stand-in for FEBio computes a force and a torque from one number of the deck.
    blind_to = frozenset({"radius", "limb", "parameters"})

    @pytest.fixture
    def half_space_solver(self):
        return None

    @pytest.fixture
    def solver(self, fake):
        return fake()

    @pytest.fixture
    def finer(self, fake):
        return fake(depth_steps=8, rotation_step_deg=2.5)

    @pytest.fixture
    def job(self):
        return job_of()

    @pytest.fixture
    def limb(self):
        return LIMB


def test_the_result_has_the_protocols_points_and_a_history(fake, tmp_path):
    simulation = fake().simulate(job_of(), LIMB)
    assert simulation.status is Status.OK, simulation.message
    assert simulation.response["force"].abscissa[-1] == 2.0
    assert set(PATH[1:, 1]) <= set(simulation.response["torque"].abscissa)
    found = simulation.diagnostics
    assert [t["method"] for t in found["tries"]] == ["broyden"]
    assert found["conventions"] == {"soft_tissue": "febio4"}
    assert found["contact"] == "augmented"
    assert list((tmp_path / "tmp").iterdir()) == []


def test_the_ladder_is_climbed_and_recorded(fake):
    simulation = fake("broyden_fails").simulate(job_of(), LIMB)
    assert simulation.status is Status.OK
    tries = simulation.diagnostics["tries"]
    assert [(t["method"], t["status"]) for t in tries] == [("broyden", "diverged"), ("newton", "ok")]
    assert "negative Jacobian" in tries[0]["message"]


def test_curves_of_a_tissue_that_relaxes_have_the_times_of_the_moves(fake):
    times_s = np.array([0.0, 1.0, 3.0, 4.0, 5.0])
    path = PATH[[0, 1, 1, 2, 3]]
    elastic = job_of(path=path)
    job = replace(
        elastic,
        materials={"soft_tissue": relaxing(Yeoh(), [0.5], isochoric=True)},
        thetas={"soft_tissue": np.append(YEOH, 0.2)},
        protocol=replace(elastic.protocol, time_s=times_s),
        channels=(FORCE_OVER_TIME, *elastic.channels),
    )
    solver = fake()
    solver.check(job, LIMB)
    simulation = solver.simulate(job, LIMB)
    assert simulation.status is Status.OK, simulation.message
    assert simulation.diagnostics["conventions"] == {"soft_tissue": "febio4"}
    over_time, torque = (simulation.response[name] for name in ("force_over_time", "torque"))
    assert set(times_s) <= set(over_time.abscissa)
    assert torque.time_s[-1] == 5.0
    assert np.interp(-20.0, torque.abscissa[::-1][-5:], torque.time_s[::-1][-5:]) == pytest.approx(4.0)
    assert solver.verify(job, LIMB, simulation)["passed"]
    late = fake("diverge").simulate(job, LIMB)
    assert late.status is Status.DIVERGED
    assert "no balance at step" not in late.message


def test_half_steps_give_results_at_the_same_points(fake):
    whole = fake().simulate(job_of(), LIMB)
    halves = fake(fallbacks=("broyden_half_steps",)).simulate(job_of(), LIMB)
    for channel in ("force", "torque"):
        np.testing.assert_array_equal(halves.response[channel].abscissa, whole.response[channel].abscissa)


@pytest.mark.slow
def test_a_run_that_diverges_by_every_method_keeps_what_it_reached(fake):
    simulation = fake("diverge").simulate(job_of(), LIMB)
    assert simulation.status is Status.DIVERGED
    assert len(simulation.diagnostics["tries"]) == 5
    assert simulation.response["force"].abscissa[-1] == 2.0
    assert "no balance at step" in simulation.message


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "status"),
    [
        ("garbled", Status.UNREADABLE),
        ("cut", Status.UNREADABLE),
        ("zeros", Status.UNREADABLE),
        ("nan", Status.UNREADABLE),
        ("elsewhere", Status.UNREADABLE),
        ("no_banner", Status.UNREADABLE),
        ("crash", Status.CRASHED),
        ("bad_code", Status.CRASHED),
    ],
)
def test_false_output_and_crashes_give_no_curve_and_no_second_attempt(fake, tmp_path, words, status):
    simulation = fake(words).simulate(job_of(), LIMB)
    assert simulation.status is status
    assert simulation.response is None
    assert simulation.message
    assert len(simulation.diagnostics["tries"]) == 1
    assert list((tmp_path / "tmp").iterdir()) == []


@pytest.mark.slow
def test_a_refused_deck_has_a_reason_without_a_log(fake, monkeypatch):
    solver = fake()
    solver.convention(Yeoh())
    monkeypatch.setenv("FAKE_FEBIO", "xml_error")
    simulation = solver.simulate(job_of(), LIMB)
    assert simulation.status is Status.CRASHED
    assert "rigid_bc" in simulation.message


@pytest.mark.slow
def test_a_hanging_run_is_ended(fake):
    simulation = fake("hang", time_limit="1.5 s").simulate(job_of(), LIMB)
    assert simulation.status is Status.TIMED_OUT
    assert simulation.response is None


@pytest.mark.slow
def test_runs_are_kept_on_request(fake, tmp_path):
    keep = tmp_path / "kept"
    fake("broyden_fails", keep_folder=str(keep)).simulate(job_of(), LIMB)
    kept = {str(p.relative_to(keep)) for p in keep.rglob("*") if p.is_file()}
    folders = {"p1/set-7-broyden", "p1/set-7-newton"}
    assert kept == {f"{f}/{name}" for f in folders for name in ("job.feb", "job.log", "rigid.csv")}
    outside = replace(job_of(), spot="../../x")
    fake(keep_folder=str(keep)).simulate(outside, LIMB)
    assert not (tmp_path / "x").exists()


# ---------------------------------------------------------------------- verification


@pytest.mark.slow
def test_a_torque_with_friction_history_passes_verification(fake):
    simulation = fake(verification="every").simulate(job_of(), LIMB)
    verification = simulation.diagnostics["verification"]
    assert verification["passed"]
    assert abs(verification["halving"]) < 1e-9
    assert abs(verification["hold"]) < 1e-9
    assert simulation.message == ""


def test_a_check_reports_elements_that_lock(fake):
    said = r"spot 'p1': FEBio's tet4 of region 'soft_tissue' locks\. The force is up to about \d+% too high"
    with pytest.warns(FebioWarning, match=said):
        fake().check(job_of(), block("tet4", n_across=4, n_down=2))


def test_the_papers_contact_warns_and_fails_its_gates(fake):
    solver = fake(verification="every", contact="paper")
    with pytest.warns(FebioWarning, match="no memory"):
        solver.check(job_of(), LIMB)
    simulation = solver.simulate(job_of(), LIMB)
    verification = simulation.diagnostics["verification"]
    assert not verification["passed"]
    assert verification["halving"] == pytest.approx(-0.5)
    assert verification["hold"] == pytest.approx(-0.5)
    assert "NOT to be relied on" in simulation.message
    assert any("no memory" in remark for remark in simulation.diagnostics["remarks"])


@pytest.mark.slow
def test_there_is_nothing_to_prove_without_a_twist_or_friction(fake):
    for job in (job_of(path=PATH[:2]), job_of(friction=0.0)):
        assert fake(verification="every").simulate(job, LIMB).diagnostics["verification"] == {}


@pytest.mark.parametrize(("n_rows", "halving"), [(9, 0.0), (8, None)])
def test_an_unfinished_finer_run_verifies_nothing_and_reports_what_it_has(n_rows, halving):
    steps = Steps(np.array([0.0, 1.0, 2.0, 2.0, 2.0]), np.array([0.0, 0.0, 0.0, -10.0, -20.0]))

    def run(finer):
        wrench = pose_of(finer.depth_mm, finer.rotation_deg / 10)
        states = EquilibriumStates(pose=pose_of(finer.depth_mm, finer.rotation_deg), wrench=wrench)
        status, reached = Status.DIVERGED, states.cut(slice(n_rows))
        return Verdict(status=status, message="no balance", states=reached, log=read_log(""))

    verification = check_torque(steps, -2.0, run, 0.02)
    assert (verification.passed, verification.halving, verification.hold) == (False, halving, None)
    assert "no balance" in str(verification)
    assert ("halved steps" in str(verification)) == (halving is not None)


# ---------------------------------------------------------------- conventions


@pytest.mark.slow
def test_the_convention_follows_the_probe(fake, tmp_path):
    keep = tmp_path / "kept"
    for words, convention, c3 in (("", "febio4", 2.76e-4), ("textbook_yeoh", "textbook", 9.2e-5)):
        solver = fake(words + f" version=4.1{len(words)}", keep_folder=str(keep))
        (tmp_path / "bin" / "libfebiomech.so").write_text(words)  # another build
        found = solver.convention(Yeoh())
        assert found.convention == convention
        assert found.deviations[convention] < 1e-9
        assert max(found.deviations.values()) > 1e-3
        solver.simulate(job_of(), LIMB)
        deck = (keep / "p1" / "set-7-broyden" / "job.feb").read_text()
        assert f"<c3>{c3:.12g}</c3>" in deck


@pytest.mark.slow
def test_a_binary_is_probed_once(fake, tmp_path):
    for _ in range(2):
        assert fake().convention(Yeoh()).convention == "febio4"
    assert (tmp_path / "count").read_text() == "probe\n"
    fake().convention(NeoHookean())
    (tmp_path / "bin" / "libfebiomech.so").write_text("another build")
    fake().convention(Yeoh())
    assert (tmp_path / "count").read_text() == "probe\n" * 3


def test_a_damaged_cache_costs_a_probe(tmp_path):
    fit = Fit("textbook", {"textbook": 1e-10})
    assert remembered(Ogden(), "d" * 64, lambda: fit, tmp_path) == fit
    assert remembered(Ogden(), "d" * 64, lambda: pytest.fail("probed again"), tmp_path) == fit
    (file,) = tmp_path.iterdir()
    file.write_text('{"half')
    assert remembered(Ogden(), "d" * 64, lambda: fit, tmp_path) == fit


def test_a_material_whose_energy_or_code_changes_is_probed_again(tmp_path, monkeypatch):
    class Stiffer(Ogden):
        factor = 1.0

        def energy(self, stretches, theta):
            return self.factor * super().energy(stretches, theta)

    fit, probes = Fit("textbook", {"textbook": 1e-10}), []
    for Stiffer.factor in (1.0, 1.0, 1.1):
        remembered(Stiffer(), "d" * 64, lambda: probes.append(Stiffer.factor) or fit, tmp_path)
    assert probes == [1.0, 1.1]
    monkeypatch.setattr(Stiffer, "fingerprint", lambda self: "other code, the same energy here")
    remembered(Stiffer(), "d" * 64, lambda: probes.append("again") or fit, tmp_path)
    assert probes == [1.0, 1.1, "again"]


def test_what_fits_no_convention_is_refused_with_the_figures(fake):
    solver = fake("odd_yeoh")
    with pytest.raises(MaterialError, match=r"textbook \d.*febio4 \d"):
        solver.check(job_of(), LIMB)
    simulation = solver.simulate(job_of(), LIMB)
    assert simulation.status is Status.CRASHED
    assert "fits no known convention" in simulation.message


class Silicone(Ogden):
    """A material of a third party, with its own spelling."""

    name = "silicone"
    febio = ("Ogden", {"kappa": "k"})


class Misnamed(Ogden):
    """The same with a wrong mapping: FEBio's neo-Hookean is not it."""

    name = "misnamed"
    febio = ("neo-Hookean", {"c1": "E", "m1": "v", "kappa": "k"})


class Misspelled(Ogden):
    """The same with a parameter that it does not have."""

    name = "misspelled"
    febio = ("Ogden", {"kapa": "k"})


@pytest.mark.slow
def test_a_third_partys_mapping_is_probed_too(fake):
    assert fake().convention(Silicone()).convention == "textbook"
    with pytest.raises(MaterialError, match="misnamed"):
        fake().convention(Misnamed())
    with pytest.raises(MaterialError, match="kapa"):
        fake().convention(Misspelled())


@pytest.mark.slow
def test_ogden_and_neo_hookean_fit_the_textbook(fake):
    for material in (Ogden(), NeoHookean()):
        found = fake().convention(material)
        assert found.convention == "textbook"
        assert found.deviations["textbook"] < 1e-9


def test_only_what_changes_a_result_makes_another_simulation(fake, tmp_path):
    key = solver_key(fake())
    harmless = {
        "threads": 2,
        "time_limit": "9 s",
        "keep_folder": str(tmp_path / "kept"),
        "verification": "never",
    }
    assert solver_key(fake(**harmless)) == key
    assert len({key, solver_key(fake(penalty=50.0)), solver_key(fake(contact="paper"))}) == 3


# ------------------------------------------------------------------ bad input


def test_what_cannot_be_run_is_refused_before(fake, monkeypatch, tmp_path):
    solver = fake()
    with pytest.raises(StudyError, match="needs a mesh"):
        solver.check(job_of(), None)
    tests = replace(job_of(), protocol=HomogeneousTests(paths={"uniaxial": np.array([1.0, 1.2])}))
    with pytest.raises(StudyError, match="homogeneous"):
        solver.check(tests, LIMB)
    with pytest.raises(MaterialError, match="demiray"):
        solver.check(job_of(Demiray(), [0.05, 1.0, 1.0]), LIMB)
    inverted = LIMB.mesh.cells["hex8"][:, [4, 5, 6, 7, 0, 1, 2, 3]]
    with pytest.raises(MeshError, match="inverted"):
        solver.check(job_of(), replace(LIMB, mesh=replace(LIMB.mesh, cells={"hex8": inverted})))
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    with pytest.raises(PluginError, match="febio"):
        fake(executable="").check(job_of(), LIMB)
