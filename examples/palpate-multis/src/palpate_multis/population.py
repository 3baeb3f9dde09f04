"""Three numbers for all people: the moduli of fat and muscle, and how they rise with the load.

The compliance of a press is that of the finite elements, times (F/√A / 0.3 N/mm)^−m. The load over the root
of the probe's area is in proportion to the depth in a half-space. Two presses of one person share a factor
of compliance, and each press has another: both are log-normal. Where the site is known it has a factor too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import minimize

from palpate.api import FloatArray, IntArray, PalpateError
from palpate_multis.emulator import LOWER, UPPER, emulator
from palpate_multis.layered_block import LENGTH_MM
from palpate_multis.presses import Presses, StrArray

SKIN_MPA = 0.6
"""Modulus of skin, assumed: published ones span orders of magnitude, and the presses do not identify it."""

REFERENCE_LOAD = 0.3
"""Load over the root of the probe's area [N/mm] at which the moduli are given: that of the median press."""

START = (np.log(0.015), np.log(0.005), 0.75)
SIMPLEX = ((0.15, 0.0, 0.0), (0.0, 0.2, 0.0), (0.0, 0.0, 0.1))

SMOOTHING = 1e-2
"""Relative error below which the loss is rounded."""

LEAST_PRESSES = 10
"""Fewest presses that three numbers are fitted to."""

AT_END = 1.001
"""Ratio to an end of the simulated moduli up to which a modulus is at it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Population:
    """Result of a fit.

    Parameters
    ----------
    muscle_MPa, fat_MPa : float
        Young's moduli at the reference load.
    load_exponent : float
        Compliance falls with this power of the load.
    person_spread, press_spread : float
        Standard deviations of the logarithm of compliance: between people, and between presses of one.
    bias : float
        Mean of measured less predicted logarithms.
    sites : mapping of site to float
        Factors of compliance, which the spreads and the bias take account of; empty where sites do not count.
    """

    muscle_MPa: float
    fat_MPa: float
    load_exponent: float
    person_spread: float = 0.0
    press_spread: float = 0.0
    bias: float = 0.0
    sites: Mapping[str, float] = field(default_factory=dict)

    def predict(
        self, layers_mm: FloatArray, width_mm: FloatArray, force_N: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Compliances (n,) [mm/MPa] and fat's shares of the compression (n,).

        Parameters
        ----------
        layers_mm : (n, 3) array
            Skin, fat and muscle.
        width_mm : (n,) array
            Of the probe: 8 or 15.
        force_N : (n,) array

        Raises
        ------
        PalpateError
            Thicknesses or moduli are outside of what was simulated, or a load is not > 0.
        """
        inputs = self._inputs(layers_mm)
        reasons = _outside(inputs, force_N)
        if row := next((row for row, reason in enumerate(reasons, start=1) if reason), 0):
            raise PalpateError(f"press {row}: {reasons[row - 1]}")
        softness, share = np.empty(len(inputs)), np.empty(len(inputs))
        for width in np.unique(width_mm):
            here = width_mm == width
            softness[here], share[here] = emulator(float(width))(inputs[here])
        load = force_N / np.sqrt(LENGTH_MM * width_mm) / REFERENCE_LOAD
        return softness / self.muscle_MPa * load**-self.load_exponent, share

    def outside(self, presses: Presses) -> list[str]:
        """Reasons (n,) why presses cannot be predicted; empty for those that can be."""
        reasons = _outside(self._inputs(presses.layers_mm), presses.force_N)
        unknown = ~np.isin(presses.site, list(self.sites)) if self.sites else np.zeros(len(reasons), bool)
        return [
            reason or (self._not_a_site(site) if here else "")
            for reason, site, here in zip(reasons, presses.site.tolist(), unknown, strict=True)
        ]

    def _inputs(self, layers_mm: FloatArray) -> FloatArray:
        """Inputs (n, 5) of the emulator."""
        ratios = np.broadcast_to([SKIN_MPA, self.fat_MPa], (len(layers_mm), 2)) / self.muscle_MPa
        return np.column_stack([layers_mm, ratios])

    def _not_a_site(self, site: str) -> str:
        return (
            f"site '{site}' is not one of {', '.join(self.sites)}; leave the column out, or fit presses at "
            "that site"
        )

    def site_factor(self, site: StrArray) -> FloatArray:
        """Factors of compliance at sites (n,).

        Raises
        ------
        PalpateError
            A site has no factor.
        """
        unknown = np.flatnonzero(~np.isin(site, list(self.sites)))
        if unknown.size:
            row = int(unknown[0])
            raise PalpateError(f"press {row + 1}: {self._not_a_site(str(site[row]))}")
        return np.array([self.sites[each] for each in site.tolist()])

    def interval(self, compliance: FloatArray, n_known: int = 0) -> tuple[FloatArray, FloatArray]:
        """Ends (n,) that hold a new press with 95 %, the person having ``n_known`` other presses."""
        person, press = self.person_spread**2, self.press_spread**2
        left = person * press / (press + n_known * person) if n_known else person
        half, middle = 1.96 * np.sqrt(left + press), compliance * np.exp(self.bias)
        return middle * np.exp(-half), middle * np.exp(half)


