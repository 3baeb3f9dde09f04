"""Laws fitted to the curves of one study: their ranges, their studies, and the sentence on the best."""

import json
import shutil
from importlib.resources import files
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given, strategies as st
from scipy.optimize import least_squares

from palpate.api import StudyError
from palpate.api.fit import Adequacy
from palpate.api.mechanics import initial_moduli
from palpate.api.runs import Plugins, read_study
from palpate.cli.app import main
from palpate_materials import Gent, MooneyRivlin, NeoHookean, Yeoh
from palpate_report.answer.law import law_name
from palpate_report.comparison import TOO_FEW
from palpate_report.law_comparison import FITTED, conclusion
from palpate_report.law_studies import (
    WRITTEN,
    Stiffness,
    largest_invariant,
    laws_of,
    ranges,
    region_of,
    write_law_study,
)

TRELOAR = Path(str(files("palpate_materials") / "studies" / "treloar"))
PLUGINS = Plugins.load()
RUBBER = Stiffness(shear_MPa=0.37, bulk_MPa=1000.0, invariant=55.0)


@pytest.fixture
def rubber(tmp_path):
    """Copy of a ready study of homogeneous tests."""
    shutil.copytree(TRELOAR, tmp_path / "rubber")
    return tmp_path / "rubber"


# ------------------------------------------------------------------------------ words


def test_all_names_every_isotropic_law_and_each_number_of_terms():
    names = [law.name for law in laws_of("all", PLUGINS)]
    assert {"gent", "arruda_boyce", "neo_hookean", "demiray", *(f"ogden-{n}" for n in range(1, 5))} <= set(
        names
    )
    assert "holzapfel_gasser_ogden" not in names
    assert len(set(names)) == len(names)


def test_a_number_of_terms_is_taken_literally():
    (law,) = laws_of("ogden-2", PLUGINS)
    assert law.settings == {"terms": 2}
    assert len(law.material.parameters) == 5


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ("hooke", "is unknown"),
        ("holzapfel_gasser_ogden", "has directions"),
        ("gent-2", "has no number of terms"),
        (" , ", "names no law"),
    ],
)
def test_a_word_that_is_no_law_is_refused(words, why):
    with pytest.raises(StudyError, match=why):
        laws_of(words, PLUGINS)


# ----------------------------------------------------------------------------- ranges


@given(
    shear=st.floats(1e-4, 10.0),
    ratio=st.floats(5.0, 1e4),
    invariant=st.one_of(st.just(0.0), st.floats(0.05, 80.0)),
    word=st.sampled_from([law.name for law in laws_of("all", PLUGINS)]),
)
def test_ranges_hold_a_material_as_stiff_as_the_measured_one(shear, ratio, invariant, word):
    """With every modulus at its lower end a law is softer, at its upper end stiffer, than what was found."""
    known = Stiffness(shear_MPa=shear, bulk_MPa=ratio * shear, invariant=invariant)
    (law,) = laws_of(word, PLUGINS)
    found = list(ranges(law.material, known))
    assert [p.name for p, _ in found] == [p.name for p in law.material.parameters]
    assert [p.name for p, value in found if value is not None] in (["kappa"], ["nu"])
    ends = [
        initial_moduli(law.material, np.array([_end(p, value, k) for p, value in found]))[0] for k in (0, 1)
    ]
    assert ends[0] < shear < ends[1]


def _end(p, value, k):
    """Value at an end of the range of a positive modulus; of others the middle, of further terms zero."""
    if value is not None:
        return value
    if p.kind == "shape":
        return 0.5 * (p.lower + p.upper)
    return (p.lower, p.upper)[k] if p.lower >= 0.0 else 0.0


def test_what_changes_the_volume_alone_keeps_the_bulk_modulus():
    for material in (Gent(), NeoHookean(), MooneyRivlin()):
        middle = {"mu": 0.37, "Jm": 90.0, "E": 1.11, "c10": 0.1, "c01": 0.085}
        theta = [middle.get(p.name) if v is None else v for p, v in ranges(material, RUBBER)]
        assert initial_moduli(material, np.array(theta))[1] == pytest.approx(1000.0, rel=0.01)


@given(st.floats(0.01, 60.0))
def test_gents_limit_begins_above_the_largest_measured_invariant(invariant):
    known = Stiffness(shear_MPa=0.37, bulk_MPa=1000.0, invariant=invariant)
    limit = next(p for p, _ in ranges(Gent(), known) if p.name == "Jm")
    assert limit.lower > invariant


def test_the_largest_invariant_is_the_largest_of_all_modes():
    found = largest_invariant({"uniaxial": [1.0, 7.6], "equibiaxial": [1.0, 4.45], "torque": [9.0]})
    assert found == pytest.approx(7.6**2 + 2 / 7.6 - 3.0)


