"""Materials whose energy is one of the shape at constant volume, and one of the volume."""

import sys
from abc import abstractmethod
from collections.abc import Mapping
from math import comb

import numpy as np
from pydantic import Field

from palpate.api import FloatArray, IsotropicMaterial, MaterialError, Parameter, Settings, SettingsT
from palpate.api.mechanics import Array, EnergyForm

POSITIVE = sys.float_info.min
"""Lower physical limit of a positive parameter."""


class Uncoupled(IsotropicMaterial[SettingsT]):
    """A material whose energy is the sum of an isochoric and a volumetric part.

    Ψ = Ψ̃(λ̃1, λ̃2, λ̃3) + κ/2 (ln J)², with λ̃ = J^(−1/3) λ. (The paper prints
    J^(1/3), a misprint.) κ is the last parameter and the initial bulk modulus.
    """

    @abstractmethod
    def isochoric_energy(self, stretches: Array, theta: Array) -> Array:
        """Ψ̃ [MPa] of isochoric stretches (..., 3), for all parameters but κ: (...,)."""

    def energy(self, stretches: Array, theta: Array) -> Array:
        """Strain energy per reference volume [MPa], (..., 3) → (...,)."""
        xp = stretches.__array_namespace__()
        log_J = log_volume_ratio(stretches)
        isochoric = stretches * xp.exp(log_J / -3.0)[..., None]
        return self.isochoric_energy(isochoric, theta[:-1]) + 0.5 * theta[-1] * log_J**2


def around(modulus_MPa: float) -> tuple[float, float]:
    """Range of a modulus that is about so large: from a quarter to three times."""
    return 0.25 * modulus_MPa, 3.0 * modulus_MPa


# Sums of three terms in place of sums over an axis: XLA compiles these into one loop with all around them.


def total(values: Array) -> Array:
    """Sum over the three principal directions, (..., 3) → (...,)."""
    return values[..., 0] + values[..., 1] + values[..., 2]


def first_invariant(stretches: Array) -> Array:
    """I1 = λ1² + λ2² + λ3², (..., 3) → (...,)."""
    return total(stretches * stretches)


def log_volume_ratio(stretches: Array) -> Array:
    """Compute ln J = ln(λ1 λ2 λ3), (..., 3) → (...,)."""
    return stretches.__array_namespace__().log(stretches[..., 0] * stretches[..., 1] * stretches[..., 2])


def bulk_modulus(lower: float = 0.25, upper: float = 2.5) -> Parameter:
    """Parameter κ; its default range is the paper's for Ogden."""
    return Parameter(
        name="kappa",
        unit="MPa",
        lower=lower,
        upper=upper,
        kind="modulus",
        description="bulk modulus",
        physical_lower=POSITIVE,
    )


def modulus(name: str, lower: float, upper: float, description: str, least: float = POSITIVE) -> Parameter:
    """Parameter in MPa that scales with stiffness; greater than zero by default (``least``)."""
    return Parameter(
        name=name,
        unit="MPa",
        lower=lower,
        upper=upper,
        kind="modulus",
        description=description,
        physical_lower=least,
    )


def shape(name: str, lower: float, upper: float, description: str, least: float = POSITIVE) -> Parameter:
    """Dimensionless parameter; greater than zero by default (``least``)."""
    return Parameter(
        name=name,
        unit="",
        lower=lower,
        upper=upper,
        kind="shape",
        description=description,
        physical_lower=least,
    )


# The paper's ranges, in FEBio 4's convention: its c_k is k times the textbook's.
PAPER_RANGES = ((1.4e-3, 3e-2), (-3e-3, -4.14e-5), (3e-6, 3e-4))


class YeohSettings(Settings):
    """Settings of :class:`Yeoh`."""

    terms: int = Field(default=3, ge=1, le=6, description="Number of terms; the paper uses three.")


