"""Each card, parsed and evaluated by the formula of its program, has palpate's stress."""

import json
import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from palpate import mechanics
from palpate.api import relaxing
from palpate.api.fit import Adequacy
from palpate.errors import MaterialError
from palpate_materials.neo_hookean import NeoHookean
from palpate_materials.uncoupled import (
    ArrudaBoyce,
    Demiray,
    Gent,
    Ogden,
    OgdenSettings,
    Yeoh,
    YeohSettings,
)
from palpate_prediction.cards.card import CardData
from palpate_prediction.cards.programs import PROGRAMS, _counting_at, _intervals, joined
from palpate_report.answer.model_verdict import ModelVerdict
from palpate_report.data.marks import Headline

CASES = {
    "neo_hookean": (NeoHookean(), [0.0735, 0.4434]),
    "yeoh": (Yeoh(), [0.0141, -0.0011, 1.05e-4, 0.8]),
    "yeoh1": (Yeoh(YeohSettings(terms=1)), [0.0141, 0.8]),
    "yeoh2": (Yeoh(YeohSettings(terms=2)), [0.0141, 0.002, 0.8]),
    "ogden": (Ogden(), [0.061, 3.1, 1.3]),
    "ogden2": (Ogden(OgdenSettings(terms=2)), [0.061, 3.1, 0.02, -2.0, 1.3]),
    "ogden4": (Ogden(OgdenSettings(terms=4)), [0.061, 3.1, 0.02, -2.0, 0.01, 5.0, 0.03, -1.2, 1.3]),
    "arruda_boyce": (ArrudaBoyce(), [0.03, 4.0, 0.9]),
    "gent": (Gent(), [0.03, 20.0, 0.9]),
}
UNIAXIAL = np.diag([1.6, 1.6**-0.5, 1.6**-0.5])
SHEAR = np.eye(3) + 0.5 * np.eye(3)[[0]].T @ np.eye(3)[[1]]
DILATED = 0.97 * np.eye(3)


def origins_of(material):
    """Where the values of a material are from: its last parameter is fixed."""
    *searched, fixed = (p.name for p in material.parameters)
    origins = dict.fromkeys(searched, "fitted") | {fixed: "fixed"}
    return {"origins": origins, "verdicts": dict.fromkeys(searched, "well")}


def data(name, **changes):
    material, theta = CASES[name]
    given = {
        "material": material,
        "theta": np.array(theta),
        "title": "arm",
        "region": "tissue",
        "intervals": {},
        "strain": {},
        **origins_of(material),
    } | changes
    return CardData(**given)


# ------------------------------------------- what each program does with its numbers, by its manual


def power_sum(coefficients):
    return lambda _, x: sum(c * x**k for k, c in enumerate(coefficients, 1))


def gent_energy(mu, limit):
    return lambda _, x: -0.5 * mu * limit * jnp.log(1.0 - x / limit)


def ogden_sum(pairs, factor):
    return lambda s, _: sum(factor(mu, a) * (jnp.sum(s**a) - 3.0) for mu, a in pairs)


def separate(shape, volume):
    """Energy of principal stretches by parts for shape and volume."""

    def energy(stretches):
        J = jnp.prod(stretches)
        isochoric = stretches * J ** (-1.0 / 3.0)
        return shape(isochoric, jnp.sum(isochoric**2) - 3.0) + volume(J)

    return energy


def numbers(text):
    return [float(each) for each in re.findall(r"[-+]?[\d.]+(?:e[-+]?\d+)?", text)]


