"""Contour lines of Fopt in the planes of the parameters, and the way of each search."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from palpate.api import FloatArray, ParameterName
from palpate_report.data.report_data import ReportData


def paths(data: ReportData, fit: str, scenario: str, spot: str) -> list[pl.DataFrame]:
    """Way of each search of a fit, that with the best end last.

    Returns
    -------
    list of DataFrame
        Columns correction, objective, n_runs, fopt, and the design's parameters as they are at a spot.
    """
    trace = data.fit.trace
    labels, columns = ("", spot, data.study.space.states.get(spot, "")), trace.columns
    names = {
        p.name: next(
            (at for label in labels if (at := str(ParameterName.parse(p.name).at(label))) in columns), p.name
        )
        for p in data.design.parameters
    }
    rows = trace.filter(fit=fit, scenario=scenario).drop_nulls("fopt")
    ways = (
        of_search.filter(pl.col("objective") == pl.col("objective").cum_min())
        .unique("objective", keep="first", maintain_order=True)
        .select(
            "correction", "objective", "n_runs", "fopt", **{name: pl.col(at) for name, at in names.items()}
        )
        for _, of_search in rows.group_by("search", maintain_order=True)
    )
    # Ends under different corrections cannot be compared: the last is the best known.
    return sorted(ways, key=lambda way: (way["correction"][-1], -way["objective"][-1]))


def reported(data: ReportData, fit: str, scenario: str) -> dict[str, Any]:
    """Reported values of a fit with their Fopt, where they differ from the least Fopt; else nothing."""
    if data.fit.intervals.is_empty():
        return {}
    rows = data.fit.ends.filter(fit=fit, scenario=scenario).to_dicts()
    return {name: value for row in rows for name, value in row.items() if value is not None}


MOST_LEVELS = 7
"""Most contour lines of a plane, from the least Fopt on."""

FIRST = 1.2
"""Least level over the least Fopt of the plane."""

LABELS_AT = (0.5, 0.2, 0.8)
"""Places of the labels of neighbouring levels along their lines, apart from each other."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Contour:
    """One level in a plane: a line (n,), with NaN between its parts.

    Parameters
    ----------
    x, y : (n,) array
    label : int
        Number of the point where the level may be written.
    """

    level: float
    x: FloatArray
    y: FloatArray
    label: int


def planes_of(data: ReportData, scenario: str) -> pl.DataFrame:
    """Fopt of the fit that leads, as the table ``profile_planes``.

    By the emulator of the posterior where there is one.
    """
    for frame in (data.table("posterior_planes"), data.table("profile_planes")):
        if not frame.is_empty():
            return frame.filter(fit=data.together, scenario=scenario)
    return pl.DataFrame()


def contours(data: ReportData, scenario: str, parameter: str, other: str) -> list[Contour]:
    """Contour lines over two parameters, which are x and y; none where most of the plane is unknown."""
    from matplotlib.figure import Figure

    planes = planes_of(data, scenario)
    if planes.is_empty():
        return []
    rows = planes.filter(parameter=parameter, other=other)
    # Share of a plane in which the emulator knows too little, above which a few ends of lines would mislead.
    if rows.is_empty() or rows["fopt"].null_count() > 0.5 * rows.height:
        return []
    wide = rows.pivot("value", index="other_value", values="fopt").sort("other_value")
    y, columns = wide["other_value"].to_numpy(), wide.drop("other_value")
    x, z = np.array([float(name) for name in columns.columns]), columns.to_numpy()
    order = np.argsort(x)
    levels = list(levels_from(float(np.nanmin(z))))
    # In logarithms, in which Fopt is smoother.
    drawn = Figure().subplots().contour(x[order], y, np.log(z[:, order]), levels=np.log(levels))
    found = []
    for k, (level, parts) in enumerate(zip(levels, drawn.allsegs, strict=True)):
        line = _joined([part for part in parts if len(part)])
        if line.size:
            label = _place(line, LABELS_AT[k % len(LABELS_AT)])
            found.append(Contour(level=level, x=line[:, 0], y=line[:, 1], label=label))
    return found


def along(data: ReportData, scenario: str, parameter: str) -> tuple[FloatArray, FloatArray] | None:
    """Values (n,) of a parameter, and Fopt there with the others fitted again; None where it is not known."""
    planes = planes_of(data, scenario)
    if planes.is_empty():
        return None
    rows = planes.filter(pl.col("parameter") == parameter, pl.col("other").is_null()).sort("value")
    return None if rows["fopt"].is_null().all() else (rows["value"].to_numpy(), rows["fopt"].to_numpy())


def levels_from(least: float) -> Iterator[float]:
    """Levels 1 and 3 times powers of ten, the first ones above the least Fopt."""
    found, power = 0, int(np.floor(np.log10(max(least, 1e-300))))
    while found < MOST_LEVELS:
        for factor in (1, 3):
            level = float(f"{factor}e{power}")
            if level >= FIRST * least and found < MOST_LEVELS:
                found += 1
                yield level
        power += 1


def _joined(parts: list[FloatArray]) -> FloatArray:
    """One line (n, 2) of all parts, with gaps between them."""
    gap = np.full((1, 2), np.nan)
    pieces = [piece for part in parts for piece in (gap, part)]
    return np.concatenate(pieces[1:]) if pieces else np.zeros((0, 2))


def _place(line: FloatArray, share: float) -> int:
    """A point of the longest part of a line, this share of its points from its start."""
    gaps = np.flatnonzero(np.isnan(line[:, 0]))
    ends = np.concatenate([[-1], gaps, [len(line)]])
    longest = int(np.argmax(np.diff(ends)))
    first, last = int(ends[longest]) + 1, int(ends[longest + 1]) - 1
    return first + round(share * (last - first))