def fit(presses: Presses, start: Sequence[float] = START) -> Population:
    """The three numbers of the least mean relative error of compliance, and the spreads around them."""
    lower, upper = np.log(SKIN_MPA / UPPER[3]), np.log(SKIN_MPA / LOWER[3])

    def numbers(logs: FloatArray) -> Population:
        muscle = float(np.clip(logs[0], lower + 1e-9, upper - 1e-9))
        ratio = float(np.clip(logs[1] - muscle, np.log(LOWER[4]) + 1e-9, np.log(UPPER[4]) - 1e-9))
        fat = np.exp(muscle + ratio)
        return Population(muscle_MPa=float(np.exp(muscle)), fat_MPa=float(fat), load_exponent=float(logs[2]))

    def loss(logs: FloatArray) -> float:
        predicted = numbers(logs).predict(presses.layers_mm, presses.width_mm, presses.force_N)[0]
        relative = predicted / presses.compliance
        return float(np.sqrt((relative - 1.0) ** 2 + SMOOTHING**2).mean())

    simplex = np.array([start, *np.add(start, SIMPLEX)])
    best = minimize(
        loss,
        np.array(start),
        method="Nelder-Mead",
        options={"xatol": 2e-3, "fatol": 2e-5, "maxiter": 200, "initial_simplex": simplex},
    )
    found = numbers(best.x)
    return _with_spread(found, presses)


def with_sites(population: Population, presses: Presses) -> Population:
    """The same numbers with a factor for each site: that of the least mean relative error of its presses."""
    predicted = population.predict(presses.layers_mm, presses.width_mm, presses.force_N)[0]
    ratios = presses.compliance / predicted
    sites = {site: _middle(ratios[presses.site == site]) for site in np.unique(presses.site).tolist()}
    return _with_spread(replace(population, sites=sites), presses)


def _middle(ratios: FloatArray) -> float:
    """Factor f of the least mean of abs(f/ratio - 1): the median with weights of 1/ratio."""
    rising = np.sort(ratios)
    below = np.cumsum(1.0 / rising)
    return float(rising[np.searchsorted(below, 0.5 * below[-1])])


def fit_own(presses: Presses, where: str) -> Population:
    """Fit presses that are not those of MULTIS, where there are enough for the numbers and their spreads.

    Raises
    ------
    PalpateError
        There are too few people or presses, nobody was pressed twice, or a modulus is at the end of what was
        simulated; ``where`` names the file.
    """
    n_people, n_presses = len(np.unique(presses.person)), len(presses.compliance)
    if n_people < 2 or n_presses < LEAST_PRESSES or n_presses == n_people:
        raise PalpateError(
            f"{where}: {n_presses} presses of {n_people} people; a fit and its spreads need {LEAST_PRESSES} "
            "of two people or more, and somebody who was pressed twice. Leave out --fitted-to, or add presses"
        )
    found = fit(presses)
    stiffness, ratio = SKIN_MPA / found.muscle_MPa, found.fat_MPa / found.muscle_MPa
    for name, value, column in (("skin over muscle", stiffness, 3), ("fat over muscle", ratio, 4)):
        if not LOWER[column] * AT_END < value < UPPER[column] / AT_END:
            raise PalpateError(
                f"{where}: the ratio of moduli {name} is {value:.3g}, at the end of what was simulated "
                f"({LOWER[column]:g} to {UPPER[column]:g}); check the units of the table"
            )
    return found


