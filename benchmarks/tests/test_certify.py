"""Comparison of solvers: agreement, and differences that are reported."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import certify
import numpy as np
import pytest

from palpate.cli.app import main
from palpate.domain import MOVES, Channel, Curve, Response, Simulation, Status
from palpate.domain.channels import EQUILIBRIUM_CHANNELS
from palpate.domain.equilibrium_states import STATE_COLUMNS, EquilibriumStates
from palpate.errors import MaterialError
from palpate.mesh.specimens import block
from palpate.plugins.interfaces import Solver
from palpate.plugins.provides import Provides
from palpate_febio.binary import find_binary
from palpate_febio.limb_source import FebioDeckSource
from palpate_indentation import MeshioSource
from palpate_limb.limb_files import write_limb
from palpate_materials import NeoHookean, Ogden, Yeoh
from solver_comparison.comparison import Case, Row, SolverComparison, at, compared
from solver_comparison.pairwise import TWIST_DEG, not_shared, twist_rows
from solver_comparison.recorded import RECORDED_VALUES, block_rows, one_element, recorded_deviation

CERTIFY = ("--plugin", str(Path(__file__).parents[1] / "certify.py"), "certify")

MATERIALS = {"ogden": Ogden, "yeoh": Yeoh, "neo_hookean": NeoHookean}


@pytest.mark.slow
def test_the_embedded_solver_agrees_with_febios_curves(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert main([*CERTIFY, "yeoh", "--into", str(tmp_path)]) == 0
    shown = capsys.readouterr().out
    assert "the solvers agree" in shown
    assert "missing: FEBio itself" in shown
    found = json.loads((tmp_path / "solver-comparison.json").read_text())
    assert found["passed"]
    assert {(r["problem"], r["quantity"]) for r in found["rows"]} == {
        ("one element", "stress"),
        ("bonded punch", "force"),
        ("bonded punch", "torque"),
        ("frictionless press", "force"),
        ("frictional twist", "torque: steps halved"),
        ("frictional twist", "torque: hold"),
        ("frictional twist, tet10", "torque: steps halved"),
        ("frictional twist, tet10", "torque: hold"),
    }
    assert all(r["verdict"] == "agrees" for r in found["rows"])
    assert list(found["solvers"]) == ["jax"]


@pytest.mark.slow
@pytest.mark.parametrize("name", RECORDED_VALUES)
def test_one_element_has_the_recorded_stress_in_one_convention(name):
    (row,) = one_element(MATERIALS[name](), None)
    assert row.difference < 1e-8
    assert ("febio4" in row.note) == (name == "yeoh")
    rows_of, sent = RECORDED_VALUES[name]
    assert recorded_deviation(MATERIALS[name](), rows_of, 1.01 * np.array(sent)) > 1e-3


class Echo(Solver):
    """Returns given curves for every job."""

    name = "echo"
    summary = "answers with given curves"

    def __init__(self, respond):
        super().__init__()
        self.respond = respond

    def simulate(self, job, limb):
        return self.respond(job)


def case_of(path):
    limb = block(n_across=2, n_down=1)
    return Case(
        problem="press",
        name="ogden",
        limb=limb,
        materials={"soft_tissue": Ogden()},
        thetas={"soft_tissue": np.array([0.06, 3.0, 1.0])},
        path=np.array(path),
        friction=1.0,
        mean_dilatation=True,
    )


def answering(factor, status=Status.OK, message=""):
    def respond(job):
        depth = job.protocol.path[:, 0]
        curve = Curve(channel="force", abscissa=depth, ordinate=factor * depth)
        response = Response(curves={"force": curve})
        return Simulation(job=job, status=status, response=response, message=message)

    return lambda _: Echo(respond)


REFERENCES = {"force": ([1.0, 2.0], np.array([1.0, 2.0]), 2.0)}


@pytest.mark.parametrize(
    ("contender", "verdict", "difference"),
    [
        (answering(1.0), "agrees", 0.0),
        (answering(1.02), "differs", 0.02),
        (answering(1.0, Status.DIVERGED, "no balance"), "failed", None),
    ],
)
def test_verdicts(contender, verdict, difference):
    case = case_of([(0, 0), (1, 0), (2, 0)])
    (row,) = compared(case, {"echo": contender}, REFERENCES, 0.01)
    assert row.verdict == verdict
    assert row.difference == (None if difference is None else pytest.approx(difference))
    assert row.note == ("no balance" if verdict == "failed" else "")
    comparison = SolverComparison(rows=(row,), solvers={}, missing=())
    assert comparison.passed == (verdict == "agrees")
    assert comparison.as_json()["rows"][0]["verdict"] == verdict


class Choosy(Echo):
    """Takes nothing."""

    def check(self, job, limb):
        raise MaterialError("material 'ogden' is not for me")


def test_an_unsupported_problem_is_open_and_shows_no_agreement():
    makers = {"choosy": lambda _: Choosy(None), "echo": answering(1.0)}
    rows = list(compared(case_of([(0, 0), (1, 0), (2, 0)]), makers, REFERENCES, 0.01))
    assert [r.verdict for r in rows] == ["open", "agrees"]
    assert rows[0].note == "material 'ogden' is not for me"
    comparison = SolverComparison(rows=tuple(rows), solvers={}, missing=())
    assert comparison.passed
    assert comparison.by_solver == {"choosy": False, "echo": True}
    twisted = list(twist_rows(block(n_across=2, n_down=1), Ogden(), np.ones(3), {"choosy": makers["choosy"]}))
    assert [r.verdict for r in twisted] == ["open", "open"]


def test_a_result_that_does_not_reach_there_is_open():
    (row,) = compared(case_of([(0, 0), (1, 0)]), {"echo": answering(1.0)}, REFERENCES, 0.01)
    assert (row.verdict, row.note) == ("failed", "its force does not reach 2")


def test_places_are_taken_in_the_order_of_the_path():
    curve = Curve(channel="torque", abscissa=[0, -1, 0, 1, 0], ordinate=[0.0, -2.0, 0.5, 2.0, -0.5])
    np.testing.assert_array_equal(at(curve, [-1, 0, 0]), [-2.0, 0.5, 0.5])
    np.testing.assert_array_equal(at(curve, [1, 0]), [2.0, -0.5])
    assert np.isnan(at(curve, [3.0])).all()


def forgetful(steps_matter):
    """A torque that shrinks with the steps and decays in a hold, as penalty friction's does."""

    def respond(job):
        turn = job.protocol.path[:, 1]
        slip = np.diff(turn, prepend=0.0)
        torque = slip if steps_matter else turn
        curves = {
            "torque": Curve(channel="torque", abscissa=turn, ordinate=torque),
            "force": Curve(channel="force", abscissa=job.protocol.path[:3, 0], ordinate=[0.0, 1.0, 2.0]),
        }
        return Simulation(job=job, status=Status.OK, response=Response(curves=curves))

    return lambda _: Echo(respond)