def febio(card):
    root = ET.fromstring(re.sub(r"<!--.*?-->", "", card, flags=re.DOTALL))
    root = root if (elastic := root.find("elastic")) is None else elastic
    own = {child.tag: float(child.text) for child in root}
    log = lambda J: 0.5 * own["k"] * jnp.log(J) ** 2  # noqa: E731
    if root.attrib["type"] == "neo-Hookean":
        mu = own["E"] / (2 * (1 + own["v"]))
        lam = own["E"] * own["v"] / ((1 + own["v"]) * (1 - 2 * own["v"]))
        return lambda s: (
            0.5 * mu * (jnp.sum(s**2) - 3) - mu * jnp.log(jnp.prod(s)) + 0.5 * lam * jnp.log(jnp.prod(s)) ** 2
        )
    if root.attrib["type"] == "Gent":
        return separate(gent_energy(own["G"], own["Jm"]), log)
    if root.attrib["type"] == "Yeoh":
        c = [own[f"c{k}"] for k in range(1, 7) if f"c{k}" in own]
        return separate(power_sum([value / k for k, value in enumerate(c, 1)]), log)
    pairs = [(own[f"c{k}"], own[f"m{k}"]) for k in range(1, 7) if f"c{k}" in own]
    return separate(ogden_sum(pairs, lambda c, m: c / m**2), log)


def abaqus(card):
    lines = [line for line in card.splitlines() if not line.startswith("**")]
    keyword = next(line for line in lines if line.startswith("*Hyperelastic")).lower()
    first = [line.lower() for line in lines].index(keyword) + 1
    after = next((i for i, line in enumerate(lines) if line.startswith("*Viscoelastic")), len(lines))
    values = numbers(" ".join(lines[first:after]))
    keyword = keyword.removesuffix(", moduli=instantaneous")
    n = int(keyword.partition("n=")[2] or {"neo hooke": 1, "yeoh": 3}[keyword.partition(", ")[2]])
    if "ogden" in keyword:
        pairs, d1 = list(zip(values[: 2 * n : 2], values[1 : 2 * n : 2], strict=True)), values[2 * n]
        return separate(ogden_sum(pairs, lambda mu, a: 2 * mu / a**2), lambda J: (J - 1) ** 2 / d1)
    return separate(power_sum(values[:n]), lambda J: (J - 1) ** 2 / values[n])


def ansys(card):
    lines = [line for line in card.partition("\nTB,PRONY")[0].splitlines() if not line.startswith("!")]
    (table,) = (line.split(",") for line in lines if line.startswith("TB,"))
    values = [v for line in lines if line.startswith("TBDATA") for v in map(float, line.split(",")[2:])]
    kind, n = table[5], int(table[4] or 1)
    if kind == "GENT":
        mu, limit, d = values
        return separate(gent_energy(mu, limit), lambda J: (0.5 * (J**2 - 1) - jnp.log(J)) / d)
    if kind == "NEO":
        return separate(power_sum([0.5 * values[0]]), lambda J: (J - 1) ** 2 / values[1])
    if kind == "YEOH":
        return separate(power_sum(values[:n]), lambda J: (J - 1) ** 2 / values[n])
    pairs = list(zip(values[: 2 * n : 2], values[1 : 2 * n : 2], strict=True))
    return separate(ogden_sum(pairs, lambda mu, a: mu / a), lambda J: (J - 1) ** 2 / values[2 * n])


READERS = {"febio": febio, "abaqus": abaqus, "ansys": ansys}
WRITTEN = [(program, name) for program in READERS for name in CASES if (program, name) != ("abaqus", "gent")]


def cauchy(energy, F):
    """Cauchy stress of an energy of principal stretches, by its spectral form."""
    directions, stretches, _ = np.linalg.svd(F)
    principal = stretches * np.asarray(jax.grad(energy)(jnp.asarray(stretches))) / np.linalg.det(F)
    return directions * principal @ directions.T


def deviator(sigma):
    return sigma - np.trace(sigma) / 3.0 * np.eye(3)


