"""Meaning of columns' names, by the words of ``words.toml`` that loggers and testing machines use.

A word is looked up without accents and in small letters; German compounds are known by their last part.
"""

import re
import tomllib
from collections.abc import Mapping, Sequence, Set
from importlib.resources import files
from itertools import chain, pairwise
from typing import NamedTuple

import numpy as np

from palpate.api import FloatArray
from palpate.api.files import BASE_UNITS, Column, Kind, factors_of, kind_of, plain_letters, unit_in

_WORD = re.compile(
    r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[\u0370-\u04ff]+|[\u3040-\u30ff\u4e00-\u9fff\uac00-\ud7a3]+"
)
_CONVERSION, _COARSEST = 1e-4, 0.1
"""Relative error of a conversion, and largest share of a curve that its digits may leave open."""
_COMPOUND = ("kraft", "weg", "zeit", "dehnung", "spannung", "tiefe", "winkel", "moment")
"""Ends of German compounds, which are read as these words."""
_TABLES = tomllib.loads(files(__package__).joinpath("words.toml").read_text(encoding="utf-8"))
_MEANINGS = {word: meaning for meaning, words in _TABLES["meanings"].items() for word in words.split()}
"""Meanings of words in other letters; a sign that is in none of them is a word of its own."""
_FOREIGN_WORD = re.compile("|".join([*sorted(_MEANINGS, key=len, reverse=True), r"[\u0370-\u04ff]+", "."]))


class Role(NamedTuple):
    """Quantity: the kind of its unit, the words of its one column, the plainest first, and of its vector."""

    kind: Kind
    words: tuple[str, ...]
    vector: frozenset[str]


def _sets(table: Mapping[str, str]) -> Mapping[str, frozenset[str]]:
    return {name: frozenset(words.split()) for name, words in table.items()}


ROLES: Mapping[str, Role] = {
    name: Role(of["kind"], tuple(of["words"].split()), frozenset(of.get("vector", "").split()))
    for name, of in _TABLES["roles"].items()
}
"""Quantities that a column or a vector has, by role."""
TURNS = {word: axis for axis, words in _TABLES["turns"].items() for word in words.split()}
"""Axes of angles that have a name of their own."""
WORDS = _sets(_TABLES["words"])
"""Words that show what a column is besides its quantity."""
TITLES: Mapping[str, str] = _TABLES["titles"]
"""Titles of the measures that are converted."""
_MEASURES = {kind: _sets(table) for kind, table in _TABLES["measures"].items()}


def words_of(name: str) -> tuple[str, ...]:
    """Words of a column's name, without its unit, in small letters and without accents.

    Examples
    --------
    >>> words_of("actual_TCP_force_0"), words_of("wrench.force.x"), words_of("Fx [N]")
    (('actual', 'tcp', 'force', '0'), ('wrench', 'force', 'x'), ('fx',))
    """
    label = plain_letters(unit_in(name)[0])
    of = _TABLES["components"]
    found = re.search(of["pattern"], label)
    if found and not has_role(rest := words_of(label.replace(found[0], ""))):
        return (*of[found[1].lower()].split(), *rest)
    words = (
        _FOREIGN_WORD.findall(word.lower()) if word[0] >= "\u0370" else [word.lower()]
        for word in _WORD.findall(label)
    )
    return tuple(_MEANINGS.get(word, word) for word in chain.from_iterable(words))


def factor_of(column: Column, kind: Kind) -> float | None:
    """Factor from a column's unit to the base unit of a kind; None where it shows another, or none."""
    return factors_of(column.shown_unit).get(kind) if column.shown_unit else None


def unit_of(role: str) -> str:
    """Unit of a role in a curve."""
    kind = ROLES[role].kind
    return "degrees" if kind == "angle" else BASE_UNITS[kind]


# ------------------------------------------------------------------ likeness to a quantity


