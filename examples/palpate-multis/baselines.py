"""What the mechanics of palpate-multis add to its prediction: models with the same inputs, people left out.

    python baselines.py

Each row is a model of the compliance of a press, fitted to the least mean relative error. Its error is that
of ten folds of people, each predicted by a fit to the others. A number that is given is not fitted.
"""

import sys
from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import minimize

from palpate.api import FloatArray
from palpate_multis import Presses, fit, person_factor, read_presses, with_sites
from palpate_multis.emulator import LOWER, UPPER, emulator, springs_in_series
from palpate_multis.layered_block import LENGTH_MM
from palpate_multis.population import REFERENCE_LOAD, SKIN_MPA, SMOOTHING

N_FOLDS = 10
Softness = Callable[[FloatArray, float], FloatArray]
Model = Callable[[FloatArray, Presses], FloatArray]
"""Compliances (n,) [mm/MPa] by the numbers that are fitted, and presses."""


def layered(softness: Softness, exponent: float | None, skin_MPa: float = SKIN_MPA) -> Model:
    """Layers whose compliance falls with a power of the load; the power is fitted if it is None."""

    def predict(logs: FloatArray, presses: Presses) -> FloatArray:
        muscle, fat = np.exp(logs[:2])
        ratios = np.broadcast_to([skin_MPa / muscle, fat / muscle], (len(presses.force_N), 2))
        inputs, found = np.column_stack([presses.layers_mm, ratios]), np.empty(len(presses.force_N))
        for width in np.unique(presses.width_mm):
            here = presses.width_mm == width
            found[here] = softness(inputs[here], float(width))
        return found / muscle * load(presses) ** -(logs[2] if exponent is None else exponent)

    return predict


def elements(inputs: FloatArray, width_mm: float) -> FloatArray:
    """Compliances (n,) for a muscle of 1 MPa, within the ratios that were simulated."""
    return emulator(width_mm)(np.clip(inputs, LOWER, UPPER))[0]


def load(presses: Presses) -> FloatArray:
    """Loads (n,) over the root of the probe's area, in units of that of the median press."""
    return presses.force_N / np.sqrt(LENGTH_MM * presses.width_mm) / REFERENCE_LOAD


def power_law(logs: FloatArray, presses: Presses) -> FloatArray:
    """No mechanics: powers of the load and of the thickness."""
    thickness = presses.layers_mm.sum(axis=1) / 30.0
    return np.exp(logs[0]) * load(presses) ** -logs[1] * thickness ** logs[2]


def equal_depth(logs: FloatArray, presses: Presses) -> FloatArray:
    """Every press as deep, as a power of the thickness: the compliance is that depth over the pressure."""
    thickness = presses.layers_mm.sum(axis=1) / 30.0
    return np.exp(logs[0]) * LENGTH_MM * presses.width_mm / presses.force_N * thickness ** logs[1]


def numbers(model: Model, presses: Presses, start: Sequence[float]) -> FloatArray:
    """The numbers of the least mean relative error."""

    def loss(logs: FloatArray) -> float:
        relative = model(logs, presses) / presses.compliance
        return float(np.sqrt((relative - 1.0) ** 2 + SMOOTHING**2).mean())

    options = {"xatol": 2e-3, "fatol": 2e-5, "maxiter": 400}
    return minimize(loss, np.array(start), method="Nelder-Mead", options=options).x


def error(model: Model, presses: Presses, start: Sequence[float]) -> float:
    """Mean relative error of people left out."""
    missed = np.empty(len(presses.force_N))
    for fold in range(N_FOLDS):
        out = presses.person % N_FOLDS == fold
        others, held = presses[np.flatnonzero(~out)], presses[np.flatnonzero(out)]
        missed[out] = np.abs(model(numbers(model, others, start), held) / held.compliance - 1.0)
    return float(missed.mean())


def with_factors(presses: Presses, *, by_site: bool, by_person: bool) -> float:
    """The same of the plugin's model, with factors of the site and of the person's other presses."""
    missed = np.empty(len(presses.force_N))
    for fold in range(N_FOLDS):
        out = presses.person % N_FOLDS == fold
        others, held = presses[np.flatnonzero(~out)], presses[np.flatnonzero(out)]
        found = fit(others)
        predicted = found.predict(held.layers_mm, held.width_mm, held.force_N)[0]
        if by_site:
            found = with_sites(found, others)
            predicted = predicted * found.site_factor(held.site)
        residuals = np.log(held.compliance / predicted)
        factors = np.ones(len(predicted))
        for k in range(len(predicted) if by_person else 0):
            same = held.person == held.person[k]
            same[k] = False
            factors[k] = person_factor(found, residuals[same])
        missed[out] = np.abs(predicted * factors / held.compliance - 1.0)
    return float(missed.mean())


def main() -> None:
    """Write a row for each model."""
    presses = read_presses()
    moduli = tuple(np.log([0.015, 0.005]))
    rows: list[tuple[str, Model, Sequence[float]]] = []
    for exponent in (None, 0.0, 0.3, 1.0):
        start = (*moduli, 0.75) if exponent is None else moduli
        words = f"load exponent {'free' if exponent is None else exponent}"
        rows.append((f"finite elements, {words}", layered(elements, exponent), start))
        rows.append((f"springs in series, {words}", layered(springs_in_series, exponent), start))
    rows += [
        (f"finite elements, skin {skin} MPa", layered(elements, None, skin), (*moduli, 0.75))
        for skin in (0.15, 0.3)
    ]
    for name, model, start in rows:
        muscle, fat, *power = numbers(model, presses, start)
        values = f"muscle {1e3 * np.exp(muscle):.1f} kPa, fat {1e3 * np.exp(fat):.1f} kPa"
        report(name, error(model, presses, start), values + "".join(f", {each:.2f}" for each in power))
    report("powers of load and thickness", error(power_law, presses, (6.0, 0.8, 0.5)))
    report("an equal depth, by thickness", error(equal_depth, presses, (1.0, 0.5)))
    report("finite elements, person", with_factors(presses, by_site=False, by_person=True))
    report("finite elements, site", with_factors(presses, by_site=True, by_person=False))
    report("finite elements, site and person", with_factors(presses, by_site=True, by_person=True))


def report(name: str, missed: float, values: str = "") -> None:
    """Write one row."""
    sys.stdout.write(f"{name:38} {missed:.1%}  {values}\n")


if __name__ == "__main__":
    main()