def test_presses_scale_the_moduli_by_the_initial_shear_modulus():
    known = Stiffness(shear_MPa=0.028, bulk_MPa=0.56, invariant=0.0)
    double = Stiffness(shear_MPa=0.056, bulk_MPa=0.56, invariant=0.0)
    for (one, _), (other, _) in zip(ranges(Yeoh(), known), ranges(Yeoh(), double), strict=True):
        if one.name != "kappa":
            assert (other.lower, other.upper) == pytest.approx((2.0 * one.lower, 2.0 * one.upper))


# ---------------------------------------------------------------------------- studies


@pytest.mark.parametrize("word", ["gent", "ogden-3", "neo_hookean", "yeoh-2"])
def test_the_study_of_a_law_is_a_study_of_the_same_curves(rubber, word):
    base = read_study(rubber / "study.toml", PLUGINS)
    (law,) = laws_of(word, PLUGINS)
    region = region_of(base, None)
    study = read_study(write_law_study(base, region, law, RUBBER), PLUGINS)
    assert study.name == f"treloar-{word}"
    assert [spot.measured for spot in study.spots] == [spot.measured for spot in base.spots]
    assert study.generalising.weighed == base.generalising.weighed
    (found,) = study.space.regions
    assert found.material == law.material
    expected = [p for p, value in ranges(law.material, RUBBER) if value is None]
    assert [(p.name, p.scale) for p in found.searched] == [(p.name, p.scale) for p in expected]
    for p, q in zip(found.searched, expected, strict=True):
        assert (p.lower, p.upper) == pytest.approx((q.lower, q.upper), rel=1e-5)


def test_a_file_of_the_user_is_not_replaced(rubber):
    base = read_study(rubber / "study.toml", PLUGINS)
    (law,) = laws_of("gent", PLUGINS)
    (rubber / "study-gent.toml").write_text("# mine\n")
    with pytest.raises(StudyError, match="has not written"):
        write_law_study(base, region_of(base, None), law, RUBBER)
    (rubber / "study-gent.toml").write_text(f"{WRITTEN}\nold")
    assert "gent" in write_law_study(base, region_of(base, None), law, RUBBER).read_text()


def test_a_region_that_is_not_searched_is_refused(rubber):
    base = read_study(rubber / "study.toml", PLUGINS)
    with pytest.raises(StudyError, match="'bone' is not searched"):
        region_of(base, "bone")


@pytest.mark.parametrize(
    ("word", "name"), [("arruda_boyce", "Arruda-Boyce"), ("neo_hookean", "neo-Hookean"), ("ogden-2", "Ogden")]
)
def test_texts_have_the_names_of_the_textbook(word, name):
    (law,) = laws_of(word, PLUGINS)
    assert law_name(law.material) == name
    assert law.title == name + (" (2 terms)" if name == "Ogden" else "")


def test_homogeneous_tests_of_a_law_start_no_worker(rubber):
    base = read_study(rubber / "study.toml", PLUGINS)
    (law,) = laws_of("gent", PLUGINS)
    study = read_study(write_law_study(base, region_of(base, None), law, RUBBER), PLUGINS)
    assert study.executor.name == "in_process"


# --------------------------------------------------------------------------- sentence


def row(law, difference, held_out, *, meaning="", verdict=Adequacy.DESCRIBES, status=FITTED):
    return {
        "law": law,
        "difference_aicc": difference,
        "held_out": held_out,
        "meaning": meaning,
        "model": str(verdict),
        "status": status,
    }


@pytest.mark.parametrize(
    ("rows", "text"),
    [
        (
            [row("yeoh", 0.0, 0.03), row("gent", 12.0, 0.05)],
            "yeoh describes these curves best: AICc 12 lower than gent, held-out error 3 %.",
        ),
        (
            [row("yeoh", 0.0, 0.03, verdict=Adequacy.APPROXIMATES), row("gent", 12.0, 0.05)],
            "yeoh approximates these curves best: AICc 12 lower than gent, held-out error 3 %.",
        ),
        (
            [row("yeoh", 0.0, 0.03, verdict=Adequacy.FAILS), row("gent", 12.0, 0.05)],
            "yeoh comes closest to these curves: AICc 12 lower than gent, held-out error 3 %. "
            "Even yeoh does not describe the curves.",
        ),
        (
            [row("yeoh", 0.0, 0.05), row("gent", 1.0, 0.03)],
            "yeoh and gent are equally good for these curves by AICc, held-out error 5 %. "
            "gent predicts held-out curves best, to 3 %.",
        ),
        (
            [row("yeoh", 0.0, 0.05, meaning=TOO_FEW), row("gent", 1.0, 0.03, meaning=TOO_FEW)],
            "gent predicts held-out curves best; the curves have too few independent points for AICc, "
            "held-out error 3 %.",
        ),
        (
            [row("ogden-3", -3.0, 0.1, meaning=TOO_FEW), row("gent", 0.0, 0.03), row("yeoh", 4.0, 0.05)],
            "gent describes these curves best: AICc 4 lower than yeoh, held-out error 3 %. "
            "ogden-3 would have a lower AICc, with too few independent points for so many parameters.",
        ),
        (
            [row("yeoh", None, None), row("gent", None, None)],
            "No law can be chosen: the curves have too few independent points, and none can be held out.",
        ),
        (
            [
                row("gent", 0.0, 0.03, verdict=Adequacy.FAILS),
                row("ogden-2", None, None, status="solver failed"),
            ],
            "gent is the only law that could be fitted, held-out error 3 %. "
            "Even gent does not describe the curves.",
        ),
    ],
)
def test_the_last_sentence_names_the_best_law(rows, text):
    assert conclusion(pl.DataFrame(rows, infer_schema_length=None)) == text


