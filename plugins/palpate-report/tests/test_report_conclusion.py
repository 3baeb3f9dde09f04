"""The conclusion has the result and its warnings, and no warning without a cause."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from palpate.domain import Normaliser, Response, Scenario, Spot
from palpate.domain.thresholds import THRESHOLDS
from palpate.fit.least_squares import LeastSquares
from palpate.mesh.specimens import block
from palpate.plugins.score import Nmse, NmseSettings, ScoringRules
from palpate.plugins.sections import rounded
from palpate.run.result import UNSEEN, UNSETTLED
from palpate.scoring.selection import by_reason, failures, unranked
from palpate_report.answer import warnings
from palpate_report.answer.result import make_conclusion
from palpate_report.data.best import weighted_channels
from palpate_report.data.tables import cost_of_one_set, make_tables
from palpate_report.figures.style import STYLE
from palpate_report.settings import BY_ITSELF

from .fits import at_end_of_range, refused, with_tables


def conclusion(content):
    return make_conclusion(content, make_tables(content))


def distrusted(content):
    found = conclusion(content)
    assert not any(warning.is_note for warning in found.warnings)
    return {warning.what: warning.why for warning in (*found.notes, *found.warnings)}


def about(content, words):
    """Why of the one warning whose heading holds these words; None where there is none."""
    found = [why for what, why in distrusted(content).items() if words in what]
    assert len(found) < 2
    return found[0] if found else None


def test_the_best_of_each_spot_and_scenario_with_what_fits_as_well(content):
    made = content()
    found = conclusion(made)
    assert found.parameters == ("stiffness (MPa)", "grip (MPa)")
    assert [(b.spot, b.scenario, b.fitted_to) for b in found.bests[:2]] == [
        ("p1", "I", "force + torque"), ("p1", "II", "torque"),
    ]  # fmt: skip
    row = made.selection.row(0, named=True)
    best = found.bests[0]
    assert best.found == f"set {row['set_id']}"
    assert [v.value for v in best.values] == [row["soft_tissue.stiffness"], row["soft_tissue.grip"]]
    assert best.values[0].lower < 0.4 < best.values[0].upper
    assert found.bests[1].values[0].identifiability == "not"
    assert found.lead.startswith(
        f"One set for all 2 spots: set {made.generalisation['set_id'][0]}, stiffness = "
    )


def test_the_joint_fit_leads_and_those_of_spots_replace_the_sweeps_sets(content):
    made = content(assessed=False, search=LeastSquares())
    found = conclusion(made)
    assert [best.where for best in found.bests[2:5]] == [
        "all spots, scenario III", "p1, scenario I", "p1, scenario II",
    ]  # fmt: skip
    assert {best.found for best in found.bests} == {"fit"}
    joint, own = found.bests[0], found.bests[3]
    rows = made.fit.joint("I")
    assert (joint.fopt, joint.r2["torque"]) == (rows["fopt"].mean(), rows["r2_torque"].min())
    assert joint.values[0].value == rows["soft_tissue.stiffness"][0]
    assert own.values[0].value == made.fit.of_each_spot["soft_tissue.stiffness"][0]
    assert own.fopt < made.selection["fopt"][0]
    # Energy θ0 Σ(λ − 1)²: shear modulus θ0, bulk modulus 2 θ0 / 3.
    shear, young = (modulus.value for modulus in own.moduli)
    assert (shear, young) == pytest.approx((own.values[0].value, 2.0 * own.values[0].value))
    assert found.lead.startswith(
        f"One material for all 2 spots, fitted to force + torque (scenario I): "
        f"stiffness = {joint.values[0].text} MPa, grip = "
    )
    assert "initial shear modulus" in found.lead
    assert found.spent in found.sentences
    n_runs = made.fit.table.unique(["fit", "scenario"])["n_runs"].sum()
    assert found.spent == f"{made.n_simulations} simulations, of which {n_runs} by the fit."


def test_a_fit_of_some_spots_alone_stands_beside_sets_of_the_sweep(content):
    made = content(assessed=False, search=LeastSquares())
    table = made.fit.table
    reason = {"spot": None, "fopt": None, "message": "the start cannot be simulated"}
    gone = {name: pl.when(pl.col("fit") != "p1").then(pl.lit(value)).otherwise(pl.col(name)).alias(name)
            for name, value in reason.items()}  # fmt: skip
    part = replace(made, fit=replace(made.fit, table=table.with_columns(**gone)))
    found = conclusion(part)
    assert [best.found.partition(" ")[0] for best in found.bests] == ["fit"] * 3 + ["set"] * 3
    assert found.lead.startswith("One set for all 2 spots: set ")
    why = about(part, "2 of the fits have no result")
    assert why.startswith("all spots, scenario I: the start cannot be simulated; ")


def test_a_fit_that_ends_at_a_bound_or_is_not_settled_is_named(content):
    made = refused(content(search=LeastSquares()))

    def ended(**columns):
        table = made.fit.table.with_columns(**{name: pl.lit(value) for name, value in columns.items()})
        return replace(made, fit=replace(made.fit, table=table.with_columns(n_fine=2)))

    assert about(made, "end of their range") is None
    # The least Fopt may be at an end where the value of the interval, which is the one that is shown, is not.
    assert about(ended(at_bound="soft_tissue.grip"), "end of their range") is None
    at_grip = conclusion(at_end_of_range(made, "soft_tissue.grip")).bests[0]
    assert [value.at_bound for value in at_grip.values] == [False, True]
    at_bound = about(at_end_of_range(made, "soft_tissue.grip", "soft_tissue.stiffness"), "Best values are")
    assert at_bound.startswith("stiffness at all spots, scenario I; grip at all spots, scenario I. ")
    unsettled = ended(message=f"converged; {UNSETTLED}")
    assert about(unsettled, "has not settled").startswith("all spots, scenario I; p1, scenario I; ")
    assert about(unsettled, "Not every search") is None
    assert " by the fit and 18 on finer meshes." in conclusion(unsettled).spent
    unseen = ended(message=f"converged; {UNSEEN} depends on soft_tissue.grip")
    why = about(unseen, "that the curves do not decide")
    assert why.startswith("all spots, scenario I: no curve depends on soft_tissue.grip; ")
    assert about(unseen, "Not every search") is None


def test_with_one_spot_its_set_leads_and_nothing_is_generalised(content):
    made = content()
    one = pl.col("spot") == "p1"
    alone = replace(
        made,
        measured={"p1": made.measured["p1"]},
        selection=made.selection.filter(one),
        scores=made.scores.filter(one),
        tables=made.tables | {"identifiability": made.table("identifiability").filter(one)},
    )
    found = conclusion(alone)
    assert found.lead.startswith("At p1, fitted to force + torque (scenario I): stiffness = ")
    assert about(alone, "set for all spots") is None
    assert "cost_of_one_set" not in make_tables(alone)


def test_how_well_each_parameter_is_identified_is_a_sentence(content):
    made = content()
    worse = made.table("identifiability").with_columns(
        identifiability=pl.when(pl.col("spot") == "p2").then(pl.lit("not")).otherwise(pl.lit("well")),
        correlation=pl.lit(-0.97),
    )
    found = conclusion(with_tables(made, identifiability=worse)).identifiability
    together = made.table("identifiability").filter(spot="all spots").row(0, named=True)
    optimum = rounded(together["optimum"], together["lower"], together["upper"])
    assert found[0].startswith(f"stiffness: fitted optimum {optimum} MPa, ")
    assert "well identifiable by all spots together; spot by spot: " in found[0]
    assert "well identifiable at 1 of 2 spots, not identifiable at 1 of 2 spots" in found[0]
    assert "most correlated with grip (correlation -0.97, spot p1)" in found[0]
    unknown = conclusion(with_tables(made, identifiability=made.table("identifiability")[:0])).identifiability
    assert unknown[0] == "stiffness: nothing is known of how well it is identified."


def test_measured_data_without_a_spread_are_named(content):
    made = content()
    assert about(made, "No spread was measured") is None
    real = replace(made, study=replace(made.study, data="measured"))
    assert about(real, "No spread was measured")
    curves = {
        name: replace(curve, std=np.ones(curve.ordinate.size))
        for name, curve in made.measured["p1"].curves.items()
    }
    repeated = replace(real, measured=dict(real.measured) | {"p1": Response(curves=curves)})
    assert about(repeated, "No spread") is None


def test_warnings_about_the_measured_curves_are_named(content):
    made = content()
    assert about(made, "measured curves found something unusual") is None
    warned = {s: replace(r, record={"warnings": [f"p.csv: {s}: odd"]}) for s, r in made.measured.items()}
    assert (
        about(replace(made, measured=warned), "measured curves found something unusual")
        == "p.csv: p1: odd; p.csv: p2: odd."
    )


def test_warnings_about_the_meshes_are_named(content):
    made, limb = content(), block("hex8", width_mm=60.0, n_across=4, n_down=2)
    assert about(made, "meshes found something unusual") is None
    odd = replace(limb, spot=Spot(name="p1"), warnings=("the bone is free",))
    text = about(replace(made, limbs={"p1": odd}), "meshes found something unusual")
    assert "spot 'p1': the bone is free" in text


def test_a_poor_fit_is_named_with_its_channel(content):
    made = content()
    assert about(made, "poor") is None
    poor = replace(made, selection=made.selection.with_columns(r2_torque=pl.lit(0.5)))
    found = conclusion(poor)
    (warning,), (note,) = ([w for w in of if "poor" in w.what] for of in (found.warnings, found.notes))
    assert (warning.what, note.what) == ("2 fits are poor",) * 2
    assert "p1, scenario I: torque R² 0.500; p2, scenario I: torque R² 0.500" in warning.why
    assert "p1, scenario II: torque R² 0.500; p2, scenario II: torque R² 0.500" in note.why
    assert "within the stated errors" not in warning.why
    row = {
        "fit": "all spots",
        "scenario": "I",
        "check": "discrepancy",
        "channel": "torque",
        "verdict": "describes",
    }
    checks = pl.DataFrame([{**row, "difference": 0.211, "r2": 0.94, "explained_by": "friction"}])
    explained = replace(poor, fit=replace(poor.fit, adequacy=checks))
    text = about(explained, "fits are poor")
    assert (
        "The torque differs by 21 % of its peak, within the stated errors, mostly by friction; check" in text
    )


def test_a_best_value_at_the_end_of_its_range_is_named(content):
    made = content()
    stiffness = made.design.values[:, 0]

    def with_best(value, identifiability="well", lower=None):
        selection = made.selection.with_columns(
            pl.lit(value).alias("soft_tissue.stiffness"), pl.lit(20.0).alias("soft_tissue.grip")
        )
        found = made.table("identifiability").with_columns(
            identifiability=pl.lit(identifiability), lower=pl.lit(lower, pl.Float64), upper=pl.lit(0.9)
        )
        changed = replace(with_tables(made, identifiability=found), selection=selection)
        return about(changed, "end of their range")

    for end in (stiffness.min(), stiffness.max(), 0.1001, 0.1 + 0.9 / 40):
        assert "stiffness at p1, scenario I" in with_best(end)
        assert "stiffness at p1, scenario I" in with_best(end, lower=0.1)
        assert with_best(end, lower=0.3) is None  # the interval ends inside: it is a coincidence
        assert with_best(end, "not") is None  # nor does the range of an unidentifiable parameter matter
    assert with_best(0.5) is None


def test_a_best_set_outside_the_interval_of_the_optimum_is_named(content):
    made = content()
    inside = made.table("identifiability").with_columns(lower=pl.lit(0.1), upper=pl.lit(50.0))
    assert about(with_tables(made, identifiability=inside), "between the sampled sets") is None
    outside = inside.with_columns(
        lower=pl.when(pl.col("parameter") == "soft_tissue.stiffness").then(49.0).otherwise(0.1),
        optimum=pl.lit(49.5),
    )
    value = made.selection["soft_tissue.stiffness"][0]
    why = about(with_tables(made, identifiability=outside), "between the sampled sets")
    assert why.startswith(f"stiffness at p1: set {value:.4g}, optimum 49.5; stiffness at p2: ")
    assert best_of(made).values[0].optimum == pytest.approx(0.4, rel=1e-3)


def best_of(content):
    return conclusion(content).bests[0]


def test_a_set_that_does_not_fit_is_reported_first_instead_of_parameters(content):
    made = content()
    r2 = pl.when(pl.col("spot") == "p2").then(-567585.0).otherwise(pl.col("r2_torque"))
    wrong = replace(
        made,
        selection=made.selection.with_columns(r2_torque=r2),
        generalisation=made.generalisation.with_columns(r2_torque=r2),
    )
    found = conclusion(wrong)
    assert found.lead.startswith(
        "No parameters can be read from this run: the best set does not fit torque at p2"
    )
    assert found.sentences == (found.lead,)
    assert "stiffness" not in found.lead
    first = "1 best set does not fit. p2, scenario I: torque R² -5.68e+05."
    assert str(found.warnings[0]).startswith(first)
    one = pl.col("spot") == "p2"
    alone = replace(
        wrong,
        measured={"p2": made.measured["p2"]},
        selection=wrong.selection.filter(one),
        scores=made.scores.filter(one),
        tables=made.tables | {"identifiability": made.table("identifiability").filter(one)},
    )
    assert conclusion(alone).lead.startswith("No parameters can be read")


def test_weights_that_are_not_1_are_shown_with_their_channels():
    assert weighted_channels(Scenario(name="a", weights={"force": 1.0, "torque": 1.0})) == "force + torque"
    mixed = Scenario(name="a", weights={"force": 0.7, "torque": 0.3, "slide": 0.0})
    assert weighted_channels(mixed) == "0.7 × force + 0.3 × torque"


def test_what_is_not_identifiable_or_unclear_and_spots_that_disagree_are_named(content):
    made = content()
    first = pl.col("spot") == "p1"
    apart = made.table("identifiability").with_columns(
        lower=pl.when(first).then(0.1).otherwise(0.4),
        upper=pl.when(first).then(0.3).otherwise(0.9),
        identifiability=pl.when(first).then(pl.lit("not")).otherwise(pl.lit("unclear")),
    )
    made = with_tables(made, identifiability=apart)
    assert about(made, "unclear")
    not_seen = made.table("identifiability").with_columns(identifiability=pl.lit("not"))
    assert about(with_tables(made, identifiability=not_seen), "Not identified: stiffness, grip")
    assert "stiffness at p1 and p2 have intervals that do not meet" in about(made, "spots disagree")


def test_the_price_of_one_set_is_the_ratio_to_the_least(content):
    made = content()
    costs = cost_of_one_set(made)
    own = made.selection.filter(scenario="I")["fopt"]
    assert costs["times"].to_list() == (made.generalisation["fopt"] / own).to_list()
    assert (costs["times"] >= 1.0).all()
    cheap = made.generalisation.with_columns(fopt=100.0 * own)
    assert "p1 (100 times); p2 (100 times)" in about(replace(made, generalisation=cheap), "fits some spots")
    assert about(replace(made, generalisation=made.generalisation[:0]), "No set for all spots")


def test_few_sets_and_many_failures_are_named_by_reason(content):
    thin = content(n_sets=12)
    assert about(thin, "thin sweep: 12 sets for 2 parameters")
    made = content()
    assert about(made, "thin") is None
    failed = made.scores.with_columns(
        nmse=pl.when(pl.col("set_id") < 10).then(None).otherwise(pl.col("nmse")),
        status=pl.when(pl.col("set_id") < 10).then(pl.lit("diverged")).otherwise(pl.col("status")),
        message=pl.format("no balance at step {}", pl.col("set_id")),
    )
    reasons = by_reason(failures(unranked(failed)))
    assert reasons.select("status", "reason", "n").rows() == [("diverged", "no balance at step …", 20)]
    why = about(replace(made, scores=failed), "20 of 80 simulations could not be ranked")
    assert "no balance at step …" in why
    assert "narrow the ranges" in why


def test_searches_conventions_and_unfinished_sets_are_named(content):
    made = content(search=LeastSquares())
    region = replace(made.study.space.regions[0], convention="febio4")
    study = replace(
        made.study,
        scoring=ScoringRules(score=Nmse(NmseSettings(normaliser=Normaliser.MEAN))),
        space=replace(made.study.space, regions=(region,)),
    )
    table = made.fit.table.with_columns(message=pl.lit("stopped after 40 steps"))
    doubtful = replace(
        made, study=study, fit=replace(made.fit, table=table),
        selection=made.selection.with_columns(partial=pl.lit(True)),
    )  # fmt: skip
    assert about(doubtful, "Not every search") == "stopped after 40 steps."
    assert "close to zero" in about(doubtful, "mean of the measured")
    assert about(doubtful, "convention 'febio4'")
    unfinished = replace(doubtful, fit=replace(made.fit, table=table[:0]))
    assert "p1, scenario I" in about(unfinished, "did not finish")
    assert about(made, "did not finish") is None


@pytest.mark.parametrize("passed", [True, False])
def test_a_proof_that_failed_is_named(content, passed):
    verification = pl.DataFrame(
        {"spot": ["p1"], "set_id": [3], "passed": [passed], "message": ["x"], "key": ["k"]}
    )
    assert (about(replace(content(), verification=verification), "verification") is None) is passed


def test_the_guide_has_the_limits_that_are_applied():
    guide = (Path(__file__).parents[3] / "docs" / "report.md").read_text(encoding="utf-8")
    for wording in (
        f"R² below {THRESHOLDS.good_r2:g}", f"R² below {THRESHOLDS.no_fit_r2:g}",
        f"fewer than {warnings.FEW_SETS} sets per parameter",
        f"more than 1 in {1 / warnings.FAILED_SHARE:g}",
        f"{BY_ITSELF.single_column:g} mm wide for one column or {BY_ITSELF.double_column:g} mm for two",
        f"({STYLE['figure.dpi']} dpi)",
    ):  # fmt: skip
        assert wording in guide
    assert warnings.COSTLY == 3.0
    assert "Fopt there is three times the minimum, or more" in guide


@pytest.mark.parametrize("search", [None, LeastSquares()])
def test_identifiability_that_was_not_assessed_names_the_commands(content, search):
    made = content(assessed=False, **({} if search is None else {"search": search}))
    made = replace(with_tables(made, identifiability=made.table("identifiability").clear()), unfinished="")
    why = about(made, "not been assessed")
    assert "`palpate identifiability`" in why
    assert ("`palpate intervals`" in why) is (search is not None)
    assert {each.identifiability for best in conclusion(made).bests for each in best.values} == {"unclear"}
    assert about(replace(made, unfinished="3 of 9"), "not been assessed") is None


def test_intervals_without_what_the_sweep_allows_name_its_command(content):
    made = content(search=LeastSquares())
    made = with_tables(made, identifiability=made.table("identifiability").clear())
    assert about(made, "Identifiability by the sweep has not been assessed").startswith(
        "Run `palpate identifiability`"
    )


@pytest.mark.parametrize("outside", [(), ("grip",), ("stiffness", "grip")])
def test_an_interval_that_misses_the_truth_is_a_warning_with_its_unit(content, outside):
    made = described(content(search=LeastSquares()))
    rows = made.fit.intervals.filter(fit="all spots", scenario="I")
    truth = {
        row["parameter"]: row["upper"] + (row["upper"] - row["value"]) * (1 if name in outside else -0.5)
        for row in rows.to_dicts()
        for name in (row["parameter"].rpartition(".")[2],)
    }
    found = conclusion(replace(made, study=replace(made.study, truth=truth)))
    assert found.known == ("" if outside else "every interval holds the true value")
    missed = [warning for warning in found.warnings if "true value" in warning.what]
    assert len(missed) == bool(outside)
    for name in outside:
        (value,) = (each for each in found.estimates if each.parameter == name)
        at = truth[f"soft_tissue.{name}"]
        shown = f"{name}: true {rounded(at, value.lower, value.upper)} MPa, interval {value.interval} MPa"
        assert shown in missed[0].what
        assert shown in found.lines(made.study)["Warnings"]
    assert ("True values" in found.lines(made.study)) == (not outside)
    assert found.warnings[:1] == tuple(missed[:1]) or not outside


def test_without_a_known_answer_nothing_is_said_of_it(content):
    made = described(content(search=LeastSquares()))
    assert conclusion(made).known == ""
    assert about(made, "true value") is None
    half = replace(made, study=replace(made.study, truth={"soft_tissue.grip": 1e9}))
    assert about(half, "misses the true value (grip: true ")


def described(made):
    """The data of a fit whose model describes them."""
    checks = made.fit.adequacy.with_columns(verdict=pl.lit("describes"))
    return with_tables(made, adequacy=checks)


def test_what_other_scenarios_have_is_a_note(content):
    made = content(search=LeastSquares())
    checks = made.fit.adequacy.with_columns(
        verdict=pl.when(scenario="II").then(pl.lit("does not describe")).otherwise(pl.lit("describes")),
        message=pl.lit("bad"),
    )
    found = conclusion(with_tables(made, adequacy=checks))
    assert not found.failure
    of_model, model = (
        [w for w in of if w.what == "The model does not describe the data"]
        for of in (found.warnings, found.notes)
    )
    assert model
    assert of_model == []
    assert "scenario II: bad" in model[0].why
    assert not any("scenario II" in str(warning) for warning in found.warnings)
