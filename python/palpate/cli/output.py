"""Types of what ``--json`` prints, command by command, so that its schema cannot drift.

Numbers that are not finite are printed as null. A change that could break a script raises
:data:`VERSION`; ``palpate schema COMMAND`` prints the schema with it.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, NotRequired

import polars as pl
from pydantic import ConfigDict, Field, TypeAdapter, with_config
from typing_extensions import TypedDict

from palpate.domain.component import Component
from palpate.limb.outer_surface import SurfaceShares
from palpate.plugins.table import StageTable

VERSION = 6
"""Version of all that is described here."""

Number = float | None
Row = dict[str, float | int | str | bool | None]
"""A row of a table whose columns depend on the study: channels, parameters, scenarios."""


@with_config(ConfigDict(extra="forbid"))
class Closed(TypedDict):
    """An object that has just the keys that are named."""


class Searched(Closed):
    """A searched parameter, ``region.parameter``, in its region's convention."""

    name: str
    lower: float
    upper: float
    unit: str


class SearchOutput(Closed):
    """Search of a study's fit, and the names that it searches besides the parameters of the sweep."""

    search: str
    searched: list[Searched]


class CheckOutput(Closed):
    """A study without mistakes; ``spots`` has the channels of each, ``warnings`` what is odd.

    ``surface`` and ``remarks`` are by mesh: what is fixed and in contact, and what was read and left out.

    ``seconds`` is for the ``n_left`` simulations of the sweep to do, ``fit_seconds`` about for the ``n_fit``
    of all stages then (0: not known); null where nothing is left, or only the executor knows its workers.
    """

    study: str
    data: str
    spots: dict[str, list[str]]
    searched: list[Searched]
    fit: SearchOutput
    tied: dict[str, str]
    n_drawn: int
    n_sets: int
    n_left: int
    seconds: Number
    n_fit: int
    fit_seconds: Number
    solver: str
    scenarios: list[str]
    surface: dict[str, SurfaceShares]
    remarks: dict[str, list[str]]
    warnings: list[str]


class IntervalOutput(Closed):
    """A parameter of what leads; ``level`` is null where the interval is what fits about as well."""

    parameter: str
    unit: str
    value: Number
    lower: Number
    upper: Number
    identifiability: str
    verdict: str
    level: Number


class ModelOutput(Closed):
    """Verdict on whether the material law describes the curves, and a sentence on it."""

    verdict: str
    sentence: str


class RunOutput(Closed):
    """Result of a run; optional keys are of its report, the most severe of ``warnings`` first.

    ``n_simulations`` counts all that its folder has, as ``palpate status`` does. With ``is_first_answer``
    the run has stopped after its first fit, and has no more results yet.
    """

    study: str
    data: str
    folder: str
    is_first_answer: bool
    n_sets: int
    n_simulations: int
    selection: list[Row]
    generalisation: list[Row]
    fit: list[Row]
    verification: list[Row]
    conclusion: NotRequired[list[str]]
    model: NotRequired[ModelOutput]
    intervals: NotRequired[list[IntervalOutput]]
    warnings: NotRequired[list[str]]
    next: NotRequired[str]
    tables: NotRequired[dict[str, list[Row]]]
    files: NotRequired[list[str]]


class RunnerOutput(Closed):
    """Process that works in a run directory."""

    host: str
    pid: int
    since: str


class FitStateOutput(Closed):
    """The search that has taken a step last, and about how many simulations are to come."""

    fit: str
    scenario: str
    step: int
    fopt: Number
    n_simulations: int
    n_left: int | None
    seconds_left: Number