# ----------------------------------------------------------------------- whole command


def test_one_study_is_compared_at_a_time(rubber, capsys):
    assert main(["compare", str(rubber), str(rubber), "--materials", "gent"]) == 2
    assert "compares laws of one study" in capsys.readouterr().err


def ogden_by_scipy(rubber):
    """Least squares of the nominal stresses of Ogden's three terms, from the values of 1972."""
    stretches = {
        "UT": lambda t: (t, t**-0.5),
        "ET": lambda t: (t, t**-2.0),
        "PS": lambda t: (t, t**-1.0),
    }
    measured = {
        name: np.loadtxt(rubber / "measured" / f"{name}.csv", delimiter=",", skiprows=1, usecols=(0, 1))
        for name in stretches
    }

    def misfit(theta):
        parts = []
        for name, table in measured.items():
            long, thin = stretches[name](table[:, 0])
            stress = sum(
                c / m * (long**m - thin**m) / long for c, m in zip(theta[::2], theta[1::2], strict=True)
            )
            parts.append(stress - table[:, 1])
        return np.concatenate(parts)

    start = np.array([0.63 * 1.3, 1.3, 0.0012 * 5.0, 5.0, 0.01 * 2.0, -2.0])
    return least_squares(misfit, start, x_scale=np.abs(start), xtol=1e-14, ftol=1e-14, max_nfev=5000)


@pytest.mark.slow
def test_treloars_rubber_by_three_laws(rubber, capsys, monkeypatch):
    """Gent and Arruda-Boyce as least squares has them, the latter with n k T = 0.27 MPa of their paper."""
    monkeypatch.chdir(rubber.parent)
    text = (rubber / "study.toml").read_text().replace("n_sets = 250", "n_sets = 24")
    (rubber / "study.toml").write_text(text)
    named = "yeoh-3,gent,arruda_boyce,ogden-3,ogden-6,mooney_rivlin"
    command = ["compare", "rubber", "--materials", named, "--json"]
    assert main(command) == 0
    found = json.loads(capsys.readouterr().out)
    laws = {each["law"]: each for each in found["tables"]["laws"]}
    assert laws.keys() == {law.title for law in laws_of(named, PLUGINS)}
    assert (
        laws.pop("Ogden (6 terms)")["status"]
        == "left out: 12 parameters need 60 points, and the curves have 53"
    )
    # Nothing is wrong with the curves where another law describes them.
    assert laws.pop("Mooney-Rivlin")["model"] == str(Adequacy.FAILS)
    assert any(note.endswith("not describe the curves: Mooney-Rivlin.") for note in found["notes"])
    assert not any("units" in note for note in found["notes"])
    tables = {file.stem: file.read_text() for file in Path("comparison/tables").glob("*.tex")}
    assert all(text.startswith("% WARNING: ") for text in tables.values())
    assert tables["parameters"].startswith("% WARNING: No parameters can be read from laws")
    # Its least squares ends at c01 = 0, which is neo-Hookean, and that is what is reported.
    neo = pl.read_parquet("runs/treloar-mooney_rivlin/answer.parquet").filter("reported")
    assert neo.filter(parameter="specimen.c10")["value"][0] == pytest.approx(0.26393, rel=1e-4)
    assert all(each["model"] and 0.0 < each["held_out"] < 0.15 for each in laws.values())
    fits = {name: Path("runs", f"treloar-{name}") for name in ("gent", "arruda_boyce", "ogden-3")}
    least = {name: pl.read_parquet(run / "fit.parquet").row(0, named=True) for name, run in fits.items()}
    assert least["gent"]["specimen.mu"] == pytest.approx(0.27448, rel=1e-3)
    assert least["gent"]["specimen.Jm"] == pytest.approx(84.3046, rel=1e-3)
    assert least["arruda_boyce"]["specimen.mu"] == pytest.approx(0.27, rel=0.03)
    assert least["arruda_boyce"]["specimen.N"] == pytest.approx(21.404, rel=1e-3)
    expected = ogden_by_scipy(rubber)
    assert least["ogden-3"]["fopt"] == pytest.approx(2.0 * expected.cost, rel=1e-3)
    exponents = sorted(least["ogden-3"][f"specimen.m{k}"] for k in (1, 2, 3))
    assert exponents == pytest.approx(sorted(expected.x[1::2]), rel=2e-2)
    assert found["notes"][0] in Path("comparison/index.html").read_text().replace("&#x27;", "'")