def test_friction_without_memory_is_found_out():
    limb = block(n_across=2, n_down=1)
    contenders = {"forgetful": forgetful(True), "right": forgetful(False)}  # the first is not the judge
    rows = list(twist_rows(limb, Ogden(), np.array([0.06, 3.0, 1.0]), contenders))
    by = {(r.solver, r.quantity): r for r in rows}
    for quantity in ("torque: steps halved", "torque: hold"):
        assert by["right", quantity].verdict == "agrees"
        assert by["forgetful", quantity].verdict == "differs"
    assert by["forgetful", "torque"].against == "right"
    assert by["forgetful", "torque"].difference == pytest.approx(0.8)
    assert by["forgetful", "force"].verdict == "agrees"
    assert TWIST_DEG == -22.5


def test_others_are_compared_with_references_and_not_the_other_way_round():
    limb, theta = block(n_across=2, n_down=1), np.array([0.06, 3.0, 1.0])
    contenders = {"alien": forgetful(False), "ours": forgetful(False)}
    rows = list(twist_rows(limb, Ogden(), theta, contenders, references=["ours"]))
    assert {(r.solver, r.against) for r in rows if r.against != "itself"} == {("alien", "ours")}
    contenders = {"ours": forgetful(True), "alien": forgetful(False), "other": forgetful(False)}
    rows = list(twist_rows(limb, Ogden(), theta, contenders, references=["ours"]))
    assert {r.against for r in rows} == {"itself"}


