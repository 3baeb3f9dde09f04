"""Stage on the relaxation that a fit has found: moduli at once and later, and the loss tangent.

It reads both kinds of relaxation alike: shares of all moduli, of the parametrisation ``relaxing``, and shares
of each region's stress, which the solver relaxes.
"""

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from palpate.api import (
    OF_ROW,
    FloatArray,
    Indentation,
    ParameterError,
    Progress,
    RegionMaterial,
    RelaxingMaterial,
    Run,
    Stage,
    StageTable,
    StudyError,
    Summary,
    TableColumn,
    convert,
)
from palpate.api.fit import ALL_SPOTS, inputs_at, relaxing_space, relaxing_thetas
from palpate.api.report import Figure, rounded
from palpate.api.runs import Files, Study, common
from palpate_materials.relaxation import loss_tangent, reduced_relaxation

ALL_REGIONS = "all"
"""Name of the region where all moduli relax alike."""

AT_ONCE, LATER, LONG_TERM = "at once", "after {:.3g} s", "long-term"
"""Words for a shear modulus; the long-term one is shown where the record tells each time constant."""


class _Draws(NamedTuple):
    """Draws of a region: time constants (m,), shares (m, n), and shear moduli at once (n,) [MPa].

    The first draw is what was fitted.
    """

    times_s: FloatArray
    shares: FloatArray
    shear_MPa: FloatArray


class RelaxationOverTime(Stage):
    """Relaxation that a fit has found, with its band."""

    name, summary = "relaxation", "Find how far the moduli relax in time, with a band."
    needs = ("intervals",)
    tables = MappingProxyType(
        {
            "relaxation": StageTable(
                "Relaxation of the moduli in time, with 95 % bands.",
                {
                    **common("fit", "scenario"),
                    "region": TableColumn("Region of the limb.", pl.String),
                    "time_s": TableColumn("Time after a step of the strain.", unit="s"),
                    "left": TableColumn("Share of the moduli that is left."),
                    "lower": TableColumn("Lower end of the share."),
                    "upper": TableColumn("Upper end of the share."),
                    "loss_tangent": TableColumn("Loss tangent at the angular frequency 1/time."),
                    "loss_lower": TableColumn("Lower end of the loss tangent."),
                    "loss_upper": TableColumn("Upper end of the loss tangent."),
                },
            ),
            "relaxing_moduli": StageTable(
                "Shear modulus of each region at once and later, with 95 % intervals.",
                {
                    **common("fit", "scenario"),
                    "region": TableColumn("Region of the limb.", pl.String),
                    "shear_modulus": TableColumn(
                        "At once, after the record, or in the long term.", pl.String
                    ),
                    "value": TableColumn("Shear modulus.", unit=OF_ROW),
                    **common("lower", "upper"),
                    "unit": TableColumn("Unit of the modulus.", pl.String),
                },
            ),
        }
    )

    def is_in_run(self, study: Study) -> bool:
        """True where anything relaxes."""
        return study.relaxes

    def run(self, inputs: Run, progress: Progress) -> Files:
        """Rows by fit, scenario and region."""
        study = inputs.study
        if not study.relaxes:
            raise StudyError(
                'nothing relaxes; set parametrisation = "relaxing" in [fit], or relaxation_times of a region'
            )
        values, over_time, moduli = inputs.table("intervals"), [], []
        for (fit, scenario), draws in inputs.table("draws").group_by("fit", "scenario", maintain_order=True):
            found = values.filter(fit=fit, scenario=scenario)
            best = dict(zip(found["parameter"], found["value"], strict=True))
            of = {"fit": fit, "scenario": scenario}
            regions = _drawn(inputs, str(fit), [best, *(best | row for row in draws.to_dicts())])
            over_time += [of | row for row in _over_time(regions, study, study.record_s)]
            moduli += [of | row for row in _moduli(regions, study, study.record_s)]
        found_any = {"relaxation": over_time, "relaxing_moduli": moduli}
        return {name: self.tables[name].frame(rows) for name, rows in found_any.items() if rows}

    def summarise(self, inputs: Run) -> Summary:
        """Summary: what is left after the record, the moduli, the loss tangent, and slower times."""
        table = inputs.table("relaxation")
        main = _reported(inputs, table) if inputs.study.relaxes else table.clear()
        if main.is_empty():
            return Summary(lines=["No fit, and so no relaxation."])
        moduli = inputs.table("relaxing_moduli")
        left, losses = list(_left(inputs.study, main)), list(_losses(inputs.study, main))
        shear = [_shear(inputs.study, rows) for rows in _by_region(_reported(inputs, moduli))]
        return Summary(
            lines=[
                f"{line[0].upper()}{line[1:]}."
                for line in (*left, *(f"shear modulus {each}" for each in shear), *losses)
            ],
            labelled={"Relaxation": "; ".join(left), "Shear modulus": "; ".join((*shear, *losses))},
            tables={"Shear moduli": moduli, "Moduli that are left": table},
            figures=[_figure(main)],
        )


