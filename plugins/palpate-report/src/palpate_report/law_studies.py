"""Studies that fit other material laws to the curves of a study, as files next to it."""

import re
import tomllib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate.api import (
    IsotropicMaterial,
    Parameter,
    ParameterName,
    RegionMaterial,
    StudyError,
    convert,
    mechanics,
)
from palpate.api.files import toml_document, write_atomically
from palpate.api.mechanics import MODES
from palpate.api.runs import Plugins, RangeProposer, Study
from palpate_report.answer.law import law_name, searched_regions

ALL = "all"
"""Word for every isotropic law."""

TERMS, MOST_TERMS = "terms", 4
"""Setting of a law that is a series, and the most terms of it that are compared."""

MOST_SETS, SETS_ON_MESH = 64, 12
"""Sets of the sweep of a law, in whose basins its searches start: without a mesh at most, and with one."""

VALIDATE = "validate"
"""Stage that holds each curve out in turn."""

WRITTEN = "# Written by `palpate compare STUDY --materials all`, which overwrites it: copy it to change it.\n"


@dataclass(frozen=True, slots=True, kw_only=True)
class Law:
    """A material law with its settings, under the name that the comparison has for it."""

    name: str
    material: IsotropicMaterial[Any]
    settings: Mapping[str, Any]

    @property
    def title(self) -> str:
        """Name in texts and tables, with the number of terms of a series."""
        n = self.settings.get(TERMS)
        return law_name(self.material) + (f" ({n} term{'s' if n > 1 else ''})" if n else "")


@dataclass(frozen=True, slots=True, kw_only=True)
class Stiffness:
    """Initial moduli [MPa] of the measured material, and its largest I1 − 3 (0 where it is not known)."""

    shear_MPa: float
    bulk_MPa: float
    invariant: float


def laws_of(words: str, plugins: Plugins) -> list[Law]:
    """Laws that a list names: ``all``, names of materials, or ``ogden-2`` for a number of terms.

    A StudyError where a material is unknown, has directions, or is no series.
    """
    isotropic = {n: m for n, m in plugins.materials.items() if issubclass(m, IsotropicMaterial)}
    found: list[Law] = []
    for word in filter(None, map(str.strip, words.split(","))):
        for name in isotropic if word == ALL else [word]:
            head, _, terms = name.rpartition("-") if re.fullmatch(r".+-\d+", name) else (name, "", "")
            if head not in isotropic:
                why = "has directions" if head in plugins.materials else "is unknown"
                known = ", ".join(isotropic)
                raise StudyError(f"--materials {word}: the law {why}; name {ALL}, or some of {known}")
            is_series = TERMS in isotropic[head].Settings.model_fields
            if terms and not is_series:
                raise StudyError(f"--materials {word}: '{head}' has no number of terms; write {head}")
            numbers = [int(terms)] if terms else range(1, MOST_TERMS + 1)
            for settings in [{TERMS: n} for n in numbers] if is_series else [{}]:
                label = "-".join([head, *map(str, settings.values())])
                material = isotropic[head](isotropic[head].Settings(**settings))
                found.append(Law(name=label, material=material, settings=settings))
    if not found:
        raise StudyError(f"--materials names no law; name {ALL}, or some of {', '.join(isotropic)}")
    return list({law.name: law for law in found}.values())


def region_of(study: Study, name: str | None) -> RegionMaterial:
    """Region whose law is compared: the named one, else the only one that is searched.

    A StudyError where there is none, or more than one and no name.
    """
    searched = searched_regions(study.space)
    names = [each.region for each in searched]
    if name is None and len(searched) == 1:
        return searched[0]
    if name not in names:
        what = f"region '{name}' is not searched" if name else f"{len(names)} regions are searched"
        raise StudyError(f"{study.file}: {what}; give --region, one of {', '.join(names)}")
    return searched[names.index(str(name))]


def largest_invariant(modes: Mapping[str, Collection[float]]) -> float:
    """Largest I1 − 3 along homogeneous tests, by their abscissae; 0 without any."""
    stretches = [MODES[mode](np.asarray(along)) for mode, along in modes.items() if mode in MODES]
    return max((float((each**2).sum(axis=-1).max()) - 3.0 for each in stretches), default=0.0)