def wrench(factor):
    """Equilibrium states whose loads are in proportion to the pose; a moment of its own solver alone."""

    def respond(job):
        pose = job.protocol.waypoints.pose
        loads = pose * np.array([2.0, factor, 1.0, 3.0, 1.0, 5.0])
        states = EquilibriumStates(pose=pose, wrench=loads)
        return Simulation(job=job, status=Status.OK, response=states.observed(job.channels))

    return lambda _: Sliding(respond)


class Sliding(Echo):
    provides = Provides(columns=STATE_COLUMNS, motions=("depth", "rotation", "shift", "tilt"))


PUSH = Channel(
    name="push", abscissa="depth_mm", ordinate="lateral_x_N", abscissa_label="mm", ordinate_label="N"
)
CHANNELS = {channel.name: channel for channel in (*EQUILIBRIUM_CHANNELS, PUSH)}


def test_solvers_are_compared_in_every_channel_that_both_provide():
    limb, theta = block(n_across=2, n_down=1), np.array([0.06, 3.0, 1.0])
    contenders = {"ours": wrench(1.0), "theirs": wrench(1.1), "plain": forgetful(False)}
    twisted = list(twist_rows(limb, Ogden(), theta, contenders, "twist", ["ours"], CHANNELS.values()))
    pairs = {(r.solver, r.quantity) for r in twisted if r.against == "ours"}
    assert pairs == {("theirs", "force"), ("theirs", "torque"), ("theirs", "push"), ("plain", "force"),
                     ("plain", "torque")}  # fmt: skip


def test_what_is_not_shared_is_said():
    able = Provides(columns=STATE_COLUMNS, indenters=None, motions=MOVES, slopes=True, fields=True)
    plain = Provides(indenters=("sphere", "cone"), max_regions=1)
    assert not_shared({"able": able, "plain": plain}, list(EQUILIBRIUM_CHANNELS)) == [
        "not compared, 'able' alone and not 'plain': channels lateral_force, tilt_moment, motions with "
        "shift, tilt, load, indenters other than sphere, cone, more than 1 region, cell fields, slopes"
    ]
    (line,) = not_shared({"one": Provides(), "two": replace(Provides(), indenters=("cone",))}, [])[:1]
    assert line == "not compared, 'one' alone and not 'two': indenters sphere"
    assert not_shared({"one": able, "two": able}, list(EQUILIBRIUM_CHANNELS)) == []


def test_a_solver_is_compared_in_what_it_provides_alone():
    class Pressing(Echo):
        provides = Provides(channels=("force",), motions=("depth",))

    rows = list(block_rows("ogden", MATERIALS, {"echo": lambda _: Pressing(answering(1.0)(0).respond)}))
    assert {(r.problem, r.quantity, r.verdict) for r in rows} == {
        ("bonded punch", "force", "open"),
        ("bonded punch", "torque", "open"),
        ("frictionless press", "force", "differs"),
    }
    assert rows[0].note == "it does not provide motions with rotation"
    silent = Pressing(answering(1.0)(0).respond)
    (row,) = compared(
        case_of([(0, 0), (1, 0)]), {"echo": lambda _: silent}, {"torque": ([1.0], np.ones(1), 1.0)}, 0.1
    )
    assert (row.verdict, row.note) == ("open", "it does not provide channel 'torque'")


def test_a_torque_of_zero_is_a_failure():
    def respond(job):
        curve = Curve(
            channel="torque", abscissa=job.protocol.path[:, 1], ordinate=0 * job.protocol.path[:, 1]
        )
        force = Curve(channel="force", abscissa=[0.0, 1.0], ordinate=[0.0, 1.0])
        both = Response(curves={"torque": curve, "force": force})
        return Simulation(job=job, status=Status.OK, response=both)

    rows = list(
        twist_rows(block(n_across=2, n_down=1), Ogden(), np.ones(3), {"idle": lambda _: Echo(respond)})
    )
    assert [(r.verdict, r.note) for r in rows] == [("failed", "its torque is 0 at the end of the twist")] * 2


