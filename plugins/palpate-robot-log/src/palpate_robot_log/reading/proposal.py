"""Settings by which a loader may read a file: for a person to look over, and to be pasted into study.toml."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from pydantic import ValidationError

from palpate.api import CurveError, Settings
from palpate.api.files import ASKED, toml_value


class Entry(NamedTuple):
    """Setting of a loader, and what a person should know of it."""

    table: str  # below the loader's settings, such as channels; empty for one of the settings themselves
    key: str
    value: object
    remark: str = ""
    above: tuple[str, ...] = ()
    others: tuple[object, ...] = ()  # what the value may be instead
    is_open: bool = False  # until a person has filled it in

    def lines(self) -> Iterator[str]:
        """Lines of study.toml: all but the setting itself are comments."""
        remark = f"  # {self.remark}" if self.remark else ""
        yield from (f"# {each}" for each in self.above)
        yield f"{'# ' * self.is_open}{self.key} = {toml_value(self.value)}{remark}"
        yield from (f"# or {self.key} = {toml_value(other)}" for other in self.others)


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """Loader of a file and its settings; questions where the names in the file leave some open."""

    loader: str = ""
    entries: tuple[Entry, ...] = ()
    test: str = ""  # channel of a homogeneous test; empty for a press
    remarks: tuple[str, ...] = ()
    questions: tuple[str, ...] = ()  # each is open until a person answers it in the settings

    @property
    def settings(self) -> dict[str, Any]:
        """Settings that are not open, in their tables."""
        settings: dict[str, Any] = {}
        for entry in (each for each in self.entries if not each.is_open):
            table = settings
            for name in entry.table.split(".") if entry.table else ():
                table = table.setdefault(name, {})
            table[entry.key] = entry.value
        return settings

    def text(self, file: str) -> str:
        """Tables of study.toml; in comments where a question is open that no open entry shows."""
        tables = {"experiment": [f'loader = "{self.loader}"']}
        for entry in self.entries:
            name = f"experiment.settings.{entry.table}".removesuffix(".")
            tables.setdefault(name, []).extend(entry.lines())
        text = "\n".join("\n".join([f"[{name}]", *lines, ""]) for name, lines in tables.items())
        if self.test:
            measured = f"[[spot]] measured = {{ {self.test} = {toml_value(file)} }}"
            text = f"# {measured}: the key is the mode of the test\n{text}"
        if not self.questions or any(entry.is_open for entry in self.entries):
            return text
        asked = [f"{ASKED}: {question}" for question in self.questions]
        return "".join(f"# {line}".rstrip() + "\n" for line in [*asked, *text.splitlines()])


def validated(kind: type[Settings], settings: Mapping[str, Any]) -> Any:  # noqa: ANN401 - of the kind
    """Settings of a kind; a CurveError with all that is wrong with them."""
    try:
        return kind.model_validate(settings)
    except ValidationError as error:
        raise CurveError("; ".join(str(one["msg"]) for one in error.errors())) from None
