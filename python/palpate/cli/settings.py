"""Settings of a component as rows, with dotted names for nested tables."""

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel

Schema = Mapping[str, Any]


def settings_rows(model: type[BaseModel]) -> list[dict[str, Any]]:
    """One row for each setting: name, type, default, required, description.

    ``onset.exponent`` is a key of the table ``onset``; ``channels.<name>.abscissa`` one of a table
    whose name the user chooses. A table has no default of its own where its rows have theirs.
    """
    schema = model.model_json_schema()
    rows = list(_rows(schema, schema.get("$defs", {}), ""))
    for row in rows:
        if field := model.model_fields.get(row["name"]):
            default = None if field.is_required() else field.get_default(call_default_factory=True)
            row["default"] = None if isinstance(default, BaseModel) else _plain(default)
    return rows


def _rows(table: Schema, tables: Mapping[str, Schema], prefix: str) -> Iterator[dict[str, Any]]:
    for name, setting in table.get("properties", {}).items():
        default = setting.get("default")
        yield {
            "name": prefix + name,
            "type": _type(setting),
            "default": None if isinstance(default, Mapping) else default,
            "required": name in table.get("required", ()),
            "description": setting.get("description") or _table(setting, tables).get("description", ""),
        }
        chosen = ".<name>" if "additionalProperties" in setting else ""
        yield from _rows(_table(setting, tables), tables, f"{prefix}{name}{chosen}.")


def _table(setting: Schema, tables: Mapping[str, Schema]) -> Schema:
    """Schema of the table that a setting may be; empty where it is none."""
    if "$ref" in setting:
        return tables[setting["$ref"].rpartition("/")[2]]
    choices = [*setting.get("anyOf", ()), setting.get("additionalProperties")]
    return next(
        (found for each in choices if isinstance(each, Mapping) and (found := _table(each, tables))), {}
    )


def _type(schema: Schema) -> str:
    if "enum" in schema:
        return " | ".join(map(repr, schema["enum"]))
    if "anyOf" in schema:
        return " | ".join(map(_type, schema["anyOf"]))
    if "examples" in schema:
        return f"quantity, such as '{schema['examples'][0]}'"
    kinds = schema.get("type", "any")
    return "table" if "$ref" in schema else kinds if isinstance(kinds, str) else " | ".join(kinds)


def _plain(value: Any) -> Any:  # noqa: ANN401 -- a default of any kind
    """Nested tables as what a study would say of them."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", exclude_defaults=True)
    return {key: _plain(each) for key, each in value.items()} if isinstance(value, Mapping) else value