class Yeoh(Uncoupled[YeohSettings]):
    """Yeoh, uncoupled, with n terms.

    Ψ = Σ_k c_k (Ĩ1 − 3)^k + κ/2 (ln J)²

    Initial shear modulus 2 c1, bulk modulus κ.

    FEBio 4 (4.4 to 4.11) computes the stress with ∂Ψ/∂Ĩ1 = Σ c_k (Ĩ1 − 3)^(k−1):
    the factor k is missing. A number written in that convention, ``febio4``, is
    k times the textbook coefficient; the convention's factors convert it.

    The default ranges are the paper's (c1 1.4e-3…3e-2, c2 −3e-3…−4.14e-5, whose
    ends it prints in reverse, c3 3e-6…3e-4 MPa), read as ``febio4`` and hence
    divided by k here. The paper gives no range for κ: the default is the one it
    gives for Ogden, since both describe the same silicone. Terms above the third
    range over ±1e-5 MPa.

    >>> import numpy as np
    >>> paper = np.array([0.0129, -2.016e-3, 2.7623e-4, 0.6])
    >>> [float(c) for c in Yeoh().to_textbook(paper, "febio4").round(9)]
    [0.0129, -0.001008, 9.2077e-05, 0.6]
    """

    name = "yeoh"
    summary = "Yeoh: powers of the first invariant, nearly incompressible"

    def __init__(self, settings: YeohSettings | None = None) -> None:
        super().__init__(settings)
        n_terms = self.settings.terms
        self.parameters = (*yeoh_coefficients(n_terms), bulk_modulus())
        factors = (*(1.0 / k for k in range(1, n_terms + 1)), 1.0)
        self.conventions = {"febio4": factors}

    def isochoric_energy(self, stretches: Array, theta: Array) -> Array:
        """Σ_k c_k (Ĩ1 − 3)^k [MPa]."""
        return power_series(theta, first_invariant(stretches) - 3.0, self.settings.terms)

    def energy_form(self, theta: FloatArray) -> EnergyForm:
        """Declare the energy for other programs: powers of Ĩ1 − 3."""
        return EnergyForm(powers=tuple(map(float, theta[:-1])), bulk_MPa=float(theta[-1]))

    def proposed_ranges(self, shear_MPa: float, invariant: float) -> Mapping[str, tuple[float, float]]:
        """Ranges in which no term exceeds twice the first at the largest invariant."""
        first, n_terms = 0.5 * shear_MPa, self.settings.terms
        most = {f"c{k}": 2.0 * first / invariant ** (k - 1) for k in range(2, n_terms + 1)}
        return {"c1": around(first)} | {name: (-value, value) for name, value in most.items()}


def yeoh_coefficients(n_terms: int) -> tuple[Parameter, ...]:
    """Parameters c1, c2, … of a series of powers of Ĩ1 − 3; the ranges are the paper's."""
    return tuple(_coefficient(k) for k in range(1, n_terms + 1))


def power_series(coefficients: Array, x: Array, n_terms: int) -> Array:
    """Sum of c_k x^k over the first ``n_terms`` coefficients."""
    return sum(coefficients[k] * x ** (k + 1) for k in range(n_terms))


def _coefficient(k: int) -> Parameter:
    lower, upper = PAPER_RANGES[k - 1] if k <= len(PAPER_RANGES) else (-1e-5 * k, 1e-5 * k)
    least = POSITIVE if k == 1 else -np.inf
    what = "half the initial shear modulus" if k == 1 else f"coefficient of (I1 - 3)^{k}"
    return modulus(f"c{k}", lower / k, upper / k, what, least)


class OgdenSettings(Settings):
    """Settings of :class:`Ogden`."""

    terms: int = Field(default=1, ge=1, le=6, description="Number of terms; the paper uses one.")


