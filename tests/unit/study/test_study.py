"""A valid study file becomes its study."""

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from palpate.domain import Indentation, Normaliser, PointWeighting
from palpate.plugins.catalogue import Plugins
from palpate.study.reading import Study, read_study
from palpate.study.schema import NAMED_BY, json_schema

TOY = Path(__file__).parents[2] / "data" / "toy"
PLUGIN = TOY / "toy_plugin.py"
Edit = Callable[..., Study]

LIMB = """
[limb]
source = "block"

[protocol]
indenter = { shape = "sphere", radius = "0.75 cm" }
depth = "10 mm"
twist = ["-22.5 deg", "22.5 deg", "0 deg"]
friction = 1.0
"""


@pytest.fixture(scope="module")
def plugins() -> Plugins:
    return Plugins.load([PLUGIN], entry_points=False)


@pytest.fixture
def read(tmp_path: Path, plugins: Plugins) -> Edit:
    """Read the toy study after replacing texts in it."""

    def read_edited(*edits: tuple[str, str], more: str = "") -> Study:
        text = (TOY / "study.toml").read_text()
        for old, new in edits:
            assert old in text
            text = text.replace(old, new)
        for name in ("s1.txt", "s2.txt"):
            (tmp_path / name).write_bytes((TOY / name).read_bytes())
        (tmp_path / "study.toml").write_text(text + more)
        return read_study(tmp_path / "study.toml", plugins)

    return read_edited


def test_the_file_becomes_a_study(read: Edit, tmp_path: Path) -> None:
    study = read()
    assert (study.name, study.data, study.folder) == ("toy", "simulated", tmp_path)
    assert [spot.spot.name for spot in study.spots] == ["s1", "s2"]
    assert study.spots[0].measured == {"pull": (tmp_path / "s1.txt",)}
    assert (study.loader.name, study.solver.name, study.sampler.name) == ("lines", "closed_form", "lhs")
    assert (study.n_sets, study.seed, study.n_workers, study.time_limit_s) == (20, 3, 1, 60.0)
    assert (study.limb_source, study.protocol) == (None, None)
    assert [scenario.name for scenario in study.scenarios] == ["pull only"]
    assert study.plugin_files == (PLUGIN,)


def test_defaults_are_the_papers(read: Edit) -> None:
    study = read(('generalise_by = "pull only"', ""))
    assert study.scoring.score.settings.normaliser is Normaliser.MEAN_ABS
    assert study.scoring.minimum_coverage == 0.95
    assert study.generalise_by == "pull only"
    assert study.search.name == "least_squares"
    assert study.filters == ()


def test_a_folder_is_read_as_its_study_toml(plugins: Plugins) -> None:
    assert read_study(TOY, plugins).name == "toy"


def test_a_parameter_is_searched_in_its_unit_or_fixed(read: Edit) -> None:
    (k,) = read().space.parameters
    assert (k.name, k.lower, k.upper, k.unit) == ("rubber.k", 1.0, 3.0, "MPa")
    assert read().units == {"rubber.k": "kPa"}
    assert read(('"1000 kPa"', '"1 MPa"')).units == {}
    assert read().space.regions[0].fixed == {"a": 0.5}
    assert read(("a = 0.5", "a = { value = 0.25 }")).space.regions[0].fixed == {"a": 0.25}


def test_a_parameter_not_named_is_searched_over_the_materials_range(read: Edit) -> None:
    _, a = read(("a = 0.5\n", "")).space.parameters
    assert (a.name, a.lower, a.upper) == ("rubber.a", 0.0, 1.0)


def test_ranges_and_defaults_follow_the_convention(read: Edit) -> None:
    study = read(
        ('material = "spring"', 'material = "spring"\nconvention = "doubled"'),
        ('k = { lower = "1000 kPa", upper = "3 MPa" }', ""),
    )
    (k,) = study.space.parameters
    assert (k.lower, k.upper) == (1.0, 8.0)  # textbook 0.5 … 4
    thetas = study.space.thetas(np.array([3.0]))
    assert thetas["rubber"] == pytest.approx([1.5, 0.5])


