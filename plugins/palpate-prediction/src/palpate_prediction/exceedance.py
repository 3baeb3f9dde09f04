"""Where a prediction deforms the tissue beyond what the experiment reached."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import polars as pl

from palpate.api import Simulation
from palpate_prediction.bands import frame_rows

ENDS = ("stretch_min", "stretch_max", "i1_max", "J_min", "J_max")
"""Ends of the strains that solvers report; the fitted material was seen between them."""

TOLERANCE = 1e-3
"""Excess that counts as none."""


def exceedances(
    experiment: Mapping[str, Mapping[str, Any]], predicted: Mapping[str, Simulation]
) -> pl.DataFrame:
    """Compare the strains of a prediction with those of the experiment at all of its spots.

    Returns
    -------
    DataFrame
        One row per spot, region and end: experiment and prediction, whether it is beyond, from which depth
        on (null where it is not), and for ``i1_max`` where in the undeformed limb. Empty where the solver
        reports no strains.
    """
    return frame_rows(list(_rows(experiment, predicted)))


def _rows(
    experiment: Mapping[str, Mapping[str, Any]], predicted: Mapping[str, Simulation]
) -> Iterator[dict[str, Any]]:
    for spot, simulation in predicted.items():
        for region, found in simulation.diagnostics.get("strain", {}).items():
            known = [spots[region] for spots in experiment.values() if region in spots]
            for name in ENDS if known else ():
                sign = 1.0 if name.endswith("_max") else -1.0
                reached = max(sign * value for each in known for value in each[name])
                values = sign * np.array(found[name])
                beyond = values > reached + TOLERANCE
                first = int(np.argmax(beyond))
                place = found["where_mm"][int(np.argmax(values))]
                yield {
                    "spot": spot,
                    "region": region,
                    "strain": name,
                    "experiment": sign * reached,
                    "prediction": float(sign * values.max()),
                    "beyond": bool(beyond.any()),
                    "from_depth_mm": _depth(simulation, first) if beyond.any() else None,
                    "where_mm": ", ".join(f"{x:.1f}" for x in place) if name == "i1_max" else "",
                }


def _depth(simulation: Simulation, state: int) -> float | None:
    return None if simulation.surface is None else float(simulation.surface.depth_mm[state])
