"""What a study changed since its run directory was written, and what stays valid of it."""

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate.run.ledger import Ledger
from palpate.run.trust import IN_KEYS

_ABOUT_NOTHING = ("measured", "study_file", "plugin_files", "trusted", "fit_start")
"""Parts of a manifest that are no part of a study: they follow from others, or are the folder's own."""

_CODE = "fingerprints."
"""How the keys of components begin."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """One key of the manifest, and what it was and is; None where it was or is not there."""

    key: str
    before: str | None
    after: str | None

    def __str__(self) -> str:
        difference = f"{self.before or 'absent'} → {self.after or 'absent'}"
        if self.component:
            return f"{self.component}: code changed, {difference}".replace('"', "")
        return f"{self.key}: {difference}"

    @property
    def component(self) -> str:
        """Component whose code has changed, as ``kind:name``; empty where something else has."""
        return self.key.removeprefix(_CODE) if self.key.startswith(_CODE) else ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Changed:
    """How a study differs from the one that a run directory was written for."""

    changes: Sequence[Change]
    n_finished: int
    """Finished simulations of the earlier study."""
    n_valid: int
    """Those of them that are simulations of this study too."""

    @property
    def trustable(self) -> tuple[str, ...]:
        """Components whose code decides simulations, has changed, and has earlier results."""
        return tuple(c.component for c in self.changes if c.component.startswith(IN_KEYS) and c.before)

    @property
    def loses(self) -> bool:
        """Whether finished simulations would not be used any more; none is ever removed."""
        return bool(self.changes) and self.n_valid < self.n_finished


def changed(
    ledger: Ledger, before: Mapping[str, Any], after: Mapping[str, Any], keys: Sequence[str]
) -> Changed:
    """Compare a study, of manifest ``after`` and simulations ``keys``, with what a run directory holds."""
    finished = ledger.finished_of_last_sweep()
    n_valid = len(finished & set(keys))
    return Changed(changes=differences(before, after), n_finished=len(finished), n_valid=n_valid)


def differences(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[Change]:
    """Differences of two manifests, key by key, in the order of the later one."""
    # Their content shows key by key, and what they compute as a component.
    shown = {Path(file).name for file in (before["study_file"], *before["plugin_files"])}
    old, new = (_flat(_plain(each, shown)) for each in (before, after))
    return [
        Change(key=key, before=old.get(key), after=new.get(key))
        for key in dict.fromkeys([*new, *old])
        if old.get(key) != new.get(key)
    ]


def _plain(manifest: Mapping[str, Any], shown: Collection[str]) -> dict[str, Any]:
    kept = {key: value for key, value in manifest.items() if key not in _ABOUT_NOTHING}
    plain: dict[str, Any] = json.loads(json.dumps(kept))
    # Enough digits of a file's hash for people.
    plain["inputs"] = {k: v[:12] for k, v in plain["inputs"].items() if Path(k).name not in shown}
    return plain


def _flat(value: object, key: str = "") -> dict[str, str]:
    """Leaves of a tree by their dotted key; a list of things with a name goes by these names."""
    if isinstance(value, list) and value and all(isinstance(item, dict) for item in value):
        value = {item.get("region") or item.get("name") or i: item for i, item in enumerate(value)}
    if not isinstance(value, dict):
        return {key: json.dumps(value, ensure_ascii=False)}
    flat: dict[str, str] = {}
    for name, item in value.items():
        flat |= _flat(item, f"{key}.{name}" if key else str(name))
    return flat
