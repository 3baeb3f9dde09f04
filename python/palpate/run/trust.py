"""Results of earlier code that a user accepts as those of the code as it is.

A simulation's key holds the fingerprint of its materials and its solver. Where the code has changed
and the physics has not, ``--trust material:NAME`` makes the keys with the earlier fingerprint. The
manifest keeps which fingerprints were accepted as which, so that every later stage does the same.
"""

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

from palpate.domain.component import Component
from palpate.errors import StudyError
from palpate.plugins.registry import suggestion
from palpate.run.keys import identity
from palpate.study.reading import Study

IN_KEYS = ("material:", "solver:")
"""How the components begin whose code decides a simulation."""


def fingerprints(study: Study) -> dict[str, str]:
    """Fingerprint of each component that decides a number, by ``kind:name``."""
    loaders = [study.loader, *(spot.loader for spot in study.spots if spot.loader)]
    components: dict[str, list[Component]] = {
        "material": [region.material for region in study.space.regions],
        "solver": [study.solver],
        "sampler": [study.sampler],
        "filter": list(study.filters),
        "loader": list(loaders),
        "limb_source": [study.limb_source] if study.limb_source else [],
    }
    found: dict[str, dict[str, None]] = {}
    for kind, listed in components.items():
        for component in listed:
            found.setdefault(f"{kind}:{component.name}", {})[identity(component)] = None
    return {name: " | ".join(each) for name, each in found.items()}


def trusting(study: Study, manifest: Mapping[str, Any], names: Collection[str] = ()) -> Study:
    """The study with the results that its run directory accepts, and those of ``names`` from now on.

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
    """What the next manifest has under ``trusted``: by component, origin of results → accepted code."""
    now = fingerprints(study)
    record = {name: dict(origins) for name, origins in manifest.get("trusted", {}).items()}
    for name, origin in study.trusted.items():
        of_name = record.setdefault(name, {})
        of_name[origin] = list(dict.fromkeys([*of_name.get(origin, []), now[name]]))
    return record
