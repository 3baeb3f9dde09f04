"""Conversion of units: text such as ``"15 mm"`` to a number in palpate's unit.

A plain number is accepted for dimensionless quantities only. Angles are not dimensionless
here, unlike in SI: ``"0.4"`` is not an angle and ``"5 deg"`` is not a ratio.
"""

import re
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

if TYPE_CHECKING:
    import pint

DIMENSIONLESS = frozenset({"", "1", "-", "dimensionless"})
_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")
_LONGEST = 100
"""Most characters of a quantity."""
_UNIT = re.compile(r"(?:(?:[^\W\d_]\w*|[°%])(?:\s*(?:\^|\*\*)\s*[+-]?\d(?!\d))?|1|[*/·()\s])*+")
"""Names, each to a power of one digit, multiplied and divided: fast to evaluate."""


@cache
def _registry() -> "pint.UnitRegistry[float]":
    import pint

    return pint.UnitRegistry()


def convert(given: object, unit: str, usual: str = "") -> float:
    """Convert a quantity, written with its unit, to ``unit``.

    Parameters
    ----------
    given : str, int or float
        ``"15 mm"``; a plain number only where ``unit`` is dimensionless.
    unit : str
        ``"mm"``, ``"MPa"``, ``"deg"``, ``"s"`` …; ``"1"`` for dimensionless.
    usual : str, optional
        Unit of the quantities next to it, which an error proposes where there is none.

    Raises
    ------
    ValueError
        Not a number with a unit, an unknown unit, or a unit of another dimension.

    Examples
    --------
    >>> convert("1.5 cm", "mm")
    15.0
    >>> convert("20 kPa", "MPa")
    0.02
    """
    plain = unit in DIMENSIONLESS
    if isinstance(given, bool) or not isinstance(given, str | int | float):
        raise ValueError(f"{given!r} is not a quantity; {_example(unit, is_range=isinstance(given, list))}")
    if not isinstance(given, str):
        if not plain:
            raise ValueError(f'{given!r} has no unit; write "{given} {usual or unit}"')
        return _finite(float(given), given, unit)
    if len(given) > _LONGEST:
        raise ValueError(f"{given[:40]!r}… has more than {_LONGEST} characters; {_example(unit)}")
    if re.fullmatch(r"\s*[+-]?\d*,\d.*", given):
        raise ValueError(f'{given!r} has a decimal comma; write "{given.strip().replace(",", ".")}"')
    match = _QUANTITY.fullmatch(given)
    if match is None:
        raise ValueError(f"{given!r} is not a number with a unit; {_example(unit)}")
    number, written = match.groups()
    if not written and not plain:
        raise ValueError(f'{given!r} has no unit; write "{number} {usual or unit}"')
    try:
        return _finite(float(number) * _factor(written, unit, given), given, unit)
    except OverflowError:
        return _finite(float("inf"), given, unit)


def unit_of(given: str) -> str:
    """Unit of a quantity as it is written; empty for a plain number.

    Examples
    --------
    >>> unit_of("20 kPa")
    'kPa'
    """
    match = _QUANTITY.fullmatch(given)
    return match.group(2) if match else ""


def is_unit(text: str) -> bool:
    """Whether a text is a unit of a physical quantity; a count of something is none.

    Examples
    --------
    >>> is_unit("mm/min"), is_unit("V"), is_unit("counts"), is_unit("filtered")
    (True, True, False, False)
    """
    unit = _parsed(text) if text else None
    return unit is not None and (_dimension(unit) == "angle" or not _dimension(unit).startswith("ratio"))


def convert_factor(given: str, per: str, unit: str) -> float:
    """Convert a factor on quantities in ``per`` to what it is worth in ``unit``.

    Parameters
    ----------
    given : str
        A number, with a unit only where ``per`` and ``unit`` are of different kinds.

    Raises
    ------
    ValueError
        Not a finite number, or not a factor between the two.

    Examples
    --------
    >>> convert_factor("2", "kPa", "MPa")
    0.002
    """
    match = _QUANTITY.fullmatch(given)
    if match is None:
        raise ValueError(f"{given!r} is not a number; write a factor, such as 20")
    number, written = match.groups()
    units = "*".join(each for each in (written, per) if each not in DIMENSIONLESS)
    return convert(f"{number} {units}", unit)


def _finite(value: float, given: object, unit: str) -> float:
    if abs(value) < float("inf"):
        return value
    raise ValueError(f"{given!r} is not finite; {_example(unit)}")


def _example(unit: str, *, is_range: bool = False) -> str:
    one = "use a plain number, e.g. 1.0" if unit in DIMENSIONLESS else f'use e.g. "10 {unit}"'
    return f"{one}, or {{ lower = …, upper = … }} for a range" if is_range else one


def _factor(written: str, unit: str, given: str) -> float:
    if written == unit and unit in ("mm", "N", "MPa", "N*mm", "deg", "s"):
        return 1.0  # without pint, which is slow to import
    target, source = _parsed("" if unit in DIMENSIONLESS else unit), _parsed(written)
    if source is None or target is None:
        raise ValueError(f"{given!r}: unknown unit '{written}'; {_meant(written, unit) or _example(unit)}")
    if _dimension(source) != _dimension(target):
        wanted = "a plain ratio" if unit in DIMENSIONLESS else f"of the kind of {unit}"
        raise ValueError(f"{given!r} is not {wanted}; {_meant(written, unit) or _example(unit)}")
    return float(_registry().Quantity(1.0, source).to(target).magnitude)


def _meant(written: str, unit: str) -> str:
    """Suggest the usual unit of a kind that differs in case alone; empty where there is none."""
    usual_ones = ["mm", "cm", "m", "N", "mN", "kN", "Pa", "kPa", "MPa", "GPa", "N*mm", "N*m", "deg", "rad"]
    usual_ones += ["s", "ms", "min", "h", "MB", "GB"]
    alike = [usual for usual in usual_ones if usual.casefold() == written.casefold() and usual != written]
    kind = _parsed("" if unit in DIMENSIONLESS else unit)
    for usual in alike:
        source = _parsed(usual)
        if source is not None and kind is not None and _dimension(source) == _dimension(kind):
            return f"did you mean '{usual}'?"
    return ""


def _parsed(written: str) -> "pint.Unit | None":
    if not _UNIT.fullmatch(written):
        return None
    try:
        return _registry().parse_units(written.replace("·", "*"))
    except Exception:  # pint's parser raises a dozen kinds on junk
        return None


def _dimension(unit: "pint.Unit") -> str:
    names = {str(name) for name, _ in _registry().Quantity(1.0, unit).unit_items()}
    root = _registry().Quantity(1.0, unit).to_root_units().units
    if root == _registry().Unit("radian"):
        return "angle"
    if root == _registry().Unit("bit"):
        return "amount of memory"
    if unit.dimensionless and not names <= {"percent"}:
        return f"ratio of {sorted(names)}"
    # The order of the factors is another in each unit.
    return str(sorted(unit.dimensionality.items()))


@dataclass(frozen=True, slots=True)
class Quantity:
    """Annotation of a settings field that is a quantity with a unit.

    ``Annotated[float, Quantity("mm")]`` reads ``"1.5 cm"`` as 15.0.
    """

    unit: str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:  # noqa: ANN401
        """Convert first, then check the number."""
        return core_schema.no_info_before_validator_function(self._convert, handler(source))

    def _convert(self, given: object) -> float:
        return convert(given, self.unit)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Describe the value in the file: text with a unit."""
        if self.unit in DIMENSIONLESS:
            return {"type": ["number", "string"]}
        return {"type": "string", "examples": [f"10 {self.unit}"]}
