"""Changes of a curve that are known of another curve like it."""

import functools
from dataclasses import replace

import numpy as np

from palpate.domain import Curve, FloatArray
from palpate.fit.spot_term import Correction, SpotTerm


def path_of(abscissa: FloatArray) -> FloatArray:
    """Travel along a curve up to each point (n,), in ranges of its abscissa."""
    return np.concatenate([[0.0], np.cumsum(np.abs(np.diff(abscissa)))]) / np.ptp(abscissa)


def changed_like(
    change: FloatArray, of: Curve, known: FloatArray, abscissa: FloatArray, ordinate: FloatArray
) -> FloatArray:
    """Change of a curve (n,) like the known one of another: along the path and relative to its ordinates.

    On a path of another shape it is the same share of every ordinate. A curve that is zero shows no change.
    """
    if not (np.nansum(known**2) > 0.0 and np.nansum(ordinate**2) > 0.0):
        return np.zeros_like(ordinate)
    at, at_known = (path / path[-1] for path in (path_of(abscissa), path_of(of.abscissa)))
    here, there = (each / np.abs(each).max() for each in (abscissa, of.abscissa))
    seen = np.isfinite(known)
    # Largest difference of two abscissae along their paths, of the largest, up to which they have one
    # shape.
    if np.abs(np.interp(at, at_known, there) - here).max() > 0.05:
        share = (change[seen] @ known[seen]) / (known[seen] @ known[seen])
        changed: FloatArray = share * ordinate
    else:
        known = np.interp(at, at_known, known)
        both = np.isfinite(ordinate) & np.isfinite(known)  # the same part of both paths
        size = np.linalg.norm(ordinate[both]) / max(float(np.linalg.norm(known[both])), 1e-300)
        changed = size * np.interp(at, at_known, change)
    return np.where(np.isfinite(ordinate), changed, 0.0)


def correction_like(like: SpotTerm, channel: str, abscissa: FloatArray, ordinate: FloatArray) -> Correction:
    """Correction of a curve (n,), known of one like it: along the path and relative to its size.

    Parameters
    ----------
    like : SpotTerm
        With a correction of the channel.
    channel : str
    abscissa, ordinate : (n,) arrays
        Curve on the coarse mesh; NaN where it does not reach a point, at which nothing is added.
    """
    known, of = like.corrections[channel], like.measured[channel]
    changed = functools.partial(changed_like, of=of, known=known.coarse, abscissa=abscissa, ordinate=ordinate)
    return replace(
        known,
        added=changed(known.added),
        coarse=ordinate,
        contact=None if known.contact is None else changed(known.contact),
        slopes={name: changed(slope) for name, slope in known.slopes.items()},
    )
