"""``manifest.json``: what the numbers of a run depended on."""

import contextlib
import hashlib
import importlib.metadata
import json
import platform
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, NotRequired

import numpy as np
from pydantic import TypeAdapter, ValidationError
from typing_extensions import TypedDict

from palpate.domain import Channel, HomogeneousTests, Indentation, Protocol, channel_of
from palpate.domain.component import Component
from palpate.errors import StudyError
from palpate.executors.answers import plain
from palpate.fingerprints import distributions
from palpate.plugins.guard import answering_for
from palpate.plugins.registry import suggestion
from palpate.plugins.score import ScoringRules
from palpate.run.keys import identity
from palpate.run.ledger import Ledger
from palpate.study.reading import Study, StudySpot, relative
from palpate.study.spots import mesh_note


def manifest(study: Study, channels: Mapping[str, Channel]) -> dict[str, Any]:
    """Describe what the numbers of a run depended on."""
    weighted = {channel_of(name) for scenario in study.scenarios for name in scenario.weights}
    return {
        "study": study.name,
        "description": study.description,
        "data": study.data,
        "units": "mm, N, MPa, N·mm, degrees",
        "versions": versions(study),
        "inputs": _hashes(study),
        "fingerprints": fingerprints(study),
        "loader": _component(study.loader),
        "limb_source": _component(study.limb_source) if study.limb_source else None,
        "solver": _component(study.solver),
        "protocol": _protocol(study.protocol),
        "spots": {spot.spot.name: _spot(study, spot) for spot in study.spots},
        "materials": [
            {
                "region": region.region,
                **_component(region.material),
                "convention": region.convention,
                "searched": [finite(asdict(p)) for p in region.columns],
                "fixed": plain(region.fixed),
                "tied": {name: tie.plain for name, tie in region.tied.items()},
            }
            for region in study.space.regions
        ],
        "sampler": _component(study.sampler),
        "n_sets": study.n_sets,
        "n_total": study.n_total,
        "max_draws": study.max_draws,
        "seed": study.seed,
        "filters": [_component(keep) for keep in study.filters],
        "scoring": _scoring(study.scoring),
        "scenarios": {scenario.name: dict(scenario.weights) for scenario in study.scenarios},
        "generalise_by": study.generalise_by,
        "search": _component(study.search),
        "parametrisation": _component(study.parametrisation),
        "noise": study.noise,
        "fine_runs": study.fine_runs,
        "fine_nodes": study.fine_nodes,
        "budget": study.budget.model_dump(mode="json"),
        "truth": plain(study.truth),
        "channels": {name: _channel(channel) for name, channel in channels.items() if name in weighted},
    }


def versions(study: Study) -> dict[str, str]:
    """Versions of everything that took part."""
    with answering_for(study.solver, "asking for its version"):
        solver = study.solver.version()
    found = {"python": platform.python_version(), f"solver {study.solver.name}": solver}
    for name in ("palpate", "numpy", "scipy", "jax", "polars", "matplotlib"):
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            found[name] = importlib.metadata.version(name)
    return found | dict(sorted(distributions().values()))


def _hashes(study: Study) -> dict[str, str]:
    files = [study.file, *study.plugin_files]
    for spot in study.spots:
        files += [*spot.files, *spot.meshes.values()]
    return {
        relative(file, study.folder): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in files
        if file.is_file()
    }


def _channel(channel: Channel) -> dict[str, Any]:
    found = _fields(channel, ("mirrored", "needs", "observe", "mesh")) | {"mesh": asdict(channel.mesh)}
    return found | ({"needs": list(channel.needs)} if channel.needs else {})


def _component(component: Component) -> dict[str, Any]:
    return {"name": component.name, "settings": component.settings.model_dump(mode="json")}


def _scoring(rules: ScoringRules) -> dict[str, Any]:
    """The table [scoring] with all its defaults."""
    settings = rules.score.settings.model_dump(mode="json")
    return {"score": rules.score.name, **settings, **_fields(rules, ("score",))}


def _spot(study: Study, spot: StudySpot) -> dict[str, Any]:
    """Files of a spot by channel, and what is done and read there otherwise than elsewhere."""
    files = {
        channel or "": [relative(path, study.folder) for path in paths]
        for channel, paths in spot.measured.items()
    }
    own = {"state": spot.state, "layers_mm": {name: list(mm) for name, mm in spot.layers_mm.items()}}
    found: dict[str, Any] = {"measured": files, **{key: value for key, value in own.items() if value}}
    if spot.protocol is not None:
        found["protocol"] = _protocol(spot.protocol)
    if spot.loader is not None:
        found["loader"] = _component(spot.loader)
    if spot.fine_edge_mm != 0.0:
        found["fine_edge_mm"] = spot.fine_edge_mm
    for key, mesh in (("mesh", spot.mesh), ("fine_mesh", spot.fine_mesh)):
        if mesh is not None and (note := mesh_note(mesh)) is not None:
            found[key] = note
    return found


