"""Motion, scenarios and ranges of a study of own presses, or of an own test, by its measured curves."""

import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np

from palpate.domain import Indentation, Parameter, Response, channel_of
from palpate.domain.channels import FORCE, TORQUE
from palpate.domain.material import IsotropicMaterial
from palpate.errors import PalpateError
from palpate.experiment.curve_checks import check_sizes, hertz_N, secant_young_MPa
from palpate.experiment.measured import read_first
from palpate.fit.parametrisation import StandardParametrisation
from palpate.mechanics.homogeneous import MODES, nominal_stress
from palpate.plugins.catalogue import Plugins
from palpate.study.reading import Study, read_study
from palpate.toml_text import MARK, toml_value
from palpate.units import convert

DEPTHS_ALIKE = 0.01
"""Difference between depths, over their size, that counts as none: torque differs by about twice as much."""

WIDE = 4.0
"""Range of the searched modulus, over its estimate: a thin layer on bone is several times stiffer."""

AS_MEASURED = "   # as your curves have it"
BORROWED, HALF_SPACE = f"   # {MARK}: copied from ", "   # around a half-space estimate of your force"

SEARCHED = """[fit.searched]
# Skin on plastic: 0.3 to 1.0, by person and humidity. A twist in which the indenter slips identifies it.
friction = { lower = 0.1, upper = 1.5, prior = { value = 0.7, sd = 0.3 } }
"""
"""Table of a study of own presses whose ready study searches nothing else, in no other parametrisation."""


def with_own_ranges(file: Path, plugins: Plugins, ready: str) -> bool:
    """Write motion, scenarios and ranges of a study by its measured curves; False where they cannot be read.

    The first modulus of each region is searched, its others keep their ratio to it, and shape parameters stay
    in the middle of their ranges. What is copied from the ready study has a mark.
    """
    text, borrowed = file.read_text(encoding="utf-8"), f"{BORROWED}{ready}"
    try:
        study = read_study(file, plugins)
        measured = read_first(study)
        text = _with_scenarios(_with_motion(text, measured, borrowed), study, measured)
        text = _with_contact(text, study, measured)
        file.write_text(text, encoding="utf-8")
        study = read_study(file, plugins)
        if isinstance(study.protocol, Indentation):  # a force a thousand times off gives no range
            check_sizes(measured, plugins.channels, study.protocol, study.space)
        tables = dict(_tables(study, measured) if study.protocol else _tables_of_test(study, measured))
    except PalpateError:
        tables = {}
    for region, table in tables.items():
        head = rf"^\[region\.{re.escape(region)}\.parameters\]\n(?:(?!\[).*\n?)*"
        text = re.sub(head, lambda _, table=table: table, text, flags=re.MULTILINE)  # type: ignore[misc]
    file.write_text(_marked(text, borrowed), encoding="utf-8")
    return bool(tables)


def _with_motion(text: str, measured: Response, borrowed: str) -> str:
    """Depth and twist of the protocol as the curves have them.

    Without a torque there is no twist, and friction is not searched.
    """
    own = {} if TORQUE.name in measured else {"twist": ""}
    depth_error = _depth_error_mm(measured)
    if FORCE.name in measured:
        own["depth"] = _depth_of(measured)
    if TORQUE.name in measured:
        curve = measured[TORQUE.name]
        # A log's turn is known to half of the step between two points of its curve.
        within = 0.5 * float(np.median(np.abs(np.diff(curve.abscissa)))) if depth_error else 0.005
        turns = [_rounded(curve.abscissa[stop - 1], within) for _, stop in curve.branches]
        # A curve of more turns is no motion that can be copied.
        if len(turns) <= 6:
            own["twist"] = toml_value([f"{turn:g} deg" for turn in turns])
    mark = f"{AS_MEASURED}\n"
    lines = {name: f"{name} = {value}{mark}" if value else "" for name, value in own.items()}
    no_twist = f"{borrowed}; without a twist no curve shows it\n"
    searched = "   # of a sweep alone: the fit searches it, see [fit.searched]\n"
    friction = (searched if TORQUE.name in measured else no_twist) if SEARCHED in text else ""
    if TORQUE.name not in measured:
        text = text.replace(SEARCHED, "")

    def table(found: re.Match[str]) -> str:
        keys = r"^(depth|twist) = .*\n"
        moved = re.sub(keys, lambda m: lines.get(m[1], m[0]), found[0], flags=re.MULTILINE)
        named = r"^(friction = [^#\n]*?) *\n"
        return re.sub(named, rf"\1{friction}", moved, flags=re.MULTILINE) if friction else moved

    return re.sub(r"^\[protocol\]\n(?:(?!\[).*\n?)*", table, text, flags=re.MULTILINE)


