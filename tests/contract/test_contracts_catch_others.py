"""Each law of loaders, limbs, scenarios and executors fails on what breaks it, with the reason."""

import contextlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import Field

from palpate import (
    Curve,
    Executor,
    ExperimentLoader,
    LimbSource,
    Response,
    Scenario,
    Spot,
    Status,
)
from palpate.domain import Limb, Mesh
from palpate.domain.component import Settings
from palpate.errors import CurveError, MeshError
from palpate.executors import InProcess, Processes
from palpate.mesh.specimens import block
from palpate.testing import (
    ExecutorContract,
    Expected,
    LimbSourceContract,
    LoaderContract,
    ScenarioContract,
    check_described,
)


def _hold(contract, test, offered):
    method = getattr(contract, f"test_{test}")
    names = method.__code__.co_varnames[1 : method.__code__.co_argcount]
    method(**{name: offered[name] for name in names})


# ------------------------------------------------------------- loaders and limbs


class Table(ExperimentLoader):
    """Angle and torque, row by row."""

    name, summary, unit = "table", "without fault", 1.0

    def load(self, path, channel=None):
        rows = np.loadtxt(path)
        curve = Curve(channel="torque", abscissa=rows[:, 0], ordinate=self.unit * rows[:, 1])
        return Response(curves={"torque": curve})


class InNewtonMetres(Table):
    unit = 1e-3


class Sorted(Table):
    def load(self, path, channel=None):
        curve = super().load(path, channel)["torque"]
        order = np.argsort(curve.abscissa)
        kept = Curve(channel="torque", abscissa=curve.abscissa[order], ordinate=curve.ordinate[order])
        return Response(curves={"torque": kept})


EXPECTED = {"torque": Expected(abscissa=(-20.0, 20.0), ordinate=(-7.0, 7.0), n_branches=3)}


@pytest.mark.parametrize(
    ("loader", "message"),
    [
        (Table(), None),
        (
            InNewtonMetres(),
            r"spans \(-0.007, 0.007\), not \(-7.0, 7.0\): is it in the channel's unit",
        ),
        (Sorted(), "1 branches, not 3: rows must stay in the order travelled"),
    ],
)
def test_a_loaders_units_and_branches(tmp_path, loader, message):
    path = tmp_path / "twist.txt"
    np.savetxt(path, [(0, 0), (-20, -7), (0, 1), (20, 7), (0, -1)])
    offered = {"loader": loader, "good_file": path, "expected": EXPECTED}
    with pytest.raises(AssertionError, match=message) if message else contextlib.nullcontext():
        _hold(LoaderContract(), "keeps_units_and_branches", offered)


class OfTwoPresses(Table):
    def load_presses(self, path, channel=None):
        first = self.load(path, channel)
        curve = first["torque"]
        second = Curve(channel="torque", abscissa=curve.abscissa, ordinate=curve.ordinate / 2.0)
        return {"cycle_1": first, "cycle_2": Response(curves={"torque": second})}


@pytest.mark.parametrize(("loader", "message"), [(Table(), None), (OfTwoPresses(), "not equal")])
def test_a_load_that_is_not_the_last_press(tmp_path, loader, message):
    path = tmp_path / "twist.txt"
    np.savetxt(path, [(0, 0), (-20, -7)])
    with pytest.raises(AssertionError, match=message) if message else contextlib.nullcontext():
        _hold(LoaderContract(), "load_gives_the_last_press_of_a_file", {"loader": loader, "good_file": path})


class Unnamed(Table):
    def load(self, path, channel=None):
        raise CurveError("not a table")


class Indexing(Table):
    def load(self, path, channel=None):
        return [][0]


@pytest.mark.parametrize(
    ("loader", "message"),
    [
        (Table(), "twist.txt: accepted; raise CurveError with its name"),
        (Unnamed(), "twist.txt: the error does not name it: not a table"),
        (Indexing(), "twist.txt: raises IndexError.*, not CurveError"),
    ],
)
def test_a_bad_file_that_is_not_refused_is_named(tmp_path, loader, message):
    path = tmp_path / "twist.txt"
    np.savetxt(path, [(0, 0), (-20, -7)])
    with pytest.raises((AssertionError, pytest.fail.Exception), match=message):
        _hold(LoaderContract(), "refuses_bad_files_by_name", {"loader": loader, "bad_files": [path]})


