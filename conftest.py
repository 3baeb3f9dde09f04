"""A study of a tissue whose answer is known in closed form, for the tests of every stage."""

import contextlib
import ctypes
import gc
import json
import os
import shutil
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from types import ModuleType
from typing import Any

import hypothesis
import numpy as np
import polars as pl
import pytest

import palpate_certainty
import palpate_materials
import palpate_report
from palpate.cli.app import main
from palpate.domain import (
    Design,
    Indentation,
    ParameterSpace,
    RegionMaterial,
    Response,
    Scenario,
    Spot,
)
from palpate.domain.indenter import Sphere
from palpate.executors import InProcess
from palpate.fit.parametrisation import StandardParametrisation
from palpate.fit.searches import BestSet
from palpate.fit.stage import FitStage
from palpate.plugins.catalogue import Plugins
from palpate.plugins.registry import load_file
from palpate.progress import Progress
from palpate.sampling.samplers import LatinHypercube
from palpate.stages import pipeline
from palpate.study.reading import Study, StudySpot
from palpate.testing.studies import StudyRunner

# How long an example takes depends on the machine, not on the code. The fast set draws the same examples
# each time, so that it fails for a change alone; what the other one finds becomes an `@example`.
PROFILE = {"deadline": None, "suppress_health_check": [hypothesis.HealthCheck.too_slow]}
hypothesis.settings.register_profile("fast", max_examples=20, derandomize=True, **PROFILE)
hypothesis.settings.register_profile("all", max_examples=100, print_blob=True, **PROFILE)
hypothesis.settings.load_profile("fast")


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Let Ctrl-C raise: a shell in the background, or a test before this one, may have it ignored."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


# Kernels are compiled once for all test processes and worker processes, and for the next run of the
# tests; set before anything imports JAX. Its keys hold the code, its own version and its flags.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(Path(__file__).parent / ".pytest_cache" / "jax"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")

MOST_MB, MOST_IN_A_FILE_MB = 700.0, 850.0
"""Memory of a process above which JAX's functions are dropped after a file, and between its tests."""

# At Python's 700 new objects, cycles are looked for 1,651 times while one file of JAX's tests runs.
gc.set_threshold(50_000)

_spent_s = [0.0]


def pytest_addoption(parser: pytest.Parser) -> None:
    what = "processor time by folder and of the 25 slowest, and the most memory of each process"
    parser.addoption("--cpu-times", action="store_true", help=what)


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """Give memory back; JAX's functions rarely within a file, as the next test compiles them again."""
    if memory_mb() > MOST_MB:
        give_free_memory_back()
    goes_on = nextitem is not None and nextitem.path == item.path
    if "jax" in sys.modules and memory_mb() > (MOST_IN_A_FILE_MB if goes_on else MOST_MB):
        sys.modules["jax"].clear_caches()
        gc.collect()
        give_free_memory_back()


def give_free_memory_back() -> None:
    """Let the allocator, where it is glibc's, return to the system what was freed between blocks in use."""
    with contextlib.suppress(AttributeError, OSError, TypeError):  # another allocator; another system
        ctypes.CDLL(None).malloc_trim(0)


def memory_mb(which: str = "VmRSS") -> float:
    """Resident memory of this process, its most with VmHWM; 0 where the system does not report it."""
    status = Path("/proc/self/status")
    text = status.read_text() if status.exists() else f"{which}: 0 kB"
    return int(text.partition(f"{which}:")[2].split()[0]) * 1.024e-3


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: Any) -> Iterator[None]:
    """Write what each phase of a test used into its report; only its time has its child processes too."""
    report = yield
    used = os.times()
    spent_s = used.user + used.system + used.children_user + used.children_system
    report.cpu_s, _spent_s[0] = spent_s - _spent_s[0], spent_s
    report.most_mb = memory_mb("VmHWM")
    return report


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    if not config.getoption("--cpu-times"):
        return
    tests, folders = Counter[str](), Counter[str]()
    most: dict[str, tuple[float, str]] = {}
    timed = [r for r in chain(*terminalreporter.stats.values()) if hasattr(r, "cpu_s")]
    for report in sorted(timed, key=lambda report: report.start):
        tests[report.nodeid] += report.cpu_s
        folders["/".join(Path(report.fspath).parent.parts[:3])] += report.cpu_s
        process = getattr(report, "worker_id", "this")
        if report.most_mb > most.get(process, (0.0, ""))[0]:
            most[process] = (report.most_mb, report.nodeid)
    terminalreporter.section("processor time [s]")
    for name, spent_s in [*folders.most_common(), ("together", folders.total()), *tests.most_common(25)]:
        terminalreporter.line(f"{spent_s:8.1f}  {name}")
    terminalreporter.section("most memory of each process [MB]")
    for process, (mb, name) in sorted(most.items()):
        terminalreporter.line(f"{mb:8.0f}  {process}, in {name}")