class StatusOutput(Closed):
    """Progress of a run; ``states`` counts its simulations by how they ended.

    ``n_simulations`` is about, while a fit goes on. ``fit`` is null before a fit begins, and once it has
    ended; ``result`` has the lines of a finished run, and ``intervals`` its table of that name. With
    ``is_first_answer`` both are of the first fit. ``cost`` is the processor time by stage and work.
    """

    folder: str
    running: RunnerOutput | None
    n_simulations: int
    n_finished: int
    states: dict[str, int]
    seconds_left: Number
    failures: list[Row]
    is_first_answer: bool
    result: dict[str, str]
    intervals: list[Row]
    fit: FitStateOutput | None
    cost: list[Row]


class SynthesiseOutput(Closed):
    """Files that were written for a study."""

    study: str
    files: list[str]


class ExperimentRow(Closed):
    """A measured curve: ``over`` is the range of its abscissa, the numbers are in ``unit``."""

    spot: str
    channel: str
    n_points: int
    n_presses: int
    over: str
    least: float
    largest: float
    unit: str
    largest_std: Number


class LimbRow(Closed):
    """The mesh of a spot."""

    spot: str
    n_nodes: int
    n_cells: int
    regions: list[str]
    node_sets: dict[str, int]
    remarks: list[str]
    warnings: list[str]


class FindingOutput(Closed):
    """One thing that was looked at; ``level`` is fine, note or wrong."""

    topic: str
    what: str
    found: str
    level: str
    advice: str


class TemplateRow(Closed):
    """A ready study."""

    name: str
    plugin: str
    summary: str


class InitOutput(Closed):
    """A ready study that was copied."""

    study: str
    folder: str


class NewPluginOutput(Closed):
    """A new plugin: its folder, and the files in it."""

    kind: str
    name: str
    folder: str
    files: list[str]


OUTPUTS: Mapping[str, Any] = MappingProxyType(
    {
        "init": list[TemplateRow] | InitOutput,
        "check": CheckOutput,
        "plugins": dict[str, list[dict[str, Any]]],
        "new-plugin": NewPluginOutput,
        "doctor": list[FindingOutput],
        "run": RunOutput,
        "status": StatusOutput,
        "synthesise": SynthesiseOutput,
        "experiment": list[ExperimentRow],
        "limb": list[LimbRow],
        "simulate": dict[str, int],
    }
)
"""What each of the core's commands prints with ``--json``."""


KINDS: Mapping[Any, type] = MappingProxyType(
    {pl.String: str, pl.Boolean: bool, pl.Int64: int, pl.Float64: float}
)
"""Types of the values of columns."""


def _row_of(table: StageTable) -> Any:  # noqa: ANN401 - a type
    """Type of a row: its declared columns, each with its sentence and unit, and any others."""
    columns = {
        name: Annotated[KINDS[column.kind] | None, Field(description=str(column))]
        for name, column in table.columns.items()
    }
    row = TypedDict("Row", columns, total=False)  # type: ignore[misc]
    return with_config(ConfigDict(extra="allow", title=table.text))(row)


def output_of(command: str, stages: Mapping[str, type[Component]], others: Mapping[str, Any]) -> Any:  # noqa: ANN401 - a type
    """Type of what a command prints with ``--json``: of a stage its tables, and warnings."""
    if command in OUTPUTS or command in others:
        return OUTPUTS.get(command) or others[command]
    declared: Mapping[str, StageTable] = stages[command].tables  # type: ignore[attr-defined]
    tables: dict[str, Any] = {name: list[_row_of(table)] for name, table in declared.items()}  # type: ignore[misc]
    named = TypedDict("StageOutput", tables | {"warnings": list[str]})  # type: ignore[misc]
    return with_config(ConfigDict(extra="forbid"))(named)


def schema(
    command: str, stages: Mapping[str, type[Component]], others: Mapping[str, Any] = MappingProxyType({})
) -> dict[str, Any]:
    """JSON schema of what a command prints with ``--json``; ``others`` has the types of plugins' commands."""
    made = TypeAdapter(output_of(command, stages, others)).json_schema()
    dialect = "https://json-schema.org/draft/2020-12/schema"
    return {"$schema": dialect, "$id": f"urn:palpate:{command}:{VERSION}", **made}