def bootstrap(presses: Presses, n_draws: int, seed: int = 0) -> list[Population]:
    """Fits to people drawn with replacement: the uncertainty of the numbers."""
    rng, whole = np.random.default_rng(seed), fit(presses)
    start = (np.log(whole.muscle_MPa), np.log(whole.fat_MPa), whole.load_exponent)
    rows = [np.flatnonzero(presses.person == number) for number in range(presses.n_people)]
    drawn = [rng.integers(len(rows), size=len(rows)) for _ in range(n_draws)]
    return [fit(presses[np.concatenate([rows[k] for k in people])], start) for people in drawn]


def left_out(presses: Presses, folds: Sequence[IntArray], *, by_site: bool = False) -> FloatArray:
    """Predicted compliances (n,) [mm/MPa]: those of each fold's people by a fit to all others."""
    whole = fit(presses)
    start = (np.log(whole.muscle_MPa), np.log(whole.fat_MPa), whole.load_exponent)
    predicted = np.empty(len(presses.compliance))
    for people in folds:
        out = np.isin(presses.person, people)
        others, held = presses[np.flatnonzero(~out)], presses[np.flatnonzero(out)]
        found = fit(others, start)
        predicted[out] = found.predict(held.layers_mm, held.width_mm, held.force_N)[0]
        if by_site:
            predicted[out] *= with_sites(found, others).site_factor(held.site)
    return predicted


def person_factor(population: Population, residuals: FloatArray) -> float:
    """Factor of compliance of one person, of the logarithms (n,) of measured over predicted."""
    person, press, n = population.person_spread**2, population.press_spread**2, len(residuals)
    share = person / (person + press / n) if n else 0.0
    return float(np.exp(share * (residuals.mean() - population.bias))) if n else 1.0


def _with_spread(found: Population, presses: Presses) -> Population:
    """Spreads of the residuals between people and within, by analysis of variance."""
    predicted = found.predict(presses.layers_mm, presses.width_mm, presses.force_N)[0]
    at_site = found.site_factor(presses.site) if found.sites else 1.0
    residuals = np.log(presses.compliance / predicted / at_site)
    groups = [residuals[presses.person == number] for number in np.unique(presses.person)]
    n, k = len(residuals), len(groups)
    within = sum(((g - g.mean()) ** 2).sum() for g in groups) / max(n - k, 1)
    between = sum(len(g) * (g.mean() - residuals.mean()) ** 2 for g in groups) / max(k - 1, 1)
    mean_size = (n - sum(len(g) ** 2 for g in groups) / n) / max(k - 1, 1)
    person = max((between - within) / max(mean_size, 1.0), 0.0)
    return replace(
        found,
        person_spread=float(np.sqrt(person)),
        press_spread=float(np.sqrt(within)),
        bias=float(residuals.mean()),
    )


def _outside(inputs: FloatArray, force_N: FloatArray) -> list[str]:
    """Reasons (n,) why presses are outside of what was simulated; empty for those within."""
    names = ("skin [mm]", "fat [mm]", "muscle [mm]", "skin over muscle modulus", "fat over muscle modulus")
    reasons = [
        "" if force > 0.0 and np.isfinite(force) else f"the load is {force:g} N; give a load > 0 N"
        for force in force_N
    ]
    with np.errstate(invalid="ignore"):
        bad = ~((inputs >= LOWER) & (inputs <= UPPER))
    for row in np.flatnonzero(bad.any(axis=1)):
        column = int(bad[row].argmax())
        reasons[row] = (
            f"{names[column]} is {inputs[row, column]:.3g}; simulated presses have {LOWER[column]:g} to "
            f"{UPPER[column]:g}"
        )
    return reasons
