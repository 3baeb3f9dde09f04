"""The shape of study.toml: its tables and keys, and what each may hold.

This decides what a file may look like; what its names mean is for
:mod:`palpate.study.build`, and the JSON schema for editors comes from :mod:`palpate.study.schema`.
"""

import reprlib
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from palpate.domain import MOST_TILT_DEG
from palpate.study.source_positions import MOST_SETS
from palpate.units import Quantity

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$", max_length=100)]
"""A name that also serves as a file name and as a part of ``region.parameter``."""


Length = Annotated[float, Quantity("mm")]
Seconds = Annotated[float, Quantity("s")]
Ratio = Annotated[float, Quantity("1")]

Share = Annotated[Ratio, Field(ge=0.0, lt=1.0)]
"""A relative standard deviation."""

Shares = Annotated[
    dict[str, Share],
    BeforeValidator(
        lambda given: given if isinstance(given, dict) else {"": given},
        json_schema_input_type=Share | dict[str, Share],
    ),
]
"""One for each name; one for all of them is under no name."""


USUAL_DISCREPANCY = 0.005
"""Misfit that a good model leaves in a channel, over the largest ordinate."""


def _more_than_zero(shares: dict[str, float]) -> dict[str, float]:
    if not all(shares.values()):
        raise ValueError("must be more than 0")
    return shares


