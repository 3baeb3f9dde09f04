"""Units in the names of columns: ``fx_N``, ``x [m]``, ``Fz (N)``, ``torque_N_m``, ``Time, s``."""

import re
import tomllib
import unicodedata
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from itertools import product
from types import MappingProxyType
from typing import Literal

from palpate import units
from palpate.errors import CurveError

Kind = Literal["time", "length", "force", "moment", "angle", "stress", "ratio", "mass", "other"]

BASE_UNITS: MappingProxyType[Kind, str] = MappingProxyType(
    {
        "time": "s",
        "length": "mm",
        "force": "N",
        "moment": "N·mm",
        "angle": "rad",
        "stress": "MPa",
        "ratio": "1",
        "mass": "kg",
    }
)
"""Unit of each kind in a recording."""

_G, _LONGEST_UNIT = 9.80665, 20  # standard gravity; characters
_MEASURES: tuple[tuple[Kind, str, float], ...] = (
    *((kind, base, 1.0) for kind, base in BASE_UNITS.items()),
    ("force", "kg", _G),
    ("moment", "kg*mm", _G),
    ("stress", "kg/mm**2", _G),
)
"""Kinds, a unit that measures each, and its factor to the kind's base: a load in kg is its weight."""

_TABLES = tomllib.loads(files(__package__).joinpath("units.toml").read_text(encoding="utf-8"))
_SPELT = {word: unit for unit, words in _TABLES["spelt"].items() for word in words.split()}
_RATIOS = {word: float(factor) for factor, words in _TABLES["ratios"].items() for word in words.split()}
UNITS = frozenset(
    {*_RATIOS, *_SPELT, *_TABLES["usual"]["units"].split()} - {*_TABLES["usual"]["not_alone"].split()}
) | frozenset(map("".join, product(("N", "mN"), ("", *" ·*.-_"), ("m", "mm", "cm"))))
"""Units that are believed behind a name without brackets, or alone in a cell, without accents."""

_OF_LABELS = {
    unit: frozenset(words.split())
    for units_of, words in _TABLES["labels"].items()
    for unit in units_of.split()
}
"""Units that are believed without brackets behind these words alone: x_min is the least x."""

_OTHER_CASE = {unit.lower(): unit for unit in _TABLES["usual"]["other_case"].split()}
_OF_CAPITALS = {"MilliN": "mN", "MicroN": "uN", "N": "N", "Nm": "Nm", "Um": "um", "Ms": "ms"} | {
    word: f"{word.upper()}?" for word in ("Mn", "MN", "UN", "Un", "Us", "Ns")
}
"""Units at the end of a name such as depthUm; one that its capital leaves open is none that is known."""
_NO_UNITS = {
    "N": re.compile(r"(?i)(.*[\W_])?(samples?|cases?|specimens?|tests?|trials?|runs?|curves?)"),
    "m": re.compile(r"(?i)(.*[\W_])?(ft|wrench)"),
}
"""Letters that are no units behind some names: the number in sampleN, and the moment in ft.m."""
_ANNOTATIONS = frozenset(_TABLES["usual"]["annotations"].split())
"""Words in brackets that are no units."""

_WIDE = str.maketrans("（）［］【】：／", "()[][]:/")
_PLAIN = str.maketrans({"ł": "l", "Ł": "L", "ø": "o", "Ø": "O", "ı": "i", "ß": "ss", "µ": "u", "μ": "u"})
_BRACKETED = re.compile(r"[\s_]*[\[({<]\s*([^\[\](){}<>]*?)\s*[\])}>]\s*")
_SIGN = re.compile(r"[\[(][^\])]*(positive|negative)[^\])]*[\])]", re.IGNORECASE)
"""Remark in brackets on the sign of a column, which the numbers show."""
_NEWTON, _PRODUCT = re.compile(r"([kmuµμn]?N)(mm|cm|m)"), re.compile(r"(?<=[^\W\d_])[ ._-](?=[^\W\d_])")
_PART = re.compile(r"(?:1/1(0+)|0\.(0+1)|1(?:0\^|e)-(\d))[ *·×]*(?=[^\W\d])(.+)")
"""Unit behind a power of ten, 0.001 mm, 1/10 N or 10^-3 in; 10 N and 0.1 N may be the range of a cell."""
_POWER = re.compile(r"(?<=[^\W\d_])\^?(\d)$")