def ranges(material: IsotropicMaterial[Any], known: Stiffness) -> Iterator[tuple[Parameter, float | None]]:
    """Parameters of a law with their ranges for a material so stiff; a fixed one with its value.

    In a homogeneous test a law may propose its ranges. Else moduli scale with the initial shear modulus of
    the middle of the law's ranges, and what changes the volume alone keeps the bulk modulus.
    """
    middle = np.array([_middle(p) for p in material.parameters])
    shear, bulk = mechanics.initial_moduli(material, middle)
    proposed: Mapping[str, tuple[float, float]] = {}
    if known.invariant > 0.0 and isinstance(material, RangeProposer):
        proposed = material.proposed_ranges(known.shear_MPa, known.invariant)
    for i, p in enumerate(material.parameters):
        lower, upper = proposed.get(p.name, (p.lower, p.upper))
        if p.name not in proposed and _is_of_volume(material, middle, i):
            if p.kind == "modulus":
                yield p, known.bulk_MPa / bulk * middle[i]
                continue
            if p.name == "nu":
                three_bulk, shear_MPa = 3.0 * known.bulk_MPa, known.shear_MPa
                yield p, (three_bulk - 2.0 * shear_MPa) / (2.0 * (three_bulk + shear_MPa))
                continue
        elif p.name not in proposed and p.kind == "modulus":
            lower, upper = (known.shear_MPa / shear * end for end in (lower, upper))
        # Ratio of the ends of a range from which on its logarithm is searched.
        is_log = lower > 0.0 and upper > 20.0 * lower
        yield replace(p, lower=lower, upper=upper, scale="log" if is_log else "linear"), None


def _middle(p: Parameter) -> float:
    """Middle of a range: of the logarithms where both ends have one sign."""
    product = p.lower * p.upper
    return float(np.sign(p.lower) * np.sqrt(product)) if product > 0.0 else 0.5 * (p.lower + p.upper)


def _is_of_volume(material: IsotropicMaterial[Any], middle: np.ndarray, i: int) -> bool:
    """True if a parameter changes the bulk modulus far more than the shear modulus."""
    p = material.parameters[i]
    at = np.array([np.where(np.arange(middle.size) == i, end, middle) for end in (p.lower, p.upper)])
    changes = np.abs(np.diff(np.log([mechanics.initial_moduli(material, theta) for theta in at]), axis=0))[0]
    # Change of the bulk modulus over the change of the shear modulus by a parameter of the volume.
    return bool(changes[1] > 10.0 * changes[0])


def n_searched(law: Law, known: Stiffness) -> int:
    """Number of parameters of a law that are searched."""
    return sum(value is None for _, value in ranges(law.material, known))


def write_law_study(base: Study, region: RegionMaterial, law: Law, known: Stiffness) -> Path:
    """Study file of a law, next to its base; a StudyError where that would replace a file of the user's."""
    file = base.file.with_name(f"{base.file.stem}-{law.name}.toml")
    if file.is_file() and not file.read_text(encoding="utf-8", errors="replace").startswith(WRITTEN):
        raise StudyError(f"{file}: a file that palpate has not written; rename it")
    raw = tomllib.loads(base.file.read_text(encoding="utf-8-sig"))
    write_atomically(file, (WRITTEN + "\n" + toml_document(_tables(raw, base, region, law, known))).encode())
    return file


def _tables(
    raw: dict[str, Any], base: Study, region: RegionMaterial, law: Law, known: Stiffness
) -> dict[str, Any]:
    unit, n_shares = base.modulus_unit, len(region.material.relaxation_times_s)
    own = region.material.parameters
    names = {p.name for p in own[: len(own) - n_shares]}
    parameters: dict[str, Any] = {}
    for p, fixed in ranges(law.material, known):
        of = unit if p.unit == "MPa" else p.unit
        ends = {"value": fixed} if fixed is not None else {"lower": p.lower, "upper": p.upper}
        texts = {key: _quantity(value, p.unit, of) for key, value in ends.items()}
        parameters[p.name] = texts.get("value") or (texts | ({"scale": "log"} if p.scale == "log" else {}))
    old = raw["region"][region.region]
    kept = {k: v for k, v in old.items() if k in ("relaxation_times", "relaxing_stress")}
    relaxing = {name: each for name, each in old.get("parameters", {}).items() if name not in names}
    table = {"material": law.material.name, "settings": dict(law.settings), **kept}
    budget = dict(raw.get("budget", {}))
    if "parameters" in budget:
        budget["parameters"] = {
            n: v for n, v in budget["parameters"].items() if ParameterName.parse(n).region != region.region
        }
    n_sets = SETS_ON_MESH if base.solver.provides.mesh else min(base.n_sets, MOST_SETS)
    executor = {} if base.solver.provides.mesh else {"executor": {"name": "in_process"}}
    return {
        **executor,
        **{name: each for name, each in raw.items() if name not in ("truth", "stages", "region", "budget")},
        "study": raw["study"]
        | {"name": f"{base.name}-{law.name}", "description": f"law {law.name} for the curves of {base.name}"},
        "region": raw["region"] | {region.region: table | {"parameters": parameters | relaxing}},
        "budget": budget,
        "sampling": raw.get("sampling", {}) | {"n_sets": n_sets},
        "selection": {"scenarios": [base.generalise_by]},
        "stages": {VALIDATE: {}},
    }


def _quantity(value: float, unit: str, written: str) -> str | float:
    number = float(f"{value / (convert(f'1 {written}', unit) if unit else 1.0):.6g}")
    return f"{number:g} {written}".strip() if unit else number