# ------------------------------------------------------------------------- what relaxes


def _relaxing_regions(study: Study) -> list[RegionMaterial]:
    return [each for each in relaxing_space(study).regions if isinstance(each.material, RelaxingMaterial)]


def press_s(study: Study) -> float:
    """Duration of the fastest press up to its deepest [s]; 0 where motions have no times."""
    protocols = map(study.protocol_at, study.spot_names)
    timed = (p for p in protocols if isinstance(p, Indentation))
    return min((p.press_s for p in timed if p.press_s > 0.0), default=0.0)


def _untold_s(study: Study) -> list[float]:
    """Time constants that are longer than the record."""
    times = dict.fromkeys(t for r in _relaxing_regions(study) for t in r.material.relaxation_times_s)
    return [time for time in times if time > study.record_s]


# ------------------------------------------------------------------------------- tables


def _drawn(inputs: Run, fit: str, every: list[Mapping[str, Any]]) -> dict[str, _Draws]:
    """Draws by region that relaxes; a draw whose shares leave nothing is left out."""
    import jax

    from palpate.api.mechanics import moduli_at_rest

    study, thetas = inputs.study, []
    spot = study.spot_names[0] if fit == ALL_SPOTS else fit
    for values in every:
        try:
            found = inputs_at(study, spot, values, inputs.measured).thetas
        except ParameterError:
            continue
        thetas.append(relaxing_thetas(study, found, values))
    drawn = {}
    for region in _relaxing_regions(study):
        material, rows = region.material, np.array([theta[region.region] for theta in thetas])
        n_own = rows.shape[1] - len(material.relaxation_times_s)
        shear, _ = jax.vmap(lambda theta, material=material: moduli_at_rest(material, theta))(rows)
        times_s = np.array(material.relaxation_times_s)
        drawn[region.region] = _Draws(times_s, rows[:, n_own:].T, np.asarray(shear))
    return drawn


