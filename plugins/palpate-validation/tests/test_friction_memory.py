"""``palpate friction-memory``."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate.domain import BalancedStates, Curve, Response, Simulation, Status
from palpate.mesh.spot_frame import pose_of
from palpate_febio.steps import steps_of
from palpate_validation.friction_memory import SCENARIOS, best_multiple, friction_results, recorded, resampled


def curves(factor=1.0, n=8, memory=True):
    turn = np.concatenate([np.linspace(0, -20, n + 1), np.linspace(-20, 20, 2 * n + 1)[1:]])
    torque = turn if memory else np.diff(turn, prepend=0.0)
    depth = np.linspace(0.0, 2.0, 5)
    return Response(
        curves={
            "force": Curve(channel="force", abscissa=depth, ordinate=depth**1.5),
            "torque": Curve(channel="torque", abscissa=turn, ordinate=factor * torque),
        }
    )


def test_a_stiffness_found_by_torque_makes_up_for_the_torque_that_is_missing():
    right, half = curves(), curves(0.5)
    assert best_multiple(half, right, SCENARIOS["II"]) == pytest.approx(2.0)
    assert best_multiple(half, right, SCENARIOS["III"]) == pytest.approx(1.0)
    assert 1.0 < best_multiple(half, right, SCENARIOS["I"]) < 2.0
    assert best_multiple(right, right, SCENARIOS["I"]) == pytest.approx(1.0)


def test_the_best_multiple_is_the_best():
    right, other = curves(), curves(0.7)
    s = best_multiple(other, right, SCENARIOS["I"])

    def misfit(multiple):
        return sum(
            np.mean((multiple * other[k].ordinate - right[k].ordinate) ** 2)
            * len(right[k].ordinate)
            / np.abs(right[k].ordinate).mean() ** 2
            for k in ("force", "torque")
        )

    assert misfit(s) < min(misfit(0.99 * s), misfit(1.01 * s))


def test_paths_are_compared_by_what_was_travelled():
    fine, coarse = curves(n=16), curves(n=4)
    np.testing.assert_allclose(resampled(fine["torque"], coarse["torque"]), coarse["torque"].ordinate)
    with pytest.raises(ValueError, match="not the same protocol"):
        resampled(fine["torque"], fine["force"])


def test_without_memory_more_steps_find_a_stiffer_tissue():
    runs = {("penalty", n): (curves(n=n, memory=False), "") for n in (4, 8, 16)}
    runs["penalty", 32] = (None, "no balance")
    found = list(friction_results("a block", runs, curves()))
    stiffness = [o.stiffness["II"] for o in found[:3]]
    assert stiffness[1] / stiffness[0] == pytest.approx(2.0, rel=0.2)
    assert stiffness[2] / stiffness[1] == pytest.approx(2.0, rel=0.2)
    assert all(o.stiffness["III"] == pytest.approx(1.0) for o in found[:3])
    assert (found[3].torque_Nmm, found[3].note) == (None, "no balance")


def test_the_record_shows_it():
    found = [o for o in recorded() if o.problem.startswith("one hex8")]
    penalty = [o.stiffness["II"] for o in found if o.form == "penalty"]
    augmented = [o.stiffness["II"] for o in found if o.form == "augmented"]
    np.testing.assert_allclose(penalty, [2.26, 4.11, 8.33], rtol=0.01)
    assert max(augmented) - min(augmented) < 0.01
    coarse = {(o.form, o.n_steps): o for o in recorded() if o.problem.startswith("coarse block")}
    assert coarse["embedded", 10].relative == pytest.approx(1.0, abs=0.002)
    assert coarse["penalty", 10].stiffness["II"] == pytest.approx(1.86, abs=0.01)
    assert coarse["augmented to 1 %", 10].relative == pytest.approx(0.50, abs=0.01)
    assert coarse["augmented", 10].relative == pytest.approx(coarse["augmented", 5].relative, rel=0.005)
    forearm = {(o.form, o.n_steps): o for o in recorded() if "forearm" in o.problem}
    by_torque = [forearm["penalty", n].stiffness["II"] for n in (5, 10, 20)]
    assert by_torque == sorted(by_torque)
    assert by_torque[-1] / by_torque[0] == pytest.approx(1.126, abs=0.001)
    assert len({forearm["penalty", n].stiffness["III"] for n in (5, 10, 20)}) == 1
    assert forearm["embedded", 10].stiffness["II"] == pytest.approx(1.0, abs=0.002)


@given(st.floats(0.05, 20.0), st.sampled_from(sorted(SCENARIOS)))
def test_tissue_with_s_times_the_force_is_s_times_as_stiff(s, scenario):
    x = np.linspace(0.0, 1.0, 7)

    def response(factor):
        pairs = (("force", x**1.5), ("torque", np.sin(x)))
        return Response(
            curves={name: Curve(channel=name, abscissa=x, ordinate=factor * y) for name, y in pairs}
        )

    found = best_multiple(response(1.0 / s), response(1.0), SCENARIOS[scenario])
    assert found == pytest.approx(s, rel=1e-12)


def elastic(self, job, limb):
    """What friction that remembers gives, by a formula."""
    rows = steps_of(job.protocol, 20, self.settings.rotation_step_deg)
    pose, wrench = pose_of(rows.depth_mm, rows.rotation_deg), pose_of(rows.depth_mm**1.5, rows.rotation_deg)
    states = BalancedStates(pose=pose, wrench=wrench)
    return Simulation(job=job, status=Status.OK, response=states.observed(job.channels))


@pytest.mark.slow
def test_with_febio_every_form_is_run_and_without_it_is_missed(call, fake_febio, monkeypatch, tmp_path):
    monkeypatch.setattr("palpate_validation.friction_command.DEMO", ("no such study", ""))
    monkeypatch.setattr("palpate_jax.solver.JaxSolver.simulate", elastic)
    with pytest.warns(UserWarning, match="no memory"):
        found = call("friction-memory", "--steps", "2", "--steps", "4", "--json", plugin=None).json
    ran = [o for o in found["results"] if o["problem"] == "a block"]
    assert [(o["form"], o["n_steps"]) for o in ran] == [
        (form, n) for form in ("embedded", "augmented", "penalty") for n in (2, 4)
    ]
    torque = {(o["form"], o["n_steps"]): o["torque_Nmm"] for o in ran}
    assert torque["penalty", 4] == pytest.approx(torque["penalty", 2] / 2)
    assert torque["augmented", 4] == pytest.approx(torque["augmented", 2])
    assert found["missing"] == []
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.setenv("HOME", str(tmp_path))
    shown = call("friction-memory", "--steps", "2", plugin=None)
    assert shown.code == 0
    assert "missing: FEBio's two forms" in shown.out
    assert "recorded with FEBio 4.11" in shown.out
