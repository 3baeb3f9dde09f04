"""Coverage where spots differ, and where the law is another one than the tissue's.

``--spots``: worlds of Ogden's law at five spots, over tissue of four depths, whose searched values differ by
10 % (standard deviation) between the spots. Counted is how often the interval of the mean holds the value
that the spots are drawn around.

``--laws``: worlds of one law, fitted with another by two presses over tissue of other depths. Many laws can
be fitted to curves of another one to within the stated errors, which no test sees. So worlds are drawn until
so many count: those whose misfit, the best fit less the true curves, the most powerful test of 1 % would see
in 99 of 100 cases, with values of each spot's own where the run finds that spots differ. Counted are the
verdicts, and how often the curves of the second press are inside of the 90 % bands that the first predicts,
where the run has an answer. Both curves of a right model are inside in 81 to 90 %. Two presses at other
spots, which no fit has seen, are predicted as ``palpate predict`` does: counted are points inside of the 90 %
bands of the draws alone, and of those with the model error.

``--tied``: worlds of Ogden's law (m1 from 2 to 9), Yeoh's or the neo-Hookean, at constant volume, fitted by
Yeoh's c1 alone, with c2, c3 and κ tied to it as ``palpate init`` writes them. Counted is how often the
interval of c1 holds half of the initial shear modulus, for some errors of the ties.

All by the closed form and the errors of ``bench_coverage.py``. With ``--tuned`` only even seeds count, which
choices may be made on; else the odd ones.

    python benchmarks/bench_laws.py --spots 200 --laws 20 --tied 24
"""

import argparse
from collections import Counter
from dataclasses import dataclass, replace
from itertools import count, cycle, permutations

import numpy as np
from bench_coverage import (
    MESH,
    MESHES,
    NOISE,
    RATIO,
    Layered,
    LayeredSettings,
    experiment,
    measured_at,
    pressed,
    say,
    stage_of,
    study_of,
)
from bench_wrong import TISSUE_MM, Places
from scipy.stats import norm

from palpate import Job, Response
from palpate.answer.words import Adequacy
from palpate.domain import ParameterSpace, RegionMaterial
from palpate.domain.parameters import Tie
from palpate_certainty.assessment import Assessment
from palpate_certainty.assumptions import ASSUMED
from palpate_certainty.held_out import held_out
from palpate_certainty.tables import certainty_tables
from palpate_materials.uncoupled import Ogden, Yeoh
from palpate_prediction.bands import ends, linear, with_model_error

BETWEEN = 0.1
"""Standard deviation between spots, of the logarithms."""
SPOTS = ("p1", "p2", "p3", "p4", "p5")
FITTED, NEW = ("p2", "p4"), ("p1", "p3")
LAWS = ("ogden", "yeoh", "neo-Hookean")


class Spots(Places):
    """A fifth spot is as deep as the first."""

    name = "spots"

    def _slope(self, job, thetas, depth, rotation):
        named = job if job.spot in TISSUE_MM else replace(job, spot="p1")
        return super()._slope(named, thetas, depth, rotation)


def differing(study, row, rng, *, spot, shared):
    """Curves of a spot with values of its own."""
    own = row * np.exp(BETWEEN * rng.normal(size=row.size))
    box = np.array([(p.physical_lower, p.physical_upper) for p in study.space.parameters])
    return measured_at(study, np.clip(own, *box.T), rng, spot=spot, shared=shared, true=Spots)


def of_spots(seeds) -> None:
    names = [p.name for p in study_of("ogden", Spots(LayeredSettings())).space.parameters]
    held = [
        experiment("ogden", seed, measure=differing, solver=Spots, spots=SPOTS, predicts=False)["all"][:-1]
        for seed in seeds
    ]
    shares = 100.0 * np.nanmean(held, axis=0)
    counted = np.isfinite(held).sum(axis=0)
    each = zip(names, shares, counted, strict=True)
    say("mean of five spots: " + ", ".join(f"{name} {share:.0f} % of {n}" for name, share, n in each))
    say(f"together: {100.0 * np.nanmean(held):.1f} % of {counted.sum()}")


@dataclass(frozen=True, kw_only=True)
class World:
    """A law fitted to a world of another one: its misfit in standard deviations, and what is said of it.

    Where the run gives each spot values of its own, differences between spots explain a part of the misfit;
    ``by_one`` is the misfit of one value for all.
    """

    visible: float
    by_one: float
    verdict: Adequacy
    inside: list[bool]
    new: np.ndarray
    """Share of the points of each new curve (n, 2) inside of the band without and with the model error."""