def test_the_physical_range_follows_the_convention(read: Edit) -> None:
    study = read(('material = "spring"', 'material = "spring"\nconvention = "doubled"'))
    (k,) = study.space.parameters
    assert (k.physical_lower, k.physical_upper) == (0.0, np.inf)


def test_the_truth_is_read_in_its_unit_quoted_or_dotted(read: Edit) -> None:
    assert read().truth == {"rubber.k": 2.0}
    assert read(('"rubber.k" = "2 MPa"', 'rubber.k = "2000 kPa"')).truth == {"rubber.k": 2.0}


def test_one_file_may_hold_several_channels(read: Edit) -> None:
    study = read(('{ pull = "s1.txt" }', '"s1.txt"'))
    assert list(study.spots[0].measured) == [None]


def test_settings_reach_their_component(read: Edit) -> None:
    study = read(
        ("[sampling]", "[experiment.settings]\nskip = 2\n\n[sampling]"),
        ("seed = 3", "seed = 3\nsettings = { centred = true }\n[sampling.filters.stiff]"),
    )
    assert study.loader.settings.skip == 2
    assert study.sampler.settings.centred is True
    assert [entry.name for entry in study.filters] == ["stiff"]


def test_the_study_may_bring_scenarios(read: Edit) -> None:
    study = read(
        ('["pull only"]', '["twice", "pull only"]'),
        more='\n[[scenario]]\nname = "twice"\nweights = { pull = 2.0 }\ndescription = "heavier"\n',
    )
    assert [scenario.name for scenario in study.scenarios] == ["twice", "pull only"]
    assert study.scenarios[0].weights == {"pull": 2.0}


def test_a_protocol_is_a_press_and_a_twist(read: Edit) -> None:
    study = read(
        ("[sampling]", LIMB + "[sampling]"),
        ("closed_form", "on_mesh"),
        ('measured = { pull = "s1.txt" }', 'measured = { pull = "s1.txt" }\nmesh = "s1.txt"'),
        (
            'measured = { pull = "s2.txt" }',
            'measured = { pull = "s2.txt" }\nmesh = "s1.txt"\n'
            'position = ["1 mm", "2 cm", "0 mm"]\nnormal = [0, 3, 4]',
        ),
    )
    assert isinstance(study.protocol, Indentation)
    assert study.protocol.indenter.radius_mm == 7.5
    assert study.protocol.path.tolist() == [[0, 0], [10, 0], [10, -22.5], [10, 22.5], [10, 0]]
    assert study.protocol.friction == 1.0
    spot = study.spots[1].spot
    assert spot.position_mm.tolist() == [1, 20, 0]
    assert spot.normal == pytest.approx([0, 0.6, 0.8])


def test_a_spot_may_be_pressed_again_with_another_indenter_and_loader(read: Edit, tmp_path: Path) -> None:
    study = read(
        ("[sampling]", LIMB + "[experiment.settings]\nskip = 1\n[sampling]"),
        ("closed_form", "on_mesh"),
        ('measured = { pull = "s1.txt" }', 'measured = { pull = ["s1.txt", "s2.txt"] }\nmesh = "s1.txt"'),
        (
            'measured = { pull = "s2.txt" }',
            'measured = ["s2.txt"]\nmesh = "s1.txt"\nsettings = { skip = 3 }\n'
            'protocol = { indenter = { shape = "sphere", radius = "5 mm" }, twist = [] }',
        ),
    )
    one, two = study.spots
    assert one.measured == {"pull": (tmp_path / "s1.txt", tmp_path / "s2.txt")}
    assert two.measured == {None: (tmp_path / "s2.txt",)}
    assert study.protocol_at("s1") is study.protocol
    assert isinstance(small := study.protocol_at("s2"), Indentation)
    assert (small.indenter.radius_mm, small.friction, small.path.tolist()) == (5.0, 1.0, [[0, 0], [10, 0]])
    assert study.loader_at("s1").settings.skip == 1
    assert study.loader_at("s2").settings.skip == 3