class Ogden(Uncoupled[OgdenSettings]):
    """Ogden, uncoupled, with n terms.

    Ψ = Σ_k c_k/m_k² (λ̃1^m_k + λ̃2^m_k + λ̃3^m_k − 3) + κ/2 (ln J)²

    Initial shear modulus Σ c_k / 2, bulk modulus κ. The ranges of the first term
    and of κ are the paper's region of interest; further terms take the same
    ranges, the even ones with negative exponents, which act in compression.
    A term written μ_k/α_k Σ(λ^α_k − 1), as in Ogden 1972, has m_k = α_k and
    c_k = μ_k α_k.

    >>> import numpy as np
    >>> theta = np.array([0.061, 3.1, 1.3])
    >>> float(Ogden().energy(np.array([2.0, 0.5**0.5, 0.5**0.5]), theta).round(6))
    0.039718
    """

    name = "ogden"
    summary = "Ogden: powers of the principal stretches, nearly incompressible"

    def __init__(self, settings: OgdenSettings | None = None) -> None:
        super().__init__(settings)
        n_terms = self.settings.terms
        coefficients = []
        for k in range(1, n_terms + 1):
            low, high = (1.0, 8.0) if k % 2 else (-8.0, -1.0)
            # The sign of one coefficient among several is free; the sum of all must be positive.
            least = POSITIVE if n_terms == 1 else -np.inf
            coefficients += [
                modulus(f"c{k}", 0.03, 0.2, f"twice the initial shear modulus of term {k}", least),
                shape(f"m{k}", low, high, f"exponent of term {k}", -np.inf),
            ]
        self.parameters = (*coefficients, bulk_modulus())

    def isochoric_energy(self, stretches: Array, theta: Array) -> Array:
        """Σ_k c_k/m_k² (Σ_a λ̃_a^m_k − 3) [MPa]."""
        xp = stretches.__array_namespace__()
        # A power's derivatives are powers again; those of the exponential reuse it.
        logs = xp.log(stretches)
        terms = ((theta[k], theta[k + 1]) for k in range(0, 2 * self.settings.terms, 2))
        return sum(c / m**2 * (total(xp.exp(m * logs)) - 3.0) for c, m in terms)

    def energy_form(self, theta: FloatArray) -> EnergyForm:
        """Declare the energy for other programs: powers of the stretches."""
        terms = tuple((float(c), float(m)) for c, m in zip(theta[:-1:2], theta[1:-1:2], strict=True))
        return EnergyForm(stretches=terms, bulk_MPa=float(theta[-1]))

    def proposed_ranges(self, shear_MPa: float, invariant: float) -> Mapping[str, tuple[float, float]]:
        """Positive coefficients, each up to all of the shear modulus; any exponents after the first.

        A positive coefficient of each term is Ogden's condition for a stable material.
        """
        n_terms = self.settings.terms
        least = 0.1 if n_terms == 1 else 1e-6
        found = {f"c{k}": (2.0 * least * shear_MPa, 6.0 * shear_MPa) for k in range(1, n_terms + 1)}
        return found | {"m1": (0.5, 10.0)} | {f"m{k}": (-8.0, 10.0) for k in range(2, n_terms + 1)}

    def check(self, theta: FloatArray) -> None:
        """Refuse values outside their physical range, and an exponent of zero."""
        super().check(theta)
        for parameter, value in zip(self.parameters, theta, strict=True):
            if parameter.kind == "shape" and value == 0.0:
                raise MaterialError(
                    f"material 'ogden': exponent {parameter.name} = 0 leaves the energy undefined; "
                    "keep it away from zero"
                )


class MooneyRivlin(Uncoupled):
    """Mooney–Rivlin, uncoupled.

    Ψ = c10 (Ĩ1 − 3) + c01 (Ĩ2 − 3) + κ/2 (ln J)²

    Initial shear modulus 2 (c10 + c01), bulk modulus κ. The ranges give the
    initial shear moduli of the paper's Ogden region, 0.015…0.1 MPa.

    >>> import numpy as np
    >>> theta = np.array([0.02, 0.01, 1.0])
    >>> float(MooneyRivlin().energy(np.array([2.0, 0.5**0.5, 0.5**0.5]), theta).round(6))
    0.0525
    """

    name = "mooney_rivlin"
    summary = "Mooney-Rivlin: first and second invariant, nearly incompressible"
    parameters = (
        modulus("c10", 5e-3, 4e-2, "coefficient of (I1 - 3)"),
        modulus("c01", 2.5e-3, 1e-2, "coefficient of (I2 - 3)", 0.0),
        bulk_modulus(),
    )

    def isochoric_energy(self, stretches: Array, theta: Array) -> Array:
        """c10 (Ĩ1 − 3) + c01 (Ĩ2 − 3) [MPa], with Ĩ2 = Σ λ̃^−2 since J̃ = 1."""
        first, second = first_invariant(stretches), first_invariant(1.0 / stretches)
        return theta[0] * (first - 3.0) + theta[1] * (second - 3.0)

    def proposed_ranges(self, shear_MPa: float, invariant: float) -> Mapping[str, tuple[float, float]]:
        """Either coefficient up to the shear modulus and more."""
        return {"c10": around(0.5 * shear_MPa), "c01": (0.0, shear_MPa)}


