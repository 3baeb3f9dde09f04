"""Meaning of columns' names: one table of the words that loggers and testing machines use for each quantity.

A word is looked up without accents and in small letters; German compounds are known by their last part.
"""

import re
from collections.abc import Mapping, Sequence
from itertools import chain, pairwise
from typing import NamedTuple

import numpy as np

from palpate.api.files import BASE_UNITS, Column, Kind, factors_of, kind_of, plain_letters, unit_in

_WORD = re.compile(
    r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[\u0370-\u04ff]+|[\u3040-\u30ff\u4e00-\u9fff\uac00-\ud7a3]+"
)
_COMPOUND = ("kraft", "weg", "zeit", "dehnung", "spannung", "tiefe", "winkel", "moment")
"""Ends of German compounds, which are read as these words."""
_FIRST_FOREIGN = "\u0370"
_MEANINGS: Mapping[str, str] = {
    word: meaning
    for meaning, words in {
        "time": "時間 时间 시간 время",
        "displacement": "ストローク 変位 位移 行程 移動量 변위 перемещение ход",
        "depth": "深さ 深度 깊이 глубина",
        "deformation": "変形 变形 변형 деформация",
        "extension": "удлинение",
        "force": "試験力 试验力 荷重 载荷 负荷 力 하중 힘 сила нагрузка усилие",
        "angle": "角度 回転角 각도 угол",
        "torque": "トルク 扭矩 力矩 转矩 토크 момент",
        "position": "位置 위치 положение",
        "orientation": "姿勢 姿态",
        "quaternion": "四元数 クォータニオン",
        "stretch": "λ",
        "strain": "ひずみ 歪み 应变 변형률 ε",
        "stress": "応力 应力 응력 напряжение σ",
        "gamma": "γ",
        "tau": "τ",
        "theta": "θ",
        "omega": "ω",
        "compression": "圧縮 压缩 압축 сжатие",
        "tensile": "引張 拉伸 인장 растяжение",
        "shear": "せん断 剪切 전단 сдвиг",
        "true": "真",
        "nominal": "公称 工程",
    }.items()
    for word in words.split()
}
"""Words of names in other letters; Eastern ones have no blanks between them: 応力 is a stress and no 力.

A sign that is in none of them is a word of its own.
"""
_FOREIGN_WORD = re.compile("|".join([*sorted(_MEANINGS, key=len, reverse=True), r"[\u0370-\u04ff]+", "."]))


class Role(NamedTuple):
    """Quantity: the kind of its unit, the words of its one column, the plainest first, and of its vector."""

    kind: Kind
    words: tuple[str, ...]
    vector: frozenset[str]


def word_set(words: str) -> frozenset[str]:
    """Words between blanks."""
    return frozenset(words.split())


def _role(kind: Kind, words: str, vector: str = "") -> Role:
    return Role(kind, tuple(words.split()), word_set(vector))


ROLES: Mapping[str, Role] = {
    "travel": _role(
        "length",
        "depth indentation tiefe eindringtiefe profondeur profundidad enfoncement displacement disp "
        "deplacement desplazamiento spostamento verschiebung travel extension stroke weg crosshead traverse "
        "distance position deflection deformation compression course carrera recorrido corsa hub ext pos "
        "deslocamento verplaatsing forskjutning przemieszczenie draha uzama elongation z",
    ),
    "force": _role(
        "force",
        "force load kraft last charge effort carga fuerza forza carico forca kracht sila kuvvet yuk fn "
        "fz fy fx normal f cell",
        "f force forces kraft",
    ),
    "angle": _role("angle", "rotation angle twist turn winkel drehwinkel angulo angular"),
    "moment": _role(
        "moment",
        "torque moment drehmoment couple par tz mz",
        "t torque torques moment moments m tau drehmoment",
    ),
    "position": _role("length", "", "p pos position translation tcp tip tool point lage"),
    "orientation": _role(
        "angle",
        "",
        "q o quat quaternion orientation rotation rot r euler theta rotvec rvec rodrigues abc wpr",
    ),
    "stretch": _role("ratio", "stretch lambda streckung"),
    "strain": _role(
        "ratio",
        "strain eps dehnung deformation deformacion deformazione verzerrung epsilon stauchung elongation "
        "shear gamma",
    ),
    "stress": _role("stress", "stress spannung contrainte esfuerzo tension sforzo sigma piola tau"),
}
"""Quantities that a column or a vector has, by role."""