class Rank(NamedTuple):
    """Order of the columns that may be a quantity: the least is the likeliest."""

    is_elsewhere: bool  # at a joint, which may not be the tool
    unit: bool  # is one that is not known, or that no log has: it is asked about
    is_commanded: bool
    unlikeness: float  # less where words, unit or shape show the quantity
    words: tuple[int, ...]  # counts in a second form and in all, and place of one in the table


def rank_of(
    names: Sequence[str], column: Column, role: str, score: float, *of_words: int, has_unit: bool = True
) -> Rank | None:
    """Rank by the score of the words and by the unit of a column; None where it is no such quantity.

    A unit of the quantity's kind counts more than a word, and a unit of another kind excludes the column.
    """
    shown, fits = column.shown_unit, factor_of(column, ROLES[role].kind) is not None
    score += 3.0 * (fits and has_unit)
    is_odd = has_unit and bool(shown) and not fits
    if score <= 0.0 or (is_odd and kind_of(shown) not in (None, "other")):
        return None
    known = {*names}
    is_commanded = bool(WORDS["commanded"] & known) and score >= 1.0
    n_forms = len(WORDS["filtered"] & known) + bool(WORDS["aside"] & known)
    return Rank(bool(WORDS["elsewhere"] & known), is_odd, is_commanded, -score, (n_forms, *of_words))


class Picked(NamedTuple):
    """Column of a role, its factor to the base unit (None where it shows no such unit), and remarks."""

    column: Column
    factor: float | None
    remarks: tuple[str, ...] = ()

    def question(self, role: str) -> str:
        """Question for the unit where the file shows one that is not known; else empty."""
        shown = self.column.shown_unit
        if self.factor is not None or not shown:
            return ""
        ask = f"the file gives '{shown}', which is no unit of {role}"
        return f"{self.column.name}: {ask}; give scale, the factor to {unit_of(role)}"


def pick(columns: Sequence[Column], role: str) -> Picked | None:
    """Plainest column of a role, or the only one with its unit; None where none is, or several differ."""
    ranked = _ranked(columns, role)
    alike = _alike(ranked, columns, role)
    if (column := _finest(alike, ROLES[role].kind)) is None:
        return None
    others = [name for _, name, one in ranked if one not in alike]
    taken, names = f"{column.name} is taken", " and ".join(one.name for one in alike)
    remarks = [
        *[f"{names} agree within their digits: {taken}"] * (len(alike) > 1),
        *[f"{taken} for the {role}, and not {', '.join(others)}"] * bool(others),
        *[f"{taken} for the {role}, by its unit alone"] * (not ranked),
    ]
    if ranked and ranked[0][0].is_commanded:
        remarks.append(f"{column.name} is commanded, not measured; use the measured {role}")
    return Picked(column, factor_of(column, ROLES[role].kind), tuple(remarks))


def _alike(ranked: Sequence[tuple[Rank, str, Column]], columns: Sequence[Column], role: str) -> list[Column]:
    """Columns that are the likeliest for a role; where no word shows it, by its unit alone."""
    kind = ROLES[role].kind
    if ranked or kind == "ratio":
        return [column for rank, _, column in ranked if rank == ranked[0][0]]
    named = [(c, words_of(c.name)) for c in columns if factor_of(c, kind) is not None]
    free = [c for c, words in named if not (has_role(words, role) or WORDS["commanded"] & {*words})]
    return [column for column in free if np.isfinite(column.values).any()]


def _finest(columns: Sequence[Column], kind: Kind) -> Column | None:
    """Best column of one quantity in several units, which agree within their digits; else None.

    It is the one in the base unit, unless only the last digit of another explains how far they differ.
    """
    if len(columns) < 2 or len({words_of(column.name) for column in columns}) > 1:
        return columns[0] if len(columns) == 1 else None
    factors = np.array([factor_of(column, kind) or np.nan for column in columns])
    values = factors[:, None] * [column.values for column in columns]
    halves = factors * [_last_digit(column.values) for column in columns] / 2.0
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    # NaN where a row, or a unit, lacks in one of them.
    off = float(np.max(np.ptp(values, axis=0), initial=0.0)) - _CONVERSION * largest
    if not (off <= halves.sum() < _COARSEST * largest):
        return None
    base = int(np.argmin(np.abs(np.log(factors))))
    return columns[base if off <= np.delete(halves, base).max() else int(np.argmin(halves))]


