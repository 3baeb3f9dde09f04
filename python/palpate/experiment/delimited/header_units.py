"""Units in the names of columns: ``fx_N``, ``x [m]``, ``Fz (N)``, ``torque_N_m``."""

import re
from types import MappingProxyType
from typing import Literal

from palpate import units
from palpate.errors import CurveError

Kind = Literal["time", "length", "force", "moment", "angle"]

BASE_UNITS: MappingProxyType[Kind, str] = MappingProxyType(
    {"time": "s", "length": "mm", "force": "N", "moment": "N·mm", "angle": "rad"}
)
"""Unit of each kind in a recording."""

_DEGREE = 0.017453292519943295

_SPELLINGS: dict[Kind, dict[str, float]] = {
    "time": {
        **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
        **dict.fromkeys(("ms", "msec", "milliseconds"), 1e-3),
        **dict.fromkeys(("us", "µs", "μs", "usec", "microseconds"), 1e-6),
        **dict.fromkeys(("ns", "nsec", "nanoseconds"), 1e-9),
    },
    "length": {
        **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), 1e3),
        "cm": 10.0,
        **dict.fromkeys(("mm", "millimeter", "millimetre"), 1.0),
        **dict.fromkeys(("um", "µm", "μm"), 1e-3),
        **dict.fromkeys(("in", "inch"), 25.4),
    },
    "force": {
        **dict.fromkeys(("N", "newton", "newtons"), 1.0),
        "kN": 1e3,
        "mN": 1e-3,
        "uN": 1e-6,
        **dict.fromkeys(("kgf", "kp"), 9.80665),
        "gf": 9.80665e-3,
        "lbf": 4.4482216152605,
    },
    "moment": {
        **dict.fromkeys(("Nm", "N m", "N·m", "N*m", "N.m", "N-m", "N_m"), 1e3),
        **dict.fromkeys(("Nmm", "N mm", "N·mm", "N*mm", "N.mm", "N-mm", "N_mm"), 1.0),
        **dict.fromkeys(("mNm", "mN m", "mN·m", "mN*m", "mN.m", "mN-m", "mN_m"), 1.0),
        **dict.fromkeys(("Ncm", "N cm", "N·cm", "N*cm", "N_cm"), 10.0),
    },
    "angle": {
        **dict.fromkeys(("rad", "radian", "radians"), 1.0),
        "mrad": 1e-3,
        **dict.fromkeys(("deg", "degree", "degrees", "°"), _DEGREE),
    },
}

UNITS: MappingProxyType[str, tuple[Kind, float]] = MappingProxyType(
    {text: (kind, factor) for kind, texts in _SPELLINGS.items() for text, factor in texts.items()}
)
"""Kind and factor to the recording's unit, by spelling."""

_BRACKETED = re.compile(r"\s*(?P<label>.*?)[\s_]*[\[({<]\s*(?P<unit>[^\[\](){}<>]*?)\s*[\])}>]\s*")
_INDEX = re.compile(r"[\d:,\s]*")


def unit_in(name: str) -> tuple[str, str]:
    """Label and unit in a column's name; the unit is empty where it shows none.

    Examples
    --------
    >>> unit_in("fx_N"), unit_in("Fz (mN)"), unit_in("torque_x_N_m"), unit_in("state")
    (('fx', 'N'), ('Fz', 'mN'), ('torque_x', 'N_m'), ('state', ''))
    """
    bracketed = _BRACKETED.fullmatch(name)
    if bracketed and not _INDEX.fullmatch(bracketed["unit"]):
        return bracketed["label"], bracketed["unit"]
    parts = re.split(r"[_\s/]+", name.strip())
    for n_parts in (2, 1):
        unit = "_".join(parts[-n_parts:])
        if len(parts) > n_parts and unit in UNITS:
            label = name.strip()[: -len(unit)].rstrip("_ /\t")
            return label, unit
    return name.strip(), ""


def kind_of(unit: str) -> Kind | None:
    """Kind of quantity of a unit; None where it is not one that a log of a press needs."""
    known = UNITS.get(unit)
    return known[0] if known else None


def factor_to_base(unit: str, kind: Kind, where: str) -> float:
    """Factor from ``unit`` to the recording's unit of a kind.

    Parameters
    ----------
    unit : str
        A spelling of ``UNITS``, or anything that a quantity in study.toml may have.
    where : str
        File and column, for messages.

    Raises
    ------
    CurveError
        The unit measures something else, or is unknown.
    """
    known = UNITS.get(unit)
    if known is not None:
        if known[0] == kind:
            return known[1]
        raise CurveError(
            f"{where}: '{unit}' is a unit of {known[0]} where one of {kind} is needed "
            f"(such as {BASE_UNITS[kind]}); choose another column, or correct unit in the channel map"
        )
    try:
        return units.convert(f"1 {unit}", BASE_UNITS[kind])
    except ValueError as error:
        raise CurveError(f"{where}: {error}; correct unit in the channel map") from None
