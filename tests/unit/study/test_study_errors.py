"""One mistake at a time: each is reported with its line, its key and what to do."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.domain import Waypoints
from palpate.errors import StudyError
from palpate.plugins import interfaces
from palpate.plugins.catalogue import Plugins
from palpate.study.reading import Study, read_study

TOY = Path(__file__).parents[2] / "data" / "toy"
TEXT = (TOY / "study.toml").read_text()


@pytest.fixture(scope="module")
def plugins() -> Plugins:
    return Plugins.load([TOY / "toy_plugin.py"], entry_points=False)


def read_text(folder: Path, plugins: Plugins, text: str) -> Study:
    for name in ("s1.txt", "s2.txt"):
        (folder / name).write_bytes((TOY / name).read_bytes())
    (folder / "study.toml").write_text(text)
    return read_study(folder / "study.toml", plugins)


def messages(folder: Path, plugins: Plugins, text: str) -> list[str]:
    with pytest.raises(StudyError) as caught:
        read_text(folder, plugins, text)
    return [line.removeprefix(f"{folder / 'study.toml'}:") for line in str(caught.value).splitlines()]


def line_of(text: str, part: str) -> int:
    return text[: text.index(part)].count("\n") + 1


# what to replace, by what, the text whose line is named, the key, the remedy
RANGE = 'k = { lower = "1000 kPa", upper = "3 MPa" }'
CASES = {
    "unknown table": ("[truth]", "[truht]\n[truth]", "[truht]", "truht", "did you mean 'truth'"),
    "unknown key": ("n_sets", "nsets = 3\nn_sets", "nsets", "sampling.nsets", "did you mean 'n_sets'"),
    "spread of what is searched": (
        "[truth]",
        '[budget.parameters]\n"rubber.k" = "5 %"\n[truth]',
        '"rubber.k" = "5 %"',
        "budget.parameters.rubber.k",
        "is searched",
    ),
    "spread of nothing": (
        "[truth]",
        '[budget.parameters]\n"rubber.b" = "5 %"\n[truth]',
        '"rubber.b" = "5 %"',
        "budget.parameters.rubber.b",
        "no parameter 'rubber.b'",
    ),
    "spread out of what is physical": (
        "a = 0.5",
        'a = 0.8\n[budget.parameters]\n"rubber.a" = "30 %"',
        '"rubber.a" = "30 %"',
        "budget.parameters.rubber.a",
        "leads out of its physical range; give 0.25 or less",
    ),
    "spread in another unit": (
        "[truth]",
        '[budget]\nonset = "5 N"\n[truth]',
        "onset",
        "budget.onset",
        "not of the kind of mm",
    ),
    "missing key": ("n_sets = 20", "", "[sampling]", "sampling.n_sets", "add n_sets ="),
    "n_sets 1": ("= 20", "= 1", "n_sets", "sampling.n_sets", "one set is no sweep"),
    "n_sets text": ("= 20", '= "20"', "n_sets", "sampling.n_sets", "not a whole number"),
    "max_draws negative": (
        "= 20",
        "= 20\nmax_draws = -1",
        "max_draws",
        "sampling.max_draws",
        "greater than or equal to 0",
    ),
    "prior without sd": (
        '"3 MPa"',
        '"3 MPa", prior = { value = "2 MPa" }',
        "prior",
        "region.rubber.parameters.k.prior.sd",
        "add sd =",
    ),
    "prior with sd 0": (
        '"3 MPa"',
        '"3 MPa", prior = { value = "2 MPa", sd = "0 MPa" }',
        "prior",
        "region.rubber.parameters.k.prior",
        "sd > 0",
    ),
    "prior of another unit": (
        '"3 MPa"',
        '"3 MPa", prior = { value = "2 MPa", sd = "0.1 mm" }',
        "prior",
        "region.rubber.parameters.k.prior",
        "of the kind of MPa",
    ),
    "prior far outside": (
        '"3 MPa"',
        '"3 MPa", prior = { value = "9 MPa", sd = "1 MPa" }',
        "prior",
        "region.rubber.parameters.k.prior",
        "6 sd outside the range",
    ),
    "by something else": (
        '"3 MPa"',
        '"3 MPa", by = "limb"',
        "by =",
        "region.rubber.parameters.k.by",
        "'spot'",
    ),
    "searched unknown": (
        "[truth]",
        "[fit.searched]\nfrictoin = 0.3\n\n[truth]",
        "frictoin",
        "fit.searched.frictoin",
        "did you mean 'friction'",
    ),
    "friction of a pull": (
        "[truth]",
        "[fit.searched]\nfriction = { lower = 0.1, upper = 1.0 }\n\n[truth]",
        "friction",
        "fit.searched.friction",
        "homogeneous tests have none",
    ),
    "onset of a pull": (
        "[truth]",
        '[fit.searched]\ndepth_offset = { lower = "-1 mm", upper = "1 mm" }\n\n[truth]',
        "depth_offset",
        "fit.searched.depth_offset",
        "give the study a [protocol]",
    ),
    "gain of no channel": (
        "[truth]",
        "[fit.searched]\ngains.push = { lower = 0.9, upper = 1.1 }\n\n[truth]",
        "gains.push",
        "fit.searched.gains.push",
        "no spot measures 'push'",
    ),
    "gain reversed": (
        "[truth]",
        "[fit.searched]\ngains.pull = { lower = 1.2, upper = 1.1 }\n\n[truth]",
        "gains.pull",
        "fit.searched.gains.pull",
        "swap them",
    ),
    "gain with a unit": (
        "[truth]",
        '[fit.searched]\ngains.pull = { lower = "0.9 N", upper = 1.1 }\n\n[truth]',
        "gains.pull",
        "fit.searched.gains.pull.lower",
        "plain number",
    ),
    "gain's prior far outside": (
        "[truth]",
        "[fit.searched]\ngains.pull = { lower = 0.9, upper = 1.1, prior = { value = 2, sd = 0.1 } }\n[truth]",
        "gains.pull",
        "fit.searched.gains.pull",
        "9 sd outside the range",
    ),
    "gain's prior without sd": (
        "[truth]",
        "[fit.searched]\ngains.pull = { lower = 0.9, upper = 1.1, prior = { value = 1.0 } }\n\n[truth]",
        "gains.pull",
        "fit.searched.gains.pull.prior.sd",
        "add sd =",
    ),
    "scale unknown": (
        '"3 MPa"',
        '"3 MPa", scale = "cubic"',
        "cubic",
        "region.rubber.parameters.k.scale",
        "'linear' or 'log'",
    ),
    "no logarithm of zero": (
        '"1000 kPa"',
        '"0 kPa", scale = "log"',
        "0 kPa",
        "region.rubber.parameters.k.scale",
        "bounds > 0",
    ),
    "sampler setting": (
        "n_sets = 20",
        'n_sets = 20\nsampler = "optimised_lhs"\nsettings = { criterion = "dc" }',
        "settings",
        "sampling.settings.criterion",
        "'cd'",
    ),
    "seed negative": ("seed = 3", "seed = -3", "seed", "sampling.seed", "greater than or equal to 0"),
    "data": ('"simulated"', '"simulate"', "data", "study.data", "did you mean 'simulated'"),
    "name": ('name = "toy"', 'name = "a/b"', "name", "study.name", "use letters, digits, - and _"),
    "spot twice": ('name = "s2"', 'name = "s1" # again', '"s1" # again', "spot 's1', name", "its own name"),
    "file missing": ("s2.txt", "s3.txt", "s3.txt", "spot 's2', measured.pull", "relative to study.toml"),
    "file is a folder": ('"s2.txt"', '"."', '"."', "spot 's2', measured.pull", "is a folder"),
    "channel unknown": (
        'pull = "s2',
        'pul = "s2',
        "s2.txt",
        "spot 's2', measured.pul",
        "did you mean 'pull'",
    ),
    "no file": ('{ pull = "s2.txt" }', "{}", "{}", "spot 's2', measured", "at least 1"),
    "file of another type": (
        '{ pull = "s2.txt" }',
        "5",
        "= 5",
        "spot 's2', measured",
        "names no files; give one",
    ),
    "repeats without a file": ('"s2.txt"', "[]", "[]", "spot 's2', measured", "names no files; give one"),
    "repeat missing": (
        '"s2.txt"',
        '["s2.txt", "s3.txt"]',
        "s3.txt",
        "spot 's2', measured.pull[1]",
        "no such file",
    ),
    "repeat twice": (
        '"s2.txt"',
        '["s2.txt", "s2.txt"]',
        "s2.txt",
        "spot 's2', measured.pull[1]",
        "a repeat is another press",
    ),
    "protocol of a spot alone": (
        'name = "s2"',
        'name = "s2"\nprotocol = { depth = "5 mm" }',
        "protocol =",
        "spot 's2', protocol",
        "does not have; add the table",
    ),
    "loader setting of a spot": (
        'name = "s2"',
        'name = "s2"\nsettings = { skp = 1 }',
        "skp",
        "spot 's2', settings.skp",
        "did you mean 'skip'",
    ),
    "point weights": (
        "[selection]",
        '[scoring]\npoint_weighting = "sdt"\n[selection]',
        "sdt",
        "scoring.point_weighting",
        "did you mean 'std'",
    ),
    "position": (
        'name = "s2"',
        'name = "s2"\nposition = ["0 mm", "1 s", "0 mm"]',
        "1 s",
        "spot 's2', position[1]",
        'use e.g. "10 mm"',
    ),
    "position of two": (
        'name = "s2"',
        'name = "s2"\nposition = ["0 mm", "1 mm"]',
        "position",
        "spot 's2', position",
        "at least 3",
    ),
    "normal zero": (
        'name = "s2"',
        'name = "s2"\nnormal = [0, 0, 0]',
        "normal",
        "spot 's2', normal",
        "not zero",
    ),
    "loader": ('"lines"', '"line"', "loader", "experiment.loader", "did you mean 'lines'"),
    "loader setting": (
        "[region.rubber]",
        "[experiment.settings]\nskp = 1\n[region.rubber]",
        "skp",
        "experiment.settings.skp",
        "did you mean 'skip'",
    ),
    "loader setting value": (
        "[region.rubber]",
        "[experiment.settings]\nskip = -1\n[region.rubber]",
        "skip",
        "experiment.settings.skip",
        "greater than or equal to 0",
    ),
    "material": ('"spring"', '"sprung"', "material", "region.rubber.material", "did you mean 'spring'"),
    "convention": (
        'material = "spring"',
        'material = "spring"\nconvention = "halved"',
        "convention",
        "region.rubber.convention",
        "choose one of: textbook, doubled",
    ),
    "parameter": ("a = 0.5", "b = 0.5", "b = 0.5", "region.rubber.parameters.b", "known: k, a"),
    "unit unknown": (
        "1000 kPa",
        "10 apples",
        "apples",
        "region.rubber.parameters.k.lower",
        'use e.g. "10 MPa"',
    ),
    "unit of another kind": ("3 MPa", "3 mm", "3 mm", "region.rubber.parameters.k.upper", 'e.g. "10 MPa"'),
    "unit missing": ('"3 MPa"', "3", RANGE[:5], "region.rubber.parameters.k.upper", 'write "3 MPa"'),
    "range reversed": ("3 MPa", "3 kPa", "3 kPa", "region.rubber.parameters.k", "swap them"),
    "range empty": ("3 MPa", "1 MPa", "1 MPa", "region.rubber.parameters.k", "swap them"),
    "range without an end": (
        ', upper = "3 MPa"',
        "",
        "k = {",
        "region.rubber.parameters.k",
        "has no upper",
    ),
    "range misspelt": ("upper", "uper", "uper", "region.rubber.parameters.k.uper", "did you mean 'upper'"),
    "fixed and searched": (
        "upper =",
        'value = "2 MPa", upper =',
        "value",
        "region.rubber.parameters.k",
        "keep one",
    ),
    "parameter as a list": ("a = 0.5", "a = [0.5]", "a = [", "region.rubber.parameters.a", "not a quantity"),
    "parameter not finite": ("a = 0.5", "a = nan", "a = nan", "region.rubber.parameters.a", "not finite"),
    "outside the physical range": (
        "1000 kPa",
        "-1 kPa",
        "-1 kPa",
        "region.rubber.parameters.k.lower",
        "physical range [0.0, inf] MPa",
    ),
    "fixed outside the physical range": (
        RANGE,
        'k = "-1 MPa"\n',
        '"-1 MPa"',
        "region.rubber.parameters.k",
        "physical range",
    ),
    "nothing searched": (RANGE, 'k = "2 MPa"', "[region.rubber]", "region", "no parameter is searched"),
    "region name": ("region.rubber", 'region."a.b"', "[region", "region.a.b", "use letters"),
    "sampler": ("seed = 3", 'sampler = "lsh"', "lsh", "sampling.sampler", "did you mean 'lhs'"),
    "filter": (
        "[solver]",
        "[sampling.filters.stif]\n[solver]",
        "[sampling.filters.stif]",
        "sampling.filters.stif",
        "did you mean 'stiff'",
    ),
    "filter setting": (
        "[solver]",
        "[sampling.filters.stiff]\nx = 1\n[solver]",
        "x = 1",
        "sampling.filters.stiff.x",
        "unknown key",
    ),
    "solver": ('"closed_form"', '"closed"', '"closed"', "solver.name", "did you mean 'closed_form'"),
    "solver needs a limb": ("closed_form", "on_mesh", "on_mesh", "solver.name", "needs a [limb] table"),
    "solver needs a protocol": (
        "closed_form",
        "on_mesh",
        "on_mesh",
        "solver.name",
        "needs a [protocol] table",
    ),
    "solver needs a mesh": ("closed_form", "on_mesh", "[[spot]]", "spot 's1'", 'add mesh = "…"'),
    "limb of no use": (
        "[sampling]",
        '[limb]\nsource = "block"\n[sampling]',
        "[limb]",
        "limb",
        "remove the table",
    ),
    "mesh of no use": (
        'name = "s2"',
        'name = "s2"\nmesh = "s1.txt"',
        "mesh",
        "spot 's2', mesh",
        "remove the key",
    ),
    "fine mesh of no use": (
        'name = "s2"',
        'name = "s2"\nfine_mesh = "s1.txt"',
        "fine_mesh",
        "spot 's2', fine_mesh",
        "remove the key",
    ),
    "refinement of no use": (
        "[sampling]",
        '[fit]\nfine_edge = "3 mm"\n[sampling]',
        "fine_edge",
        "fit.fine_edge",
        "remove the key",
    ),
    "fine mesh missing": (
        'name = "s2"',
        'name = "s2"\nfine_mesh = "nowhere.vtu"',
        "fine_mesh",
        "spot 's2', fine_mesh",
        "no such file",
    ),
    "workers": ("n_workers = 1", "n_workers = -1", "n_workers", "solver.n_workers", "greater than or equal"),
    "time limit": ('"1 min"', '"1 mm"', "1 mm", "solver.time_limit", 'use e.g. "10 s"'),
    "time limit of zero": ('"1 min"', '"0 s"', "0 s", "solver.time_limit", "greater than 0"),
    "normaliser": (
        "[selection]",
        '[scoring]\nnormaliser = "mean_ab"\n[selection]',
        "mean_ab",
        "scoring.normaliser",
        "did you mean 'mean_abs'",
    ),
    "coverage": (
        "[selection]",
        "[scoring]\nminimum_coverage = 1.5\n[selection]",
        "minimum_coverage",
        "scoring.minimum_coverage",
        "less than or equal to 1",
    ),
    "scenario unknown": (
        '["pull only"]',
        '["pull only", "pul only"]',
        "pul only",
        "selection.scenarios[1]",
        "did you mean 'pull only'",
    ),
    "scenario twice": (
        '["pull only"]',
        '["pull only",\n"pull only"]',
        '"pull only"]',
        "selection.scenarios[1]",
        "listed twice",
    ),
    "no scenario": ('["pull only"]', "[]", "scenarios", "selection.scenarios", "at least 1"),
    "generalise_by": (
        'generalise_by = "pull only"',
        'generalise_by = "I"',
        "generalise_by",
        "selection.generalise_by",
        "not among the scenarios pull only",
    ),
    "scenario channel": (
        "[truth]",
        '[[scenario]]\nname = "x"\nweights = { pul = 1.0 }\n[truth]',
        "pul =",
        "scenario[0].weights.pul",
        "did you mean 'pull'",
    ),
    "scenario phase": (
        "[truth]",
        '[[scenario]]\nname = "x"\nweights = { "pull/up" = 1.0 }\n[truth]',
        "pull/up",
        "scenario[0].weights.pull/up",
        "unknown phase 'up' of a channel (known: load, unload)",
    ),
    "scenario weights": (
        "[truth]",
        '[[scenario]]\nname = "x"\nweights = { pull = -1.0 }\n[truth]',
        "pull = -1",
        "scenario[0].weights",
        "must be >= 0",
    ),
    "scenario taken": (
        "[truth]",
        '[[scenario]]\nname = "pull only"\nweights = { pull = 1.0 }\n[truth]',
        'name = "pull only"',
        "scenario[0].name",
        "choose another name",
    ),
    "truth of measured data": ('"simulated"', '"measured"', "[truth]", "truth", 'set data = "simulated"'),
    "truth of an unknown parameter": (
        '"rubber.k"',
        '"rubber.q"',
        "rubber.q",
        "truth.rubber.q",
        "known: rubber.k, rubber.a",
    ),
    "truth outside the physical range": (
        '"2 MPa"',
        '"-2 MPa"',
        '"-2 MPa"',
        "truth.rubber.k",
        "physical range",
    ),
    "truth without unit": ('"2 MPa"', "2", '"rubber.k" = 2', "truth.rubber.k", 'write "2 MPa"'),
}


@pytest.mark.parametrize(("old", "new", "place", "key", "remedy"), CASES.values(), ids=CASES)
def test_a_mistake_is_reported_with_line_key_and_remedy(
    tmp_path: Path, plugins: Plugins, old: str, new: str, place: str, key: str, remedy: str
) -> None:
    assert old in TEXT
    text = TEXT.replace(old, new, 1)
    found = messages(tmp_path, plugins, text)
    where = f"{line_of(text, place)}: {key}: "
    assert any(line.startswith(where) and remedy in line for line in found), found


ALONE = set(CASES) - {
    "solver needs a limb",
    "solver needs a protocol",
    "solver needs a mesh",
    "region name",  # it leaves [region.rubber.parameters] without its material
    "fine mesh missing",  # and the solver takes no mesh
}


@pytest.mark.parametrize("case", sorted(ALONE))
def test_one_mistake_gives_one_message(tmp_path: Path, plugins: Plugins, case: str) -> None:
    old, new, *_ = CASES[case]
    assert len(messages(tmp_path, plugins, TEXT.replace(old, new, 1))) == 1


LIMB_STUDY = TEXT.replace(
    "[sampling]",
    """[limb]
