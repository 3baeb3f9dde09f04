"""Jobs next to a job, with one parameter or the friction moved."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from palpate.domain import FloatArray, Indentation, Job
from palpate.domain.material import Material
from palpate.errors import MaterialError

SLOPE_STEP = 1e-3
"""Step of the central differences that slopes are compared with, relative to the value."""


def moved_values(material: Material, theta: FloatArray) -> Iterator[tuple[str, FloatArray]]:
    """Each parameter by name, and the values with it moved by a tenth, inside its physical range."""
    for k, parameter in enumerate(material.parameters):
        step = 0.1 * (abs(theta[k]) or parameter.upper - parameter.lower)
        values = np.array(theta, dtype=np.float64)
        values[k] += step
        try:
            parameter.check(float(values[k]))
        except MaterialError:
            values[k] -= 2.0 * step
        yield parameter.name, values


def neighbours(job: Job) -> Iterator[tuple[str, float, Job, Job]]:
    """Each parameter by name, the step, and the job with it moved up and down; friction too."""
    for region, material in job.materials.items():
        for k, parameter in enumerate(material.parameters):
            theta = np.asarray(job.thetas[region], dtype=np.float64)
            step = SLOPE_STEP * float(abs(theta[k]) or parameter.upper - parameter.lower)
            both = [theta + sign * step * (np.arange(theta.size) == k) for sign in (1.0, -1.0)]
            try:
                material.check(both[0])
                material.check(both[1])
            except MaterialError:
                continue  # next to a limit of its physical range
            ahead, behind = (replace(job, thetas={**job.thetas, region: other}) for other in both)
            yield f"{region}.{parameter.name}", step, ahead, behind
    press = job.protocol
    if isinstance(press, Indentation) and press.friction > 0.0:
        step = SLOPE_STEP * press.friction
        ahead, behind = (
            replace(job, protocol=replace(press, friction=press.friction + sign * step)) for sign in (1, -1)
        )
        yield "friction", step, ahead, behind