@pytest.mark.slow
@pytest.mark.parametrize(("program", "name"), WRITTEN)
def test_the_cards_formula_has_palpates_stress(program, name):
    material, theta = CASES[name]
    energy = READERS[program](PROGRAMS[program](data(name)))
    mine = {
        key: np.asarray(mechanics.cauchy_stress(material, F[None], np.array(theta)))[0]
        for key, F in (("uniaxial", UNIAXIAL), ("shear", SHEAR), ("dilated", DILATED))
    }
    scale = np.abs(mine["uniaxial"]).max()
    for key, F in (("uniaxial", UNIAXIAL), ("shear", SHEAR)):
        np.testing.assert_allclose(
            deviator(cauchy(energy, F)), deviator(mine[key]), atol=1e-10 * scale, rtol=1e-9
        )
    if program == "febio":  # the same volumetric energy: the whole stress
        for key, F in (("uniaxial", UNIAXIAL), ("shear", SHEAR), ("dilated", DILATED)):
            np.testing.assert_allclose(cauchy(energy, F), mine[key], atol=1e-10 * scale, rtol=1e-9)
    _, kappa = mechanics.initial_moduli(material, np.array(theta))
    bulk = np.trace(cauchy(energy, (1.0 + 1e-6) * np.eye(3))) / 9e-6
    assert bulk == pytest.approx(kappa, rel=1e-5)


@pytest.mark.parametrize(
    ("program", "name"),
    [(p, n) for p, n in WRITTEN if p != "febio" and n in ("neo_hookean", "yeoh", "ogden", "gent")],
)
def test_the_stated_difference_of_the_mean_stress_is_that_of_the_formula(program, name):
    material, theta = CASES[name]
    ends = {"stretch_min": 0.7, "stretch_max": 1.4, "i1_max": 3.6, "J_min": 0.96, "J_max": 1.02}
    card = PROGRAMS[program](data(name, strain=ends))
    assert "principal stretches from 0.700 to 1.400, I1 up to 3.600, J from 0.9600 to 1.0200" in card
    stated = re.search(r"pure dilation: differs from palpate's by ([-+.\d]+) % at J = 0\.96", card)
    F = 0.96 ** (1 / 3) * np.eye(3)
    mine = np.trace(np.asarray(mechanics.cauchy_stress(material, F[None], np.array(theta)))[0])
    theirs = np.trace(cauchy(READERS[program](card), F))
    assert float(stated[1]) == pytest.approx(100 * (theirs / mine - 1), abs=0.01)


def test_a_card_states_units_moduli_and_intervals():
    card = PROGRAMS["abaqus"](data("yeoh", intervals={"c1": (0.0139, 0.0143)}))
    assert "** fitted: c1 = 0.01410 MPa (95 % interval 0.01390 to 0.01430; well)" in card
    assert "** fixed: kappa = 0.8 MPa\n" in card
    assert "** initial moduli: shear 0.0282 MPa, bulk 0.8 MPa" in card
    assert "** units: mm, N, MPa, tonne, s" in card
    assert "the strains of the experiment are not known" in card
    reached = {"uniaxial": ("stretch", 1.02, 7.6), "simple_shear": ("shear", 0.0, 0.6)}
    assert (
        "valid: the experiment reached stretch 1.020 to 7.600 (uniaxial), shear 0.000 to 0.600 (simple_shear)"
        in PROGRAMS["abaqus"](data("yeoh", reached=reached))
    )


@pytest.mark.parametrize("program", PROGRAMS)
def test_every_card_gives_the_verdict(program):
    verdicts = {"c1": "well", "c2": "not identified, end of range"}
    card = PROGRAMS[program](data("yeoh2", verdicts=verdicts))
    assert "c1 well, c2 not identified, end of range (WARNING: not all are results)" in card
    assert "WARNING" not in PROGRAMS[program](data("yeoh2"))
    refused = ModelVerdict(verdict=Adequacy.FAILS, sentence="No parameters can be read: R² 0.1")
    card = PROGRAMS[program](data("yeoh2", model=refused))
    assert "WARNING: No parameters can be read: R2 0.1" in card