ALIEN = """
from palpate import Simulation, Solver, Status, hookimpl

class Alien(Solver):
    name = "alien"
    summary = "has no answer"

    def simulate(self, job, limb):
        return Simulation(job=job, status=Status.DIVERGED, response=None, message="no idea")

@hookimpl
def palpate_solvers():
    return [Alien]
"""


@pytest.mark.slow
def test_a_third_party_solver_is_compared_on_request(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr("solver_comparison.recorded.block_rows", lambda *_: iter(()))

    def only_named(limb, material, theta, contenders, problem, references, channels):
        assert references == ["jax"]
        assert {"force", "lateral_force"} <= {channel.name for channel in channels}
        for name in contenders:
            yield Row(problem=problem, material="", quantity="", solver=name, against="", tolerance=1.0,
                      difference=0.0 if name == "jax" else None)  # fmt: skip

    monkeypatch.setattr("solver_comparison.pairwise.twist_rows", only_named)
    (tmp_path / "alien.py").write_text(ALIEN)
    call = ["--plugin", str(tmp_path / "alien.py"), *CERTIFY, "yeoh", "--json"]
    assert main(call) == 0
    own = json.loads(capsys.readouterr().out)
    assert list(own["solvers"]) == own["judged"] == ["jax"]
    assert "not compared: alien; name each with --solver" in own["missing"]
    assert main([*call, "--solver", "alien"]) == 1
    asked = json.loads(capsys.readouterr().out)
    assert (list(asked["solvers"]), asked["judged"]) == (["jax", "alien"], ["alien"])
    assert asked["by_solver"]["alien"] is False
    assert any("not compared, 'jax' alone and not 'alien': " in line for line in asked["missing"])
    for name, said in (
        ("homogeneous", "takes no mesh"),
        ("febio", "febio4"),
        ("alein", "did you mean 'alien'"),
    ):
        assert main([*call, "--solver", name]) == 2
        assert said in capsys.readouterr().err


def test_a_mesh_is_compared_as_one_material_for_any_regions(tmp_path):
    write_limb(tmp_path / "limb.vtu", block(n_across=2, n_down=2, layers_mm={"skin": 2.0}))
    plugins = SimpleNamespace(limb_sources={"meshio": MeshioSource, "febio_deck": FebioDeckSource})
    assert certify._read(plugins, tmp_path / "limb.vtu").mesh.regions == ("soft_tissue",)


def test_the_recorded_block_is_the_one_that_is_simulated():
    asked = []

    def respond(job):
        asked.append(job)
        return Simulation(job=job, status=Status.CRASHED, response=None, message="only looking")

    rows = list(block_rows("layered", MATERIALS, {"echo": lambda _: Echo(respond)}))
    assert [r.verdict for r in rows] == ["failed"] * 3
    bonded, pressed = asked
    np.testing.assert_allclose(bonded.protocol.path[-1], [3.0, 22.5])
    np.testing.assert_allclose(pressed.protocol.path, [(0, 0), (2, 0), (4, 0)])
    assert set(bonded.materials) == {"skin", "soft_tissue"}


def test_a_solver_that_raises_fails_only_its_rows():
    def respond(job):
        raise ZeroDivisionError("a layer of no thickness")

    rows = list(block_rows("layered", MATERIALS, {"echo": lambda _: Echo(respond)}))
    assert [r.verdict for r in rows] == ["failed"] * 3
    assert all("ZeroDivisionError: a layer of no thickness" in r.note for r in rows)


# ----------------------------------------------------------- the real program


def _febio():
    try:
        return find_binary()
    except Exception:
        return None


needs_febio = pytest.mark.skipif(
    _febio() is None, reason="no febio4 on this machine: its recorded curves stand in"
)


@needs_febio
@pytest.mark.parametrize("name", MATERIALS)
def test_the_installed_febio_reads_coefficients_in_a_known_way(name):
    from palpate_febio.solver import FebioSolver

    found = FebioSolver().convention(MATERIALS[name]())
    assert found.deviations[found.convention] < 1e-6


@needs_febio
def test_the_installed_febio_agrees_with_its_record():
    from palpate_febio.solver import FebioSolver

    rows = list(block_rows("ogden", MATERIALS, {"febio": lambda _: FebioSolver()}))
    assert [r.verdict for r in rows] == ["agrees"] * 3, [r.note for r in rows]
