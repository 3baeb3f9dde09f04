"""The tables of one study file, as far as they are valid."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

from pydantic import TypeAdapter, ValidationError

from palpate.plugins.registry import suggestion
from palpate.study.model import (
    BudgetTable,
    ExecutorTable,
    ExperimentTable,
    FitTable,
    LimbTable,
    ProtocolTable,
    RegionTable,
    SamplingTable,
    ScenarioTable,
    ScoringTable,
    SelectionTable,
    SolverTable,
    SpotTable,
    StudyFile,
    StudyTable,
)
from palpate.study.problems import Problems


@dataclass(frozen=True, slots=True, kw_only=True)
class Tables:
    """The tables of one file; None or empty where a table is absent or not valid.

    ``written`` names the tables that the file has, valid or not.
    """

    written: frozenset[str]
    study: StudyTable | None = None
    spot: Sequence[SpotTable] = ()
    experiment: ExperimentTable | None = None
    limb: LimbTable | None = None
    protocol: ProtocolTable | None = None
    region: Mapping[str, RegionTable] = field(default_factory=dict)
    sampling: SamplingTable | None = None
    solver: SolverTable | None = None
    executor: ExecutorTable | None = None
    scoring: ScoringTable | None = None
    selection: SelectionTable | None = None
    fit: FitTable | None = None
    budget: BudgetTable | None = None
    scenario: Sequence[ScenarioTable] = ()
    stages: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    truth: Mapping[str, Any] = field(default_factory=dict)


def read_tables(raw: Mapping[str, Any], problems: Problems) -> Tables:
    """Check the shape of a study file, table by table, so that one bad table hides no other."""
    valid: dict[str, Any] = {}
    for name, declared in StudyFile.model_fields.items():
        if name not in raw:
            if declared.is_required():
                problems.add((), f"missing table [{name}]; add it")
            elif declared.default is not None:
                valid[name] = declared.default
            continue
        try:
            table: Any = Annotated[declared.annotation, declared]
            valid[name] = TypeAdapter(table).validate_python(raw[name])
        except ValidationError as error:
            problems.add_invalid((name,), error, declared.annotation)
    for name in raw.keys() - StudyFile.model_fields.keys():
        known = tuple(StudyFile.model_fields)
        problems.add((name,), f"unknown table{suggestion(name, known)} (known: {', '.join(known)})")
    return Tables(written=frozenset(raw), **valid)
