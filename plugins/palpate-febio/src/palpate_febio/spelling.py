"""Materials in FEBio's spelling.

A material of your own joins in by an attribute ``febio``: the name of FEBio's
material and, for each parameter, what FEBio calls it::

    class Gent(IsotropicMaterial):
        febio = ("Gent", {"mu": "G", "Jm": "Jm", "kappa": "k"})

Whether FEBio then computes the same stress is measured, not believed
(:mod:`palpate_febio.conventions`).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from palpate.api import FloatArray, Material, MaterialError

SPELLED: Mapping[str, tuple[str, Mapping[str, str]]] = MappingProxyType(
    {
        "ogden": ("Ogden", {"kappa": "k"}),
        "yeoh": ("Yeoh", {"kappa": "k"}),
        "neo_hookean": ("neo-Hookean", {"E": "E", "nu": "v"}),
        "mooney_rivlin": ("Mooney-Rivlin", {"c10": "c1", "c01": "c2", "kappa": "k"}),
        "veronda_westmann": ("Veronda-Westmann", {"c1": "c1", "c2": "c2", "kappa": "k"}),
    }
)
"""FEBio's name and the parameters that it names otherwise, by palpate's name."""

UNPROBED: Mapping[str, str] = MappingProxyType({"yeoh": "febio4"})
"""Convention that FEBio 4.4 to 4.11 was measured to have, where it is not the textbook's."""

DENSITY_T_PER_MM3 = 1e-9


@dataclass(frozen=True, slots=True)
class Written:
    """A material as a deck has it."""

    febio_type: str
    values: tuple[tuple[str, float], ...]


def expected_convention(material: Material) -> str:
    """Convention to assume where no FEBio could be asked."""
    known = UNPROBED.get(material.name, "textbook")
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
    febio_type, names = spelling(material)
    numbers = material.from_textbook(theta, convention)
    values = tuple(
        (names.get(p.name, p.name), float(v)) for p, v in zip(material.parameters, numbers, strict=True)
    )
    return Written(febio_type, values)


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
