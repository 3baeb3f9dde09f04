"""The JSON schema of study.toml, for editors."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from pydantic import BaseModel

from palpate.study.model import (
    ExecutorTable,
    ExperimentTable,
    FitTable,
    LimbTable,
    ProtocolTable,
    RegionTable,
    SamplingTable,
    ScoringTable,
    SolverTable,
    StudyFile,
    Table,
)

NAMED_BY: Mapping[str, tuple[type[Table], str, str]] = MappingProxyType(
    {
        "loaders": (ExperimentTable, "loader", "settings"),
        "limb_sources": (LimbTable, "source", "settings"),
        "motions": (ProtocolTable, "motion", ""),
        "materials": (RegionTable, "material", "settings"),
        "samplers": (SamplingTable, "sampler", "settings"),
        "solvers": (SolverTable, "name", "settings"),
        "scores": (ScoringTable, "score", ""),
        "executors": (ExecutorTable, "name", "settings"),
        "searches": (FitTable, "search", "settings"),
        "parametrisations": (FitTable, "parametrisation", "searched"),
    }
)
"""Table, key that names a component of a kind there, and key of its settings; empty: next to the name."""


def json_schema(settings: Mapping[str, Mapping[str, type[BaseModel]]] | None = None) -> dict[str, Any]:
    """Describe every table, with the ``settings`` of components by kind (a key of ``NAMED_BY``) and name."""
    schema = StudyFile.model_json_schema()
    for kind, models in (settings or {}).items():
        table, key, settings_key = NAMED_BY[kind]
        choices = schema["$defs"][table.__name__].setdefault("allOf", [])
        for name, model in models.items():
            own = model.model_json_schema(ref_template=f"#/$defs/{kind}.{name}.{{model}}")
            schema["$defs"] |= {f"{kind}.{name}.{k}": each for k, each in own.pop("$defs", {}).items()}
            own.pop("required", None)  # a spot may give what [experiment] leaves out
            named: dict[str, Any] = {"properties": {key: {"const": name}}}
            if table.model_fields[key].default != name:
                named["required"] = [key]
            within = own | {"properties": dict.fromkeys(table.model_fields, True) | own.get("properties", {})}
            then = {"properties": {settings_key: own}} if settings_key else within
            choices.append({"if": named, "then": then})
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