source = "block"

[protocol]
indenter = { shape = "sphere", radius = "7.5 mm" }
depth = "10 mm"
twist = ["-22.5 deg", "0 deg"]
friction = 1.0

[sampling]""",
).replace('"closed_form"', '"on_mesh"')
LIMB_STUDY = LIMB_STUDY.replace('.txt" }', '.txt" }\nmesh = "s1.txt"')


@pytest.mark.parametrize(
    ("old", "new", "key", "remedy"),
    [
        (
            '"10 mm"',
            '"10 apples"',
            "protocol.depth",
            "'10 apples': unknown unit 'apples'; use e.g. \"10 mm\"",
        ),
        ('"10 mm"', '"-10 mm"', "protocol.depth", "greater than 0"),
        ('= "10 mm"', "= 10\n", "protocol.depth", 'write "10 mm"'),
        ('"-22.5 deg"', '"-22.5"', "protocol.twist[0]", 'write "-22.5 deg"'),
        ("friction = 1.0", "friction = -1.0", "protocol.friction", "greater than or equal to 0"),
        ("twist =", "twits =", "protocol.twits", "unknown key; did you mean 'twist'"),
        (
            'depth = "10 mm"',
            'motion = "move"',
            "protocol.motion",
            "no motion 'move' (known:",
        ),
        ('"sphere"', '"spher"', "protocol.indenter.shape", "no indenter 'spher'; did you mean 'sphere'"),
        ('"7.5 mm"', '"7.5 kg"', "protocol.indenter.radius", "not of the kind of mm"),
        ('"7.5 mm"', '"7.5 mm", edge = "1 mm"', "protocol.indenter.edge", "unknown key (known: radius)"),
        ('"7.5 mm"', '"0 mm"', "protocol.indenter.radius", "greater than 0"),
        ('"block"', '"blok"', "limb.source", "did you mean 'block'"),
    ],
)
def test_a_mistake_in_limb_or_protocol(
    tmp_path: Path, plugins: Plugins, old: str, new: str, key: str, remedy: str
) -> None:
    assert old in LIMB_STUDY
    text = LIMB_STUDY.replace(old, new, 1)
    (found,) = messages(tmp_path, plugins, text)
    assert found.startswith(f"{line_of(text, new)}: {key}: ")
    assert remedy in found


def test_a_scenario_needs_channels_that_are_measured(tmp_path: Path, plugins: Plugins) -> None:
    text = TEXT.replace('["pull only"]', '["pull only", "both"]')
    text += '\n[[scenario]]\nname = "both"\nweights = { pull = 1.0, push = 1.0 }\n'
    found = messages(tmp_path, plugins, text)
    where = f"{line_of(text, 'both')}: selection.scenarios[1]: scenario 'both' weighs channel 'push', "
    assert [line.startswith(f"{where}which no spot measures") for line in found] == [True]


def provide(plugins: Plugins, monkeypatch: pytest.MonkeyPatch, name: str, **changes: Any) -> None:
    """Let a solver provide something else."""
    solver = plugins.solvers[name]
    monkeypatch.setattr(solver, "provides", replace(solver.provides, **changes))


def test_a_scenario_needs_channels_that_the_solver_computes(
    tmp_path: Path, plugins: Plugins, monkeypatch: pytest.MonkeyPatch
) -> None:
    provide(plugins, monkeypatch, "closed_form", channels=("push",))
    (message,) = messages(tmp_path, plugins, TEXT)
    assert "selection.scenarios[0]: scenario 'pull only' weights channel 'pull', which solver" in message
    assert message.endswith("does not compute (it has push); choose another of either")


def test_a_solver_refuses_an_indenter_that_it_does_not_simulate(
    tmp_path: Path, plugins: Plugins, monkeypatch: pytest.MonkeyPatch
) -> None:
    provide(plugins, monkeypatch, "on_mesh", indenters=("punch", "cuff"))
    text = LIMB_STUDY + '\n[spot.protocol]\nindenter = { shape = "sphere", radius = "1 mm" }\n'
    whole, own = messages(tmp_path, plugins, text)
    assert whole.startswith(f"{line_of(text, 'shape')}: protocol.indenter.shape: solver 'on_mesh' does not")
    assert "'on_mesh' does not simulate indenter 'sphere' (it has punch, cuff); choose" in whole
    assert own.split(": ")[1] == "spot 's2', protocol.indenter.shape"


def test_a_solver_without_a_mesh_needs_a_protocol_where_it_makes_no_homogeneous_tests(
    tmp_path: Path, plugins: Plugins, monkeypatch: pytest.MonkeyPatch
) -> None:
    provide(plugins, monkeypatch, "closed_form", body="layers")
    (message,) = messages(tmp_path, plugins, TEXT)
    assert "solver.name: solver 'closed_form' needs a [protocol] table; add one" in message


def test_a_solver_refuses_regions_and_materials_that_it_does_not_simulate(
    tmp_path: Path, plugins: Plugins, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = TEXT + '\n[region.skin]\nmaterial = "spring"\nparameters = { k = "1 MPa", a = 0.5 }\n'
    assert read_text(tmp_path, plugins, text)
    provide(plugins, monkeypatch, "closed_form", max_regions=1)
    (message,) = messages(tmp_path, plugins, text)
    assert message.startswith(
        f"{line_of(text, '[region.skin]')}: region.skin: solver 'closed_form' simulates"
    )
    assert message.endswith(
        "1 region, and the study has 2 (rubber, skin); remove a table, or choose another solver"
    )
    monkeypatch.setattr(plugins.materials["spring"], "fields", ("fibre",))
    (message,) = messages(tmp_path, plugins, TEXT)
    assert "region.rubber.material: material 'spring' takes cell data fibre, which solver" in message
    monkeypatch.setattr(interfaces, "AnisotropicMaterial", plugins.materials["spring"])
    (message,) = messages(tmp_path, plugins, TEXT)
    assert "region.rubber.material: solver 'closed_form' simulates no anisotropic material such as" in message
    provide(plugins, monkeypatch, "closed_form", anisotropic=True)
    (message,) = messages(tmp_path, plugins, TEXT)
    assert message.endswith("which solver 'closed_form' has not; choose another of either")
    provide(plugins, monkeypatch, "closed_form", fields=True)
    assert read_text(tmp_path, plugins, TEXT)


def test_a_spot_has_a_motion_of_its_own(
    tmp_path: Path, plugins: Plugins, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = LIMB_STUDY + '\n[spot.protocol]\ndepht = "5 mm"\n'
    (message,) = messages(tmp_path, plugins, text)
    assert "spot 's2', protocol.depht: unknown key; did you mean 'depth'" in message
    provide(plugins, monkeypatch, "on_mesh", motions=("depth",))
    text = LIMB_STUDY.replace('twist = ["-22.5 deg", "0 deg"]\n', "")
    (message,) = messages(tmp_path, plugins, text + '\n[spot.protocol]\ntwist = ["5 deg"]\n')
    assert "spot 's2', protocol.motion: solver 'on_mesh' simulates no motion with rotation" in message


def test_a_motion_until_a_load_does_not_scale(
    tmp_path: Path, plugins: Plugins, monkeypatch: pytest.MonkeyPatch
) -> None:
    pose, loads = np.array([[0.0] * 6, [5.0] + [0.0] * 5]), np.full((2, 6), np.nan)
    loads[1, 0] = 3.0
    made = Waypoints(pose=pose, loads=loads)
    monkeypatch.setattr(plugins.motions["press_and_twist"], "waypoints", lambda _: made)
    provide(plugins, monkeypatch, "on_mesh", motions=("depth", "load"))
    text = LIMB_STUDY.replace("[selection]", "[selection]\nstiffness_scaling = true")
    found = messages(tmp_path, plugins, text)
    assert any("selection.stiffness_scaling: a motion until a load" in message for message in found), found


def test_friction_is_that_of_the_protocol_or_of_the_tool(tmp_path: Path, plugins: Plugins) -> None:
    (message,) = messages(tmp_path, plugins, LIMB_STUDY.replace("friction = 1.0", ""))
    assert "protocol.friction: missing; add friction = … here, or to the indenter" in message
    own = LIMB_STUDY.replace("friction = 1.0", "").replace('"7.5 mm"', '"7.5 mm", friction = -1.0')
    (message,) = messages(tmp_path, plugins, own)
    assert "protocol.indenter.friction: -1.0: must be greater than or equal to 0" in message


def test_all_mistakes_are_reported_at_once_in_the_order_of_the_file(tmp_path: Path, plugins: Plugins) -> None:
    text = TEXT
    for case in ("data", "file missing", "loader", "unit unknown", "n_sets 1", "solver", "generalise_by"):
        text = text.replace(*CASES[case][:2], 1)
    found = messages(tmp_path, plugins, text)
    keys = [line.split(": ")[1] for line in found]
    assert keys == [
        "study.data",
        "spot 's2', measured.pull",
        "experiment.loader",
        "region.rubber.parameters.k.lower",
        "sampling.n_sets",
        "solver.name",
        "selection.generalise_by",
    ]


def test_missing_tables_are_named(tmp_path: Path, plugins: Plugins) -> None:
    found = messages(tmp_path, plugins, "")
    for table in ("study", "spot", "experiment", "region", "sampling", "solver", "selection"):
        assert f"1: missing table [{table}]; add it" in found


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"[study]\nname = \n", "line 2"),
        (b"[study]\nname = '\xff'\n", "is not UTF-8"),
        (None, "`palpate init` makes a study"),
    ],
)
def test_a_file_that_cannot_be_read(
    tmp_path: Path, plugins: Plugins, content: bytes | None, message: str
) -> None:
    path = tmp_path / "study.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(StudyError) as caught:
        read_study(path, plugins)
    assert str(caught.value).startswith(str(path))
    assert message in str(caught.value)


def test_a_broken_plugin_is_named_where_its_entry_is_missed(tmp_path: Path) -> None:
    bad = tmp_path / "bad.py"
    bad.write_text("import nowhere_at_all\n")
    plugins = Plugins.load([TOY / "toy_plugin.py", bad], entry_points=False)
    (found,) = messages(tmp_path, plugins, TEXT.replace('"spring"', '"yeoh"'))
    assert "No module named 'nowhere_at_all'" in found


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("= 20", "= 2.5", "sampling.n_sets: 2.5: not a whole number"),
        ("= 20", "= -1", "sampling.n_sets: -1: must be greater than or equal to 0"),
        ('"lines"', "5", "experiment.loader: 5: not a text; put it in quotation marks"),
        ('name = "s2"', 'name = "s2"\nnormal = ["a", 0, 0]', "spot 's2', normal[0]: 'a': not a number"),
        ('name = "s2"', 'name = "s2"\nnormal = 5', "spot 's2', normal: 5: not a list; write [ … ]"),
        ('name = "s2"', 'name = "s2"\nsettings = 5', "spot 's2', settings: 5: not a table; write { … }"),
        (
            "[selection]",
            '[selection]\nstiffness_scaling = "yes"',
            "selection.stiffness_scaling: 'yes': not true or false",
        ),
    ],
)
def test_the_common_mistakes_are_one_plain_line(
    tmp_path: Path, plugins: Plugins, old: str, new: str, message: str
) -> None:
    (found,) = messages(tmp_path, plugins, TEXT.replace(old, new, 1))
    assert found.endswith(message)
