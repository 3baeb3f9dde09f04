"""The best set of each spot and scenario, as the answer of a run has it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import polars as pl

from palpate.api import Parameter, ParameterName, Scenario
from palpate.api.fit import FIT, MODULUS, PARAMETER, UNCLEAR, Adequacy
from palpate_report.data.marks import Headline, in_words


@dataclass(frozen=True, slots=True, kw_only=True)
class Best:
    """The best set of one spot in one scenario, or of a joint fit.

    Parameters
    ----------
    fitted_to : str
        Channels that the scenario weights.
    found : str
        ``set 12`` of the sweep, or ``fit`` where a search went on from there.
    fopt : float
        At the values; of a joint fit the mean over its spots.
    fopt_least : float or None
        The least that the search has found; None of a set of the sweep.
    values : tuple of Headline
        In the order of ``ReportData.searched``.
    r2 : mapping of channel or phase to number or None
        Of a joint fit the least of its spots.
    moduli : tuple of Headline
        Initial shear modulus and Young's modulus of each region that is searched, where its material has
        them, in ``ReportData.modulus_unit``.
    model : Adequacy
        Verdict on its model.
    is_reported : bool
        True of the one that a run reports.
    """

    spot: str
    scenario: str
    fitted_to: str
    found: str
    fopt: float
    fopt_least: float | None = None
    values: tuple[Headline, ...]
    r2: Mapping[str, float | None]
    moduli: tuple[Headline, ...]
    model: Adequacy
    is_reported: bool

    @property
    def where(self) -> str:
        """Spot and scenario."""
        return f"{self.spot}, scenario {self.scenario}"


def headlines_of(rows: pl.DataFrame, brief: Mapping[str, Parameter]) -> tuple[Headline, ...]:
    """Values of rows of the answer; ``brief`` has the parameters by full name, each under its brief name."""
    return tuple(_headline(row, brief) for row in rows.iter_rows(named=True))


def _headline(row: Mapping[str, Any], brief: Mapping[str, Parameter]) -> Headline:
    name, is_parameter = ParameterName.parse(row["parameter"]), row["kind"] == PARAMETER
    same = ("unit", "value", "optimum", "lower", "upper", "identifiability", "level", "at_bound")
    return Headline(
        parameter=str(ParameterName.parse(brief[name.shared].name).at(name.spot))
        if is_parameter
        else row["parameter"],
        name=row["parameter"] if is_parameter else "",
        model=Adequacy(row["model"]),
        **{key: row[key] for key in same},
    )


def bests_of(
    answer: pl.DataFrame,
    ends: Mapping[tuple[str, str, bool], Mapping[str, Any]],
    fitted_to: Mapping[str, str],
    channels: Sequence[str],
    brief: Mapping[str, Parameter],
    states: Mapping[str, str],
) -> Iterator[Best]:
    """Fits, then sets of the sweep; of each the joint ones first.

    Parameters
    ----------
    answer : DataFrame
    ends : mapping of (spot, scenario, whether it is a fit) to mapping
        Rows of the selection and of the ends of fits, which have their Fopt and R².
    fitted_to : mapping of scenario to str
    channels : sequence of str
    """
    for key, rows in answer.group_by("spot", "scenario", "source", maintain_order=True):
        spot, scenario, source = map(str, key)
        if (end := ends.get((spot, scenario, source == FIT))) is None:
            continue
        values = headlines_of(rows.filter(kind=PARAMETER), brief)
        yield Best(
            spot=spot,
            scenario=scenario,
            fitted_to=fitted_to[scenario],
            found=source,
            fopt=end["fopt"],
            fopt_least=end.get("fopt_least"),
            values=tuple(_at(spot, name, values, brief, states) for name in brief),
            r2={name: end.get(f"r2_{name}") for name in channels},
            moduli=headlines_of(rows.filter(kind=MODULUS), brief),
            model=Adequacy(rows["model"][0]),
            is_reported=rows["reported"][0],
        )


def _at(
    spot: str,
    name: str,
    values: Sequence[Headline],
    brief: Mapping[str, Parameter],
    states: Mapping[str, str],
) -> Headline:
    """Value of a parameter at a spot; without a number where it differs from spot to spot."""
    for each in values:
        full = ParameterName.parse(each.name)
        if full.shared == name and full.counts_at(spot, states):
            return each
    parameter, model = brief[name], values[0].model
    return Headline(
        parameter=parameter.name,
        name=name,
        unit=parameter.unit,
        value=None,
        identifiability=UNCLEAR,
        model=model,
    )


def weighted_channels(scenario: Scenario) -> str:
    """Channels and phases that a scenario weights, joined with plus signs; with weights that are not 1."""
    weighed = ((in_words(name), weight) for name, weight in scenario.weighed.items())
    return " + ".join(name if weight == 1.0 else f"{weight:g} × {name}" for name, weight in weighed)
