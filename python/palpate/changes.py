"""What a study changed since its run directory was written, and what stays valid of it."""

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from palpate.ledger import Ledger

_ABOUT_NOTHING = ("measured", "inputs", "study_file", "plugin_files")
"""Parts of a manifest whose changes show elsewhere, if they matter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """One key of the manifest, and what it was and is; None where it was or is not there."""

    key: str
    before: str | None
    after: str | None

    def __str__(self) -> str:
        return f"{self.key}: {self.before or 'absent'} → {self.after or 'absent'}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Changed:
    """How a study differs from the one that a run directory was written for.

    Parameters
    ----------
    n_finished : int
        Simulations of that one that are finished.
    n_valid : int
        Those of them that are simulations of this one too.
    """

    changes: Sequence[Change]
    n_finished: int
    n_valid: int

    @property
    def loses(self) -> bool:
        """Whether finished simulations would not be used any more; none is ever removed."""
        return bool(self.changes) and self.n_valid < self.n_finished


def changed(
    ledger: Ledger, before: Mapping[str, Any], after: Mapping[str, Any], keys: Sequence[str]
) -> Changed:
    """Compare a study with what a run directory holds.

    Parameters
    ----------
    ledger : Ledger
    before, after : mapping
        Manifests.
    keys : sequence of str
        Keys of the simulations that the study asks for.
    """
    finished = ledger.finished_of_last_sweep()
    n_valid = len(finished & set(keys))
    changes = differences(before, after)
    if not changes and n_valid < len(finished):  # then a file matters: of a mesh, or what a test followed
        changes = differences({"inputs": before.get("inputs")}, {"inputs": after["inputs"]}, left_out=())
    return Changed(changes=changes, n_finished=len(finished), n_valid=n_valid)


def differences(
    before: Mapping[str, Any], after: Mapping[str, Any], left_out: Collection[str] = _ABOUT_NOTHING
) -> list[Change]:
    """Differences of two manifests, key by key, in the order of the later one."""
    old = _flat(_plain(before, left_out))
    new = _flat(_plain(after, left_out))
    return [
        Change(key=key, before=old.get(key), after=new.get(key))
        for key in dict.fromkeys([*new, *old])
        if old.get(key) != new.get(key)
    ]


def _plain(manifest: Mapping[str, Any], left_out: Collection[str]) -> dict[str, Any]:
    kept = {key: value for key, value in manifest.items() if key not in left_out}
    plain: dict[str, Any] = json.loads(json.dumps(kept))
    return plain


def _flat(value: object, key: str = "") -> dict[str, str]:
    """Leaves of a tree by their dotted key; a list of things with a name goes by these names."""
    if isinstance(value, dict):
        items = value.items()
    elif isinstance(value, list) and value and all(isinstance(item, dict) for item in value):
        items = {
            str(item.get("region") or item.get("name") or i): item for i, item in enumerate(value)
        }.items()
    else:
        return {key: json.dumps(value, ensure_ascii=False)}
    flat: dict[str, str] = {}
    for name, item in items:
        flat.update(_flat(item, f"{key}.{name}" if key else str(name)))
    return flat