def test_points_may_be_weighted_by_their_standard_deviation(read: Edit) -> None:
    assert read().scoring.score.settings.point_weighting is PointWeighting.EQUAL
    study = read(more='[scoring]\npoint_weighting = "std"\n')
    assert study.scoring.score.settings.point_weighting is PointWeighting.STD


def test_comments_order_and_byte_order_do_not_matter(read: Edit, tmp_path: Path, plugins: Plugins) -> None:
    text = (TOY / "study.toml").read_text()
    head, tail = text.split("[sampling]")
    read()
    (tmp_path / "study.toml").write_text("# start\n[sampling]" + tail + head)
    assert read_study(tmp_path, plugins).n_sets == 20


# --------------------------------------------------------------- JSON schema


def parsed(path: Path) -> object:
    import tomllib

    return tomllib.loads(path.read_text())


def shipped_studies() -> list[Path]:
    root = Path(__file__).parents[3]
    return [TOY / "study.toml", *sorted(root.glob("*/palpate-*/src/**/study*.toml"))]


@pytest.mark.parametrize("path", shipped_studies(), ids=lambda path: path.parent.name)
def test_the_schema_accepts_every_shipped_study(path: Path) -> None:
    jsonschema.Draft202012Validator(whole_schema()).validate(parsed(path))


@cache
def whole_schema() -> dict[str, Any]:
    plugins = Plugins.load()
    kinds = {kind: plugins.catalogue(kind) for kind in NAMED_BY}
    return json_schema({kind: {n: c.Settings for n, c in each.items()} for kind, each in kinds.items()})


def test_the_schema_has_the_settings_of_the_named_component() -> None:
    study = parsed(Path(Plugins.load().studies["robot-log"].directory) / "study.toml")
    validator = jsonschema.Draft202012Validator(whole_schema())
    validator.check_schema(validator.schema)
    study["experiment"]["settings"]["onset"] = {"exponent": 9.0}
    study["region"]["soft_tissue"]["settings"] = {"none_such": 2}
    study["fit"] = {"settings": {"max_steps": 0}, "searched": {"none_such": True}}  # of the default search
    assert sorted(error.json_path for error in validator.iter_errors(study)) == [
        "$.experiment.settings.onset.exponent",
        "$.fit.searched",
        "$.fit.settings.max_steps",
        "$.region.soft_tissue.settings",
    ]


def test_the_schema_is_json_and_refuses_what_reading_refuses() -> None:
    schema = json.loads(json.dumps(json_schema()))
    jsonschema.Draft202012Validator.check_schema(schema)
    study = parsed(TOY / "study.toml")
    assert isinstance(study, dict)
    for edit in (
        {"unknown": {}},
        {"sampling": {"n_sets": 1}},
        {"study": {"name": "x", "data": "guessed"}},
        {"spot": []},
        {"protocol": {"depth": 10}},
    ):
        assert not jsonschema.Draft202012Validator(schema).is_valid({**study, **edit})


def test_sampling_may_refill_and_spread_the_logarithm(read: Edit) -> None:
    study = read(
        (
            "n_sets = 20",
            'n_sets = 20\nmax_draws = 320\nsampler = "optimised_lhs"\nsettings = { criterion = "maximin" }',
        ),
        ('upper = "3 MPa" }', 'upper = "3 MPa", scale = "log" }'),
    )
    assert study.max_draws == 320
    assert study.sampler.settings.criterion == "maximin"
    assert study.space.parameters[0].scale == "log"
    assert read().max_draws == 0
    assert read().space.parameters[0].scale == "linear"