class Block(LimbSource):
    """A block, for any file."""

    name, summary, change = "block", "without fault", staticmethod(lambda points: points)

    def load(self, path: Path, spot: Spot) -> Limb:
        mesh = block(n_across=2, n_down=1).mesh
        names = ("cells", "cell_regions", "regions", "node_sets")
        kept = {name: getattr(mesh, name) for name in names}
        return Limb(spot=spot, mesh=Mesh(points_mm=self.change(mesh.points_mm), **kept))


class InMetres(Block):
    change = staticmethod(lambda points: points / 1000.0)


class Mirrored(Block):
    change = staticmethod(lambda points: points * [-1.0, 1.0, 1.0])


@pytest.mark.parametrize(
    ("test", "source", "message"),
    [
        ("makes_a_limb", Block(), None),
        ("is_in_millimetres", Block(), None),
        ("is_in_millimetres", InMetres(), r"is 0.036 mm long.* are its points in mm\?"),
        ("makes_a_limb", Mirrored(), "inverted"),
    ],
)
def test_a_limb_sources_units_and_elements(test, source, message):
    offered = {"limb_source": source, "good_file": Path("any"), "spot": Spot(name="p1")}
    with pytest.raises((AssertionError, MeshError), match=message) if message else contextlib.nullcontext():
        _hold(LimbSourceContract(), test, offered)


def test_a_scenario_of_no_channel_is_reported():
    contract, channels = ScenarioContract(), {"force", "torque"}
    contract.test_weighs_channels_that_exist(Scenario(name="V", weights={"force/load": 1.0}), channels)
    with pytest.raises(AssertionError, match="weighs lateral, which no plugin declares"):
        contract.test_weighs_channels_that_exist(Scenario(name="V", weights={"lateral": 1.0}), channels)
    with pytest.raises(AssertionError, match="'V' needs a description"):
        contract.test_says_what_it_is(Scenario(name="V", weights={"force": 1.0}))


class Timed(Settings):
    patience: float = Field(1.0, description="Longest wait.")
    wait_s: float = Field(1.0, description="Longest wait.")


class TimedSource(Block, LimbSource[Timed]):
    pass


def test_a_setting_of_a_time_names_its_unit():
    with pytest.raises(AssertionError, match=r"setting 'wait_s' of .* write \[mm\] in the description"):
        check_described(TimedSource())


# ----------------------------------------------------------------------- executors


class TestInProcess(ExecutorContract):
    @pytest.fixture
    def executor(self):
        return InProcess()


@pytest.mark.slow
class TestProcesses(ExecutorContract):
    @pytest.fixture
    def executor(self):
        return Processes()


class Forgetful(Executor):
    """Gives no message for a failed job."""

    name, summary, holds_limits = "forgetful", "loses failures", False

    def results(self, batch):
        yield from (each for each in InProcess().results(batch) if each[1].status is Status.OK)


class Silent(Forgetful):
    """Keeps that a job failed, and not why."""

    def results(self, batch):
        yield from ((index, replace(each, message="")) for index, each in InProcess().results(batch))


class Muddled(Forgetful):
    """Counts the results instead of reading whose they are."""

    def results(self, batch):
        turned = replace(batch, jobs=batch.jobs[::-1])
        yield from InProcess().results(turned)


class Doubling(Forgetful):
    def results(self, batch):
        for result in InProcess().results(batch):
            yield from (result, result)


class Unstoppable(Forgetful):
    def results(self, batch):
        yield from InProcess().results(replace(batch, should_continue=lambda: True))


class Claiming(Forgetful):
    """Runs jobs here and declares that a memory limit holds."""

    holds_limits = True

    def results(self, batch):
        yield from InProcess().results(batch)


@pytest.mark.parametrize(
    ("test", "executor", "message"),
    [
        ("every_job_has_one_result", Forgetful(), r"no result for the jobs at \[2, 8\]"),
        ("every_job_has_one_result", Doubling(), "24 results for 12 jobs"),
        ("results_are_those_of_their_jobs", Silent(), "why it failed is lost"),
        ("results_are_those_of_their_jobs", Muddled(), "holds the answer of another job"),
        ("starts_nothing_when_asked_to_stop", Unstoppable(), "goes on although"),
        ("results_are_those_of_their_jobs", Claiming(), "set holds_limits = False"),
    ],
)
def test_an_executors_fault_is_reported(test, executor, message):
    contract = ExecutorContract()
    jobs = ExecutorContract.jobs.__wrapped__(contract)
    with pytest.raises(AssertionError, match=message):
        _hold(contract, test, {"executor": executor, "jobs": jobs})
