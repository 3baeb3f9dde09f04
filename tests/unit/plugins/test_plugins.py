"""Plugins: what works is found, what is broken is named and harms nothing else."""

import importlib
import importlib.metadata
import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
import typer

from palpate.errors import PalpateError, PluginError
from palpate.plugins import registry
from palpate.plugins.catalogue import Plugins
from palpate.plugins.registry import HOOKS, KINDS, add_commands, load_file, plugin_source
from palpate.plugins.versions import FIRST_PARTY
from palpate.stages.order import in_order

from .conftest import Write

SAMPLER = """
import numpy as np
from palpate import hookimpl
from palpate.plugins.interfaces import Sampler

class Grid(Sampler):
    name = "{name}"
    summary = "Evenly spread"

    def draw(self, n_sets, n_parameters, seed):
        return np.full((n_sets, n_parameters), 0.5)

@hookimpl
def palpate_samplers():
    return [Grid]
"""


def load(*files: Path) -> Plugins:
    return Plugins.load(files, entry_points=False)


def test_the_core_provides_its_sampler_through_the_hooks() -> None:
    plugins = load()
    assert plugins.samplers.provider("lhs") == "palpate"
    points = plugins.samplers["lhs"]().draw(8, 2, 1)
    assert points.shape == (8, 2)
    assert sorted((points[:, 0] * 8).astype(int)) == list(range(8))


def test_centred_is_a_setting_of_the_sampler() -> None:
    sampler = load().samplers["lhs"]
    points = sampler(sampler.Settings.model_validate({"centred": True})).draw(4, 1, 1)
    assert sorted(points[:, 0]) == [0.125, 0.375, 0.625, 0.875]


def test_every_hook_fills_a_catalogue_or_adds_commands() -> None:
    from palpate.plugins import hookspecs

    specified = {name for name, value in vars(hookspecs).items() if hasattr(value, "palpate_spec")}
    assert specified == HOOKS
    assert {kind.hook for kind in KINDS.values()} == HOOKS - {"palpate_commands"}


def test_a_file_provides_a_component(write: Write) -> None:
    plugins = load(write("grid", SAMPLER.format(name="grid")))
    assert plugins.broken == ()
    assert list(plugins.samplers) == ["lhs", "optimised_lhs", "sobol", "grid"]
    assert plugins.samplers.provider("grid") == "grid"


COMMAND = """
from palpate import hookimpl
from palpate.api.cli import Command

def {name}() -> None:
    pass

@hookimpl
def palpate_commands():
    yield Command(function={name})
    {then}
"""

HOOKIMPL = "from palpate import hookimpl\n@hookimpl\n"


def grid(old: str, new: str) -> str:
    assert old in SAMPLER.format(name="x")
    return SAMPLER.format(name="x").replace(old, new)