def _last_digit(values: FloatArray) -> float:
    """Place of the last decimal digit of some numbers."""
    known = values[np.isfinite(values)]
    return next((10.0**-n for n in range(12) if np.array_equal(np.round(known, n), known)), 1e-12)


def spread_of(columns: Sequence[Column], role: str) -> Picked | None:
    """The one column that is the standard deviation of a role; None where none is, or several are."""
    named = ((column, words_of(column.name)) for column in columns)
    spread = ((column, words) for column, words in named if WORDS["spread"] & {*words})
    found = [column for column, words in spread if {*map(_simple, words)} & {*ROLES[role].words}]
    return Picked(found[0], factor_of(found[0], ROLES[role].kind)) if len(found) == 1 else None


def rivals(columns: Sequence[Column], role: str) -> tuple[str, ...]:
    """Names of the columns that are as likely for a role; empty where one is the likeliest, or none is."""
    alike = _alike(_ranked(columns, role), columns, role)
    return tuple(column.name for column in alike) if len(alike) > 1 else ()


def _ranked(columns: Sequence[Column], role: str) -> list[tuple[Rank, str, Column]]:
    """Columns that a word shows to be of a role, the likeliest first."""
    found = []
    for column in columns:
        words, known = words_of(column.name), ROLES[role].words
        places = [known.index(word) for word in map(_simple, words) if word in known]
        is_error = bool((WORDS["spread"] | WORDS["uncertainty"]) & {*words})
        if has_role(words, role) and {known[place] for place in places} <= {"z", "shear"}:
            continue  # Torque Z, Shear Stress
        if places and not is_error and np.isfinite(column.values).any():
            found.append((rank_of(words, column, role, 2.0, len(words), min(places)), column.name, column))
    return sorted((rank, name, column) for rank, name, column in found if rank is not None)


def _simple(word: str) -> str:
    return next((end for end in _COMPOUND if word.endswith(end)), word)


def has_role(words: Sequence[str], but: str = "") -> bool:
    """Whether a name is a quantity's, other than time and one more role."""
    return any({*map(_simple, words)} & {*role.words} for name, role in ROLES.items() if name != but)


# ------------------------------------------------------------------ strain and stress


class Test(NamedTuple):
    """Homogeneous test by the names of its strain and stress; ``questions`` where they leave it open."""

    mode: str
    strain: str
    stress: str
    is_compressive: bool
    questions: tuple[str, ...]
    remarks: tuple[str, ...]


def _mode_of(words: Set[str]) -> str:
    """Mode of a homogeneous test by the words of its names."""
    if words & (WORDS["shear"] | {"planar"}):
        return "pure_shear" if {"pure", "planar"} & words else "simple_shear"
    if words & WORDS["biaxial"]:
        return "equibiaxial"
    return "confined_compression" if "confined" in words and "unconfined" not in words else "uniaxial"


def _direction_of(column: Column) -> Set[str]:
    """Axes of a component by its name, x as 1, and words of a direction across the specimen."""
    label = plain_letters(unit_in(column.name)[0]).lower()
    axes = ["".join(sorted({*"".join(found)})) for found in re.findall(_TABLES["axes"]["pattern"], label)]
    return {axis.translate(str.maketrans("xyz", "123")) for axis in axes[-1:]} | (
        WORDS["across"] & {*words_of(column.name)}
    )


