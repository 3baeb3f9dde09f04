"""``manifest.json``: what the numbers of a run depended on."""

import contextlib
import hashlib
import importlib.metadata
import platform
from collections.abc import Mapping
from dataclasses import asdict, fields
from types import MappingProxyType
from typing import Any

import numpy as np

from palpate.domain import (
    Channel,
    HomogeneousTests,
    Indentation,
    Normaliser,
    PointWeighting,
    Protocol,
    ScoringRules,
)
from palpate.executors.answers import plain
from palpate.plugins.fingerprints import distributions
from palpate.plugins.guard import answering_for
from palpate.plugins.interfaces import Component
from palpate.run.trust import fingerprints
from palpate.study.mesh_note import mesh_note
from palpate.study.reading import Study, StudySpot, relative

UNITS = "mm, N, MPa, N·mm, degrees"
"""Units of every number in a run directory."""

_LIBRARIES = ("palpate", "numpy", "scipy", "jax", "polars", "matplotlib")


def manifest(study: Study, channels: Mapping[str, Channel]) -> dict[str, Any]:
    """Tell what the numbers of a run depended on."""
    weighted = {channel for scenario in study.scenarios for channel in scenario.weights}
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
                "searched": [finite(asdict(p)) for p in region.searched],
                "fixed": plain(region.fixed),
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
        "refine": study.refine,
        "stiffness_scaling": study.stiffness_scaling,
        "truth": plain(study.truth),
        "channels": {name: asdict(channel) for name, channel in channels.items() if name in weighted},
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
        files += [*spot.files, *([spot.mesh] if spot.mesh else [])]
    return {
        relative(file, study.folder): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in files
        if file.is_file()
    }


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
    if spot.mesh is not None and (note := mesh_note(spot.mesh)) is not None:
        found["mesh"] = note
    return found


def _protocol(protocol: Protocol | None) -> dict[str, Any]:
    if isinstance(protocol, Indentation):
        return {
            "kind": "indentation",
            "indenter": type(protocol.indenter).__name__,
            **plain(_fields(protocol.indenter)),
            "path_depth_mm_rotation_deg": protocol.path.tolist(),
            **plain(_fields(protocol, ("indenter", "path"))),
        }
    if protocol is None or type(protocol) is HomogeneousTests:
        return {"kind": "homogeneous tests"}
    return {"kind": type(protocol).__qualname__, **plain(_fields(protocol))}


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


_TYPES: Mapping[str, type | tuple[type, ...]] = MappingProxyType(
    {
        "study": str,
        "study_file": str,
        "plugin_files": list,
        "spots": dict,
        "scenarios": dict,
        "inputs": dict,
        "fingerprints": dict,
        "trusted": dict,
        "n_total": int,
        "scoring": dict,
    }
)
"""What is read of the manifest again."""


def checked_manifest(content: object) -> dict[str, Any]:
    """Return a manifest, and refuse one that is not as palpate writes it.

    Raises
    ------
    ValueError
    """
    if not isinstance(content, dict):
        raise ValueError("not an object")
    for key, kind in _TYPES.items():
        if not isinstance(content.get(key), kind):
            raise ValueError(f"'{key}' is missing or of another type")
    texts = (*content["plugin_files"], *content["fingerprints"].values(), *content["inputs"].values())
    if not all(isinstance(text, str) for text in texts):
        raise ValueError("a plugin file, a fingerprint or a hash is not text")
    for key, kinds in (("scenarios", (int, float)), ("trusted", (list,))):
        for table in content[key].values():
            if not isinstance(table, dict) or not all(isinstance(each, kinds) for each in table.values()):
                raise ValueError(f"'{key}' holds something of another type")
    scoring_rules(content)
    return content


def scoring_rules(content: Mapping[str, Any]) -> ScoringRules:
    """Scoring rules of a manifest.

    Raises
    ------
    ValueError, TypeError
    """
    rules = ScoringRules(
        **content["scoring"]
        | {
            "normaliser": Normaliser(content["scoring"].get("normaliser")),
            "point_weighting": PointWeighting(content["scoring"].get("point_weighting")),
        }
    )
    if not isinstance(rules.minimum_coverage, (int, float)) or not isinstance(rules.rank_partial, bool):
        raise TypeError("'scoring' holds something of another type")
    return rules