def unit_in(name: str) -> tuple[str, str]:
    """Label and unit in a column's name; the unit is empty where it shows none.

    Examples
    --------
    >>> unit_in("fx_N"), unit_in("Fz (lb)"), unit_in("torque_x_N_m"), unit_in("state")
    (('fx', 'N'), ('Fz', 'lb'), ('torque_x', 'N_m'), ('state', ''))
    """
    name = name.translate(_WIDE)
    # R replaces blanks, brackets and signs such as % by dots: Depth..mm. was Depth (mm).
    if of_r := re.fullmatch(r"(.*?[^.])\.\.+(|[^.].*?)\.", name.strip()):
        return of_r[1], of_r[2] or "..."
    found = [each for each in _BRACKETED.finditer(name) if not re.fullmatch(r"[\d:,\s]*", each[1])]
    shown = [each for each in found if each[1].lower() not in _ANNOTATIONS]
    known = [e for e in shown if kind_of(bare_unit(e[1])) and not kind_of(unit_in(name[e.end() :])[1])]
    last = [each for each in found if each.end() == len(name)]
    # A remark may be behind the unit, Force [N] (compression negative), as the unit is in Cell(s) force N.
    chosen = [each for each in last if each in known] or (known if len(known) == 1 else last)
    if chosen:
        before, behind = name[: chosen[0].start()].strip(), _SIGN.sub("", name[chosen[0].end() :]).strip()
        own = "" if chosen[0] in known else unit_in(before)[1]
        if own or chosen[0] not in shown:
            return name.strip(), own
        return f"{before} {behind}".strip(), bare_unit(chosen[0][1])
    for unit in re.findall(r"(?=(?:^|[-_\s,/.])([^-\s_,/.].*)$)", name.strip()):
        label = re.sub(r"[\s_]in$", "", name.strip()[: -len(unit)].rstrip("-_ /\t,."))  # Force in N
        if label and _fits(label, unit):
            return label, unit
    label, _, unit = name.strip().rpartition(" in ")
    if label and kind_of(unit):  # Spannung in N/cm²
        return label, unit
    before, _, label = name.strip().partition(" ")
    if label and (before == "%" or len(before) > 1) and before != "in" and is_believed(before):  # mN Force
        return label, before
    in_capitals = re.fullmatch(r"([A-Z\d_ ]+)[_ ]([A-Z]{2,3})", name)  # DEPTH_UM
    pattern = r"(.*?[a-z\d])((?:Milli|Micro|Kilo)?[A-Z][A-Za-z]?|Deg|Rad|Sec|[KM]Pa)"
    if written := in_capitals or re.fullmatch(pattern, name):
        label, word = written.groups()
        word = word.title() if in_capitals else word
        is_open = in_capitals and word == "Nm" and not re.search("TORQUE|MOMENT|(^|_)[MT][XYZ]?$", label)
        unit = "NM?" if is_open else _OF_CAPITALS.get(word, _OTHER_CASE.get(word.lower(), ""))
        unit = unit if unit.endswith("?") or _fits(label, unit) else ""
        return (label, unit) if unit else (name, "")
    is_both = _RATIOS.get(name.strip().lower(), 1.0) < 1.0  # Microstrain
    return ("strain", name.strip()) if is_both and "strain" in name.lower() else (name.strip(), "")


def _fits(label: str, unit: str) -> bool:
    """Whether a word behind a label is a unit: N is the number in sampleN, but not in Force_test_N."""
    is_named = {word.lower() for word in re.split(r"[\W_]+", label)} & _OF_LABELS.get(unit, frozenset())
    is_letter = unit in _NO_UNITS and _NO_UNITS[unit].fullmatch(label) is not None
    return bool(is_named) or (is_believed(unit) and not is_letter)


def is_believed(unit: str) -> bool:
    """Whether a word is one of ``UNITS``, a long one in letters of any size."""
    plain = plain_letters(unit)
    return not UNITS.isdisjoint({unit, plain, plain.lower() if len(plain) > 3 else plain})


def bare_unit(cell: str) -> str:
    """Unit in a cell of a line of units, without brackets; empty where a quantity has none."""
    bare = _SIGN.sub("", cell).strip().strip("[](){}<>").strip()
    before = bare.partition(",")[0]  # N, compression negative
    bare = before if before != bare and kind_of(before) else bare
    return "" if bare in {"-", "--", "1"} else bare


def is_units_line(cells: Sequence[str], share: float = 0.5) -> bool:
    """Whether a share of the filled cells of a line are units, as some loggers write them under the names."""
    filled = [cell for cell in cells if bare_unit(cell)]
    known = [c for c in filled if is_believed(c) or (bare_unit(c) != c and kind_of(bare_unit(c)))]
    if len(filled) > 2 and all(kind_of(bare_unit(cell)) not in (None, "other") for cell in filled):
        share = min(share, 1.0 / len(filled))  # g alone may be a name, and next to s and mm it is a unit
    return 0 < share * len(filled) <= len(known) and all(len(cell) <= _LONGEST_UNIT for cell in filled)


