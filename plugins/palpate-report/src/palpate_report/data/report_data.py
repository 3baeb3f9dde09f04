"""Data that a report is made of, and how the simulations of its sweep ended."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import polars as pl

from palpate.api import (
    SILENT,
    Channel,
    Design,
    Limb,
    Parameter,
    ParameterName,
    Response,
    Scenario,
    Simulation,
    StageTable,
    Status,
    Summary,
    SurfaceStates,
)
from palpate.api.fit import (
    ALL_SPOTS,
    MODULUS,
    PARAMETER,
    WIDENED,
    FitResult,
    Results,
    answer_table,
    searched_parameters,
    weighed_phases,
)
from palpate.api.report import Section
from palpate.api.runs import ASSESSED, Completeness, Study, completeness, without_result
from palpate_report.data.best import Best, bests_of, headlines_of, weighted_channels
from palpate_report.data.marks import Headline
from palpate_report.settings import BY_ITSELF, ReportSettings


def by_spot(simulations: Iterable[Simulation]) -> pl.DataFrame:
    """Count how simulations ended, and what they cost.

    Returns
    -------
    DataFrame
        One row per spot: spot, simulations, a column per status that occurs, median_s and
        longest_s with the longest_set, and the median of every number that the solver reported
        of those that are ok, such as median_n_iterations.
    """
    rows = [
        {"spot": s.job.spot, "set_id": s.job.set_id, "status": s.status.value, "seconds": s.seconds}
        | {
            str(name): float(value)
            for name, value in s.diagnostics.items()
            if s.status is Status.OK and isinstance(value, (int, float)) and not isinstance(value, bool)
        }
        for s in simulations
    ]
    if not rows:
        return pl.DataFrame()
    frame = pl.DataFrame(rows, infer_schema_length=None)
    reported = [name for name in frame.columns if name not in ("spot", "set_id", "status", "seconds")]
    statuses = [s.value for s in Status if s.value in frame["status"].unique()]
    return frame.group_by("spot", maintain_order=True).agg(
        pl.len().cast(pl.Int64).alias("simulations"),
        *((pl.col("status") == name).sum().cast(pl.Int64).alias(name) for name in statuses),
        pl.col("seconds").median().alias("median_s"),
        pl.col("seconds").max().alias("longest_s"),
        pl.col("set_id").get(pl.col("seconds").arg_max()).alias("longest_set"),
        *(pl.col(name).median().alias(f"median_{name}") for name in reported),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class ReportData:
    """The results of a run, as the stages left them.

    Parameters
    ----------
    folder : Path
        Run directory, which commands on the page name.
    channels : mapping of name to Channel
        Axes and labels.
    scores, selection, generalisation : DataFrame
        As :mod:`palpate.scoring.scores`, :mod:`palpate.scoring.selection` and
        :mod:`palpate.scoring.generalisation` return them.
    responses : mapping of (spot, set_id) to Response
        Simulated curves of every selected and of the generalised set.
    tables : mapping of name to DataFrame
        Tables of the stages, by the present fit and sweep.
    convergence : DataFrame
        As :func:`palpate_report.data.report_data.by_spot` returns it.
    limbs : mapping of str to Limb
        By spot, and finer meshes by ``SPOT/fine``; empty where there is no mesh.
    manifest : mapping
        What the numbers depended on, as :func:`palpate.run.manifest.manifest` returns it.
    verification : DataFrame
        As :func:`palpate.simulation.verification.verify` returns it; empty where the solver has none.
    factors : mapping of full parameter name to number
        Factors from the material's unit to the unit of the values here, where they differ.
    pictures : mapping of spot name to sequence of Path
        Pictures that there are of its mesh, and of how its presses were processed, in that order.
    sections : mapping of name to type of Section
        Of the page.
    unfinished : str
        How far the run is where it has not ended.
    simulated : str
        Until when, how often and how long together; empty where nothing was simulated.
    n_simulations : int
        Simulations of the run, as `palpate status` counts them.
    refusal : str
        Sentence on every figure of a run without parameters.
    surfaces : mapping of spot name to SurfaceStates
        Skin under the press with the fitted parameters; empty where it was not simulated.
    summaries : mapping of stage to (str, Summary)
        Purpose and summary of each stage of a plugin.
    processor_time : DataFrame
        As :func:`palpate.api.runs.processor_time` returns it.
    settings : ReportSettings
        Style of the figures.
    note : callable
        Shows a message in the terminal.
    """

    study: Study
    folder: Path
    channels: Mapping[str, Channel]
    measured: Mapping[str, Response]
    design: Design
    scores: pl.DataFrame
    selection: pl.DataFrame
    generalisation: pl.DataFrame
    fit: FitResult
    responses: Mapping[tuple[str, int], Response]
    tables: Mapping[str, pl.DataFrame] = field(default_factory=dict)
    convergence: pl.DataFrame = field(default_factory=pl.DataFrame)
    limbs: Mapping[str, Limb] = field(default_factory=dict)
    manifest: Mapping[str, Any] = field(default_factory=dict)
    verification: pl.DataFrame = field(default_factory=pl.DataFrame)
    factors: Mapping[str, float] = field(default_factory=dict)
    pictures: Mapping[str, Sequence[Path]] = field(default_factory=dict)
    sections: Mapping[str, type[Section]] = field(default_factory=dict)
    unfinished: str = ""
    simulated: str = ""
    n_simulations: int = 0
    refusal: str = ""
    surfaces: Mapping[str, SurfaceStates] = field(default_factory=dict)
    summaries: Mapping[str, tuple[str, Summary]] = field(default_factory=dict)
    processor_time: pl.DataFrame = field(default_factory=pl.DataFrame)
    settings: ReportSettings = BY_ITSELF
    note: Callable[[str], None] = SILENT.note

    def table(self, name: str) -> pl.DataFrame:
        """Table of a stage; empty where its plugin is not installed."""
        return self.tables.get(name, ASSESSED.get(name, StageTable("")).empty())

    def without_assessment(self) -> "ReportData":
        """The data of the sweep, and of the fit without its intervals."""
        kept = {"identifiability": self.table("identifiability")}
        return replace(self, fit=self.fit.without_assessment(), tables=kept)

    @property
    def shown_scenarios(self) -> tuple[str, ...]:
        """Scenarios that figures show."""
        return self.settings.scenarios or tuple(scenario.name for scenario in self.study.scenarios)

    @property
    def spots(self) -> tuple[str, ...]:
        """Names of the spots, in the study's order."""
        return tuple(self.measured)

    @property
    def measured_channels(self) -> tuple[str, ...]:
        """Channels that any spot has, in the order in which they come."""
        return tuple(dict.fromkeys(name for response in self.measured.values() for name in response))

    @property
    def brief(self) -> dict[str, Parameter]:
        """Parameters of the design by name, each under its brief name."""
        names = (p.name for p in self.design.parameters)
        return dict(zip(names, named_briefly(self.design.parameters), strict=True))

    @property
    def modulus_unit(self) -> str:
        """Unit of shown moduli: the unit of the first modulus that the study writes in another one."""
        written = (p.unit for p in self.design.parameters if p.name in self.factors and p.kind == "modulus")
        return next(written, "MPa")

    @cached_property
    def searched(self) -> dict[str, Parameter]:
        """:attr:`brief`, and what a fit has searched besides, such as friction."""
        return searched_parameters(self.study, self.design, self.fit) | self.brief

    @cached_property
    def widened(self) -> dict[str, Parameter]:
        """Parameters by full name whose ranges the fit that leads has widened, with these ranges."""
        found, pattern = {}, rf"{WIDENED} (\S+) widened from \S+ to ([^\s…]+)…(\S+)"
        for message in self.leading_rows(self.fit.table).select("message").unique().to_series():
            for name, lower, upper in re.findall(pattern, message):
                shared = ParameterName.parse(name).shared
                low, high = (self.factors.get(shared, 1.0) * float(end) for end in (lower, upper))
                found[shared] = replace(self.searched[shared], lower=low, upper=high)
        return found

    @cached_property
    def answer(self) -> pl.DataFrame:
        """Every value of the run with what may be read of it, as `answer_table` returns it."""
        return answer_table(
            Results(
                study=self.study,
                spots=self.spots,
                searched=self.searched,
                design=self.design,
                selection=self.selection,
                generalisation=self.generalisation,
                identifiability=self.table("identifiability"),
                fit=self.fit,
                factors=self.factors,
                modulus_unit=self.modulus_unit,
            )
        )

    @cached_property
    def fits_and_sets(self) -> tuple[Best, ...]:
        """Fits, and sets of the sweep, as :attr:`answer` has them."""
        ends = ((frame, is_fit) for frame, is_fit in ((self.fit.ends, True), (self.selection, False)))
        rows = ((row, is_fit) for frame, is_fit in ends for row in frame.iter_rows(named=True))
        return tuple(
            bests_of(
                self.answer,
                {(row["spot"], row["scenario"], is_fit): row for row, is_fit in rows},
                {s.name: weighted_channels(s) for s in self.study.scenarios},
                (*self.measured_channels, *weighed_phases(self.study.scenarios)),
                self.searched,
                self.study.space.states,
            )
        )

    @property
    def bests(self) -> tuple[Best, ...]:
        """Best set by spot and scenario, the fitted one where there is one; the joint fits come first."""
        found: dict[tuple[str, str], Best] = {}
        for best in self.fits_and_sets:
            found.setdefault((best.spot, best.scenario), best)
        every = product((ALL_SPOTS, *self.spots), (s.name for s in self.study.scenarios))
        return tuple(found[key] for key in every if key in found)

    @property
    def lead(self) -> Best | None:
        """The fit, or the set of the only spot, that is reported; None where it is the set for all spots."""
        return next((best for best in self.fits_and_sets if best.is_reported), None)

    @property
    def estimates(self) -> tuple[Headline, ...]:
        """Parameters that are reported."""
        return headlines_of(self.answer.filter(pl.col("reported"), kind=PARAMETER), self.searched)

    @property
    def moduli(self) -> tuple[Headline, ...]:
        """Initial moduli that are reported."""
        return headlines_of(self.answer.filter(pl.col("reported"), kind=MODULUS), self.searched)

    def brief_name(self, name: str) -> str:
        """Name of a parameter, as brief as :attr:`searched` has it, with its spot."""
        full = ParameterName.parse(name)
        brief = full.shared
        if full.shared in self.searched:
            brief = self.searched[full.shared].name
        elif len(self.study.space.regions) == 1:
            brief = str(replace(ParameterName.parse(brief), region=""))
        return str(ParameterName.parse(brief).at(full.spot))

    @property
    def together(self) -> str:
        """Name of the fit that leads: of all spots together, or of the only one."""
        return ALL_SPOTS if len(self.spots) > 1 else self.spots[0]

    def leading_rows(self, frame: pl.DataFrame) -> pl.DataFrame:
        """Rows of the fit that leads, in the scenario that generalises; an empty frame as it is."""
        return frame if frame.is_empty() else frame.filter(fit=self.together, scenario=self.generalising.name)

    def spots_differ(self, scenario: str) -> bool:
        """Whether the spots of the joint fit in a scenario differ by more than their errors."""
        rows = self.table("between_spots")
        return not (rows.is_empty() or rows.filter(fit=self.together, scenario=scenario).is_empty())

    @property
    def is_fitted(self) -> bool:
        """Whether a fit of all spots together, or of the only one, has a result where it generalises."""
        return not self.leading_rows(self.fit.ends).is_empty()

    def scenario(self, name: str) -> Scenario:
        """Scenario of the study by its name."""
        return next(s for s in self.study.scenarios if s.name == name)

    @property
    def generalising(self) -> Scenario:
        """The scenario whose mean over the spots decides the generalised set."""
        return self.study.generalising

    def identified(self, *, together: bool) -> pl.DataFrame:
        """Rows of the identifiability in the scenario that generalises.

        Parameters
        ----------
        together : bool
            Rows of all spots together, or of the only spot; else the rows of each spot.
        """
        rows = self.table("identifiability").filter(pl.col("scenario") == self.generalising.name)
        of_all = pl.col("spot") == ALL_SPOTS
        if together:
            return rows.filter(of_all) if len(self.spots) > 1 else rows
        return rows.filter(~of_all)

    @property
    def completeness(self) -> Completeness:
        """Share of the sweep that was scored."""
        return completeness(self.scores, self.spots, self.design)

    @property
    def without_result(self) -> dict[tuple[str, str], str]:
        """Spots and scenarios without a selected set and without a fit, and why."""
        return without_result(self.scores, self.selection, self.study.scenarios, self.spots, self.fit)

    @property
    def notice(self) -> str:
        """Notice on the data, such as that they are simulated."""
        return self.study.notice

    @property
    def stamp(self) -> str:
        """Text that every figure of these data states: the notice, and that it shows no result."""
        return "\n".join(filter(None, (self.notice, self.refusal)))


def brief_names(names: Iterable[str]) -> dict[str, str]:
    """Brief name of each parameter: without its region, where all are of one."""
    parsed = {name: ParameterName.parse(name) for name in names}
    if len({name.region for name in parsed.values() if name.region}) > 1:
        return {name: name for name in parsed}
    return {full: str(replace(name, region="")) for full, name in parsed.items()}


def named_briefly(parameters: Sequence[Parameter]) -> tuple[Parameter, ...]:
    """Parameters under their brief names."""
    brief = brief_names(p.name for p in parameters)
    return tuple(replace(p, name=brief[p.name]) for p in parameters)


def label_of(parameter: Parameter) -> str:
    """Name of a parameter with its unit."""
    return parameter.name if parameter.unit in ("", "1") else f"{parameter.name} ({parameter.unit})"