class Demiray(Uncoupled):
    """Demiray (1972), the isotropic exponential of the Fung and Holzapfel family, uncoupled.

    Ψ = μ / (2b) (exp(b (Ĩ1 − 3)) − 1) + κ/2 (ln J)²

    Initial shear modulus μ, bulk modulus κ. The range of μ is the range of the paper's Ogden region,
    0.015…0.1 MPa.

    >>> import numpy as np
    >>> theta = np.array([0.04, 1.0, 1.0])
    >>> float(Demiray().energy(np.array([1.5, 1.5**-0.5, 1.5**-0.5]), theta).round(6))
    0.01584
    """

    name = "demiray"
    summary = "Demiray: one exponential of the first invariant, nearly incompressible"
    parameters = (
        modulus("mu", 1.5e-2, 0.1, "initial shear modulus"),
        shape("b", 0.1, 5.0, "exponent per unit of (I1 - 3)"),
        bulk_modulus(),
    )

    def isochoric_energy(self, stretches: Array, theta: Array) -> Array:
        """μ / (2b) (exp(b (Ĩ1 − 3)) − 1) [MPa]."""
        xp = stretches.__array_namespace__()
        mu, b = theta[0], theta[1]
        return 0.5 * mu / b * xp.expm1(b * (first_invariant(stretches) - 3.0))

    def proposed_ranges(self, shear_MPa: float, invariant: float) -> Mapping[str, tuple[float, float]]:
        """Exponents up to 5 at the largest invariant."""
        return {"mu": around(shear_MPa), "b": (0.01 / invariant, 5.0 / invariant)}


class VerondaWestmann(Uncoupled):
    """Veronda–Westmann (1970, skin), uncoupled.

    Ψ = c1 (exp(c2 (Ĩ1 − 3)) − 1) − c1 c2 / 2 (Ĩ2 − 3) + κ/2 (ln J)²

    Initial shear modulus c1 c2, bulk modulus κ. The ranges give initial shear
    moduli of 0.01…0.15 MPa, around the paper's Ogden region.

    >>> import numpy as np
    >>> theta = np.array([0.04, 1.0, 1.0])
    >>> float(VerondaWestmann().energy(np.array([1.5, 1.5**-0.5, 1.5**-0.5]), theta).round(6))
    0.022791
    """

    name = "veronda_westmann"
    summary = "Veronda-Westmann: exponential in the first invariant, for skin"
    parameters = (
        modulus("c1", 2e-2, 5e-2, "scale of the exponential"),
        shape("c2", 0.5, 3.0, "exponent per unit of (I1 - 3)"),
        bulk_modulus(),
    )

    def isochoric_energy(self, stretches: Array, theta: Array) -> Array:
        """c1 (exp(c2 (Ĩ1 − 3)) − 1) − c1 c2 / 2 (Ĩ2 − 3) [MPa], with Ĩ2 = Σ λ̃^−2 since J̃ = 1."""
        xp = stretches.__array_namespace__()
        c1, c2 = theta[0], theta[1]
        first, second = first_invariant(stretches), first_invariant(1.0 / stretches)
        return c1 * xp.expm1(c2 * (first - 3.0)) - 0.5 * c1 * c2 * (second - 3.0)

    def proposed_ranges(self, shear_MPa: float, invariant: float) -> Mapping[str, tuple[float, float]]:
        """Exponents up to 5 at the largest invariant, and scales that have the shear modulus."""
        lower, upper = 0.05 / invariant, 5.0 / invariant
        return {"c1": (0.25 * shear_MPa / upper, 3.0 * shear_MPa / lower), "c2": (lower, upper)}