class Table(BaseModel):
    """A table of study.toml: unknown keys and values of another type are refused."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class StudyTable(Table):
    """Name of the study, its description and where its data come from."""

    name: Name = Field(description="Name of the study; its runs are kept under it.")
    description: str = Field(default="", description="Subject of the study, in a sentence.")
    data: Literal["measured", "simulated"] = Field(
        description="Whether the experiment is real; shown wherever results are."
    )
    plugins: list[str] = Field(
        default=[], description="One-file plugins of this study, relative to its file, such as goh.py."
    )


Files = str | list[str]
"""One file, or the files of repeated presses."""


def _by_channel(given: object) -> object:
    """Files by channel; those that hold several channels stand under no name."""
    by_channel = given if isinstance(given, dict) else {"": given}
    files = {name: [each] if isinstance(each, str) else each for name, each in by_channel.items()}
    for each in files.values():
        if not (isinstance(each, list) and each and all(isinstance(file, str) for file in each)):
            raise ValueError(
                f"{reprlib.repr(given)} names no files; give one file, a list of files for repeated presses, "
                'or either by channel, such as { force = "f.csv" }'
            )
    return files


class OpenTable(Table):
    """A table that names a component, whose settings are its other keys."""

    model_config = ConfigDict(extra="allow")

    @property
    def settings(self) -> dict[str, Any]:
        """Settings of the component."""
        return self.model_extra or {}


class IndenterTable(OpenTable):
    """The rigid indenter; the other keys are its settings."""

    shape: str = Field(description="Name of an indenter.")
    friction: float | None = Field(default=None, ge=0.0, description="Coulomb coefficient of this indenter.")


class ProtocolTable(OpenTable):
    """Motion of the indenter against the limb; the other keys are the settings of the motion."""

    indenter: IndenterTable = Field(description="Indenter that touches the limb.")
    motion: str = Field(default="press_and_twist", description="Name of a motion.")
    friction: float | None = Field(default=None, ge=0.0, description="Coulomb coefficient of any indenter.")


class SpotProtocolTable(OpenTable):
    """Protocol of one spot; each key takes the place of the same key of [protocol]."""

    indenter: IndenterTable | None = Field(default=None, description="Indenter that touches the limb here.")
    motion: str | None = Field(default=None, description="Name of a motion; its settings are given here.")
    friction: float | None = Field(default=None, ge=0.0, description="Coulomb coefficient here.")


def _value_and_sd(given: object) -> object:
    if len(ends := tuple(str(given).split("±"))) != 2:
        raise ValueError(f'{given!r} is no thickness with its error; write "1.6 mm ± 0.2 mm"')
    return ends


class SpotTable(Table):
    """A marked spot with its files."""

    name: Name = Field(description="Name of the spot.")
    measured: Annotated[
        dict[str, list[str]], BeforeValidator(_by_channel, json_schema_input_type=Files | dict[str, Files])
    ] = Field(
        min_length=1,
        description="File of the measured curves, or one file per channel, by channel name. A list of "
        "files holds repeated presses, which are averaged.",
    )
    mesh: str | None = Field(default=None, description="File of the limb around the spot.")
    fine_mesh: str | None = Field(default=None, description="A finer mesh of it, to correct a fit.")
    position: list[Length] = Field(
        default=[0.0, 0.0, 0.0], min_length=3, max_length=3, description="Where the indenter first touches."
    )
    normal: list[float] = Field(
        default=[0.0, 0.0, 1.0], min_length=3, max_length=3, description="Outward normal at the spot."
    )
    layers: dict[
        Name,
        Annotated[
            tuple[Annotated[Length, Field(gt=0.0)], Annotated[Length, Field(ge=0.0)]],
            BeforeValidator(_value_and_sd, json_schema_input_type=str),
        ],
    ] = Field(default={}, description='Measured thickness of layers here, such as "1.6 mm ± 0.2 mm".')
    state: Name | None = Field(
        default=None, description="State of the person, such as rest or contracted; of each spot or of none."
    )
    protocol: SpotProtocolTable | None = Field(
        default=None, description="Differences at this spot, such as another indenter."
    )
    settings: dict[str, Any] = Field(
        default={}, description="Settings of the loader for this spot's files, in addition to [experiment]."
    )


class ExperimentTable(Table):
    """Loader of measured curves, with its settings."""

    loader: str = Field(description="Name of an experiment loader.")
    settings: dict[str, Any] = Field(default={}, description="Settings of the loader.")


class LimbTable(Table):
    """Source of meshes, with its settings."""

    source: str = Field(description="Name of a limb source.")
    settings: dict[str, Any] = Field(default={}, description="Settings of the limb source.")
    one_frame: bool = Field(
        default=False,
        description="Whether the meshes of all spots are in one frame, so that one direction of a material's "
        "fibres serves them all.",
    )
    linear: bool = Field(
        default=False,
        description="Whether four-node tetrahedra stay as they are, although they lock in nearly "
        "incompressible tissue; else each edge gets a node in its middle.",
    )
    rigid: list[str] = Field(
        default=[], description="Regions that do not deform, such as bone: fixed, without a material."
    )


class PriorTable(Table):
    """Prior of a number: its expected value and standard deviation."""

    value: str | float = Field(description="The quantity expected, with its unit.")
    sd: str | float = Field(description="Its standard deviation, with its unit.")


class SearchedRange(Table):
    """The two ends between which a parameter is searched."""

    lower: str | float = Field(description="Lower end, with its unit.")
    upper: str | float = Field(description="Upper end, with its unit.")
    scale: Literal["linear", "log"] = Field(
        default="linear", description="Whether sets are spread evenly over the values or their logarithms."
    )
    prior: PriorTable | None = Field(
        default=None, description="Prior knowledge of the value; it counts in a fit."
    )
    by: Literal["spot", "state"] | None = Field(
        default=None, description="Groups of which a fit of several spots finds a value for each."
    )


class FixedValue(Table):
    """A fixed or tied parameter, written out."""

    value: str | float = Field(description='The quantity, with its unit, or a tie such as "20 * c1".')


class ParameterTable(Table):
    """A parameter as read: ``value`` when it is fixed or tied, else the ends of its range.

    The quantities stay as written here, since their unit is the material's to say.
    """

    value: Any = None
    lower: Any = None
    upper: Any = None
    scale: Literal["linear", "log"] = "linear"
    prior: PriorTable | None = None
    by: Literal["spot", "state"] | None = None


def _fixed_or_searched(given: object) -> object:
    if not isinstance(given, dict):
        return {"value": given}
    if "value" in given and len(given) > 1:
        raise ValueError("both fixed (value) and searched (lower, upper); keep one of the two")
    missing = [end for end in ("lower", "upper") if end not in given]
    if missing and "value" not in given and set(given) <= set(SearchedRange.model_fields):
        raise ValueError(
            f"the range has no {' and no '.join(missing)}; "
            'write { lower = "…", upper = "…" }, or one quantity to fix the parameter'
        )
    return given


class RegionTable(Table):
    """The material of one region of the limb."""

    material: str = Field(description="Name of a material.")
    convention: str = Field(
        default="textbook",
        description="How the coefficients are written: textbook, or one the material knows.",
    )
    settings: dict[str, Any] = Field(default={}, description="Settings of the material.")
    relaxation_times: list[Annotated[Seconds, Field(gt=0.0)]] = Field(
        default=[],
        description="Time constants of its relaxation; each adds a parameter, the share of the stress "
        'that relaxes with it: relaxed_10s of "10 s".',
    )
    relaxing_stress: Literal["all", "isochoric"] = Field(
        default="all", description="Stress that relaxes: all, or only for a change of shape."
    )
    parameters: dict[
        str,
        Annotated[
            ParameterTable,
            BeforeValidator(
                _fixed_or_searched, json_schema_input_type=str | float | FixedValue | SearchedRange
            ),
        ],
    ] = Field(
        default={},
        description='A fixed quantity, lower and upper, or a tie to another parameter, such as "20 * c1" '
        'or "0.3 * skin.E"; lower and upper of a searched ratio are ties. '
        "A parameter not named is searched over the material's own range.",
    )


def _none_or_two(n_sets: int) -> int:
    if n_sets == 1:
        raise ValueError("one set is no sweep; give 2 or more, or 0 for a fit without a sweep")
    return n_sets


class SamplingTable(Table):
    """Sampler of parameter sets, with their number and filters."""

    sampler: str = Field(default="lhs", description="Name of a sampler.")
    n_sets: Annotated[int, AfterValidator(_none_or_two)] = Field(
        ge=0,
        le=MOST_SETS,
        json_schema_extra={"not": {"const": 1}},
        description="Number of accepted parameter sets; 0: no sweep, a fit starts from the ranges.",
    )
    max_draws: int = Field(
        default=0,
        ge=0,
        le=1_000 * MOST_SETS,
        description="Most sets to draw for n_sets accepted ones; as many as n_sets: draw once and keep "
        "the sets that pass the filters; 0: 64 for each.",
    )
    seed: int = Field(default=1, ge=0, description="Seed of the draw.")
    settings: dict[str, Any] = Field(default={}, description="Settings of the sampler.")
    filters: dict[str, dict[str, Any]] = Field(
        default={}, description="Set filters by name, each with its settings."
    )


class SolverTable(Table):
    """Solver that simulates a set at a spot, with its settings."""

    name: str = Field(description="Name of a solver.")
    n_workers: int = Field(
        default=0,
        ge=0,
        description="Local worker processes; 0: one per core, and no more than a memory limit has room for.",
    )
    time_limit: Seconds = Field(
        default=600.0, gt=0.0, description="Most processor time for one simulation, on each thread."
    )
    settings: dict[str, Any] = Field(default={}, description="Settings of the solver.")


class ExecutorTable(Table):
    """Executor of simulations, with its limits."""

    name: str | None = Field(
        default=None, description="Name of an executor; if left out worker processes of this machine."
    )
    settings: dict[str, Any] = Field(default={}, description="Settings of the executor.")
    memory_limit: Annotated[float, Quantity("MB")] | None = Field(
        default=None, gt=0.0, description="Most memory that one simulation may take; if left out no limit."
    )
    attempts: int = Field(default=2, ge=1, le=10, description="Worker crashes tolerated per job.")
    cache: str | None = Field(
        default=None, description="Folder of finished simulations that is shared with other studies."
    )


class ScoringTable(OpenTable):
    """Score that compares simulated with measured curves; the other keys are its settings."""

    score: str = Field(default="nmse", description="Name of a score.")
    rank_partial: bool = Field(
        default=False,
        description="Rank a diverged simulation too, by its partial curves, where these cover enough of "
        "the measured curve; its scores and selected sets say so.",
    )
    minimum_coverage: float = Field(
        default=0.95, gt=0.0, le=1.0, description="Least share of the measured points that must be reached."
    )


class SelectionTable(Table):
    """Scenarios by which the best sets are chosen."""

    scenarios: list[str] = Field(min_length=1, description="Names of scenarios, in the order to report.")
    generalise_by: str | None = Field(
        default=None, description="Scenario whose mean over the spots decides; the first one if left out."
    )


class FitTable(Table):
    """Search for the parameters for which the curves fit best, with its settings."""

    search: str = Field(default="least_squares", description="Name of a search; sweep: the best set itself.")
    settings: dict[str, Any] = Field(default={}, description="Settings of the search.")
    parametrisation: str = Field(default="standard", description="Name of a parametrisation.")
    searched: dict[str, Any] = Field(
        default={},
        description="Searched values besides the materials' parameters: settings of the parametrisation.",
    )
    noise: float = Field(
        default=0.01,
        gt=0.0,
        le=1.0,
        description="Relative misfit, the root of the NMSE, that one standard deviation of a prior is worth.",
    )
    fine_runs: int = Field(
        default=3, ge=0, le=20, description="Most simulations of each spot's finer mesh that correct a fit."
    )
    fine_edge: Literal["auto"] | Annotated[Length, Field(ge=0.0)] = Field(
        default="auto",
        description="Longest edge under the indenter to which each spot's own mesh is refined, as the finer "
        "mesh of spots without a fine_mesh; 0: none; auto: 0.28 of the contact's radius, or the mesh's "
        "mean edge there, for tetrahedra and a solver with slopes.",
    )
    fine_nodes: int = Field(
        default=20_000,
        ge=0,
        description="Nodes up to which a run refines further by itself, where fine_edge is auto and the mesh "
        "more than a fifth of a variance.",
    )


class BudgetTable(Table):
    """Error budget of curves and model: standard deviations, from which intervals follow."""

    onset: Length | None = Field(
        default=None,
        ge=0.0,
        description="Of the depth where the measured curves begin; if left out, as the loader has found, "
        "else 0.05 mm.",
    )
    radius: Length = Field(default=0.0, ge=0.0, description="Of the indenter's radius.")
    tilt: Annotated[float, Quantity("deg")] = Field(
        default=0.0,
        ge=0.0,
        lt=MOST_TILT_DEG / 2.0,
        description="Of the axis of press and twist from the normal, about each of two directions; costs "
        "four simulations for each spot.",
    )
    friction: Ratio | None = Field(
        default=None,
        ge=0.0,
        description="Of the Coulomb coefficient; if left out, 0.3 of it, of simulated data a tenth.",
    )
    position: Length | None = Field(
        default=None,
        ge=0.0,
        description="Of the place of each spot along the skin, in each of two directions; if left out, as "
        "the note of the mesh has it, else 1 mm; none where data are simulated.",
    )
    bone: Length | None = Field(
        default=None,
        ge=0.0,
        description="Of the depth of the bones, that is of all nodes that are held, at all spots together; "
        "if left out, 1 mm; none where data are simulated.",
    )
    layers: Shares = Field(
        default={},
        description="Of the thickness of the layers above the deepest, relative, at all spots together: one "
        "number, or one for each region. If left out, 10 %, as ultrasound has it (optical scans: 40 %); none "
        "where data are simulated.",
    )
    gain: Ratio = Field(
        default=0.01, ge=0.0, lt=1.0, description="Of the calibration of each channel, relative."
    )
    zero: Ratio | None = Field(
        default=None,
        ge=0.0,
        lt=1.0,
        description="Drift of a channel along its curve, over its largest ordinate; if left out, as "
        "the loader has found, else none.",
    )
    mesh: Shares = Field(
        default={},
        description="Of the error of a channel by the mesh, relative, where no finer mesh shows it; also the "
        "least of a prediction's. One number, or one for each channel. If left out, as the note of the mesh "
        "has it, else 3 % of the force and 7 % of other channels, less where edges are below 0.3 radii.",
    )
    parameters: dict[str, Share] = Field(
        default={},
        description="Of fixed and tied parameters, relative, by region.parameter; if left out, half, of "
        "simulated data a tenth, and of a fixed one no more than its physical range has.",
    )
    discrepancy: Annotated[Shares, AfterValidator(_more_than_zero)] = Field(
        default={"": USUAL_DISCREPANCY},
        description="Residual that a good model leaves, over the largest ordinate: one number, or one for "
        "each channel, 0.5 % of others. Intervals allow for no less, for parameters may hide it. A model "
        "that leaves four times as much does not describe the data.",
    )

    def discrepancy_of(self, channel: str) -> float:
        """Misfit that a good model leaves in a channel, over the largest ordinate."""
        return self.discrepancy.get(channel, self.discrepancy.get("", USUAL_DISCREPANCY))


class ScenarioTable(Table):
    """A scenario of this study."""

    name: str = Field(min_length=1, max_length=100, description="Name of the scenario.")
    weights: dict[str, float] = Field(
        description='Weight in Fopt of the NMSE of each channel, or phase such as "torque/unload".'
    )
    description: str = Field(default="", description="Purpose of the scenario.")


class StudyFile(Table):
    """A palpate study: from measured curves to identified parameters."""

    study: StudyTable
    spot: list[SpotTable] = Field(min_length=1, description="The marked spots.")
    experiment: ExperimentTable
    limb: LimbTable | None = Field(default=None, description="Leave out for homogeneous tests.")
    protocol: ProtocolTable | None = Field(default=None, description="Leave out for homogeneous tests.")
    region: dict[Name, RegionTable] = Field(min_length=1, description="Material of each region, by its name.")
    sampling: SamplingTable
    solver: SolverTable
    executor: ExecutorTable | None = Field(default=None, description="Leave out to use this machine.")
    scoring: ScoringTable = ScoringTable()
    selection: SelectionTable
    fit: FitTable = FitTable()
    budget: BudgetTable = BudgetTable()
    scenario: list[ScenarioTable] = Field(default=[], description="Scenarios of this study's own.")
    stages: dict[Name, dict[str, Any]] = Field(
        default={},
        description="Stages that `palpate run` includes besides its own: a table of settings for each.",
    )
    truth: dict[str, Any] = Field(
        default={}, description="Known answer by region.parameter, for simulated data only."
    )