def _depth_error_mm(measured: Response) -> float:
    """How well a log knows the depth of its first contact; curves that are processed are as written."""
    return float(measured.record.get("uncertainty", {}).get("depth_mm", 0.0))


def _depth_of(measured: Response) -> str:
    """Depth of a press by its force, as a study writes it."""
    deepest = float(measured[FORCE.name].abscissa.max())
    return f'"{_rounded(deepest, min(_depth_error_mm(measured), DEPTHS_ALIKE * deepest)):.4g} mm"'


def _with_contact(text: str, study: Study, measured: Response) -> str:
    """Text where each spot has its own depth, and first contact of layers is searched.

    A spot whose file cannot be read is left to `palpate check`.
    """
    if FORCE.name not in measured:
        return text
    deepest, sd_mm = measured[FORCE.name].abscissa.max(), _depth_error_mm(measured)
    for number, spot in enumerate(study.spots[1:], start=1):
        with suppress(PalpateError):
            there = read_first(study, number)
            if FORCE.name not in there:
                continue
            sd_mm = max(sd_mm, _depth_error_mm(there))
            if abs(there[FORCE.name].abscissa.max() - deepest) > DEPTHS_ALIKE * deepest:
                head = rf'^\[\[spot\]\]\nname = "{re.escape(spot.spot.name)}"\n(?:(?!\[).+\n)*'
                own = f"\n[spot.protocol]\ndepth = {_depth_of(there)}{AS_MEASURED}\n"
                text = re.sub(head, lambda found, own=own: found[0] + own, text, flags=re.MULTILINE)  # type: ignore[misc]
    by, head = study.parametrisation, "\n[fit.searched]\n"
    is_open = isinstance(by, StandardParametrisation) and by.settings.depth_offset is None
    if not sd_mm or not is_open or len(study.space.regions) < 2:
        return text
    # Curves of soft layers bend so much with depth that slopes around a wrong first contact mislead.
    most, known = f"{max(1.0, 3.0 * sd_mm):.3g} mm", f'prior = {{ value = "0 mm", sd = "{sd_mm:.2g} mm" }}'
    line = f'depth_offset = {{ lower = "-{most}", upper = "{most}", {known} }}   # as your logs show it\n'
    return text.replace(head, head + line) if head in text else f"{text.rstrip()}\n{head}{line}"


def _rounded(value: float, within: float) -> float:
    """Number of the fewest decimals that is as near to a value as it is known."""
    near = (round(float(value), n) for n in range(6))
    return next((each for each in near if abs(each - value) <= within), float(value)) + 0.0


def _with_scenarios(text: str, study: Study, measured: Response) -> str:
    """Scenarios of the ready study that weigh measured channels alone; all of them where none does."""
    kept = [s.name for s in study.scenarios if {*map(channel_of, s.weighed)} <= {*measured}]
    if not kept or len(kept) == len(study.scenarios):
        return text
    text = re.sub(r"^scenarios = \[[^\]]*\]", f"scenarios = {toml_value(kept)}", text, flags=re.MULTILINE)
    return text if study.generalise_by in kept else re.sub(r"(?m)^generalise_by = .*\n", "", text)