TIME_WORDS = word_set(
    "time t timestamp stamp zeit prufzeit clock seconds secs received elapsed temps tiempo tempo tijd tid "
    "czas cas zaman millis"
)
COUNTERS = word_set(
    "frame frames sample samples index idx count counter no nr num number seq sequence row line id packet "
    "bild"
)
"""Words of columns that count rows."""

SPECIMENS = word_set("sample samples case cases specimen specimens trial trials run runs probe proben")
"""Words of columns that are numbered by specimen or repetition."""

COMMANDED = word_set(
    "target desired d cmd command commanded ref reference setpoint goal setp sp sol soll demand demanded"
)
MEASURED = word_set("actual act measured meas ist real feedback fb fbk rel state")
FILTERED = word_set(
    "filtered filter filt smoothed smooth raw corrected avg average mean peak max min corr lp offset tared"
)
"""Words of a column that is a second form of another."""

SPREADS = word_set("sd std stdev stddev deviation")
"""Words of a column that is the standard deviation of another."""

_NO_VALUES = SPREADS | word_set("se sem error err uncertainty variance var ci")
"""Words of a column of uncertainties, which is no quantity itself."""

_ASIDE = word_set("transverse lateral radial poisson quer querdehnung true cauchy log hencky green pk2 pk")
"""Words of a strain or stress that is taken after one without them."""

TENSILE = word_set("tensile zug traction elongation gauge specimen extensometer pull")
_COMPRESSIVE = word_set("compressive compression compress compressed stauchung druck druckspannung")
_UNCERTAIN = word_set(
    "almansi eulerian biot swainger mises equivalent effective principal deviatoric indentation volumetric"
)
_STRAIN_MEASURES: Mapping[str, frozenset[str]] = {
    "log": word_set("true log logarithmic ln hencky natural wahre"),
    "green": word_set("green lagrange lagrangian gl"),
    "": word_set("engineering eng nominal technische"),
}
_STRESS_MEASURES: Mapping[str, frozenset[str]] = {
    "true": word_set("true cauchy wahre"),
    "pk2": word_set("pk2 2pk spk second 2nd"),
    "": word_set("engineering eng nominal pk1 1pk first 1st technische"),
}
SHEAR = word_set("shear scherung schub schubspannung gamma")
_BIAXIAL = word_set("biaxial equibiaxial")


