"""Compliance and fat's share of the compression, between the simulated presses of ``runs.csv``.

The logarithm of compliance is that of springs in series, whose load spreads with depth, plus a Gaussian
process of what they miss; there is one for each probe.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np
import polars as pl

from palpate.api import FloatArray, PalpateError
from palpate_certainty.api import GaussianProcess
from palpate_multis.layered_block import LENGTH_MM

LENGTHS = {8.0: (3.0503, 0.49985, 0.9283, 1.7705, 1.2425), 15.0: (3.6134, 0.47404, 0.9180, 1.7721, 1.2369)}
"""Most likely correlation lengths of each probe's runs, in half ranges.

Kept here because their search takes longer than all else of a prediction; a test repeats it.
"""

LOWER = np.array([0.6, 0.45, 5.0, 1.0, 0.08])
UPPER = np.array([3.2, 42.0, 90.0, 60.0, 2.5])
"""Ranges of skin, fat and muscle [mm], and of skin's and fat's modulus over muscle's."""

WIDTHS_MM = (8.0, 15.0)
"""Of the two probes' faces, which are 45 mm long."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Simulated:
    """Simulated presses of one probe.

    Parameters
    ----------
    inputs : (n, 5) array
        Columns as in ``LOWER``.
    compliance : (n,) array
        Compression times area over force [mm/MPa], for a muscle of 1 MPa.
    fat_share : (n,) array
        Of the compression under the probe's middle.
    """

    inputs: FloatArray
    compliance: FloatArray
    fat_share: FloatArray


def simulated(width_mm: float) -> Simulated:
    """The simulated presses that come with the plugin, of the probe of this width."""
    with (files("palpate_multis") / "data" / "runs.csv").open("rb") as stream:
        table = pl.read_csv(stream).filter(pl.col("width_mm") == width_mm)
    names = ["skin_mm", "fat_mm", "muscle_mm", "skin_ratio", "fat_ratio"]
    return Simulated(
        inputs=table.select(names).to_numpy(),
        compliance=table["compliance_mm_per_MPa"].to_numpy(),
        fat_share=table["fat_share"].to_numpy(),
    )


class PressEmulator:
    """Presses with one probe.

    Parameters
    ----------
    lengths : five floats, optional
        Correlation lengths, in half ranges; the most likely ones by default.

    Attributes
    ----------
    left_out : (n, 2) array
        Logarithm of compliance, and fat's share, of each run less what the others predict.
    """

    def __init__(self, width_mm: float, runs: Simulated, lengths: Sequence[float] | None = None) -> None:
        self.width_mm = width_mm
        missed = np.log(runs.compliance) - np.log(springs_in_series(runs.inputs, width_mm))
        values = np.column_stack([missed, runs.fat_share])
        none = np.zeros(0, dtype=np.int64)
        known = None if lengths is None else np.array(lengths)
        self._process = GaussianProcess(_scaled(runs.inputs), none, values, np.zeros((5, 0, 2)), known)
        self.left_out = self._process.left_out

    def __call__(self, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compliances (n,) [mm/MPa] for a muscle of 1 MPa, and fat's shares (n,), at inputs (n, 5)."""
        missed, share = self._process(_scaled(inputs)).T
        return springs_in_series(inputs, self.width_mm) * np.exp(missed), np.clip(share, 0.0, 1.0)


@cache
def emulator(width_mm: float) -> PressEmulator:
    """The emulator of a probe of 45 mm × ``width_mm``."""
    if width_mm not in WIDTHS_MM:
        raise PalpateError(f"a probe of 45 × {width_mm:g} mm; the presses have 45 × 8 and 45 × 15 mm")
    return PressEmulator(width_mm, simulated(width_mm), LENGTHS[width_mm])


def springs_in_series(inputs: FloatArray, width_mm: float) -> FloatArray:
    """Compliance (n,) [mm/MPa] of layers whose load spreads by half of the depth to each side.

    Σ area/E ∫ dz/((length + z)(width + z)) over the layers.
    """
    depths = np.concatenate([np.zeros((len(inputs), 1)), np.cumsum(inputs[:, :3], axis=1)], axis=1)
    spread = np.log((width_mm + depths) / (LENGTH_MM + depths)) / (LENGTH_MM - width_mm)
    softness = 1.0 / np.column_stack([inputs[:, 3:5], np.ones(len(inputs))])
    compliance: FloatArray = LENGTH_MM * width_mm * (np.diff(spread, axis=1) * softness).sum(axis=1)
    return compliance


def _scaled(inputs: FloatArray) -> FloatArray:
    """Logarithms from −1 to 1 within the ranges."""
    scaled: FloatArray = 2.0 * np.log(inputs / LOWER) / np.log(UPPER / LOWER) - 1.0
    return scaled