def test_json_has_every_material_and_others_are_refused_with_the_reason():
    material = Demiray()
    theta = np.array([0.5 * (p.lower + p.upper) for p in material.parameters])
    given = CardData(
        title="arm",
        region="r",
        material=material,
        theta=theta,
        intervals={},
        strain={},
        **origins_of(material),
    )
    found = json.loads(PROGRAMS["json"](given))
    assert found["parameters"]["kappa"]["value"] == theta[-1]
    shear_MPa = mechanics.initial_moduli(material, theta)[0]
    assert found["initial_shear_modulus_MPa"] == pytest.approx(shear_MPa)
    lines = PROGRAMS["text"](given).splitlines()
    assert f"fixed: kappa = {theta[-1]:.6g} MPa" in lines
    assert any(line.startswith(f"initial moduli: shear {shear_MPa:.4g} MPa") for line in lines)
    assert not any("density" in line for line in lines)
    for program in READERS:
        with pytest.raises(MaterialError, match=f"'demiray' cannot be written for {program}: its class decl"):
            PROGRAMS[program](given)


def test_gents_energy_is_refused_where_a_program_has_it_as_a_subroutine():
    with pytest.raises(MaterialError, match=r"'gent' cannot be written for abaqus.*fit arruda_boyce"):
        PROGRAMS["abaqus"](data("gent"))


# ------------------------------------------------------------------------ relaxation

TIMES_S, SHARES = (0.5, 3.0, 10.0, 40.0), (0.1, 0.0, 0.2, 0.15)


def relaxed(name, isochoric=False, times_s=TIMES_S, shares=SHARES):
    elastic, theta = CASES[name]
    material, own = relaxing(elastic, times_s, isochoric), origins_of(elastic)
    own["origins"] |= {p.name: "fitted" for p in material.parameters if p.name.startswith("relaxed")}
    return data(name, material=material, theta=np.array([*theta, *shares]), **own)


def moduli_of(energy):
    h = jax.hessian(energy)(jnp.ones(3))
    return float(h[0, 0] - h[0, 1]) / 2.0, float(h[0, 0] + 2.0 * h[0, 1]) / 3.0


def febio_over_time(card, time_s):
    """FEBio's manual, viscoelastic: G(t) = g0 + Σ g_i e^(-t/t_i) of the elastic material, g0 = 1."""
    root = ET.fromstring(re.sub(r"<!--.*?-->", "", card, flags=re.DOTALL))
    own = {child.tag: float(child.text) for child in root if child.tag[0] in "gt"}
    n = len(own) // 2
    left = own.get("g0", 1.0) + sum(own[f"g{i}"] * np.exp(-time_s / own[f"t{i}"]) for i in range(1, n + 1))
    shear, bulk = moduli_of(febio(card))
    is_of_shape = root.attrib["type"] == "uncoupled viscoelastic"
    return shear * left, bulk * (np.ones_like(left) if is_of_shape else left)


def abaqus_over_time(card, time_s):
    """Abaqus: g_R(t) = 1 - Σ g_i (1 - e^(-t/τ_i)), k_R(t) alike, of the moduli that MODULI names."""
    lines = [line for line in card.splitlines() if not line.startswith("**")]
    assert "moduli=instantaneous" in next(line for line in lines if line.startswith("*Hyperelastic"))
    rows = np.array([numbers(line) for line in lines[lines.index("*Viscoelastic, time=prony") + 1 :]])
    gone = -np.expm1(-time_s[:, None] / rows[:, 2])
    shear, bulk = moduli_of(abaqus(card))
    return shear * (1.0 - gone @ rows[:, 0]), bulk * (1.0 - gone @ rows[:, 1])


