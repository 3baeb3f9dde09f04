"""Keys of simulations: the hash of everything that decides a result, and of nothing else.

A component is in a key by its name, its settings and the fingerprint of its code; everything else by
its values, of whatever class it is: all fields of a dataclass count, and so does its class.
"""

import functools
import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import Field, fields, is_dataclass
from importlib import metadata
from typing import Any

import numpy as np

from palpate.domain import Channel, FloatArray, Job, Limb, Protocol, Simulation
from palpate.domain.channels import PRESS_AND_TWIST
from palpate.domain.component import Component
from palpate.domain.indenter import Indenter, Sphere
from palpate.domain.material import Material
from palpate.errors import PluginError
from palpate.fingerprints import CORE, code_fingerprint
from palpate.plugins.guard import answering_for
from palpate.plugins.interfaces import Solver

NOTHING_TRUSTED: Mapping[str, str] = {}
"""Every component's results are those of its code as it is."""


def job_key(job: Job, limb: Limb | None, solver: Solver, trusted: Mapping[str, str] = NOTHING_TRUSTED) -> str:
    """Hash of everything that decides the result of a job.

    That is the mesh, the spot, each region's material with its code, settings and values, the
    protocol, the solver with its version, code and settings, the warm starts, whether slopes or the skin are
    wanted, and which channels beyond force and torque. The ``set_id`` is a name and decides nothing.
    ``trusted`` has fingerprints of earlier code whose results count as results of the present code, by
    ``material:NAME`` or ``solver:NAME``.
    """
    return JobKeys(solver, {} if limb is None else {job.limb_name: limb}, trusted).key(job)


def limb_key(limb: Limb | None) -> str:
    """Hash of a mesh and the spot on it."""
    digest = hashlib.sha256()
    if limb is not None:
        for value, name_tags in ((limb, ("spot", "remarks", "warnings")), (limb.spot, ("name",))):
            kind, items = _fields(value)
            _add_items(digest, kind, [(name, item) for name, item in items if name not in name_tags])
    return digest.hexdigest()


def solver_key(solver: Solver, trusted: Mapping[str, str] = NOTHING_TRUSTED) -> str:
    """Hash of a solver, its version, its code and its settings."""
    digest = hashlib.sha256()
    _add(digest, *_described("solver", solver, trusted))
    return digest.hexdigest()


def identity(component: Component) -> str:
    """Fingerprint of a component's code; of a solver with its version and the version of palpate."""
    with answering_for(component, "asking for its version and fingerprint"):
        parts = [component.fingerprint()]
        if isinstance(component, Solver):  # it computes with palpate's own elements and stresses
            parts = [component.version(), f"{CORE} {metadata.version(CORE)}", *parts]
    for part in parts:
        if not (isinstance(part, str) and part):
            raise PluginError(
                f"'{component.name}': its version or fingerprint is {part!r}; return a non-empty text"
            )
    return ", ".join(dict.fromkeys(parts))


class JobKeys:
    """Keys of jobs; what all sets of a spot have in common is hashed once."""

    def __init__(
        self, solver: Solver, limbs: Mapping[str, Limb], trusted: Mapping[str, str] = NOTHING_TRUSTED
    ) -> None:
        self._limbs = limbs
        self._limb_keys: dict[str, str] = {}
        self._trusted = trusted
        self._solver = solver_key(solver, trusted)
        # The object itself is kept next to the answer, so that no other object gets its id.
        self._heads: dict[tuple[str, int], tuple[Protocol, hashlib._Hash]] = {}
        self._regions: dict[tuple[str, int], tuple[Material, bytes]] = {}
        self._warm_starts: dict[int, tuple[object, bytes]] = {}

    def key(self, job: Job) -> str:
        """Key of a job on its limb."""
        if (name := job.limb_name) not in self._limb_keys:
            self._limb_keys[name] = limb_key(self._limbs.get(name))
        digest = self._head(job.protocol, self._limb_keys[name]).copy()
        for region in sorted(job.materials):
            digest.update(self._region(region, job.materials[region]))
            _add(digest, job.thetas[region])
        if job.slopes:
            _add(digest, "slopes")
        if job.channels != PRESS_AND_TWIST:  # the first keys were of these two
            _add(digest, "channels", [_observation(channel) for channel in job.channels])
        if job.surface:
            _add(digest, "surface")
        if job.warm_starts:
            digest.update(self._warm_starts_of(job.warm_starts))
        return digest.hexdigest()

    def _warm_starts_of(self, warm_starts: Mapping[str, FloatArray]) -> bytes:
        found = self._warm_starts.get(id(warm_starts))
        if found is None:
            digest = hashlib.sha256()
            _add(digest, "warm_starts", warm_starts)
            found = self._warm_starts[id(warm_starts)] = (warm_starts, digest.digest())
        return found[1]

    def _head(self, protocol: Protocol, limb: str) -> "hashlib._Hash":
        found = self._heads.get((limb, id(protocol)))
        if found is None:
            digest = hashlib.sha256()
            _add(digest, limb, self._solver, protocol)
            found = self._heads[limb, id(protocol)] = (protocol, digest)
        return found[1]

    def _region(self, region: str, material: Material) -> bytes:
        found = self._regions.get((region, id(material)))
        if found is None:
            described = _described("material", material, self._trusted)
            encoded = b"".join(map(_encoded, (region, *described)))
            found = self._regions[region, id(material)] = (material, encoded)
        return found[1]