BROKEN = {
    "import error": ("import no_such_module_anywhere\n", "ModuleNotFoundError", "no_such_module_anywhere"),
    "syntax error": ("def broken(:\n", "SyntaxError", ""),
    "exit at import": ("import sys\nsys.exit(3)\n", "sys.exit(3)", ""),
    "raise at import": ("raise BaseException('deep')\n", "BaseException", "deep"),
    "newer": (
        "palpate_api = (1, 99)\n" + SAMPLER,
        "needs version 1.99 of palpate.api",
        "this is 1.0; install",
    ),
    "another major": ("palpate_api = (0, 1)\n" + SAMPLER, "needs version 0.1 of palpate.api", "this is 1.0"),
    "no version": ("palpate_api = 'new'\n" + SAMPLER, "palpate_api = 'new'", "(1, 0)"),
    "newer name": ("from palpate.api import Tendon\n", "cannot import name 'Tendon'", "this is 1.0; install"),
    "misspelt": (
        grid("palpate_samplers", "palpate_samplrs"),
        "palpate_samplrs",
        "did you mean 'palpate_samplers'",
    ),
    "marked but unknown": (HOOKIMPL + "def samplers(): return []\n", "unknown hook 'samplers'", ""),
    "not marked": (grid("@hookimpl\n", ""), "palpate_samplers", "put @palpate.hookimpl above it"),
    "wrong arguments": (grid("palpate_samplers()", "palpate_samplers(extra)"), "extra", ""),
    "raises in hook": (grid("return [Grid]", "raise RuntimeError('boom')"), "RuntimeError: boom", ""),
    "exits in hook": (grid("return [Grid]", "raise SystemExit('bye')"), "sys.exit('bye')", ""),
    "raises in generator": (
        grid("return [Grid]", "yield Grid\n    raise ValueError('late')"),
        "ValueError: late",
        "",
    ),
    "not a list": (grid("return [Grid]", "return Grid"), "return a list", ""),
    "a string": (grid("return [Grid]", "return 'Grid'"), "return a list", ""),
    "an instance": (grid("[Grid]", "[Grid()]"), "return subclasses of Sampler", ""),
    "another class": (grid("[Grid]", "[dict]"), "return subclasses of Sampler", ""),
    "abstract": (grid("def draw", "def drew"), "class Grid does not define draw", ""),
    "no name": (grid('    name = "x"\n', ""), "has no name", ""),
    "no summary": (grid('summary = "Evenly spread"', 'summary = ""'), "has no summary", ""),
    "setting without help": (
        grid(
            "class Grid(Sampler):",
            "from palpate.domain.component import Settings\nclass S(Settings):\n    n: int = 1\n"
            "class Grid(Sampler[S]):",
        ),
        "setting 'n' of 'x' has no description",
        "pydantic.Field",
    ),
    "settings of another class": (
        grid("(Sampler)", "(Sampler[int])"),
        "name a subclass of palpate.api.Settings",
        "",
    ),
    "nothing": (
        "from palpate.plugins.interfaces import Sampler\n",
        "provides nothing",
        "marked @palpate.hookimpl",
    ),
    "no return": (grid("return [Grid]", "[Grid]"), "palpate_samplers returned None", "return a list"),
    "no parameters": (
        "from palpate import IsotropicMaterial, hookimpl\n"
        "class M(IsotropicMaterial):\n    name, summary = 'm', 'm'\n"
        "    def energy(self, stretches, theta): return 0\n"
        "@hookimpl\ndef palpate_materials(): return [M]\n",
        "material 'm' has no parameters",
        "give it a tuple of palpate.Parameter",
    ),
    "material of no kind": (
        "from palpate import hookimpl\nfrom palpate.domain.material import HyperelasticMaterial\n"
        "class M(HyperelasticMaterial): ...\n@hookimpl\ndef palpate_materials(): return [M]\n",
        "return subclasses of IsotropicMaterial or AnisotropicMaterial",
        "",
    ),
    "channel of a wrong type": (
        HOOKIMPL + "def palpate_channels(): return ['force']\n",
        "return Channel values",
        "",
    ),
}


@pytest.mark.parametrize(("text", "reason", "remedy"), BROKEN.values(), ids=BROKEN)
def test_a_broken_plugin_is_listed_and_the_rest_works(
    write: Write, text: str, reason: str, remedy: str
) -> None:
    path = write("broken", text)
    plugins = load(path, write("grid", SAMPLER.format(name="grid")))
    (broken,) = plugins.broken
    assert (broken.name, broken.source) == ("broken", str(path))
    assert reason in broken.reason
    assert remedy in broken.reason
    assert list(plugins.samplers) == ["lhs", "optimised_lhs", "sobol", "grid"]


def test_a_broken_plugin_contributes_nothing_at_all(write: Write) -> None:
    text = (
        SAMPLER.format(name="half") + "\n@hookimpl\ndef palpate_solvers():\n    raise OSError('no engine')\n"
    )
    path = write("half", text)
    plugins = load(path)
    assert "half" not in plugins.samplers
    assert plugins.broken[0].reason == f"OSError: no engine (line {len(text.splitlines())} of {path})"


def test_the_line_is_the_last_one_of_the_plugin_itself(write: Write) -> None:
    path = write("deep", "import json\n\ndef read():\n    json.loads('{')\n\nread()\n")
    (broken,) = load(path).broken
    assert broken.reason.endswith(f" (line 4 of {path})")
    assert "json/decoder.py" in broken.traceback


def test_every_broken_plugin_is_listed(write: Write) -> None:
    texts = [BROKEN[case][0] for case in ("misspelt", "wrong arguments", "import error")]
    plugins = load(*(write(f"p{i}", text) for i, text in enumerate(texts)))
    assert [broken.name for broken in plugins.broken] == ["p0", "p1", "p2"]