def new_presses(assessed, tissue, study, row) -> np.ndarray:
    """Share of the points of each new curve (n, 2) that bands hold without the model error, and with."""
    tables, space = certainty_tables([assessed], study), study.space
    values = dict(zip(space.names, assessed.values.tolist(), strict=True))
    draws = tables["draws"] if tables["spot_draws"].is_empty() else tables["spot_draws"]
    drawn = [space.thetas(np.array([each[n] for n in space.names])) for each in draws.to_dicts()]
    errors, exact = tables["model_errors"], Spots(LayeredSettings())
    best, shares = space.thetas(np.array([values[name] for name in space.names])), []
    for spot in NEW:
        made = [
            exact.simulate(
                Job(
                    spot=spot,
                    set_id=0,
                    materials={r.region: r.material for r in of.space.regions},
                    thetas=thetas,
                    protocol=study.protocol,
                    slopes=True,
                ),
                None,
            ).response
            for of, thetas in ((tissue, tissue.space.thetas(row)), (study, best))
        ]
        for name, curve in made[1].curves.items():
            alone = linear(curve, best, drawn, space)
            true = made[0][name].ordinate[1:]
            bands = [ends(lines) for lines in (alone, with_model_error(alone, curve, errors))]
            shares.append([np.mean((low[1:] <= true) & (true <= high[1:])) for low, high in bands])
    return np.array(shares)


def another_law(true: str, fitted: str, seed: int) -> World:
    """Verdict on the fitted law, and whether the curves of each press are inside of their bands."""
    rng, spots = np.random.default_rng(seed), FITTED
    coarse = MESH * rng.normal()
    solver = Spots(LayeredSettings(coarse=coarse, fine=coarse / RATIO))
    tissue, study = study_of(true, solver, spots), study_of(fitted, solver, spots)
    (row,) = pressed.truths(tissue, 1, seed)
    measured = {
        spot: measured_at(tissue, row, rng, spot=spot, shared=np.random.default_rng(1000 + seed), true=Spots)
        for spot in spots
    }
    case, *others = stage_of(study, measured).run()
    certainty = Assessment(study=study, measured=measured, meshes=dict.fromkeys(spots, MESHES))
    assessed = certainty.assess(case, *certainty.columns(case), cases=others)
    table, missed = held_out(assessed), misfit(tissue, study, row, measured)
    fitted_to = assessed.linear if assessed.errors.between is None else assessed.linear.by_spot
    return World(
        visible=in_deviations(fitted_to, missed),
        by_one=in_deviations(assessed.linear, missed),
        verdict=assessed.verdict,
        inside=[bool(table.filter(spot=spot)["inside"].all()) for spot in spots],
        new=new_presses(assessed, tissue, study, row),
    )


def misfit(tissue, study, row, measured) -> np.ndarray:
    """Residuals of the best fit to curves without any error."""
    exact = Spots(LayeredSettings())
    materials = {r.region: r.material for r in tissue.space.regions}
    curves = {}
    for spot, response in measured.items():
        job = Job(
            spot=spot,
            set_id=0,
            materials=materials,
            thetas=tissue.space.thetas(row),
            protocol=tissue.protocol,
        )
        true = exact.simulate(job, None).response
        curves[spot] = Response(
            curves={
                name: replace(
                    curve,
                    ordinate=np.interp(curve.abscissa, true[name].abscissa, true[name].ordinate)
                    if name == "force"
                    else true[name].ordinate,
                )
                for name, curve in response.curves.items()
            }
        )
    return stage_of(replace(study, solver=exact), curves).run()[0].end.at_end().residuals


def in_deviations(linear, residuals: np.ndarray) -> float:
    """Length of a misfit in standard deviations of the stated errors, where no parameter explains it."""
    parts = [
        NOISE**2 * linear.rows.noise(channel, 0.0)
        + linear.expected[channel] ** 2 * linear.rows.discrepancy(channel, ASSUMED.law_length)
        for channel in linear.rows.channels
    ]
    covariance = linear.stated @ linear.stated.T + sum(parts)
    free = linear.free
    missed = free.T @ (linear.groups @ residuals)
    return float(np.sqrt(missed @ np.linalg.solve(free.T @ covariance @ free, missed)))


VISIBLE = float(norm.isf(0.01) - norm.isf(0.99))
"""Length of a misfit whose shape is known, that a test of 1 % sees in 99 of 100 cases."""


def of_laws(n: int, seeds) -> None:
    pairs, found, drawn = list(permutations(LAWS, 2)), [], []
    for pair, seed in zip(cycle(pairs), seeds, strict=False):
        drawn.append(another_law(*pair, seed))
        if drawn[-1].visible >= VISIBLE:
            found.append((pair, drawn[-1]))
        if len(found) == n:
            break
    say(f"{n} of {len(drawn)} worlds count: a misfit of {VISIBLE:.1f} standard deviations or more")
    say(f"verdicts: {dict(Counter(str(world.verdict) for _, world in found))}")
    others = [world for world in drawn if world.by_one >= VISIBLE > world.visible]
    counts = dict(Counter(str(world.verdict) for world in others))
    say(f"besides, {len(others)} worlds that would count by one value for both spots: {counts}")
    for text, worlds in (("of these", [world for _, world in found]), ("of all", drawn)):
        answered = [world for world in worlds if world.verdict is not Adequacy.FAILS]
        inside = sum(world.inside[1] for world in answered)
        say(f"second press inside of its bands, {text}: {inside} of {len(answered)} with an answer")
        for verdict in (Adequacy.DESCRIBES, Adequacy.APPROXIMATES):
            new = np.concatenate([np.empty((0, 2)), *(w.new for w in worlds if w.verdict is verdict)])
            if not len(new):
                continue
            points, curves = 100.0 * new.mean(axis=0), 100.0 * np.mean(new >= 0.9, axis=0)
            shares = f"points inside {points.round()} %, 90 % of the points of {curves.round()} %"
            say(f"  {verdict}: {len(new)} new curves, {shares}")
    for pair in pairs:
        texts = [f"{w.visible:.0f}: {w.verdict}, {w.inside}" for of, w in found if of == pair]
        say(f"{' by '.join(pair)}: {'; '.join(texts)}")