def _tables(study: Study, measured: Response) -> Iterator[tuple[str, str]]:
    """Text of the parameters of each region, its name first; nothing without an estimate."""
    space, protocol, unit = study.space, study.protocol, study.modulus_unit
    if not isinstance(protocol, Indentation) or FORCE.name not in measured:
        return
    middle = np.array([0.5 * (p.lower + p.upper) for p in space.parameters])
    thetas, every = space.thetas(middle), space.complete(dict(zip(space.names, middle, strict=True)))
    force = float(np.abs(measured[FORCE.name].ordinate).max())
    # The force shows a mean of the layers, and each is stiffer or softer: 1.4 mm of skin 5.6 times stiffer.
    wide = WIDE if len(space.regions) == 1 else 4.0 * WIDE
    for region in space.regions:
        if not isinstance(region.material, IsotropicMaterial):
            continue  # it has directions
        young = float(secant_young_MPa(region.material, thetas[region.region], np.array([1e-3]))[0])
        names = [p.name for p in region.material.parameters if p.kind == "modulus"]
        searched = (name for name in names if region.name_of(name) in space.names)
        first = next((name for name in searched if every[region.name_of(name)] > 0.0), None)
        estimate = force / hertz_N(young, protocol) if young > 0.0 else 0.0
        if first is None or not (np.isfinite(estimate) and estimate > 0.0):
            continue
        lines = [f"[region.{region.region}.parameters]"]
        for p in region.material.parameters:
            value = every[region.name_of(p.name)]
            entry = f"{value:.4g}"
            if p.name == first:
                ends = (f"{estimate * value * by} {p.unit}" for by in (1.0 / wide, wide))
                lower, upper = (f"{convert(end, unit):.3g} {unit}" for end in ends)
                entry = f'{{ lower = "{lower}", upper = "{upper}", scale = "log" }}{HALF_SPACE}'
            elif p.kind == "modulus":
                entry = f'"{value / every[region.name_of(first)]:.4g} * {first}"'
            elif p.unit:
                entry = f'"{value:.4g} {p.unit}"'
            lines.append(f"{p.name} = {entry}")
        yield region.region, "\n".join(lines) + "\n\n"


def _tables_of_test(study: Study, measured: Response) -> Iterator[tuple[str, str]]:
    """Text of the parameters of a specimen: the ready moduli, times measured stress over the middle's."""
    space, unit, ((mode, curve), *_) = study.space, study.modulus_unit, measured.curves.items()
    region, *others = space.regions
    material = region.material
    if others or mode not in MODES or not isinstance(material, IsotropicMaterial):
        return
    middle = np.array([0.5 * (p.lower + p.upper) for p in space.parameters])
    theta = space.thetas(middle)[region.region]
    every = space.complete(dict(zip(space.names, middle, strict=True)))
    # Next to the undeformed specimen its material has no stress, and a creep test has its largest.
    modelled = np.abs(nominal_stress(material, theta, mode, curve.abscissa))
    ratio = abs(curve.ordinate[modelled.argmax()]) / modelled.max()
    if not (np.isfinite(ratio) and ratio > 0.0):
        return
    searched = {p.name: p for p in space.parameters}
    lines = [f"[region.{region.region}.parameters]"]
    for p in material.parameters:
        name, times = region.name_of(p.name), ratio if p.kind == "modulus" else 1.0
        found = searched.get(name)
        ends = (every[name],) * 2 if found is None else (found.lower, found.upper)
        lower, upper = (toml_value(_quantity(times * end, p, unit)) for end in ends)
        ranges = f"{{ lower = {lower}, upper = {upper} }}   # {MARK}: the ready range, scaled to your stress"
        lines.append(f"{p.name} = {lower if found is None else ranges}")
    yield region.region, "\n".join(lines) + "\n\n"


def _quantity(value: float, parameter: Parameter, modulus_unit: str) -> str | float:
    """Value of a parameter as a study has it, with its unit."""
    unit = modulus_unit if parameter.kind == "modulus" else parameter.unit
    number = float(f"{convert(f'{value} {parameter.unit}', unit) if unit else value:.3g}")
    return f"{number:g} {unit}" if unit else number


def _marked(text: str, mark: str) -> str:
    """Text with a mark on each line that is copied, in the tables of the motion and the materials."""
    lines, table = [], ""
    for line in text.splitlines():
        table = line.strip("[]") if line.startswith("[") else table
        is_copied = table.split(".")[0] in ("protocol", "region") or table == "fit.searched"
        is_value = re.match(r"\w[\w.-]* = .*[^\[{,]$", line) is not None
        lines.append(line + mark if is_copied and is_value and "#" not in line else line)
    return "\n".join(lines) + "\n"
