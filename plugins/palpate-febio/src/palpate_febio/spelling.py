"""Materials in FEBio's spelling.

A material of your own joins in by an attribute ``febio``: the name of FEBio's
material and, for each parameter, what FEBio calls it::

    class TwoPowers(IsotropicMaterial):
        febio = ("Mooney-Rivlin", {"a": "c1", "b": "c2", "kappa": "k"})

Whether FEBio then computes the same stress is measured, not believed
(:mod:`palpate_febio.conventions`).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from palpate.api import FloatArray, IsotropicMaterial, Material, MaterialError, RelaxingMaterial

SPELLED: Mapping[str, tuple[str, Mapping[str, str]]] = MappingProxyType(
    {
        "ogden": ("Ogden", {"kappa": "k"}),
        "yeoh": ("Yeoh", {"kappa": "k"}),
        "neo_hookean": ("neo-Hookean", {"E": "E", "nu": "v"}),
        "mooney_rivlin": ("Mooney-Rivlin", {"c10": "c1", "c01": "c2", "kappa": "k"}),
        "gent": ("Gent", {"mu": "G", "kappa": "k"}),
        "veronda_westmann": ("Veronda-Westmann", {"c1": "c1", "c2": "c2", "kappa": "k"}),
    }
)
"""FEBio's name and the parameters that it names otherwise, by palpate's name.

FEBio 4.0 to 4.11 has another energy by the name "Arruda-Boyce": coefficient i is i times the textbook's.
"""

DENSITY_T_PER_MM3 = 1e-9

BULK = "k"
"""Bulk modulus of all uncoupled materials of FEBio."""

MOST_TIMES = 6
"""Time constants that FEBio's viscoelastic materials take."""

SHAPE, VOLUME = np.array([1.3, 0.8, 1.0 / 1.04]), np.full(3, 1.1)
"""Stretches that change the shape alone, and the volume alone."""


@dataclass(frozen=True, slots=True)
class Written:
    """A material as a deck has it; what relaxes has the elastic material of the long term in it.

    ``uncoupled`` is true for FEBio's uncoupled materials, which its three-field elements need.
    """

    febio_type: str
    values: tuple[tuple[str, float], ...]
    elastic: "Written | None" = None
    uncoupled: bool = False


def expected_convention(material: Material) -> str:
    """Convention to assume where no FEBio could be asked."""
    # Convention that FEBio 4.4 to 4.11 was measured to have, where it is not the textbook's.
    known = {"yeoh": "febio4"}.get(material.name, "textbook")
    return known if known in material.conventions else "textbook"


def written(material: Material, theta: FloatArray, convention: str) -> Written:
    """The material with textbook values ``theta`` (n_parameters,), spelled for FEBio.

    Parameters
    ----------
    convention : str
        How FEBio reads the numbers: ``textbook`` or a key of ``material.conventions``.

    Raises
    ------
    MaterialError
        FEBio has no such material.
    """
    if isinstance(material, RelaxingMaterial):
        return _relaxing(material, theta, convention)
    febio_type, names = spelling(material)
    numbers = material.from_textbook(theta, convention)
    values = tuple(
        (names.get(p.name, p.name), float(v)) for p, v in zip(material.parameters, numbers, strict=True)
    )
    uncoupled = BULK in dict(values) and separates(material, theta)
    return Written(febio_type, values, uncoupled=uncoupled)


def separates(material: Material, theta: FloatArray) -> bool:
    """True if the energy is the sum of an energy of the shape and an energy of the volume."""
    both = _energy(material, SHAPE * VOLUME, theta)
    apart = _energy(material, SHAPE, theta) + _energy(material, VOLUME, theta)
    return bool(np.isclose(both, apart, rtol=1e-6))


def _relaxing(material: RelaxingMaterial, theta: FloatArray, convention: str) -> Written:
    """Material around the elastic one of the long term: G(t) = G∞ (1 + Σ g_i e^(−t/t_i)).

    With shares γ_i of the stress at once that relax, g_i = γ_i / (1 − Σ γ).
    """
    elastic, at_once = material.at_once(theta)
    shares = material.relaxation(theta)
    if len(shares) > MOST_TIMES:
        raise MaterialError(
            f"material '{material.name}': FEBio's viscoelastic materials take {MOST_TIMES} time constants, "
            f"and it has {len(shares)}; use fewer, or solver 'jax'"
        )
    coupled = not separates(elastic, at_once)
    if coupled == material.relaxes_isochoric:
        part, other = ("shape alone", "all") if coupled else ("whole stress", "isochoric")
        raise MaterialError(
            f"material '{material.name}': FEBio has no form in which the {part} relaxes of an energy that "
            f"{'couples' if coupled else 'separates'} shape and volume; set relaxing_stress = "
            f"\"{other}\", or use solver 'jax'"
        )
    left = 1.0 - sum(shares.values())
    _, names = spelling(elastic)
    later = [
        left * value if p.kind == "modulus" and (coupled or names.get(p.name, p.name) != BULK) else value
        for p, value in zip(elastic.parameters, at_once.tolist(), strict=True)
    ]
    probe = SHAPE * VOLUME if coupled else SHAPE
    expected = left * _energy(elastic, probe, at_once)
    if not np.isclose(_energy(elastic, probe, np.array(later)), expected, rtol=1e-9):
        raise MaterialError(
            f"material '{material.name}': its stress is not in proportion to its moduli, which FEBio's form "
            "of relaxation needs; correct the kinds of its parameters, or use solver 'jax'"
        )
    terms = [
        (f"{name}{i}", value)
        for i, (time_s, share) in enumerate(shares.items(), 1)
        for name, value in (("g", share / left), ("t", time_s))
    ]
    kind = "viscoelastic" if coupled else "uncoupled viscoelastic"
    return Written(kind, tuple(terms), written(elastic, np.array(later), convention), not coupled)


def _energy(material: Material, stretches: FloatArray, theta: FloatArray) -> float:
    if isinstance(material, IsotropicMaterial):
        return float(material.energy(stretches, theta))
    return float(material.energy_from_F(np.diag(stretches), theta))


def spelling(material: Material) -> tuple[str, Mapping[str, str]]:
    """FEBio's name of the material, and of the parameters that it names otherwise.

    Raises
    ------
    MaterialError
    """
    own = getattr(material, "febio", None)
    found = own if own is not None else SPELLED.get(material.name)
    if found is None:
        raise MaterialError(
            f"material '{material.name}' has no counterpart in FEBio (known: {', '.join(SPELLED)}); give its "
            "class an attribute febio = (\"FEBio's name\", {parameter: FEBio's parameter}), or use "
            "another solver"
        )
    febio_type, names = found
    unknown = sorted(set(names) - {p.name for p in material.parameters})
    if unknown:
        raise MaterialError(
            f"material '{material.name}': its attribute febio names {', '.join(unknown)}, which is no "
            f"parameter of it ({', '.join(p.name for p in material.parameters)}); correct the name"
        )
    return str(febio_type), names
