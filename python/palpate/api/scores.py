"""Scores of simulated against measured curves, and the kernels of the one that is built in."""

from typing import TYPE_CHECKING

from palpate.lazy_imports import deferred

if TYPE_CHECKING:
    from palpate._core import (
        Measured as Measured,
        branches as branches,
        interpolate as interpolate,
        nmse as nmse,
    )
    from palpate.plugins.score import Score as Score

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)
    __dir__ = __getattr__("__dir__")
