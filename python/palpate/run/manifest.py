"""``manifest.json``: what the numbers of a run depended on."""

import contextlib
import hashlib
import importlib.metadata
import json
import platform
from collections.abc import Mapping
from dataclasses import asdict, fields
from typing import Any, NotRequired

import numpy as np
from pydantic import TypeAdapter, ValidationError
from typing_extensions import TypedDict

from palpate.domain import Channel, HomogeneousTests, Indentation, Protocol, ScoringRules, channel_of
from palpate.domain.component import Component
from palpate.executors.answers import plain
from palpate.fingerprints import distributions
from palpate.plugins.guard import answering_for
from palpate.run.trust import fingerprints
from palpate.study.mesh_note import mesh_note
from palpate.study.reading import Study, StudySpot, relative

UNITS = "mm, N, MPa, N·mm, degrees"
"""Units of every number in a run directory."""

_LIBRARIES = ("palpate", "numpy", "scipy", "jax", "polars", "matplotlib")


def manifest(study: Study, channels: Mapping[str, Channel]) -> dict[str, Any]:
    """Describe what the numbers of a run depended on."""
    weighted = {channel_of(name) for scenario in study.scenarios for name in scenario.weights}
    return {
        "study": study.name,
        "description": study.description,
        "data": study.data,
        "units": UNITS,
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
        "scoring": asdict(study.scoring),
        "scenarios": {scenario.name: dict(scenario.weights) for scenario in study.scenarios},
        "generalise_by": study.generalise_by,
        "search": _component(study.search),
        "parametrisation": _component(study.parametrisation),
        "noise": study.noise,
        "fine_runs": study.fine_runs,
        "budget": study.budget.model_dump(mode="json"),
        "truth": plain(study.truth),
        "channels": {name: _channel(channel) for name, channel in channels.items() if name in weighted},
    }


def versions(study: Study) -> dict[str, str]:
    """Versions of everything that took part."""
    with answering_for(study.solver, "asking for its version"):
        solver = study.solver.version()
    found = {"python": platform.python_version(), f"solver {study.solver.name}": solver}
    for name in _LIBRARIES:
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
    found = _fields(channel, ("mirrored", "needs", "observe"))
    return found | ({"needs": list(channel.needs)} if channel.needs else {})


def _component(component: Component) -> dict[str, Any]:
    return {"name": component.name, "settings": component.settings.model_dump(mode="json")}


def _spot(study: Study, spot: StudySpot) -> dict[str, Any]:
    """Files of a spot by channel, and what is done and read there otherwise than elsewhere."""
    files = {
        channel or "": [relative(path, study.folder) for path in paths]
        for channel, paths in spot.measured.items()
    }
    found: dict[str, Any] = {"measured": files}
    if spot.protocol is not None:
        found["protocol"] = _protocol(spot.protocol)
    if spot.loader is not None:
        found["loader"] = _component(spot.loader)
    if spot.fine_edge_mm:
        found["fine_edge_mm"] = spot.fine_edge_mm
    for key, mesh in (("mesh", spot.mesh), ("fine_mesh", spot.fine_mesh)):
        if mesh is not None and (note := mesh_note(mesh)) is not None:
            found[key] = note
    return found


def _protocol(protocol: Protocol | None) -> dict[str, Any]:
    if isinstance(protocol, Indentation):
        return {
            "kind": "indentation",
            "indenter": _component(protocol.indenter),
            "path_depth_mm_rotation_deg": protocol.path.tolist(),
            **plain(_fields(protocol, ("indenter", "path", *_unused(protocol)))),
        }
    if protocol is None or type(protocol) is HomogeneousTests:
        return {"kind": "homogeneous tests"}
    return {"kind": type(protocol).__qualname__, **plain(_fields(protocol))}


def _unused(protocol: Indentation) -> tuple[str, ...]:
    """What only other motions than a press and twist have."""
    return tuple(name for name in ("aside", "loads", "time_s") if getattr(protocol, name) is None)


def _fields(value: Any, left_out: tuple[str, ...] = ()) -> dict[str, Any]:  # noqa: ANN401 - any dataclass
    return {field.name: getattr(value, field.name) for field in fields(value) if field.name not in left_out}


_LIMITS = ("physical_lower", "physical_upper")


def finite(parameter: dict[str, Any]) -> dict[str, Any]:
    """Make a parameter fit for JSON, which has no infinity: no limit is null."""
    return parameter | {k: None for k in _LIMITS if not np.isfinite(parameter[k])}


def infinite(parameter: dict[str, Any]) -> dict[str, Any]:
    """Make a parameter of what :func:`finite` made: the inverse."""
    missing = {"physical_lower": -np.inf, "physical_upper": np.inf}
    return parameter | {k: v for k, v in missing.items() if parameter[k] is None}


class _ReadAgain(TypedDict):
    """What is read of the manifest again."""

    study: str
    study_file: str
    plugin_files: list[str]
    spots: dict[str, Any]
    scenarios: dict[str, dict[str, float]]
    inputs: dict[str, str]
    fingerprints: dict[str, str]
    trusted: dict[str, dict[str, list[Any]]]
    n_total: int
    scoring: ScoringRules
    fit_start: NotRequired[dict[str, float]]


def checked_manifest(text: str) -> dict[str, Any]:
    """Parse a manifest, and refuse one that is not as palpate writes it.

    Raises
    ------
    ValueError
    """
    try:
        TypeAdapter(_ReadAgain).validate_json(text, strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        raise ValueError(f"'{'.'.join(map(str, first['loc']))}': {first['msg']}") from None
    content: dict[str, Any] = json.loads(text)
    if content["scoring"].keys() != {field.name for field in fields(ScoringRules)}:
        raise ValueError("'scoring': not the rules of this palpate")
    return content


def scoring_rules(content: Mapping[str, Any]) -> ScoringRules:
    """Scoring rules of a manifest that :func:`checked_manifest` returned."""
    return TypeAdapter(ScoringRules).validate_python(content["scoring"])
