"""Everything that is wrong with a study file, gathered to be reported at once."""

import contextlib
import functools
import operator
import reprlib
import types
import typing
from collections.abc import Container, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from palpate.errors import PalpateError, StudyError
from palpate.plugins.registry import suggestion
from palpate.study.source_positions import Key, KeyLines, dotted

T = TypeVar("T")
ModelT = TypeVar("ModelT", bound=BaseModel)


class Problems:
    """Collects messages about a study file and its content, each with file, line and key.

    Keys that were ``given`` on the command line are named as its options.
    """

    def __init__(
        self, path: Path, lines: KeyLines, raw: Mapping[str, Any], given: Container[str | int] = ()
    ) -> None:
        self._path = path
        self._lines = lines
        self._raw = raw
        self._given = given
        self._found: list[tuple[int, str]] = []

    def add(self, key: Key, message: str) -> None:
        """Note that ``key`` is wrong; the message states how, and what to do."""
        found = (self._lines.line(key), f"{self.place(key)}: {message}")
        if found not in self._found:
            self._found.append(found)

    def place(self, key: Key) -> str:
        """File, line and name of a key, as messages start."""
        if key and key[0] in self._given:
            return f"--{' '.join(filter(None, (str(key[0]), dotted(key[1:]))))}"
        return f"{self._path}:{self._lines.line(key)}" + (f": {self._name(key)}" if key else "")

    def _name(self, key: Key) -> str:
        """Key as the user knows it: a spot by its name."""
        match key, self._raw.get("spot"):
            case ("spot", int(index), *rest), [*tables] if index < len(tables):
                match tables[index]:
                    case {"name": str(name)}:
                        return ", ".join(filter(None, (f"spot {name!r}", dotted(tuple(rest)))))
        return dotted(key)

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
            # Names of validators, such as literal['auto'], are no keys.
            parts = tuple(part for part in detail["loc"] if not str(part).endswith("]"))
            unknown = detail["type"] == "extra_forbidden"
            known = _keys(model, parts[:-1]) if unknown else ()
            message = _message(detail, known)
            if detail["type"] == "missing" and key[:2] == ("experiment", "settings"):
                message = "missing; `palpate experiment inspect FILE` prints the tables that read a file"
            self.add((*key, *parts), message)

    def validated(
        self, model: type[ModelT], values: Mapping[str, Any], context: Mapping[str, Any] | None = None
    ) -> ModelT:
        """Whole file as ``model``, whose validators find ``context``; a StudyError with all that is wrong."""
        try:
            return model.model_validate(values, context=context)
        except ValidationError as error:
            self.add_invalid((), error, model)
            self.raise_if_any()
            raise

    def raise_if_any(self) -> None:
        """Raise a StudyError that lists everything found, in the order of the file."""
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
            return f"{_shortened(given)} is not one of {choices}{suggestion(str(given), names)}"
        case "string_pattern_mismatch":
            return f"{_shortened(given)} is not a name; use letters, digits, - and _"
        case "float_type" if detail["loc"][-1] == "friction" and isinstance(given, dict):
            return "a range; write one number here, and the range as friction under [fit.searched]"
        case kind:
            sentence = _SENTENCES[kind].format(**context) if kind in _SENTENCES else detail["msg"]
            return f"{_shortened(given)}: {sentence[0].lower()}{sentence[1:]}"


_SENTENCES: Mapping[str, str] = types.MappingProxyType(
    {
        "int_type": "not a whole number",
        "int_from_float": "not a whole number",
        "float_type": "not a number",
        "finite_number": "not a finite number",
        "string_type": "not a text; put it in quotation marks",
        "bool_type": "not true or false",
        "list_type": "not a list; write [ … ]",
        "tuple_type": "not a list; write [ … ]",
        "dict_type": "not a table; write {{ … }}",
        "model_type": "not a table; write {{ … }}",
        "model_attributes_type": "not a table; write {{ … }}",
        "greater_than": "must be greater than {gt}",
        "greater_than_equal": "must be greater than or equal to {ge}",
        "less_than": "must be less than {lt}",
        "less_than_equal": "must be less than or equal to {le}",
        "too_short": "{actual_length} of them; give at least {min_length}",
        "too_long": "more than {max_length} of them; give at most {max_length}",
        "string_too_short": "give at least {min_length} characters",
        "string_too_long": "give at most {max_length} characters",
    }
)
"""What is wrong, by pydantic's name for it."""


def _shortened(given: object) -> str:
    return text if len(text := reprlib.repr(given)) <= 60 else f"{text[:59]}…"


def _keys(annotation: object, parts: tuple[str | int, ...]) -> tuple[str, ...]:
    """Keys that the model at ``parts`` inside ``annotation`` has."""
    try:
        fields = _fields(functools.reduce(_step, parts, annotation))
    except LookupError:
        return ()
    return tuple(fields or ())


def _step(annotation: object, part: str | int) -> object:
    fields = _fields(annotation)
    return typing.get_args(_plain(annotation))[-1] if fields is None else fields[str(part)].annotation


def _fields(annotation: object) -> dict[str, FieldInfo] | None:
    """Fields of a model; None for another annotation."""
    inner = _plain(annotation)
    return inner.model_fields if isinstance(inner, type) and issubclass(inner, BaseModel) else None


def _plain(annotation: object) -> object:
    """Strip ``Annotated`` and ``| None``."""
    if typing.get_origin(annotation) is typing.Annotated:
        return _plain(typing.get_args(annotation)[0])
    if typing.get_origin(annotation) in (types.UnionType, typing.Union):
        kept = [arg for arg in typing.get_args(annotation) if arg is not type(None)]
        return _plain(kept[0]) if len(kept) == 1 else functools.reduce(operator.or_, kept)
    return annotation


def require(value: T | None) -> T:
    """Give back a part that no problem was found with."""
    assert value is not None, "a part that is missing must have been reported as a problem"
    return value


def choice(name: str, known: Mapping[str, object], noun: str) -> str:
    """Message for a name that is not among ``known``."""
    return f"no {noun} '{name}'{suggestion(name, known)} (known: {', '.join(known) or 'none'})"