TISSUE_FILE = Path(__file__).parent / "tests" / "data" / "plugins" / "analytic_tissue.py"
FIRST_PARTY = (palpate_certainty, palpate_report)
"""Plugins whose stages and sections every run has."""
TOY_PLUGIN = Path(__file__).parent / "tests" / "data" / "toy" / "toy_plugin.py"
TRUTH = {"p1": (0.4, 20.0), "p2": (0.5, 25.0)}
SCENARIOS = (
    Scenario(name="I", weights={"force": 1.0, "torque": 1.0}),
    Scenario(name="II", weights={"torque": 1.0}),
    Scenario(name="III", weights={"force": 1.0}),
)
PATH = [(0.0, 0.0), (10.0, 0.0), (10.0, -22.5), (10.0, 22.5), (10.0, 0.0)]


LIMIT_S = 300.0
"""Most that a test waits for an event; only a failure takes so long."""


def wait_until(reached: Callable[[], Any], still: Callable[[], bool] = lambda: True) -> Any:
    """First value of ``reached`` that is not false; ``still`` is what must hold meanwhile."""
    deadline = time.monotonic() + LIMIT_S
    while not (value := reached()):
        assert still(), "cannot be reached any more"
        assert time.monotonic() < deadline, f"not reached within {LIMIT_S:g} s"
        time.sleep(0.02)
    return value


def process_has_ended(pid: int) -> bool:
    """True if no process has this id, or only what is left of one until its parent asks for it."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in "ZX"
    except OSError:
        return True


@pytest.fixture(scope="session")
def until() -> Callable[..., Any]:
    return wait_until


@pytest.fixture(scope="session")
def has_ended() -> Callable[[int], bool]:
    return process_has_ended


@pytest.fixture(scope="session")
def soft_region() -> dict[str, object]:
    """The table ``region`` of a study that searches both moduli of a neo-Hookean tissue."""
    bounds = {"E": {"lower": "20 kPa", "upper": "120 kPa"}, "nu": {"lower": 0.2, "upper": 0.49}}
    return {"tissue": {"material": "neo_hookean", "parameters": bounds}}


class Notes(Progress):
    """Progress that keeps its notes."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def note(self, text: str) -> None:
        self.texts.append(text)


@pytest.fixture
def notes() -> Notes:
    """Progress whose ``texts`` are what was noted."""
    return Notes()


@pytest.fixture(scope="session")
def one_press(soft_region: dict[str, object]) -> Callable[..., tuple[Study, Plugins]]:
    """Make a study of one press in a folder, whose solver is in closed form; keywords are further tables."""

    def make(folder: Path, **tables: object) -> tuple[Study, Plugins]:
        return StudyRunner(folder).study(
            palpate_materials,
            palpate_certainty,
            region=soft_region,
            fit={"search": "least_squares"},
            protocol={
                "indenter": {"shape": "sphere", "radius": "7.5 mm"},
                "depth": "2 mm",
                "twist": ["4 deg"],
                "friction": 1.0,
            },
            **tables,
        )

    return make


@pytest.fixture(scope="session")
def pressed_meshes(soft_region: dict[str, object]) -> Callable[..., tuple[Study, Plugins]]:
    """Make a study of one press on a mesh with a finer one, in a folder; plugins, and tables by keyword."""

    def make(folder: Path, *plugins: object, **tables: object) -> tuple[Study, Plugins]:
        usual = {
            "region": soft_region,
            "limb": {"source": "tetrahedra"},
            "fit": {"search": "least_squares", "fine_edge": "3 mm"},
            "sampling": {"n_sets": 0},
        }
        every = (palpate_materials, palpate_certainty, load_file(TISSUE_FILE.with_name("tetrahedra.py")))
        return StudyRunner(folder).study(*every, *plugins, mesh="block", **(usual | tables))

    return make


