"""One mistake at a time: each is reported with its line, its key and what to do."""

from pathlib import Path

import pytest

from palpate.plugins.catalogue import Plugins

from .toy_study import TEXT, line_of, messages

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


@pytest.mark.slow
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