def ansys_over_time(card, time_s):
    """Ansys: G(t) = G0 (1 - Σ α_i + Σ α_i e^(-t/τ_i)), G0 of the constants at the fast load limit."""
    left = {"SHEAR": np.ones_like(time_s), "BULK": np.ones_like(time_s)}
    for part in card.split("TB,PRONY,")[1:]:
        first, *rows = [line for line in part.splitlines() if line.startswith(("1,", "TBDATA"))]
        values = [v for line in rows for v in map(float, line.split(",")[2:])]
        pairs = np.array(values).reshape(-1, 2)
        _, _, n, kind = first.split(",")
        assert int(n) == len(pairs)
        left[kind] = 1.0 - pairs[:, 0].sum() + np.exp(-time_s[:, None] / pairs[:, 1]) @ pairs[:, 0]
    shear, bulk = moduli_of(ansys(card))
    return shear * left["SHEAR"], bulk * left["BULK"]


OVER_TIME = {"febio": febio_over_time, "abaqus": abaqus_over_time, "ansys": ansys_over_time}


@pytest.mark.parametrize("isochoric", [False, True])
@pytest.mark.parametrize("name", ["neo_hookean", "yeoh", "ogden2"])
@pytest.mark.parametrize("program", OVER_TIME)
def test_the_cards_formula_relaxes_as_palpate_does(program, name, isochoric):
    if (program, name, isochoric) == ("febio", "neo_hookean", True):
        return  # refused
    time_s = np.array([0.0, 0.1, 1.0, 10.0, 1e5])
    card = PROGRAMS[program](relaxed(name, isochoric))
    material, theta = CASES[name]
    left = 1.0 + np.expm1(-time_s[:, None] / np.array(TIMES_S)) @ np.array(SHARES)
    shear, bulk = OVER_TIME[program](card, time_s)
    mu, kappa = mechanics.initial_moduli(material, np.array(theta))
    np.testing.assert_allclose(shear, mu * left, rtol=1e-9)
    if program == "febio" and name != "neo_hookean" and not isochoric:
        assert "the bulk modulus does not relax here; in palpate it does, as the shear one" in card
        np.testing.assert_allclose(bulk, kappa, rtol=1e-9)
    else:
        np.testing.assert_allclose(bulk, kappa * (1.0 if isochoric else left), rtol=1e-9)
    assert f"long-term moduli: shear {0.55 * mu:.6g} MPa" in card
    assert "not determined" not in card
    card = PROGRAMS[program](replace(relaxed(name, isochoric), record_s=6.0))
    assert "not determined by a record of 6 s: relaxation with 10 s, 40 s" in card


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_febios_elastic_material_is_that_of_the_long_term(name):
    """At large strains too: its whole stress, or that of the shape, is a share of the stress at once."""
    material, theta = CASES[name]
    energy = febio(PROGRAMS["febio"](relaxed(name)))
    for F in (UNIAXIAL, SHEAR):
        at_once = np.asarray(mechanics.cauchy_stress(material, F[None], np.array(theta)))[0]
        np.testing.assert_allclose(
            deviator(cauchy(energy, F)), 0.55 * deviator(at_once), rtol=1e-9, atol=1e-12
        )


def test_a_card_that_a_program_has_no_form_for_is_refused_with_the_reason():
    with pytest.raises(
        MaterialError, match="the whole stress of an energy that couples shape and volume, and"
    ):
        PROGRAMS["febio"](relaxed("neo_hookean", isochoric=True))
    many = relaxed("yeoh", times_s=range(1, 8), shares=[0.1] * 7)
    with pytest.raises(MaterialError, match="take 6 time constants, and it has 7; fit fewer"):
        PROGRAMS["febio"](many)


def test_a_card_without_a_share_above_zero_is_that_of_the_elastic_material():
    for program in READERS:
        card, elastic = PROGRAMS[program](relaxed("yeoh", shares=[0.0] * 4)), PROGRAMS[program](data("yeoh"))
        kept = [line for line in card.splitlines() if "relaxed" not in line]
        assert kept == elastic.splitlines()


def test_json_has_the_shares_of_what_relaxes():
    given = relaxed("yeoh", times_s=(10.0,), shares=(0.2,))
    card, elastic = (json.loads(PROGRAMS["json"](each)) for each in (given, data("yeoh")))
    assert card["energy"] == elastic["energy"]
    assert card["settings"]["relaxation_times_s"] == [10.0]
    assert card["parameters"]["relaxed_10s"]["value"] == 0.2