def _protocol(protocol: Protocol | None) -> dict[str, Any]:
    if isinstance(protocol, Indentation):
        # Only other motions than a press and twist have these.
        unused = [name for name in ("lateral", "loads", "time_s") if getattr(protocol, name) is None]
        return {
            "kind": "indentation",
            "indenter": _component(protocol.indenter),
            "path_depth_mm_rotation_deg": protocol.path.tolist(),
            **plain(_fields(protocol, ("indenter", "path", *unused))),
        }
    if protocol is None or type(protocol) is HomogeneousTests:
        return {"kind": "homogeneous tests"}
    return {"kind": type(protocol).__qualname__, **plain(_fields(protocol))}


def _fields(value: Any, left_out: tuple[str, ...] = ()) -> dict[str, Any]:  # noqa: ANN401 - any dataclass
    return {field.name: getattr(value, field.name) for field in fields(value) if field.name not in left_out}


def finite(parameter: dict[str, Any]) -> dict[str, Any]:
    """Make a parameter fit for JSON, which has no infinity: no limit is null."""
    return parameter | {
        k: None for k in ("physical_lower", "physical_upper") if not np.isfinite(parameter[k])
    }


def infinite(parameter: dict[str, Any]) -> dict[str, Any]:
    """Make a parameter of what :func:`finite` made: the inverse."""
    missing = {"physical_lower": -np.inf, "physical_upper": np.inf}
    return parameter | {k: v for k, v in missing.items() if parameter[k] is None}


class _ReadAgain(TypedDict):
    """Entries of the manifest that are read again."""

    study: str
    study_file: str
    kept_study: NotRequired[str]
    plugin_files: list[str]
    inputs: dict[str, str]
    fingerprints: dict[str, str]
    trusted: dict[str, dict[str, list[Any]]]
    n_total: int
    fit_start: NotRequired[dict[str, float]]


def checked_manifest(text: str) -> dict[str, Any]:
    """Parse a manifest; a ValueError where it is not as palpate writes it."""
    try:
        TypeAdapter(_ReadAgain).validate_json(text, strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        raise ValueError(f"'{'.'.join(map(str, first['loc']))}': {first['msg']}") from None
    return json.loads(text)


IN_KEYS = ("material:", "solver:")
"""How the components begin whose code decides a simulation."""


def fingerprints(study: Study) -> dict[str, str]:
    """Fingerprint of each component that decides a number, by ``kind:name``."""
    loaders = [study.loader, *(spot.loader for spot in study.spots if spot.loader)]
    components: dict[str, list[Component]] = {
        "material": [region.material for region in study.space.regions],
        "solver": [study.solver],
        "sampler": [study.sampler],
        "score": [study.scoring.score],
        "filter": list(study.filters),
        "loader": list(loaders),
        "limb_source": [study.limb_source] if study.limb_source else [],
    }
    found: dict[str, dict[str, None]] = {}
    for kind, listed in components.items():
        for component in listed:
            found.setdefault(f"{kind}:{component.name}", {})[identity(component)] = None
    return {name: " | ".join(each) for name, each in found.items()}


def with_trusted_code(study: Study, manifest: Mapping[str, Any], names: Collection[str] = ()) -> Study:
    """The study with the results that its run directory accepts, and from now on results of ``names``.

    ``manifest`` is empty for a new run. A StudyError where the study has no component of such a name,
    ``material:NAME`` or ``solver:NAME``, or the run directory no results of it.
    """
    now = {name: text for name, text in fingerprints(study).items() if name.startswith(IN_KEYS)}
    earlier, accepted = manifest.get("fingerprints", {}), manifest.get("trusted", {})
    for name in names:
        if name not in now:
            raise StudyError(
                f"--trust {name}: no such component{suggestion(name, now)} (known: {', '.join(now)})"
            )
        if name not in earlier:
            raise StudyError(
                f"--trust {name}: the run directory holds no results of it; leave the option out"
            )
    trusted = {}
    for name, text in now.items():
        wanted = earlier[name] if name in names else text
        # Code that the results were made with which count as those of the wanted fingerprint.
        origins = (origin for origin, others in accepted.get(name, {}).items() if wanted in others)
        if (origin := next(origins, wanted)) != text:
            trusted[name] = origin
    return replace(study, trusted=trusted)


def recorded(study: Study, manifest: Mapping[str, Any]) -> dict[str, dict[str, list[str]]]:
    """Entry ``trusted`` of the next manifest: by component, origin of results → accepted code."""
    now = fingerprints(study)
    record = {name: dict(origins) for name, origins in manifest.get("trusted", {}).items()}
    for name, origin in study.trusted.items():
        of_name = record.setdefault(name, {})
        of_name[origin] = list(dict.fromkeys([*of_name.get(origin, []), now[name]]))
    return record


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
    """Differences of a study from the one that a run directory was written for."""

    changes: Sequence[Change]
    n_finished: int
    """Finished simulations of the earlier study."""
    n_valid: int
    """Simulations among them that are of this study too."""

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
    finished = set(ledger.sweep().drop_nulls("state")["key"])
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
    # No part of a study: these follow from others or from an option, or are the folder's own.
    others = ("measured", "study_file", "kept_study", "plugin_files", "trusted", "fit_start", "n_total")
    kept = {key: value for key, value in manifest.items() if key not in others}
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
