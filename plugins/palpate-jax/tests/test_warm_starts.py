"""Laws of sets with warm starts: the same bits in any order, and the results of cold starts."""

import random
import shutil
from dataclasses import replace

import numpy as np
import pytest

from palpate.domain import Indentation, Job, Status
from palpate.domain.indenter import Sphere
from palpate.mesh.specimens import block
from palpate_jax import path_simulation, solver as solver_module
from palpate_jax.initial_guess import InitialGuess, WarmStartStates
from palpate_jax.path_simulation import PathSimulations
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_materials.uncoupled import Yeoh

YEOH = np.array([0.0141, -0.0011, 1.05e-4, 0.4])
SETS = YEOH * np.random.default_rng(7).uniform(0.8, 1.25, (8, 4))
PATH = [(0.0, 0.0), (2.0, 0.0), (2.0, -10.0), (2.0, 10.0)]
SETTINGS = JaxSettings(depth_steps=3, rotation_step_deg=5.0, tolerance=1e-6)
COLLAPSES = [0.0141, -0.006, 1e-6, 0.4]


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(solver_module, "GROUPS", (3, 5))
    return tmp_path / "cache" / "palpate" / "warm_starts"


@pytest.fixture(scope="module")
def limb():
    return block("hex8", n_across=6, n_down=2, width_mm=24.0, height_mm=10.0, grading=1.4)


def job_of(set_id, path=PATH, sets=SETS, **changes):
    n = JaxSolver(SETTINGS).n_warm_starts(set_id)
    return Job(
        spot="block",
        set_id=set_id,
        materials={"soft_tissue": Yeoh()},
        thetas={"soft_tissue": np.array(sets[set_id])},
        protocol=Indentation(indenter=Sphere(radius_mm=7.5), path=np.array(path), friction=0.6),
        warm_starts={"soft_tissue": np.array(sets[:n])} if n else None,
        is_warm_start=set_id < 5,
        **changes,
    )


def bits(simulation):
    return {name: curve.ordinate.tobytes() for name, curve in simulation.response.curves.items()}


@pytest.mark.slow
def test_the_same_bits_in_any_order_on_any_worker_and_without_the_files(limb, cache):
    expected = [bits(s) for s in JaxSolver(SETTINGS).simulate_many(map(job_of, range(8)), limb)]
    drawn = random.Random(3)
    for _ in range(3):
        order = drawn.sample(range(8), 5)
        workers = [JaxSolver(SETTINGS) for _ in range(2)]
        for set_id in order:
            if drawn.random() < 0.3:
                shutil.rmtree(cache)
            found = drawn.choice(workers).simulate(job_of(set_id), limb)
            assert bits(found) == expected[set_id]


@pytest.mark.slow
def test_a_start_from_warm_starts_saves_effort_and_changes_no_result(limb):
    used = JaxSolver(SETTINGS)
    *_, warm = used.simulate_many(map(job_of, range(8)), limb)
    alone = used.simulate(replace(job_of(7), warm_starts=None), limb)
    assert warm.diagnostics["n_warm_starts"] == 5
    assert warm.diagnostics["n_iterations"] < 0.9 * alone.diagnostics["n_iterations"]
    for channel in ("force", "torque"):
        expected = alone.response[channel].ordinate
        np.testing.assert_allclose(
            warm.response[channel].ordinate, expected, atol=1e-4 * np.abs(expected).max()
        )


@pytest.mark.slow
def test_warm_starts_that_are_simulated_first_count_in_the_seconds(limb, monkeypatch):
    clock, walk = [0.0], PathSimulations._walk

    def walked(self, *given):
        clock[0] += 1.0
        return walk(self, *given)

    monkeypatch.setattr(PathSimulations, "_walk", walked)
    monkeypatch.setattr(path_simulation.time, "perf_counter", lambda: clock[0])
    used = JaxSolver(SETTINGS)
    assert used.simulate(job_of(3), limb).seconds == 4.0  # three warm starts and itself
    assert used.simulate(job_of(4), limb).seconds == 1.0


@pytest.mark.slow
def test_warm_starts_that_diverge_are_left_out(limb, monkeypatch):
    path = [(0.0, 0.0), (4.0, 0.0)]
    sets = np.array([COLLAPSES, *SETS[1:]])
    found = JaxSolver(SETTINGS).simulate(job_of(3, path, sets), limb)
    assert found.status is Status.OK, found.message
    assert found.diagnostics["n_warm_starts"] == 2
    monkeypatch.setattr(solver_module, "GROUPS", (1, 5))
    cold = JaxSolver(SETTINGS).simulate(replace(job_of(1, path, sets), warm_starts=None), limb)
    alone = JaxSolver(SETTINGS).simulate(job_of(1, path, sets), limb)
    assert alone.diagnostics["n_warm_starts"] == 0
    assert bits(alone) == bits(cold)


def test_states_in_a_folder_that_cannot_be_changed_are_read(tmp_path, monkeypatch):
    states = WarmStartStates(tmp_path)
    states.store("a", [np.ones((2, 3))])

    def refuse(path):
        raise PermissionError(path)

    monkeypatch.setattr("os.utime", refuse)
    np.testing.assert_array_equal(WarmStartStates(tmp_path).load("a"), np.ones((1, 2, 3)))


def test_without_the_setting_no_set_has_warm_starts():
    assert [JaxSolver(SETTINGS).n_warm_starts(i) for i in (0, 2, 3, 4, 5, 99)] == [0, 0, 3, 3, 5, 5]
    assert JaxSolver(SETTINGS.model_copy(update={"warm_starts": False})).n_warm_starts(99) == 0


def test_a_guess_that_the_warm_starts_span_is_corrected_to_it():
    """A state between the warm starts is found at the next load step, whatever the interpolation says."""
    drawn = np.random.default_rng(1)
    stacks = [drawn.normal(size=(3, 20, 3)).astype(np.float32) for _ in range(4)]
    guess, true = InitialGuess(np.array([1.0, 0.0, 0.0, 0.0]), stacks), (0.4, 0.3, 0.2, 0.1)
    at = np.tensordot(true, np.array(stacks, dtype=float), 1)[1:]
    corrected, interpolated = guess.at(1, at[0])
    np.testing.assert_allclose(corrected, at[1], atol=1e-5)
    np.testing.assert_array_equal(interpolated, stacks[0][2])


def test_states_come_back_and_what_is_cut_short_counts_as_missing(tmp_path, monkeypatch):
    states, stack = (
        WarmStartStates(tmp_path),
        np.random.default_rng(2).normal(size=(4, 5, 3)).astype(np.float32),
    )
    states.store("a", stack)
    np.testing.assert_array_equal(WarmStartStates(tmp_path).load("a"), stack)
    (tmp_path / "a.npy").write_bytes((tmp_path / "a.npy").read_bytes()[:-8])
    assert WarmStartStates(tmp_path).load("a") is None
    monkeypatch.setattr("palpate_jax.initial_guess.MOST_BYTES", 700)
    for name in "abcd":
        states.store(name, stack)
    assert 1 <= len(list(tmp_path.iterdir())) <= 2
    assert states.load("d") is not None


def test_a_folder_that_cannot_be_made_leaves_the_states_in_memory(tmp_path):
    (tmp_path / "file").write_text("in the way")
    states, stack = WarmStartStates(tmp_path / "file" / "below"), np.zeros((2, 3, 3), dtype=np.float32)
    states.store("a", stack)
    np.testing.assert_array_equal(states.load("a"), stack)