def _ends(values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Fitted values (n,) and the ends of their band, of values (n, n_draws)."""
    # Quantiles of the draws at the ends of a band.
    lower, upper = np.quantile(values[:, 1:] if values.shape[1] > 1 else values, (0.025, 0.975), axis=1)
    return values[:, 0], lower, upper


def _over_time(regions: Mapping[str, _Draws], study: Study, longest_s: float) -> Iterator[dict[str, Any]]:
    if study.parametrisation.times_s:
        regions = {ALL_REGIONS: next(iter(regions.values()))}
    for region, (times_s, shares, _) in regions.items():
        # Times of the table, from a tenth of the shortest time constant on.
        at_s = np.geomspace(0.1 * times_s.min(), max(longest_s, times_s.min()), 25)
        at_s = np.unique([*at_s, press_s(study) or at_s[0]])
        left = _ends(reduced_relaxation(at_s, times_s, shares))
        loss = _ends(loss_tangent(1.0 / at_s, times_s, shares))
        names = ("left", "lower", "upper", "loss_tangent", "loss_lower", "loss_upper")
        for i, time_s in enumerate(at_s.tolist()):
            numbers = (float(values[i]) for values in (*left, *loss))
            yield {"region": region, "time_s": time_s} | dict(zip(names, numbers, strict=True))


def _moduli(regions: Mapping[str, _Draws], study: Study, longest_s: float) -> Iterator[dict[str, Any]]:
    """Rows of shear moduli in the unit of the study's moduli."""
    unit = study.modulus_unit
    for region, (times_s, shares, shear) in regions.items():
        later_s = np.array([0.0, longest_s, *([] if _untold_s(study) else [np.inf])])
        moduli = reduced_relaxation(later_s, times_s, shares) * shear * convert("1 MPa", unit)
        words = (AT_ONCE, LATER.format(longest_s), LONG_TERM)
        for word, value, lower, upper in zip(words, *_ends(moduli), strict=False):
            yield {"region": region, "shear_modulus": word, "value": float(value), "lower": float(lower),
                   "upper": float(upper), "unit": unit}  # fmt: skip


# ------------------------------------------------------------------------------ summary


def _reported(inputs: Run, table: pl.DataFrame) -> pl.DataFrame:
    """Rows of the fit that the run reports."""
    found = inputs.fitted()
    return table.filter(fit=found.fit, scenario=found.scenario)


def _by_region(table: pl.DataFrame) -> Iterator[pl.DataFrame]:
    for _, rows in table.group_by("region", maintain_order=True):
        yield rows


def _of(study: Study, region: str) -> str:
    return "" if region == ALL_REGIONS or len(study.space.regions) == 1 else f" of {region}"


def _in_digits(value: float, lower: float, upper: float) -> list[str]:
    """Value and ends of its interval, with the digits of the interval."""
    return [rounded(each, lower, upper) for each in (value, lower, upper)]


def _left(study: Study, main: pl.DataFrame) -> Iterator[str]:
    for rows in _by_region(main):
        last = rows.row(-1, named=True)
        left, lower, upper = _in_digits(*(100.0 * last[name] for name in ("left", "lower", "upper")))
        yield (
            f"{left} % of the moduli{_of(study, last['region'])} at once are left after "
            f"{last['time_s']:.3g} s ({lower} to {upper} %)"
        )
    if untold := [f"{time:g} s" for time in _untold_s(study)]:
        yield f"a record of {study.record_s:.3g} s does not tell {', '.join(untold)}"


def _shear(study: Study, rows: pl.DataFrame) -> str:
    """Shear moduli of a region in words."""
    parts = (
        "{0} {unit} {shear_modulus} ({1} to {2})".format(
            *_in_digits(row["value"], row["lower"], row["upper"]), **row
        )
        for row in rows.iter_rows(named=True)
    )
    return f"{_of(study, rows['region'][0])} {', '.join(parts)}".removeprefix(" ")


def _losses(study: Study, main: pl.DataFrame) -> Iterator[str]:
    """Sentences on the loss tangent at the rate of the fastest press."""
    if not (seconds := press_s(study)):
        return
    for rows in _by_region(main):
        row = rows.row(int(np.abs(rows["time_s"].to_numpy() - seconds).argmin()), named=True)
        loss, lower, upper = _in_digits(row["loss_tangent"], row["loss_lower"], row["loss_upper"])
        yield (
            f"loss tangent{_of(study, row['region'])} {loss} ({lower} to {upper}) at "
            f"{1.0 / seconds:.2g} rad/s, the rate of a press in {seconds:.3g} s"
        )


def _figure(main: pl.DataFrame) -> Figure:
    """Share of the moduli that is left over time, with its band."""
    traces: list[Mapping[str, Any]] = []
    for k, rows in enumerate(_by_region(main)):
        region, colour = rows["region"][0], f"--line{k % 6}"
        line = {"type": "scatter", "mode": "lines", "x": rows["time_s"].to_list()}
        edge = {"color": colour, "width": 1, "dash": "dot"}
        name = "left" if region == ALL_REGIONS else region
        traces += [
            line | {"y": rows[end].to_list(), "line": edge, "showlegend": False, "name": f"{name}, {end} end"}
            for end in ("lower", "upper")
        ]
        traces.append(line | {"y": rows["left"].to_list(), "line": {"color": colour}, "name": name})
    return Figure(
        label="Share of the moduli at once that is left after each time, with its 95 % band; the numbers are "
        "in the table of moduli that are left.",
        traces=traces,
        layout={
            "xaxis": {"title": "time (s)", "type": "log"},
            "yaxis": {"title": "share of the moduli at once"},
        },
    )