TIES = {"c2": -0.08, "c3": 0.009333, "kappa": 53.33}
"""Factors of Yeoh's c1, as ``palpate init`` writes them."""
TIE_ERRORS = (0.1, 0.3, 0.5, 0.9)


class Isochoric(Layered):
    """Strips that keep their volume, so that no bulk modulus counts."""

    name = "isochoric"

    def _slope(self, job, thetas, depth, rotation):
        (material,), (theta,) = job.materials.values(), thetas.values()
        lateral = np.exp(0.5 * pressed.COMPRESSED * depth[:, None])
        return pressed.energy(material, depth, rotation, theta, lateral=lateral).imag / pressed.STEP.imag


def of_law(material, fixed, ties, solver):
    """A study of measured data that searches c1 of a law."""
    c1 = replace(material.parameters[0], lower=1e-4, upper=0.3)
    tied = {name: Tie(source="tissue.c1", factor=factor) for name, factor in ties.items()}
    region = RegionMaterial(region="tissue", material=material, searched=(c1,), fixed=fixed, tied=tied)
    study = pressed.study_of(Ogden(), ("c1",), solver=solver)
    return replace(study, space=ParameterSpace(regions=(region,)), data="measured")


def tied_law(seed: int) -> dict[float, tuple[Adequacy, bool, float, float]]:
    """Verdict, whether the interval holds, its relative width and the error of c1, by the ties' error."""
    rng = np.random.default_rng(seed)
    coarse = MESH * rng.normal()
    solver = Isochoric(LayeredSettings(coarse=coarse, fine=coarse / RATIO))
    mu = np.exp(rng.uniform(np.log(0.004), np.log(0.03)))
    kind, bulk = rng.integers(3), {"kappa": 50.0 * mu}
    if kind == 2:
        tissue, row = of_law(Ogden(), {"m1": rng.uniform(2.0, 9.0)} | bulk, {}, solver), 2.0 * mu
    else:
        c2, c3 = (rng.uniform(-0.15, 0.1), rng.uniform(0.0, 0.03)) if kind else (0.0, 0.0)
        shape = {"c2": 0.5 * c2 * mu, "c3": 0.5 * c3 * mu}
        tissue, row = of_law(Yeoh(), shape | bulk, {}, solver), 0.5 * mu
    common = np.random.default_rng(1000 + seed)
    measured = {"p1": measured_at(tissue, np.array([row]), rng, shared=common, true=Isochoric)}
    found = {}
    for sd in TIE_ERRORS:
        study = of_law(Yeoh(), {}, TIES, solver)
        stated = {"parameters": {f"tissue.{name}": sd for name in TIES}, "friction": 0.1}
        study = replace(study, budget=study.budget.model_copy(update=stated))
        case, *others = stage_of(study, measured).run()
        certainty = Assessment(study=study, measured=measured, meshes={"p1": MESHES})
        assessed = certainty.assess(case, *certainty.columns(case), cases=others)
        box = assessed.end.problem.box
        ends = [box.lower + x * (box.upper - box.lower) for x in assessed.density.interval(assessed.point)]
        (low,), (high,), (value,) = *ends, assessed.values
        found[sd] = assessed.verdict, low <= 0.5 * mu <= high, (high - low) / value, 2.0 * value / mu - 1.0
    return found


def of_ties(seeds) -> None:
    worlds = list(map(tied_law, seeds))
    for sd in TIE_ERRORS:
        found = [of[1:] for world in worlds if (of := world[sd])[0] is not Adequacy.FAILS]
        approximate = sum(world[sd][0] is Adequacy.APPROXIMATES for world in worlds)
        holds, widths, errors = map(np.array, zip(*found, strict=True))
        held = f"{holds.sum()} of {len(found)} hold, {approximate} approximate"
        wide = f"median width {100.0 * np.median(widths):.1f} %"
        missed = f"rms error {100.0 * np.sqrt(np.mean(errors**2)):.1f} %"
        say(f"ties within {100.0 * sd:.0f} %: {held}, {wide}, {missed}")


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--spots", type=int, default=0)
    arguments.add_argument("--laws", type=int, default=0)
    arguments.add_argument("--tied", type=int, default=0)
    arguments.add_argument("--tuned", action="store_true")
    given = arguments.parse_args()
    first = 0 if given.tuned else 1
    if given.spots:
        of_spots(range(first, 2 * given.spots, 2))
    if given.laws:
        of_laws(given.laws, count(first, 2))
    if given.tied:
        of_ties(range(first, 2 * given.tied, 2))


if __name__ == "__main__":
    main()