def _described(kind: str, component: Component, trusted: Mapping[str, str]) -> tuple[str, str, str]:
    settings = json.dumps(component.settings.model_dump(mode="json"), sort_keys=True)
    return component.name, settings, trusted.get(f"{kind}:{component.name}") or identity(component)


def answers_key(simulations: Iterable[Simulation]) -> str:
    """Hash of what simulations answered: how each ended, and its curves to the last bit."""
    digest = hashlib.sha256()
    for simulation in simulations:
        job = simulation.job
        _add(digest, job.spot, int(job.set_id), simulation.status.value, simulation.message)
        for name, curve in simulation.response.curves.items() if simulation.response is not None else ():
            _add(digest, name, curve.abscissa, curve.ordinate)
            if curve.slopes:
                _add(digest, curve.slopes)
    return digest.hexdigest()[:16]


def _add(digest: "hashlib._Hash", *parts: object) -> None:
    """Feed values to a hash so that neither their borders nor their shapes can be confused."""
    for part in parts:
        match part:
            case np.ndarray():
                digest.update(f"array {part.dtype.str} {part.shape};".encode())
                digest.update(np.ascontiguousarray(part).tobytes())
            case str() | int() | float() | None:
                digest.update(_encoded(part))
            case np.generic():
                _add(digest, part.item())
            case Mapping():
                _add_items(digest, "mapping", sorted(part.items()))
            case Indenter():
                _add_items(digest, *_indenter(part))
            case Sequence():
                digest.update(f"sequence {len(part)};".encode())
                _add(digest, *part)
            case _:
                _add_items(digest, *_fields(part))


def _add_items(digest: "hashlib._Hash", kind: str, items: Iterable[tuple[str, object]]) -> None:
    listed = list(items)
    digest.update(f"{kind} {len(listed)};".encode())
    for name, value in listed:
        _add(digest, name, value)


def _observation(channel: Channel) -> list[object]:
    """Definition of a channel's curve; its labels and its checks are not in it."""
    code = "" if channel.observe is None else code_fingerprint(channel.observe)
    named = "" if channel.observe is None else channel.observe.__qualname__
    return [channel.name, channel.abscissa, channel.ordinate, list(channel.needs), named, code]


def _indenter(indenter: Indenter) -> tuple[str, list[tuple[str, Any]]]:
    """Definition of an indenter; of a sphere its radius under its first name, as in every key so far."""
    if type(indenter) is Sphere:
        return "palpate.domain.Sphere ", [("radius_mm", indenter.radius_mm)]
    return "indenter", list(
        zip(("name", "settings", "code"), _described("indenter", indenter, NOTHING_TRUSTED), strict=True)
    )


def _fields(value: object) -> tuple[str, list[tuple[str, Any]]]:
    """Class and fields of a dataclass, and whatever else was put on the value."""
    cls = type(value)
    if not is_dataclass(value):
        raise PluginError(
            f"a value of class {cls.__module__}.{cls.__qualname__} decides a result but cannot be part of "
            "its key; make the class a dataclass"
        )
    # A field that a class got later is no part of a key while it has its default: earlier results are found.
    names = [field.name for field in fields(value) if not _is_as_before(field, getattr(value, field.name))]
    names += [name for name in vars(value) if name not in names] if hasattr(value, "__dict__") else []
    names = [n for n in names if not isinstance(getattr(cls, n, None), functools.cached_property)]
    kind = f"{cls.__module__}.{cls.__qualname__} {code_fingerprint(cls)}"
    return kind, [(name, getattr(value, name)) for name in names]


def _is_as_before(field: Field[Any], value: object) -> bool:
    if field.metadata.get("in_key") != "unless default":
        return False
    return value is field.default or (not isinstance(value, np.ndarray) and value == field.default)


def _encoded(part: object) -> bytes:
    text = json.dumps(part).encode()
    return f"json {len(text)};".encode() + text
