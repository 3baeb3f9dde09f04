"""Parameters that follow others: read from a study file, and the same as if they were written out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate.domain import ParameterSpace, Prior, RegionMaterial, Tie
from palpate.errors import StudyError
from palpate.plugins.catalogue import Plugins
from palpate.run.manifest import manifest
from palpate.stages.core_stages import Sample
from palpate.study.reading import read_study

TOY = Path(__file__).parents[2] / "data" / "toy"
RANGE = 'k = { lower = "1000 kPa", upper = "3 MPa" }\na = 0.5\n'
SKIN = '\n[region.skin]\nmaterial = "spring"\n[region.skin.parameters]\n'


@pytest.fixture
def read(tmp_path, plugins):
    """Read the toy study with these parameters of its region, and these of a second region."""

    def read_with(rubber=RANGE, skin="", truth=""):
        for name in ("s1.txt", "s2.txt"):
            (tmp_path / name).write_bytes((TOY / name).read_bytes())
        text = (TOY / "study.toml").read_text().replace(RANGE, rubber)
        if truth:
            text = text[: text.index("[truth]")] + truth
        if skin:
            text = text.replace("\n[sampling]", SKIN + skin + "\n[sampling]")
        (tmp_path / "study.toml").write_text(text)
        return read_study(tmp_path / "study.toml", plugins)

    return read_with


def test_a_tied_parameter_follows_and_is_neither_searched_nor_fixed(read):
    space = read(skin='k = "0.3 * rubber.k"\na = "2 * a2"\n'.replace("2 * a2", "0.5 * rubber.a")).space
    assert [p.name for p in space.parameters] == ["rubber.k"]
    assert space.ties == {
        "skin.k": Tie(source="rubber.k", factor=0.3),
        "skin.a": Tie(source="rubber.a", factor=0.5),
    }
    thetas = space.thetas(np.array([2.0]))
    np.testing.assert_allclose(thetas["skin"], [0.6, 0.25])
    np.testing.assert_allclose(thetas["rubber"], [2.0, 0.5])


def test_every_modulus_has_the_unit_of_the_first(read):
    skin = 'k = { lower = "0.1 MPa", upper = "0.5 MPa" }\na = 0.5\n'
    assert read(skin=skin).units == {"rubber.k": "kPa", "skin.k": "kPa"}


def test_the_unit_of_the_first_modulus_may_be_that_of_its_material(read):
    rubber = 'k = { lower = "1 MPa", upper = "3 MPa" }\na = 0.5\n'
    skin = 'k = { lower = "100 kPa", upper = "500 kPa" }\na = 0.5\n'
    assert read(rubber, skin=skin).units == {}


def test_a_tied_parameter_has_the_written_unit_of_what_it_follows(read):
    assert read(skin='k = "0.3 * rubber.k"\na = 0.5\n').units == {"rubber.k": "kPa", "skin.k": "kPa"}
    ratio = 'k = { lower = "0.1 * rubber.k", upper = "0.5 * rubber.k" }\na = "0.1 MPa^-1 * k"\n'
    assert read(skin=ratio).units == {"rubber.k": "kPa", "skin.k": "kPa"}
    fixed = read('k = "500 kPa"\na = { lower = 0.0, upper = 1.0 }\n', skin='k = "2 * rubber.k"\na = 0.5\n')
    assert fixed.units == {"skin.k": "kPa"}


def test_the_factor_has_a_unit_where_the_two_have_not_the_same(read):
    assert read('k = { lower = "1 MPa", upper = "3 MPa" }\na = "0.2 MPa^-1 * k"\n').space.ties == {
        "rubber.a": Tie(source="rubber.k", factor=pytest.approx(0.2))
    }


def test_a_tie_may_be_to_one_that_is_tied(read):
    space = read(skin='k = "0.5 * rubber.k"\na = "0.1 MPa^-1 * k"\n').space
    np.testing.assert_allclose(space.thetas(np.array([2.0]))["skin"], [1.0, 0.1])
    assert space.columns_of("skin") == (0,)


def test_the_manifest_has_the_ties(read, plugins):
    study = read(skin='k = "0.5 * rubber.k"\na = 0.1\n')
    (_, skin) = manifest(study, plugins.channels)["materials"]
    assert skin["tied"] == {"k": {"source": "rubber.k", "factor": 0.5}}


@given(data=st.data())
def test_a_tie_is_as_if_written_out(data):
    """Any forest of ties over two regions, in any of their conventions."""
    spring = Plugins.load([TOY / "toy_plugin.py"], entry_points=False).materials["spring"]()
    names = [f"{region}.{p}" for region in ("one", "two") for p in ("k", "a")]
    order = data.draw(st.permutations(names))
    numbers = st.floats(0.1, 10.0)
    convention = {region: data.draw(st.sampled_from(["textbook", "doubled"])) for region in ("one", "two")}
    ties, values = {}, {}
    for i, name in enumerate(order):
        if i and data.draw(st.booleans()):
            source, factor = data.draw(st.sampled_from(order[:i])), data.draw(numbers)
            values[name] = factor * values[source]
            if data.draw(st.booleans()):
                values[f"{name}_ratio"] = factor
                factor = replace(spring.parameters[1], name=f"{name.partition('.')[2]}_ratio")
            ties[name] = Tie(source=source, factor=factor)
        else:
            values[name] = data.draw(numbers)

    def space(tied):
        return ParameterSpace(
            regions=tuple(
                RegionMaterial(
                    region=region,
                    material=spring,
                    searched=tuple(p for p in spring.parameters if f"{region}.{p.name}" not in tied),
                    fixed={},
                    convention=convention[region],
                    tied={p: tied[f"{region}.{p}"] for p in ("k", "a") if f"{region}.{p}" in tied},
                )
                for region in ("one", "two")
            )
        )

    tied, written = (
        each.thetas(np.array([values[p.name] for p in each.parameters])) for each in (space(ties), space({}))
    )
    for region in ("one", "two"):
        np.testing.assert_allclose(tied[region], written[region], rtol=1e-14)
    assert space(ties).written(tied) == pytest.approx(values, rel=1e-12)


def test_a_ratio_is_searched_between_factors(read):
    prior = 'prior = { value = "0.3 * rubber.k", sd = "0.1 * rubber.k" }'
    study = read(
        skin=f'k = {{ lower = "0.1 * rubber.k", upper = "0.5 * rubber.k", by = "spot", {prior} }}\na = 0.1\n',
    )
    _, ratio = study.space.parameters
    assert (ratio.name, ratio.unit, ratio.lower, ratio.upper) == ("skin.k_ratio", "1", 0.1, 0.5)
    assert (ratio.kind, ratio.by, ratio.prior) == ("shape", "spot", Prior(value=0.3, sd=0.1))
    np.testing.assert_allclose(study.space.thetas(np.array([2.0, 0.4]))["skin"], [0.8, 0.1])
    assert study.space.columns_of("skin") == (0, 1)


def test_the_range_of_a_ratio_decides_the_design_and_is_in_the_manifest(read, plugins):
    narrow, wide = (
        read(skin=f'k = {{ lower = "0.1 * rubber.k", upper = "{upper} * rubber.k" }}\na = 0.1\n')
        for upper in (0.5, 0.6)
    )
    assert Sample().decides(narrow)["materials"] == Sample().decides(wide)["materials"]
    assert Sample().decides(narrow)["ranges"] != Sample().decides(wide)["ranges"]
    (_, skin) = manifest(narrow, plugins.channels)["materials"]
    assert skin["tied"] == {"k": {"source": "rubber.k", "factor": "k_ratio"}}
    assert [p["name"] for p in skin["searched"]] == ["k_ratio"]


def test_the_true_ratio_is_that_of_the_true_values(read):
    text = '\n[truth]\n"rubber.k" = "2 MPa"\n"skin.k" = "500 kPa"\n'
    ranges = 'k = { lower = "0.1 * rubber.k", upper = "0.5 * rubber.k" }\na = 0.1\n'
    assert read(skin=ranges, truth=text).truth["skin.k_ratio"] == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("ends", "message"),
    [
        ('lower = "0.1 * rubber.k", upper = "3 MPa"', "factors of one parameter; write"),
        ('lower = "0.1 * rubber.k", upper = "0.5 MPa * rubber.a"', "factors of one parameter; write"),
        (
            'lower = "0.1 * rubber.k", upper = "1 * rubber.k", prior = { value = "1 MPa", sd = "1 MPa" }',
            "factors of one parameter; write",
        ),
        ('lower = "0.5 * rubber.k", upper = "0.1 * rubber.k"', "swap them"),
        ('lower = "-1 * rubber.k", upper = "1 * rubber.k"', "where rubber.k = 1 MPa, skin.k_ratio = -1 1: "),
        ('lower = "1 * skin.k", upper = "2 * skin.k"', "the ties go round in a circle"),
    ],
)
def test_a_ratio_that_means_nothing_is_refused_with_its_line(read, tmp_path, ends, message):
    with pytest.raises(StudyError) as caught:
        read(skin=f"k = {{ {ends} }}\na = 0.1\n")
    text = (tmp_path / "study.toml").read_text()
    line = text[: text.index(ends)].count("\n") + 1
    assert f"study.toml:{line}: region.skin.parameters.k: " in str(caught.value)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("tie", "message"),
    [
        ("2 * rubber.l", "no parameter 'rubber.l'; did you mean 'rubber.k'"),
        ("2 * l", "no parameter 'skin.l'"),
        ("2 * fat.k", "no parameter 'fat.k'"),
        ("2 mm * rubber.k", "no factor from 'rubber.k' [MPa] to 'skin.k' [MPa]"),
        ("2 * rubber.a", "no factor from 'rubber.a' [1] to 'skin.k' [MPa]"),
        ("1e999 * rubber.k", "not finite"),
        ("nan * rubber.k", "'nan' is not a number"),
        ("0 * rubber.k", "write a quantity to fix"),
        ("-1 * rubber.k", "leaves its range where rubber.k = 1 MPa"),
        ("2 * skin.k", "the ties go round in a circle, skin.k → skin.k"),
        ("1 MPa * a", "the ties go round in a circle, skin.k → skin.a → skin.k"),
    ],
)
def test_a_tie_that_means_nothing_is_refused_with_its_line(read, tmp_path, tie, message):
    with pytest.raises(StudyError) as caught:
        read(skin=f'k = "{tie}"\na = "0.1 MPa^-1 * k"\n')
    text = (tmp_path / "study.toml").read_text()
    line = text[: text.index(f'k = "{tie}"')].count("\n") + 1
    assert f"study.toml:{line}: region.skin.parameters.k: " in str(caught.value)
    assert message in str(caught.value)


def test_spots_have_states(read, tmp_path, plugins):
    text = read(rubber='k = { lower = "1 MPa", upper = "3 MPa", by = "state" }\na = 0.5\n').file.read_text()

    def stated(first, second):
        named = text.replace('name = "s1"', f'name = "s1"\n{first}').replace(
            'name = "s2"', f'name = "s2"\n{second}'
        )
        (tmp_path / "study.toml").write_text(named)
        return read_study(tmp_path / "study.toml", plugins)

    study = stated('state = "rest"', 'state = "contracted"')
    assert dict(study.space.states) == {"s1": "rest", "s2": "contracted"}
    names = [p.name for p in study.parametrisation.parameters(study.space, study.spot_names)]
    assert names == ["rubber.k@rest", "rubber.k@contracted"]
    assert manifest(study, plugins.channels)["spots"]["s2"]["state"] == "contracted"
    with pytest.raises(StudyError, match="has no state, which other spots have"):
        stated('state = "rest"', "")
    with pytest.raises(StudyError, match="is the name of a spot too"):
        stated('state = "rest"', 'state = "s1"')
    with pytest.raises(StudyError, match="by state, and no spot has one"):
        study.parametrisation.parameters(stated("", "").space, study.spot_names)


def test_a_tie_decides_the_design_and_a_prior_does_not(read):
    one, other = (Sample().decides(read(skin=f'k = "{f} * rubber.k"\na = 0.1\n')) for f in (0.3, 0.4))
    assert one["materials"] != other["materials"]
    known = (
        'k = { lower = "1 MPa", upper = "3 MPa", by = "spot", prior = { value = "2 MPa", sd = "500 kPa" } }'
    )
    study = read(rubber=f"{known}\na = 0.5\n")
    (parameter,) = study.space.parameters
    assert parameter.prior == Prior(value=2.0, sd=0.5)
    assert parameter.by == "spot"
    assert Sample().decides(study) == Sample().decides(read())
