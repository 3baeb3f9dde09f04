"""What a loader finds in a file that no study describes yet."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectedTable:
    """A table of text, to be shown."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Inspection:
    """Contents of a file, and how a study might read it.

    Parameters
    ----------
    tables : tuple of InspectedTable
        For a person: channels, units, rates, gaps.
    findings : tuple of str
        What is wrong or doubtful, each a sentence.
    study_text : str
        Tables of study.toml that would read the file; empty if there are none.
    record : mapping
        The same for a script; JSON-able.
    """

    tables: tuple[InspectedTable, ...] = ()
    findings: tuple[str, ...] = ()
    study_text: str = ""
    record: Mapping[str, Any] = field(default_factory=dict)