def test_ctrl_c_is_not_a_broken_plugin(write: Write) -> None:
    text = "import signal\nsignal.raise_signal(signal.SIGINT)\n"
    with pytest.raises(KeyboardInterrupt):
        load(write("stop", text))


def test_what_a_plugin_prints_stays_out_of_the_results(
    write: Write, capsys: pytest.CaptureFixture[str]
) -> None:
    plugins = load(write("chatty", "print('welcome to chatty')\n" + SAMPLER.format(name="chatty")))
    assert "chatty" in plugins.samplers
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "welcome to chatty" in captured.err


def test_of_two_components_with_one_name_the_first_keeps_it(write: Write) -> None:
    more = SAMPLER.format(name="lhs") + (
        "class More(Grid):\n    name = 'more'\n@hookimpl\ndef palpate_samplers():\n    return [Grid, More]\n"
    )
    plugins = load(
        write("one", SAMPLER.format(name="grid")),
        write("two", SAMPLER.format(name="grid")),
        write("three", more),
    )
    assert plugins.samplers.provider("grid") == "one"
    assert plugins.samplers.provider("lhs") == "palpate"
    assert plugins.samplers.provider("more") == "three"
    two, three = plugins.broken
    assert two.reason == (
        "sampler 'grid' of plugin 'two' is already provided by plugin 'one'; rename one, or leave a plugin "
        "out (--no-plugin)"
    )
    assert (three.component, three.headline[:19]) == ("sampler 'lhs'", "component left out:")


def test_equal_values_of_two_plugins_do_not_clash(write: Write) -> None:
    channel = "name='x', abscissa='a_mm', ordinate='{}_N', abscissa_label='a', ordinate_label='b'"
    text = "from palpate import Channel, hookimpl\n@hookimpl\ndef palpate_channels(): return [Channel({})]\n"
    one, two = (write(name, text.format(channel.format("b"))) for name in ("one", "two"))
    assert load(one, two).broken == ()
    (broken,) = load(one, write("three", text.format(channel.format("c")))).broken
    assert broken.reason.endswith("out (--no-plugin)")


