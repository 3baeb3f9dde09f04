"""How the simulations of a sweep ended, spot by spot, and how the indenter touched the limb."""

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any

import polars as pl

from palpate.api import Simulation, Status
from palpate.api.experiment import POSE

CONTACT: Mapping[str, str] = MappingProxyType(
    {
        "contact_radius_mm": "contact radius [mm]",
        "penetration_mm": "deepest penetration [mm]",
        "sticking": "share of the contact that sticks",
    }
)
"""Diagnostics of contact that a solver may give for each step of its path, and their labels.

It does so in its diagnostics, as lists as long as ``depth_mm`` and the other columns of the pose there.
"""

Contact = Mapping[str, list[float]]


def by_spot(simulations: Iterable[Simulation]) -> pl.DataFrame:
    """Count how simulations ended, and what they cost.

    Parameters
    ----------
    simulations : iterable of Simulation

    Returns
    -------
    DataFrame
        One row per spot: spot, simulations, a column per status that occurs, median_s and
        longest_s with the longest_set, and the median of every number that the solver reported
        of those that are ok, such as median_n_iterations.
    """
    rows = [
        {"spot": s.job.spot, "set_id": s.job.set_id, "status": s.status.value, "seconds": s.seconds}
        | {
            str(name): float(value)
            for name, value in s.diagnostics.items()
            if s.status is Status.OK and isinstance(value, (int, float)) and not isinstance(value, bool)
        }
        for s in simulations
    ]
    if not rows:
        return pl.DataFrame()
    frame = pl.DataFrame(rows, infer_schema_length=None)
    reported = [name for name in frame.columns if name not in ("spot", "set_id", "status", "seconds")]
    statuses = [s.value for s in Status if s.value in frame["status"].unique()]
    return frame.group_by("spot", maintain_order=True).agg(
        pl.len().cast(pl.Int64).alias("simulations"),
        *((pl.col("status") == name).sum().cast(pl.Int64).alias(name) for name in statuses),
        pl.col("seconds").median().alias("median_s"),
        pl.col("seconds").max().alias("longest_s"),
        pl.col("set_id").get(pl.col("seconds").arg_max()).alias("longest_set"),
        *(pl.col(name).median().alias(f"median_{name}") for name in reported),
    )


def contact_along(simulations: Iterable[Simulation]) -> dict[tuple[str, int], Contact]:
    """Collect the contact along the path by spot and set, of the simulations that report it."""
    found = {s.id: _contact(s.diagnostics) for s in simulations}
    return {key: contact for key, contact in found.items() if contact}


def _contact(diagnostics: Mapping[str, Any]) -> Contact:
    """Path and contact as far as they are lists of numbers, all of one length."""
    lists = {name: diagnostics[name] for name in (*POSE, *CONTACT) if _are_numbers(diagnostics.get(name))}
    depths = lists.get(POSE[0], [])
    found = {name: values for name, values in lists.items() if depths and len(values) == len(depths)}
    return found if found.keys() & CONTACT.keys() else {}


def places_along(contact: Contact) -> list[str]:
    """Where the indenter is at each step, by the columns of the pose that move."""
    moving = {name: contact[name] for name in POSE if name in contact and len(set(contact[name])) > 1}
    shown = [name.rpartition("_") for name in moving]
    return [
        ", ".join(f"{n.replace('_', ' ')} {v:.4g} {unit}" for (n, _, unit), v in zip(shown, row, strict=True))
        for row in zip(*moving.values(), strict=True)
    ]


def _are_numbers(values: object) -> bool:
    return isinstance(values, list) and bool(values) and all(isinstance(v, (int, float)) for v in values)