def test_json_has_the_formula_alone():
    energy = json.loads(PROGRAMS["json"](data("ogden")))["energy"]
    assert energy == "Ψ = Σ_k c_k/m_k² (λ̃1^m_k + λ̃2^m_k + λ̃3^m_k − 3) + κ/2 (ln J)²"


def test_materials_of_several_regions_have_numbers_of_their_own():
    given = {region: data("yeoh", region=region, number=i) for i, region in enumerate(("fat", "muscle"), 1)}
    texts = {name: joined(name, {r: write(d) for r, d in given.items()}) for name, write in PROGRAMS.items()}
    febio_root = ET.fromstring(f"<Material>{texts['febio']}</Material>")
    assert [(m.attrib["id"], m.attrib["name"]) for m in febio_root] == [("1", "fat"), ("2", "muscle")]
    lines = texts["ansys"].splitlines()
    assert [line for line in lines if line.startswith("MP,")] == ["MP,DENS,1,1e-09", "MP,DENS,2,1e-09"]
    assert [line for line in lines if line.startswith("TB,")] == [
        "TB,HYPER,1,1,3,YEOH",
        "TB,HYPER,2,1,3,YEOH",
    ]
    assert [card["region"] for card in json.loads(texts["json"]).values()] == ["fat", "muscle"]
    assert texts["abaqus"].count("not fitted: density 1e-09 t/mm3, as of water") == 2


def test_the_interval_is_that_of_the_spot_whose_value_it_is(space):
    (region,) = space.regions
    ends = {"soft_tissue.stiffness@p1": 0.3, "soft_tissue.stiffness@p2": 0.7, "soft_tissue.grip": 19.9}
    every = [
        Headline(parameter=name, name=name, unit="", value=lower, lower=lower, upper=lower + 0.2, level=0.95)
        for name, lower in ends.items()
    ]
    known = _counting_at("p1", {}, every)
    searched = {name: known.get(full) for name, full in region.full_names.items()}
    assert _intervals(region, np.array([0.4, 20.0]), searched) == {
        "stiffness": pytest.approx((0.3, 0.5)),
        "grip": pytest.approx((19.9, 20.1)),
    }
    of_sweep = {name: each and replace(each, level=None) for name, each in searched.items()}
    assert _intervals(region, np.array([0.4, 20.0]), of_sweep) == {}


def test_more_terms_than_three_are_a_reduced_polynomial():
    material = Yeoh(YeohSettings(terms=4))
    given = CardData(
        title="arm",
        region="r",
        material=material,
        theta=np.array([0.01, 0, 0, 0, 0.5]),
        intervals={},
        strain={},
        **origins_of(material),
    )
    assert "reduced polynomial, n=4" in PROGRAMS["abaqus"](given)


@pytest.mark.parametrize("name", CASES)
def test_the_declared_form_is_the_energy(name):
    material, theta = CASES[name]
    stretches = np.random.default_rng(4).uniform(0.6, 1.6, (50, 3))
    np.testing.assert_allclose(
        material.energy_form(np.array(theta)).energy(stretches),
        material.energy(stretches, np.array(theta)),
        rtol=1e-12,
        atol=1e-14,
    )


def test_values_by_spot_and_state_have_the_verdicts_of_their_spot():
    names = ("muscle.c1", "muscle.k1@rest", "muscle.k1@tense", "muscle.k2@p1", "muscle.k2@p2")
    every = [Headline(parameter=name, name=name, unit="", value=1.0) for name in names]
    known = _counting_at("p2", {"p1": "rest", "p2": "tense"}, every)
    assert {shared: each.name for shared, each in known.items()} == {
        "muscle.c1": "muscle.c1",
        "muscle.k1": "muscle.k1@tense",
        "muscle.k2": "muscle.k2@p2",
    }