class Gent(Uncoupled):
    """Gent (1996), uncoupled: rubber and tissue whose chains have a largest length.

    Ψ = −μ Jm / 2 ln(1 − (Ĩ1 − 3) / Jm) + κ/2 (ln J)²

    Initial shear modulus μ, bulk modulus κ. The energy is not defined where
    Ĩ1 − 3 reaches Jm: give Jm a range above the largest Ĩ1 − 3 of the experiment.
    The filter of stable sets checks the stretches below this limit.

    >>> import numpy as np
    >>> theta = np.array([0.04, 50.0, 1.0])
    >>> float(Gent().energy(np.array([2.0, 0.5**0.5, 0.5**0.5]), theta).round(6))
    0.040822
    """

    name = "gent"
    summary = "Gent: limited extension by the first invariant, nearly incompressible"
    parameters = (
        modulus("mu", 1.5e-2, 0.1, "initial shear modulus"),
        shape("Jm", 10.0, 200.0, "limit of I1 - 3"),
        bulk_modulus(),
    )

    def isochoric_energy(self, stretches: Array, theta: Array) -> Array:
        """−μ Jm / 2 ln(1 − (Ĩ1 − 3) / Jm) [MPa]."""
        xp = stretches.__array_namespace__()
        mu, limit = theta[0], theta[1]
        return -0.5 * mu * limit * xp.log1p(-(first_invariant(stretches) - 3.0) / limit)

    def in_reach(self, stretches: Array, theta: Array) -> Array:
        """Mask (...,) of isochoric stretches (..., 3) whose Ĩ1 − 3 is below the limit."""
        return (first_invariant(stretches) - 3.0 < theta[1]) | (theta[1] < 0.0)

    def proposed_ranges(self, shear_MPa: float, invariant: float) -> Mapping[str, tuple[float, float]]:
        """Limits above the largest invariant, where the energy ends."""
        return {"mu": around(shear_MPa), "Jm": (1.02 * invariant, 30.0 * invariant)}

    def energy_form(self, theta: FloatArray) -> EnergyForm:
        """Declare the energy for other programs."""
        mu, limit, bulk = map(float, theta)
        return EnergyForm(gent=(mu, limit), bulk_MPa=bulk)


CHAIN_SERIES = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)
"""Coefficients of the inverse Langevin function's series, as Arruda and Boyce (1993) print them."""


class ArrudaBoyce(Uncoupled):
    """Arruda–Boyce (1993), the eight-chain model in five terms, uncoupled.

    Ψ = μ Σ_i C_i / N^(i−1) (Ĩ1^i − 3^i) + κ/2 (ln J)²

    C = 1/2, 1/20, 11/1050, 19/7000, 519/673750. N is the number of links of a
    chain, λm² of Abaqus; μ is the modulus n k T of the network. Initial shear
    modulus μ (1 + 3/(5N) + 99/(175N²) + 513/(875N³) + 42039/(67375N⁴)), bulk modulus κ.
    The energy is a polynomial of Ĩ1 − 3, and other programs get it as such. FEBio's
    own Arruda-Boyce has i C_i for C_i, which is another energy.

    >>> import numpy as np
    >>> theta = np.array([0.04, 10.0, 1.0])
    >>> float(ArrudaBoyce().energy(np.array([2.0, 0.5**0.5, 0.5**0.5]), theta).round(6))
    0.043679
    """

    name = "arruda_boyce"
    summary = "Arruda-Boyce: eight chains of limited length, nearly incompressible"
    parameters = (
        modulus("mu", 1.5e-2, 0.1, "modulus of the network, about the initial shear modulus"),
        shape("N", 2.0, 50.0, "links of a chain"),
        bulk_modulus(),
    )

    def isochoric_energy(self, stretches: Array, theta: Array) -> Array:
        """Polynomial of Ĩ1 − 3 [MPa], which keeps its digits at rest."""
        return power_series(_chain_coefficients(theta[0], theta[1]), first_invariant(stretches) - 3.0, 5)

    def proposed_ranges(self, shear_MPa: float, invariant: float) -> Mapping[str, tuple[float, float]]:
        """Chains from half as long as the largest stretch of a chain asks for, I1 / 3 links."""
        links = (invariant + 3.0) / 3.0
        return {"mu": around(shear_MPa), "N": (0.5 * links, 30.0 * links)}

    def energy_form(self, theta: FloatArray) -> EnergyForm:
        """Declare the energy for other programs: powers of Ĩ1 − 3."""
        powers = tuple(map(float, _chain_coefficients(theta[0], theta[1])))
        return EnergyForm(powers=powers, bulk_MPa=float(theta[-1]))


def _chain_coefficients(mu: Array, links: Array) -> list[Array]:
    """Coefficients of (Ĩ1 − 3)^k, k = 1 to 5, by the binomial theorem."""
    n = len(CHAIN_SERIES)
    return [
        mu
        * sum(CHAIN_SERIES[i - 1] * comb(i, k) * 3.0 ** (i - k) / links ** (i - 1) for i in range(k, n + 1))
        for k in range(1, n + 1)
    ]