def words_of(name: str) -> tuple[str, ...]:
    """Words of a column's name, without its unit, in small letters and without accents.

    Examples
    --------
    >>> words_of("actual_TCP_force_0"), words_of("wrench.force.x"), words_of("Fx [N]")
    (('actual', 'tcp', 'force', '0'), ('wrench', 'force', 'x'), ('fx',))
    """
    words = (
        _FOREIGN_WORD.findall(word.lower()) if word[0] >= _FIRST_FOREIGN else [word.lower()]
        for word in _WORD.findall(plain_letters(unit_in(name)[0]))
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
    is_commanded = bool(COMMANDED & known) and score >= 1.0
    n_forms = len(FILTERED & known) + bool(_ASIDE & known)
    return Rank(is_odd, is_commanded, -score, (n_forms, *of_words))


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
    """Plainest column of a role, or the only one with its unit; None where none is, or several are alike."""
    ranked, kind = _ranked(columns, role), ROLES[role].kind
    if not ranked:
        alone = [
            c
            for c in columns
            if factor_of(c, kind) is not None
            and not (has_role(words_of(c.name), role) or COMMANDED & {*words_of(c.name)})
        ]
        if len(alone) != 1 or role in ("stretch", "strain"):
            return None
        remark = f"{alone[0].name} is taken for the {role}, by its unit alone"
        return Picked(alone[0], factor_of(alone[0], kind), (remark,))
    (best, _, column), *others = ranked
    if others and others[0][0] == best:
        return None
    remarks = []
    if others:
        remarks.append(f"{column.name} is taken for the {role}, and not {', '.join(o[1] for o in others)}")
    if best.is_commanded:
        remarks.append(f"{column.name} is commanded, not measured; use the measured {role}")
    return Picked(column, factor_of(column, kind), tuple(remarks))


def spread_of(columns: Sequence[Column], role: str) -> Picked | None:
    """The one column that is the standard deviation of a role; None where none is, or several are."""
    named = ((column, words_of(column.name)) for column in columns)
    found = [c for c, words in named if SPREADS & {*words} and {*map(_simple, words)} & {*ROLES[role].words}]
    return Picked(found[0], factor_of(found[0], ROLES[role].kind)) if len(found) == 1 else None


def rivals(columns: Sequence[Column], role: str) -> tuple[str, ...]:
    """Names of the columns that are as likely for a role; empty where one is the likeliest, or none is."""
    ranked, kind = _ranked(columns, role), ROLES[role].kind
    best = [name for rank, name, _ in ranked if rank == ranked[0][0]]
    best = best or [one.name for one in columns if kind != "ratio" and factor_of(one, kind) is not None]
    return tuple(best) if len(best) > 1 else ()


def _ranked(columns: Sequence[Column], role: str) -> list[tuple[Rank, str, Column]]:
    """Columns that a word shows to be of a role, the likeliest first."""
    found = []
    for column in columns:
        words, known = words_of(column.name), ROLES[role].words
        places = [known.index(word) for word in map(_simple, words) if word in known]
        if places and np.isfinite(column.values).any() and not _NO_VALUES & {*words}:
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


def test_of(strain: Column, stress: Column, columns: Sequence[Column]) -> Test:
    """Mode and measures of a homogeneous test by its names; other columns may show a compression."""
    along, of = (
        {*words, *map("".join, pairwise(words))} for words in (words_of(strain.name), words_of(stress.name))
    )  # pk2 is a word, and pk and 2 are
    both = along | of
    questions = [
        f"{column.name}: palpate does not convert a measure '{word}'; give nominal stress over stretch"
        for column, words in ((strain, along), (stress, of))
        for word in sorted(words & _UNCERTAIN)
    ]
    measure, kind = (
        [name for name, words in table.items() if words & names]
        for table, names in ((_STRAIN_MEASURES, along), (_STRESS_MEASURES, of))
    )
    if not kind and "kirchhoff" in of:
        kind = [] if "piola" in of else ["true"]  # Kirchhoff's stress is J σ, and J is 1
    if {"piola"} & of and not kind:
        questions.append(f'{stress.name}: first or second Piola-Kirchhoff? write stress = "nominal" or "pk2"')
    elif not kind and (not of & {*ROLES["stress"].words} or (any(measure) and not questions)):
        questions.append(f"{stress.name}: true, second Piola-Kirchhoff or nominal? write it as stress")
    for column, found in ((strain, measure), (stress, kind)):
        if len(found) > 1:
            questions.append(f"{column.name}: the name has two measures; write one in the settings")
    mode = "uniaxial"
    if both & SHEAR:
        mode = "pure_shear" if {"pure", "planar"} & both else "simple_shear"
    elif {"planar"} & both:
        mode = "pure_shear"
    elif both & _BIAXIAL:
        mode = "equibiaxial"
    elif "confined" in both and "unconfined" not in both:
        mode = "confined_compression"
    is_open = mode == "uniaxial" and not both & TENSILE
    others = [(one.values, {*words_of(one.name)}) for one in columns if is_open]
    named = both.union(
        *(words for _, words in others if words & {"load", "force", "kraft", "last"} and "cell" not in words)
    )
    gaps = [values for values, words in others if "gap" in words]
    is_compressive = mode == "confined_compression" or any(gap[-1] < gap[0] for gap in gaps)
    is_compressive |= bool(named & _COMPRESSIVE)
    return Test(mode, next(iter(measure), ""), next(iter(kind), ""), is_compressive, tuple(questions))
