"""The best set of each spot and scenario, with how well its parameters are identified."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from palpate.domain import weighed_phases
from palpate.report.report_data import ReportData
from palpate.report.tables import weighted_channels
from palpate.stages.identifiability import UNCLEAR


@dataclass(frozen=True, slots=True)
class Value:
    """One parameter of a best set, with the fitted optimum and the interval around that.

    These are None where they are unknown; the set need not be in the interval.
    """

    value: float
    optimum: float | None
    lower: float | None
    upper: float | None
    identifiability: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Best:
    """The best set of one spot in one scenario.

    Parameters
    ----------
    fitted_to : str
        Channels that the scenario weights.
    found : str
        ``set 12`` of the sweep, or ``fit`` where a search went on from there.
    values : tuple of Value
        In the order of the design's parameters.
    r2 : mapping of channel or phase to number or None
    """

    spot: str
    scenario: str
    fitted_to: str
    found: str
    fopt: float
    values: tuple[Value, ...]
    r2: Mapping[str, float | None]

    @property
    def where(self) -> str:
        """Spot and scenario."""
        return f"{self.spot}, scenario {self.scenario}"


def best_sets(data: ReportData) -> Iterator[Best]:
    """Best set by spot and scenario: the fitted one, where there is one."""
    fitted = data.fit.of_spots()
    names = (*data.measured_channels, *weighed_phases(data.study.scenarios))
    fits = {(r["spot"], r["scenario"], r["parameter"]): r for r in data.identifiability.iter_rows(named=True)}
    for row in data.selection.iter_rows(named=True):
        key = row["spot"], row["scenario"]
        best, found = row, f"set {row['set_id']}{', unfinished' if row.get('partial') else ''}"
        if key in fitted:
            best, found = fitted[key], "fit"
        yield Best(
            spot=key[0],
            scenario=key[1],
            fitted_to=weighted_channels(data.scenario(key[1])),
            found=found,
            fopt=best["fopt"],
            values=tuple(_value(best[p.name], fits.get((*key, p.name), {})) for p in data.design.parameters),
            r2={name: best.get(f"r2_{name}") for name in names},
        )


def _value(value: float, fit: Mapping[str, Any]) -> Value:
    word = fit.get("identifiability", UNCLEAR)
    return Value(value, fit.get("optimum"), fit.get("lower"), fit.get("upper"), word)