def test_two_files_of_one_name_clash(write: Write, tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    plugins = load(write("grid", SAMPLER.format(name="a")), write("sub/grid", SAMPLER.format(name="b")))
    assert "b" not in plugins.samplers
    assert "the plugin name 'grid' is taken by" in plugins.broken[0].reason


def test_a_half_registered_plugin_does_not_block_another_of_its_name(write: Write, tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    half = COMMAND.format(name="x", then="") + BROKEN["wrong arguments"][0]
    plugins = load(write("sub/grid", half), write("grid", SAMPLER.format(name="grid")))
    assert [broken.source for broken in plugins.broken] == [str(tmp_path / "sub" / "grid.py")]
    assert plugins.samplers.provider("grid") == "grid"


def test_a_missing_file_is_a_mistake_of_the_user(tmp_path: Path) -> None:
    with pytest.raises(PluginError, match=r"absent\.py: no such file"):
        load(tmp_path / "absent.py")


def test_an_unknown_name_offers_what_is_close(write: Write) -> None:
    plugins = load(write("grid", SAMPLER.format(name="grid")), write("bad", "import nope\n"))
    with pytest.raises(PalpateError) as caught:
        plugins.samplers["gird"]
    message = str(caught.value)
    assert "; did you mean 'grid'? (known: lhs, optimised_lhs, sobol, grid)" in message
    assert "bad" in message
    assert "No module named 'nope'" in message
    assert "--plugin FILE" in message
    with pytest.raises(
        PluginError, match=r"no material 'yeoh' .* \(known: none\); if a file .* --plugin FILE"
    ):
        plugins.materials["yeoh"]


def test_a_catalogue_is_an_ordinary_mapping() -> None:
    samplers = load().samplers
    assert "gird" not in samplers
    assert samplers.get("gird") is None
    assert len(samplers) == 3
    assert dict(samplers).keys() == {"lhs", "optimised_lhs", "sobol"}


def test_an_unknown_kind_offers_what_is_close() -> None:
    with pytest.raises(PluginError, match=r"no kind of plugin 'material'; did you mean 'materials'"):
        load().catalogue("material")


def test_a_plugin_file_that_was_edited_is_still_had_as_it_was_imported(write: Write) -> None:
    file = write("mine", SAMPLER.format(name="same"))
    module = load_file(file)
    file.write_text("half of a line that is being ed")
    assert load_file(file, plugin_source(file)) is module


# ------------------------------------------------------------- entry points


class FakePoint:
    def __init__(self, name: str, path: Path, dist: str = "", attribute: str = "") -> None:
        self.name, self.value, self.attribute = name, path.stem, attribute
        self.group = "palpate.samplers" if attribute else "palpate"
        self.dist = SimpleNamespace(name=dist) if dist else None
        self._path = path

    def load(self) -> object:
        module = load_file(self._path)
        return getattr(module, self.attribute) if self.attribute else module


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    def install(*points: FakePoint) -> None:
        found = SimpleNamespace(select=lambda group: [point for point in points if point.group == group])
        monkeypatch.setattr(importlib.metadata, "entry_points", lambda: found)

    return install


def test_entry_points_register_in_the_order_of_their_names(
    write: Write, installed: Callable[..., None]
) -> None:
    one, two = write("zed", SAMPLER.format(name="same")), write("abc", SAMPLER.format(name="same"))
    bad = write("bad", "import nope\n")
    installed(FakePoint("zed", one), FakePoint("abc", two), FakePoint("bad", bad), FakePoint("zed", one))
    plugins = Plugins.load()
    assert plugins.samplers.provider("same") == "abc"
    assert [broken.name for broken in plugins.broken] == ["bad", "zed"]
    assert Plugins.load(entry_points=False).broken == ()


def test_a_package_says_for_all_its_modules_what_they_need(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "palpate_vermat"
    package.mkdir()
    (package / "__init__.py").write_text("palpate_api = (9, 0)\n")
    (package / "parts.py").write_text(SAMPLER.format(name="same"))
    monkeypatch.syspath_prepend(tmp_path)
    module = importlib.import_module("palpate_vermat.parts")
    with pytest.raises(PluginError, match=r"needs version 9\.0 of palpate\.api"):
        registry._check_version(module)
    module.palpate_api = ModuleType("palpate_api")
    with pytest.raises(PluginError, match=r"needs version 9\.0 of palpate\.api"):
        registry._check_version(module)
    module.palpate_api = (1, 0)
    registry._check_version(module)


@pytest.mark.parametrize("stated", [0, (), "", False])
def test_an_empty_version_is_refused(write: Write, stated: object) -> None:
    module = load_file(write("empty", f"palpate_api = {stated!r}\n" + SAMPLER.format(name="x")))
    with pytest.raises(
        PluginError, match=re.escape(f"palpate_api = {stated!r}; give major and minor version")
    ):
        registry._check_version(module)


def test_an_object_states_its_version_before_its_module() -> None:
    class Hooks:
        palpate_api = (9, 0)

    for plugin in (Hooks, Hooks(), SimpleNamespace(palpate_api=(9, 0))):
        with pytest.raises(PluginError, match=r"needs version 9\.0 of palpate\.api"):
            registry._check_version(plugin)


def test_modules_are_kept_when_files_are_added(write: Write) -> None:
    module = load_file(write("mine", SAMPLER.format(name="same")))
    plugins = Plugins.load(entry_points=False, modules=[module])
    more = plugins.with_files([write("other", SAMPLER.format(name="different"))])
    assert {"same"} <= set(plugins.samplers)
    assert {"same", "different"} <= set(more.samplers)


def test_names_of_the_released_plugins_are_theirs(write: Write, installed: Callable[..., None]) -> None:
    ours, theirs = write("materials", SAMPLER.format(name="x")), write("aaa", SAMPLER.format(name="x"))
    same = write("other", SAMPLER.format(name="y"))
    installed(
        FakePoint("aaa", theirs, "aaa-materials"),
        FakePoint("materials", same, "aaa-samplers"),
        FakePoint("materials", ours, "palpate-materials"),
    )
    plugins = Plugins.load()
    assert plugins.samplers.provider("x") == "materials"
    taken, second = plugins.broken
    assert "the plugin name 'materials' is taken by distribution palpate-materials" in taken.reason
    assert second.component == "sampler 'x'"


def test_an_entry_point_may_be_one_component(write: Write, installed: Callable[..., None]) -> None:
    path = write("grid", SAMPLER.format(name="grid"))
    unknown = write("unknown", "raise RuntimeError('no engine')\n")
    installed(
        FakePoint("grid", path, "lab-grid", "Grid"),
        FakePoint("mesh", path, "lab-mesh", "Grid"),
        FakePoint("none", unknown, "lab-none", "Grid"),
    )
    assert add_commands(typer.Typer()) == ()  # nothing of them is imported for a list of commands
    plugins = Plugins.load([write("mine", SAMPLER.format(name="grid"))])
    assert plugins.samplers.provider("grid") == "lab-grid"
    mesh, none, mine = plugins.broken
    assert mine.component == "sampler 'grid'"  # a file comes after what is installed
    assert mesh.reason == "palpate.samplers: 'mesh' provides 'grid'; give both one name"
    assert none.component == "sampler 'none'"
    assert none.reason.startswith("RuntimeError: no engine (line ")


def test_an_installed_plugin_may_be_left_out(write: Write, installed: Callable[..., None]) -> None:
    path = write("grid", SAMPLER.format(name="grid"))
    installed(FakePoint("grid", path, "lab-grid"))
    for name in ("grid", "lab-grid"):
        assert "grid" not in Plugins.load(without=[name]).samplers
    with pytest.raises(PluginError, match="no plugin 'lab-gird' is installed; did you mean 'lab-grid'"):
        Plugins.load(without=["lab-gird"])


def test_the_released_plugins_are_those_of_this_repository() -> None:
    folders = (Path(__file__).parents[3] / "plugins").glob("*/pyproject.toml")
    assert {path.parent.name for path in folders} == FIRST_PARTY


def test_every_released_package_is_typed() -> None:
    root = Path(__file__).parents[3]
    for package in [
        root / "python" / "palpate",
        *root.glob("plugins/*/src/*"),
        *root.glob("examples/*/src/*"),
    ]:
        assert (package / "py.typed").is_file() or not (package / "__init__.py").is_file(), package


# ------------------------------------------------- one-file plugins, workers


def test_a_file_is_imported_once_for_its_content(write: Write) -> None:
    path = write("grid", SAMPLER.format(name="grid"))
    first = load(path).samplers["grid"]
    assert load(path).samplers["grid"] is first
    path.write_text(SAMPLER.format(name="grid").replace("0.5", "0.25"))
    assert load(path).samplers["grid"] is not first


@pytest.mark.slow
def test_another_process_unpickles_what_the_file_defines(write: Write) -> None:
    path = write("grid", SAMPLER.format(name="grid"))
    pickled = pickle.dumps(load(path).samplers["grid"]())
    code = (
        "import pathlib, pickle, sys\n"
        "from palpate.plugins.catalogue import Plugins\n"
        f"Plugins.load([pathlib.Path({str(path)!r})], entry_points=False)\n"
        "print(pickle.load(sys.stdin.buffer).draw(1, 2, 0).tolist())\n"
    )
    done = subprocess.run([sys.executable, "-c", code], input=pickled, capture_output=True, check=True)
    assert done.stdout.decode().strip() == "[[0.5, 0.5]]"


def test_a_failed_import_leaves_no_half_module_behind(write: Write) -> None:
    path = write("late", "x = 1\nraise RuntimeError('late')\n")
    load(path)
    assert not [name for name in sys.modules if name.startswith("palpate_plugin_late")]


def test_import_palpate_is_light() -> None:
    code = "import sys, palpate; print({'jax', 'polars', 'matplotlib', 'numpy', 'pint'} & sys.modules.keys())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True)
    assert done.stdout.strip() == "set()"


def test_every_public_name_can_be_imported() -> None:
    import palpate

    for name in palpate.__all__:
        assert getattr(palpate, name) is not None
    with pytest.raises(AttributeError, match="nonsense"):
        _ = palpate.nonsense  # type: ignore[attr-defined]


def test_a_stage_without_its_plugin_names_what_brings_it():
    with pytest.raises(PalpateError, match=r"no stage 'certainty'.*palpate\[standard\]"):
        Plugins.load(entry_points=False).stages["certainty"]
    with pytest.raises(PalpateError, match=r"no stage 'intervals'.*palpate\[standard\]"):
        in_order({}, ["intervals"])
