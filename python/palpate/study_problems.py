"""Everything that is wrong with a study file, gathered so that it is told at once."""

import contextlib
import functools
import operator
import types
import typing
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from palpate.errors import PalpateError, StudyError
from palpate.plugins import suggestion
from palpate.study_lines import Key, KeyLines, dotted
from palpate.study_model import StudyFile, Tables

T = TypeVar("T")


class Problems:
    """Collects messages, each with file, line and key.

    Parameters
    ----------
    path : Path
        The study file, as the user named it.
    lines : KeyLines
    """

    def __init__(self, path: Path, lines: KeyLines) -> None:
        self._path = path
        self._lines = lines
        self._found: list[tuple[int, str]] = []

    def add(self, key: Key, message: str) -> None:
        """Note that ``key`` is wrong; the message says how, and what to do."""
        line = self._lines.line(key)
        where = f"{self._path}:{line}: " + (f"{dotted(key)}: " if key else "")
        if (line, where + message) not in self._found:
            self._found.append((line, where + message))

    @contextlib.contextmanager
    def at(self, *key: str | int) -> Iterator[None]:
        """Note under ``key`` the mistake, if any, that the block runs into."""
        try:
            yield
        except (PalpateError, ValueError) as error:
            self.add(key, str(error))

    def add_invalid(self, key: Key, error: ValidationError, model: object) -> None:
        """Note everything that pydantic found when it read ``model`` at ``key``."""
        for detail in error.errors(include_url=False):
            parts = tuple(part for part in detail["loc"] if part != "[key]")
            unknown = detail["type"] == "extra_forbidden"
            known = _keys(model, parts[:-1]) if unknown else ()
            self.add((*key, *parts), _message(detail, known))

    def raise_if_any(self) -> None:
        """Raise a StudyError that lists everything found, in the order of the file.

        Raises
        ------
        StudyError
        """
        if self._found:
            raise StudyError("\n".join(message for _, message in sorted(self._found)))


def _message(detail: ErrorDetails, known: tuple[str, ...]) -> str:
    given, context = detail["input"], detail.get("ctx", {})
    match detail["type"]:
        case "missing":
            return f"missing; add {detail['loc'][-1]} = …"
        case "extra_forbidden":
            name = str(detail["loc"][-1])
            return f"unknown key{suggestion(name, known)} (known: {', '.join(known)})"
        case "value_error":
            return str(context["error"])
        case "enum" | "literal_error":
            choices = str(context["expected"])
            names = choices.replace("'", "").replace(" or ", ", ").split(", ")
            return f"{given!r} is not one of {choices}{suggestion(str(given), names)}"
        case "string_pattern_mismatch":
            return f"{given!r} is not a name; use letters, digits, - and _"
        case _:
            return f"{given!r}: {detail['msg']}"


def _keys(annotation: object, parts: tuple[str | int, ...]) -> tuple[str, ...]:
    """Keys that the model at ``parts`` inside ``annotation`` has."""
    try:
        return tuple(_model(functools.reduce(_step, parts, annotation)).model_fields)
    except (LookupError, TypeError):
        return ()


def _step(annotation: object, part: str | int) -> object:
    inner = _plain(annotation)
    if isinstance(inner, type) and issubclass(inner, BaseModel):
        return inner.model_fields[str(part)].annotation
    return typing.get_args(inner)[-1]


def _model(annotation: object) -> type[BaseModel]:
    inner = _plain(annotation)
    if isinstance(inner, type) and issubclass(inner, BaseModel):
        return inner
    raise TypeError(annotation)


def _plain(annotation: object) -> object:
    """Strip ``Annotated`` and ``| None``."""
    if typing.get_origin(annotation) is typing.Annotated:
        return _plain(typing.get_args(annotation)[0])
    if typing.get_origin(annotation) in (types.UnionType, typing.Union):
        kept = [arg for arg in typing.get_args(annotation) if arg is not type(None)]
        return _plain(kept[0]) if len(kept) == 1 else functools.reduce(operator.or_, kept)
    return annotation


def read_tables(raw: Mapping[str, Any], problems: Problems) -> Tables:
    """Check the shape of a study file, table by table, so that one bad table hides no other."""
    valid: dict[str, Any] = {}
    for name, field in StudyFile.model_fields.items():
        if name not in raw:
            if field.is_required():
                problems.add((), f"missing table [{name}]; add it")
            elif field.default is not None:
                valid[name] = field.default
            continue
        try:
            table: Any = Annotated[field.annotation, field]
            valid[name] = TypeAdapter(table).validate_python(raw[name])
        except ValidationError as error:
            problems.add_invalid((name,), error, field.annotation)
    for name in raw.keys() - StudyFile.model_fields.keys():
        known = tuple(StudyFile.model_fields)
        problems.add((name,), f"unknown table{suggestion(name, known)} (known: {', '.join(known)})")
    return Tables(written=frozenset(raw), **valid)


def settled(value: T | None) -> T:
    """Give back a part that no problem was found with."""
    assert value is not None, "a part that is missing must have been reported as a problem"
    return value


def choice(name: str, known: Mapping[str, object], noun: str) -> str:
    """Message for a name that is not among ``known``."""
    return f"no {noun} '{name}'{suggestion(name, known)} (known: {', '.join(known) or 'none'})"