def _kinds_in(stated: Set[str]) -> list[Set[str]]:
    """Words of each kind of test in the text above the names; a uniaxial one is of either sense."""
    pulled, pushed = WORDS["tensile_test"], WORDS["compressive"] | {"confined", "unconfined"}
    either = {"uniaxial"} if stated.isdisjoint(pulled | pushed) else set[str]()
    kinds = (WORDS["shear"] | {"planar"}, WORDS["biaxial"], pulled, pushed, either)
    return [stated & kind for kind in kinds if stated & kind]


def _measures_of(
    strain: Column, stress: Column, along: Set[str], of: Set[str]
) -> tuple[list[str], list[str], list[str]]:
    """Measures of a strain and of a stress by the words of their names, and questions on them."""
    questions = [
        f"{column.name}: palpate does not convert a measure '{word}'; give nominal stress over stretch"
        for column, words in ((strain, along), (stress, of))
        for word in sorted(words & WORDS["not_converted"])
    ]
    ways = [_direction_of(column) for column in (strain, stress)]
    if WORDS["across"] & (ways[0] ^ ways[1]) or (all(ways) and ways[0] != ways[1]):
        ask = "are of two directions; give strain and stress along one axis"
        questions.append(f"{strain.name}, {stress.name}: {ask}")
    measure, kind = (
        ["" if name == "nominal" else name for name, words in _MEASURES[of_which].items() if words & names]
        for of_which, names in (("strain", along), ("stress", of))
    )
    if "component" in along and not measure:
        ask = 'keep offset = 1, or write strain = "log" or "green" in its place'
        questions.append(f"{strain.name}: nominal, logarithmic or Green-Lagrange strain? {ask}")
    if "kirchhoff" in of and "piola" not in of:  # Kirchhoff's stress is J σ, and J is 1
        kind = kind or ["true"]
    kind = kind or (["true"] if {"abaqus"} & along and {"s", "component"} <= of else [])
    is_open = {"component"} & of or {*ROLES["stress"].words}.isdisjoint(map(_simple, of))
    if {"piola"} & of and not kind:
        questions.append(f'{stress.name}: first or second Piola-Kirchhoff? write stress = "nominal" or "pk2"')
    elif not kind and (is_open or any(measure) > bool(questions)):
        questions.append(f"{stress.name}: true, second Piola-Kirchhoff or nominal? write it as stress")
    for column, found in ((strain, measure), (stress, kind)):
        if len(found) > 1:
            questions.append(f"{column.name}: the name has two measures; write one in the settings")
    return measure, kind, questions


def test_of(strain: Column, stress: Column, columns: Sequence[Column], stated: Set[str]) -> Test:
    """Mode and measures of a homogeneous test by its names.

    Where they are open, other columns and the words ``stated`` above the names may show them.
    """
    along, of = (
        {*words, *map("".join, pairwise(words))} for words in (words_of(strain.name), words_of(stress.name))
    )  # pk2 is a word, and pk and 2 are
    both = along | of
    measure, kind, questions = _measures_of(strain, stress, along, of)
    of_mode = WORDS["shear"] | WORDS["biaxial"] | WORDS["tensile"] | WORDS["compressive"]
    kinds = [] if both & of_mode else _kinds_in(stated)
    if len(kinds) > 1:
        questions.append("the text above the names has several tests: write the mode")
    mode = _mode_of(both := both.union(*kinds, stated & {"pure"}) if len(kinds) == 1 else both)
    remarks = (f"the text above the names states {mode}; correct it if that is wrong",) * (len(kinds) == 1)
    is_open = mode == "uniaxial" and not both & WORDS["tensile"]
    others = [(one.values, {*words_of(one.name)}) for one in columns if is_open]
    of_load = {"load", "force", "kraft", "last"}
    both = both.union(*(words for _, words in others if words & of_load and "cell" not in words))
    is_compressive = mode == "confined_compression" or bool(both & WORDS["compressive"])
    is_compressive |= any(gap[-1] < gap[0] for gap, words in others if "gap" in words)
    return Test(mode, "".join(measure[:1]), "".join(kind[:1]), is_compressive, tuple(questions), remarks)