@pytest.fixture(scope="session", autouse=True)
def no_waiting_for_the_disk() -> Iterator[None]:
    """Leave out ``fsync``: it guards against a loss of power, which no test makes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda descriptor: None)
        yield


@pytest.fixture(scope="session")
def tissue() -> ModuleType:
    return load_file(TISSUE_FILE)


@pytest.fixture(scope="session")
def plugins() -> Plugins:
    return Plugins.load([TISSUE_FILE], entry_points=False, modules=FIRST_PARTY)


def write_curves(path: Path, response: Response) -> None:
    rows = [
        f"{name},{float(x)!r},{float(y)!r}\n"
        for name, curve in response.curves.items()
        for x, y in zip(curve.abscissa, curve.ordinate, strict=True)
    ]
    path.write_text("".join(rows))


@pytest.fixture
def space(tissue: ModuleType) -> ParameterSpace:
    material = tissue.Spongy()
    region = RegionMaterial(region="soft_tissue", material=material, searched=material.parameters, fixed={})
    return ParameterSpace(regions=(region,))


@pytest.fixture
def make_study(tmp_path: Path, tissue: ModuleType, space: ParameterSpace) -> Callable[..., Study]:
    """Make a study of two spots; ``solver`` is one, or names a class of the tissue; the rest are fields.

    Where nothing is said of workers it runs in this very process.
    """

    def make(solver: Any = "Analytic", **changes: Any) -> Study:
        spots = []
        for name, truth in TRUTH.items():
            path = tmp_path / f"{name}.csv"
            if not path.exists():
                write_curves(path, tissue.answer(*truth))
            spots.append(StudySpot(spot=Spot(name=name), measured={None: (path,)}, mesh=None))
        study = Study(
            name="sponge",
            description="a stand-in with a known answer",
            file=tmp_path / "study.toml",
            data="simulated",
            spots=tuple(spots),
            loader=tissue.Table(),
            limb_source=None,
            protocol=Indentation(indenter=Sphere(radius_mm=7.5), path=PATH, friction=1.0),
            space=space,
            sampler=LatinHypercube(),
            n_sets=12,
            seed=1,
            filters=(),
            solver=getattr(tissue, solver)() if isinstance(solver, str) else solver,
            scenarios=SCENARIOS,
            generalise_by="I",
            search=BestSet(),
            parametrisation=StandardParametrisation(),
            truth={},
            n_workers=1,
            time_limit_s=60.0,
            plugin_files=(TISSUE_FILE,),
            executor=None if "n_workers" in changes else InProcess(),
        )
        return replace(study, **changes)

    return make


@pytest.fixture
def one_figure(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the drawing to the tests of the report."""

    def draw_one(content: Any, folder: Path) -> tuple[Path, ...]:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "one.svg").touch()
        return (folder / "one.svg",)

    monkeypatch.setattr("palpate_report.from_run.write_figures", draw_one)


@dataclass(frozen=True)
class Outcome:
    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)


Call = Callable[..., Outcome]


@pytest.fixture
def call(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """Call palpate with the toy plugin, in an empty working folder."""
    monkeypatch.chdir(tmp_path)

    def call_palpate(*arguments: object, plugin: str | None = str(TOY_PLUGIN)) -> Outcome:
        given = [*(["--plugin", plugin] if plugin else []), *map(str, arguments)]
        capsys.readouterr()
        code = main(given)
        captured = capsys.readouterr()
        return Outcome(code, captured.out, captured.err)

    return call_palpate


@pytest.fixture(scope="module")
def whole_run(tmp_path_factory):
    """Folder of the run that the first test of a file makes, and the others copy."""
    return tmp_path_factory.mktemp("whole") / "run"


@pytest.fixture
def run_once(whole_run, plugins, tmp_path):
    """Run the study of a file of tests, always the same, into ``run``; every test has a copy to change."""

    def run(study):
        if not whole_run.exists():
            pipeline.run_study(study, tmp_path / "run", plugins)
            shutil.copytree(tmp_path / "run", whole_run)
        return shutil.copytree(whole_run, tmp_path / "run", dirs_exist_ok=True)

    return run


@pytest.fixture(scope="session")
def contents():
    """What ``content`` has made, by the changes: a run of the same study is made once."""
    return {}


@pytest.fixture
def content(make_study, plugins, tmp_path, monkeypatch, contents):
    """ReportData of a run of the analytic tissue, whose spots differ; with ``assessed`` its model fails."""

    def run(changes):
        kept = []
        study = make_study(**({"n_sets": 40} | changes))
        with monkeypatch.context() as patch:
            patch.setattr("palpate_report.from_run.write_report", lambda data, folder: kept.append(data))
            pipeline.run_study(study, tmp_path / "run", plugins)
        return kept[-1]

    def made(*, assessed=True, truth=None, **changes):
        key = repr(sorted(changes.items()))
        if "solver" in changes or " at 0x" in key:  # not named by what it does
            kept = run(changes)
        elif key in contents:
            kept = contents[key]
        else:
            kept = contents[key] = run(changes)
        kept = replace(kept, study=replace(kept.study, truth=truth or {}))  # only the report asks for it
        return kept if assessed else kept.without_assessment()

    return made


@pytest.fixture
def undrawn(monkeypatch):
    """Report without drawing, for what is not about the pictures."""
    from palpate_report import from_run

    def write_figures(content, folder):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "a figure.svg").write_text("<svg></svg>")
        return (folder / "a figure.svg",)

    monkeypatch.setattr(from_run, "write_figures", write_figures)


PRESSED = Path(__file__).parent / "tests" / "data" / "plugins" / "pressed_tissue.py"


@pytest.fixture(scope="session")
def pressed():
    return load_file(PRESSED)


@pytest.fixture(scope="session")
def stage_of(pressed):
    """Make the fit of a study, without a sweep, from the middle of the ranges."""

    def made(study, measured, limbs=None):
        return FitStage(
            study=study,
            design=Design(
                parameters=study.space.parameters,
                values=np.zeros((0, len(study.space.parameters))),
                seed=1,
                n_drawn=0,
            ),
            measured=measured if isinstance(measured, dict) else dict.fromkeys(study.spot_names, measured),
            scores=pl.DataFrame(),
            simulations=pressed.Here(study.solver, limbs or {}),
            abscissae={"force": "depth_mm", "torque": "rotation_deg"},
        )

    return made
