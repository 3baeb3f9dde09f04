"""Remarks on a study by itself, before any curve is read."""

import re
from collections.abc import Iterator

import numpy as np

from palpate.domain import Indentation, Parameter, ParameterSpace, RegionMaterial
from palpate.domain.material import IsotropicMaterial
from palpate.plugins.guard import answering_for
from palpate.study.reading import Study
from palpate.toml_text import ASKED, MARK


def unedited_warnings(study: Study) -> Iterator[str]:
    """Warning with every line of the study file that is still marked as another study's, or as open."""
    if not study.file.is_file():
        return
    table, found = "", list[str]()
    for number, line in enumerate(study.file.read_text(encoding="utf-8").splitlines(), start=1):
        if header := re.match(r"\s*\[+\s*([^\]#]+?)\s*\]", line):
            table = f"{header[1]}."
        value, _, comment = line.partition("#")
        if MARK in comment:
            found.append(f"line {number} {table}{value.partition('=')[0].strip()}".rstrip("."))
        elif ASKED in comment:
            found.append(f"line {number} {ASKED}{comment.partition(ASKED)[2].rstrip()}")
    if found:
        yield (
            f"{study.file.name}: not edited yet: {', '.join(found)}; write your values, and remove the words "
            f"'{MARK}' and '{ASKED}' there"
        )


def setting_warnings(study: Study) -> Iterator[str]:
    """Say what no study needs and a slip of the pen easily makes."""
    protocols = {spot.spot.name: study.protocol_at(spot.spot.name) for spot in study.spots}
    for spot, protocol in protocols.items():
        if isinstance(protocol, Indentation):
            indenter, depth = protocol.indenter, float(protocol.path[:, 0].max())
            # Depth over radius beyond which an indenter is deeper in the limb than any measurement of the
            # kind.
            if depth > 3.0 * indenter.radius_mm:
                yield (
                    f"spot '{spot}': a {indenter.name} of radius {indenter.radius_mm:g} mm is pressed "
                    f"{depth:g} mm deep, {depth / indenter.radius_mm:.0f} times its radius; check both"
                )
            # Coefficient above which an indenter sticks for any purpose, and which no skin or silicone has.
            if protocol.friction > 3.0:
                yield (
                    f"spot '{spot}': friction {protocol.friction:g} is far above measured friction of skin "
                    "and rubber; check friction in [protocol]"
                )
    every = study.parametrisation.parameters(study.space, study.spot_names[:1])
    for parameter in every if study.search.name == "sweep" else ():
        if parameter.prior or parameter.by or parameter.name not in study.space.names:
            yield (
                f"{parameter.name}: search 'sweep' uses no prior, no value by spot and nothing of "
                "[fit.searched]; name another search, or remove it"
            )
    for region in study.space.regions:
        yield from _swelling(study.space, region)
        for parameter in region.searched:
            name = region.name_of(parameter.name)
            yield from _range(name, region, parameter)
            if study.protocol is not None and _only_volume(study.space, region, name):
                yield (
                    f"{name}: is searched and resists change of volume only, which an indentation of nearly "
                    "incompressible tissue hardly shows; fix it, or expect that it is not identifiable"
                )


def _range(name: str, region: RegionMaterial, parameter: Parameter) -> Iterator[str]:
    low, high = sorted((abs(parameter.lower), abs(parameter.upper)))
    # Upper over lower end of a range beyond which sets that are spread evenly leave the lower decades out.
    if parameter.scale == "linear" and parameter.lower * parameter.upper > 0.0 and high > 100.0 * low:
        yield (
            f"{name}: the range spans a factor of {high / low:.0f}, and a linear scale leaves its lower "
            'decades next to empty; set scale = "log", or narrow the range'
        )
    usual = next(p for p in region.material.parameters if p.name == parameter.name)
    if (
        usual.lower * usual.upper > 0.0
        and parameter.upper * usual.lower < 0.0 > parameter.lower * usual.lower
    ):
        yield (
            f"{name}: the range has the other sign than the material's own, {usual.lower:.3g} to "
            f"{usual.upper:.3g} {usual.unit}; check the sign"
        )


def _swelling(space: ParameterSpace, region: RegionMaterial) -> Iterator[str]:
    """Warn of a material whose Poisson's ratio is negative in the middle of the ranges."""
    material, strain = region.material, 1e-3
    if not isinstance(material, IsotropicMaterial):
        return
    middle = [
        np.copysign(np.sqrt(p.lower * p.upper), p.lower) if p.scale == "log" else 0.5 * (p.lower + p.upper)
        for p in space.parameters
    ]
    theta = space.thetas(np.array(middle))[region.region]
    with answering_for(material, "energy in the middle of the ranges"), np.errstate(all="ignore"):
        energies = material.energy(np.exp(strain * np.array([[1.0, -1.0, 0.0], [1.0, 1.0, 1.0]])), theta)
    shear, bulk = np.asarray(energies) / strain**2 / (2.0, 4.5)
    if 0.0 < bulk < shear / 1.5:
        ratio = (3.0 * bulk - 2.0 * shear) / (6.0 * bulk + 2.0 * shear)
        yield (
            f"{region.region}: Poisson's ratio is {ratio:.2g} in the middle of the ranges, with a bulk "
            f"modulus of {bulk:.3g} MPa and a shear modulus of {shear:.3g} MPa; check the units of both"
        )


def _only_volume(space: ParameterSpace, region: RegionMaterial, name: str) -> bool:
    """Whether a parameter changes the energy of a change of volume, and of no change of shape."""
    material = region.material
    if not isinstance(material, IsotropicMaterial):
        return False
    shapes = np.exp([[0.3, -0.15, -0.15], [-0.2, 0.3, -0.1]])
    rows = [[0.5 * (p.lower + p.upper) for p in space.parameters] for _ in range(2)]
    column = next(i for i, p in enumerate(space.parameters) if p.name == name)
    rows[0][column], rows[1][column] = space.parameters[column].lower, space.parameters[column].upper
    thetas = [space.thetas(np.array(row))[region.region] for row in rows]
    with answering_for(material, "energy at the ends of the ranges"), np.errstate(all="ignore"):
        low, high = (
            material.energy(np.concatenate([shapes, 1.1 * np.ones((1, 3))]), each) for each in thetas
        )
    change = np.abs(high - low) / np.maximum(np.abs(high), np.finfo(float).tiny)
    return bool((change[:-1] < 1e-9).all() and change[-1] > 1e-3)