def stated_units(head: str, names: Sequence[str]) -> list[str]:
    """Units of some columns in the text above them: ``units: s, mm``, ``force: mN`` or ``force in mN``."""
    for line in re.findall(r"(?im)^\W*units?\s*[:=]\s*\[?(.*?)\]?\s*$", head):
        cells = re.split(r"[,;\t|]\s*", line)
        if len(cells) == len(names) and is_units_line(cells):
            return [bare_unit(cell) for cell in cells]
    behind = r"(?: units?)?\W*?(?:[:=(\[]|\bin\b)\s*([^\s,;)\]}]+)"
    found = [{*re.findall(rf"(?i)(?<!\w){re.escape(name)}{behind}", head)} for name in names]
    known = [{unit for unit in units if is_believed(unit)} for units in found]
    return ["".join(units) if len(units) == 1 else "" for units in known]


def plain_letters(text: str) -> str:
    """Text whose Latin letters have no accents."""
    letters = (unicodedata.normalize("NFKD", c)[0] if c < "\u0370" and c != "°" else c for c in text)
    return "".join(letters).translate(_PLAIN)


@cache
def factors_of(unit: str) -> MappingProxyType[Kind, float]:
    """Factors to the recording's unit of each kind that a unit may measure: the first is its own kind.

    They are empty for an unknown unit, and of the kind ``other`` for a unit that no log has.
    """
    if part := _PART.fullmatch(unit):
        tenth = 10.0 ** -int(part[3] or len(part[1] or part[2]))
        known = factors_of(part[4]).items()
        return MappingProxyType({kind: float(f"{tenth * one:.15g}") for kind, one in known})
    plain = plain_letters(unit)
    spelt = _SPELT.get(unit) or _SPELT.get(plain.lower(), unit if plain.isupper() else plain)
    if len(spelt) > 1 and spelt.isupper():
        spelt = _OTHER_CASE.get(spelt.lower(), spelt)
    spelt = spelt.replace("²", "2").replace("³", "3").replace("⋅", "*").replace("·", "*").replace("×", "*")
    spelt = _POWER.sub(r"**\1", _NEWTON.sub(r"\1*\2", _PRODUCT.sub("*", spelt)))
    if not units.is_unit(spelt):
        is_word = len(spelt) > 3 and spelt.istitle() and units.is_unit(spelt.lower())  # Newtons
        spelt = spelt.lower() if is_word else _OTHER_CASE.get(spelt.lower(), spelt)
    found: dict[Kind, float] = {}
    for kind, base, factor in _MEASURES:
        try:
            value = factor * units.convert(f"1 {spelt}", base.replace("·", "*"))
        except ValueError:
            continue
        found[kind] = float(f"{value:.15g}")  # 1e-6 and not 1.0000000000000002e-06
    if not found:  # a length over a length, such as mm/m
        parts = spelt.split("/") if spelt.count("/") == 1 else ()
        lengths = [factors_of(part).get("length", 0.0) for part in parts]
        ratio = lengths[0] / lengths[1] if lengths and all(lengths) else 0.0
        if ratio := _RATIOS.get(spelt.lower(), float(f"{ratio:.15g}")):
            found["ratio"] = ratio
    if not found and units.is_unit(spelt):
        found["other"] = 1.0
    if "mass" in found:  # it is its own kind first
        found = {"mass": found["mass"], **found}
    return MappingProxyType(found)


def kind_of(unit: str) -> Kind | None:
    """Kind of quantity of a unit; None where the unit is not known, ``other`` where no log needs it."""
    return next(iter(factors_of(unit)), None) if unit else None


def factor_to_base(unit: str, kind: Kind, where: str) -> float:
    """Factor from ``unit`` to the recording's unit of a kind; a mass is its weight where a force is needed.

    A CurveError names ``where``, file and column, if the unit measures something else or is unknown.
    """
    known = factors_of(unit)
    if kind in known:
        return known[kind]
    if not known:
        raise CurveError(
            f"{where}: the unit '{unit}' is not known; write a unit such as {BASE_UNITS[kind]} in its place"
        )
    raise CurveError(
        f"{where}: '{unit}' is a unit of {'another kind' if 'other' in known else next(iter(known))} where "
        f"one of {kind} is needed (such as {BASE_UNITS[kind]}); choose another column, or correct unit"
    )
