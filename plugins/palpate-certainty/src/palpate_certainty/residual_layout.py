"""Where each residual of a fit is on the measured curves, and how errors of these are correlated."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.api import FloatArray, IntArray
from palpate.api.fit import SpotTerm, channel_of, pieces

COMMON = 0.5
"""Share of a discrepancy's variance that all spots have in common."""

LONGEST_NOISE = 0.1
"""Longest correlation of noise, in ranges of the abscissa."""

MOST_ROWS = 64
"""Points of a curve; more are averaged with their neighbours."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ResidualLayout:
    """Where each residual is on the measured curves.

    Parameters
    ----------
    spot, site, channel : (n,) integer array
        Numbers of the spots, of the places on limbs that they are at, and of the channels; negative for
        residuals that are no measured point.
    point : (n,) array
        Number of the measured point on its curve.
    path : (n,) array
        Travel along the curve, in ranges of its abscissa.
    scale : (n,) array
        Residual of the largest ordinate of the curve.
    envelope : (n,) array
        Residual of the largest ordinate reached so far.
    """

    spot: IntArray
    site: IntArray
    channel: IntArray
    point: FloatArray
    path: FloatArray
    scale: FloatArray
    envelope: FloatArray

    @property
    def channels(self) -> list[int]:
        """Numbers of the channels."""
        return [int(each) for each in np.unique(self.channel) if each >= 0]

    def noise(self, channel: int, points: float) -> FloatArray:
        """Covariance (n, n) of noise of size 1 over the largest ordinate, correlated over so many points.

        Over no more than a part of the path, however: what is longer is no noise.
        """
        inside = self.channel == channel
        spacing = np.ptp(self.path[inside]) / np.ptp(self.point[inside])
        length = min(points, LONGEST_NOISE / spacing)
        apart = np.abs(self.point[:, None] - self.point)
        along = matern(apart / length) if length > 0.0 else (apart == 0.0).astype(np.float64)
        same = (self.spot[:, None] == self.spot) * self._both(channel)
        covariance: FloatArray = same * along * np.outer(self.scale, self.scale)
        return covariance

    def discrepancy(self, channel: int, length: float) -> FloatArray:
        """Covariance (n, n) of a discrepancy of size 1 over the largest ordinate in a channel."""
        along = matern(np.abs(self.path[:, None] - self.path) / length)
        same = np.where(self.site[:, None] == self.site, 1.0, COMMON) * self._both(channel)
        covariance: FloatArray = same * along * np.outer(self.envelope, self.envelope)
        return covariance

    def _both(self, channel: int) -> FloatArray:
        inside = (self.channel == channel).astype(np.float64)
        return np.outer(inside, inside)


def matern(apart: FloatArray) -> FloatArray:
    """Correlation of a process with one derivative (Matérn, 3/2) at distances in correlation lengths."""
    scaled = np.sqrt(3.0) * apart
    correlation: FloatArray = (1.0 + scaled) * np.exp(-scaled)
    return correlation


def path_of(abscissa: FloatArray) -> FloatArray:
    """Travel along a curve up to each point (n,), in ranges of its abscissa."""
    path: FloatArray = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(abscissa)))]) / np.ptp(abscissa)
    return path


def layout_of(terms: Sequence[SpotTerm], n: int) -> tuple[ResidualLayout, tuple[str, ...]]:
    """Where each of ``n`` residuals is, those of priors last; and the names of the channels."""
    channels = tuple(dict.fromkeys(channel_of(name) for term in terms for name in term.weights))
    spots, sites = [term.spot for term in terms], [term.site for term in terms]
    found = {name: np.zeros(n) for name in ("point", "path", "scale", "envelope")}
    spot, site, channel = (np.full(n, -1) for _ in range(3))
    for term, name, at, scale in pieces(terms):
        curve, inside = term.measured[channel_of(name)], term.counted(name)
        size = np.abs(curve.ordinate)
        spot[at], channel[at] = spots.index(term.spot), channels.index(channel_of(name))
        site[at] = sites.index(term.site)
        found["point"][at] = np.arange(size.size)[inside]
        found["path"][at] = path_of(curve.abscissa)[inside]
        found["scale"][at] = (scale * size.max())[inside]
        found["envelope"][at] = (scale * np.maximum.accumulate(size))[inside]
    return ResidualLayout(spot=spot, site=site, channel=channel, **found), channels


def groups_of(rows: ResidualLayout) -> FloatArray:
    """Average neighbours on long curves: (n_groups, n), with orthonormal rows."""
    n = rows.spot.size
    number, last = np.arange(n), 0
    for key in dict.fromkeys(zip(rows.spot.tolist(), rows.channel.tolist(), strict=True)):
        inside = np.flatnonzero((rows.spot == key[0]) & (rows.channel == key[1]))
        each = 1 if key[1] < 0 else -(-inside.size // MOST_ROWS)
        number[inside] = last + np.arange(inside.size) // each
        last = int(number[inside].max()) + 1
    groups = (np.arange(last)[:, None] == number).astype(np.float64)
    averaged: FloatArray = groups / np.sqrt(groups.sum(axis=1, keepdims=True))
    return averaged


def grouped(rows: ResidualLayout, groups: FloatArray) -> ResidualLayout:
    """Where averages are, of groups as :func:`groups_of` returns them."""
    first = np.argmax(groups > 0.0, axis=1)
    share = groups**2
    return replace(
        rows,
        spot=rows.spot[first],
        site=rows.site[first],
        channel=rows.channel[first],
        point=share @ rows.point / (groups > 0.0).sum(axis=1),
        path=share @ rows.path,
        scale=share @ rows.scale,
        envelope=groups @ rows.envelope,
    )
