"""A tissue whose answer is known in closed form, and solvers that fail in every way.

force = stiffness · depth^1.5, torque = a loop of amplitude grip with hysteresis.
Not physics: a stand-in that is as fast as it is exact.
"""

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from pydantic import Field

from palpate import (
    Channel,
    Curve,
    ExperimentLoader,
    HomogeneousTests,
    IsotropicMaterial,
    Job,
    Limb,
    Parameter,
    Response,
    Settings,
    Simulation,
    Solver,
    Status,
    hookimpl,
)
from palpate.plugins.provides import Provides

DEPTHS = np.linspace(0.0, 10.0, 21)
ANGLES = np.concatenate(
    [np.linspace(0, -22.5, 16), np.linspace(-22.5, 22.5, 31)[1:], np.linspace(22.5, 0, 16)[1:]]
)


def answer(stiffness: float, grip: float) -> Response:
    """Force over depth, torque over rotation with one value per branch."""
    way = np.sign(np.gradient(ANGLES))
    torque = grip * (np.tanh(ANGLES / 10.0) + 0.2 * way * (1.0 - (ANGLES / 22.5) ** 2))
    return Response(
        curves={
            "force": Curve(channel="force", abscissa=DEPTHS, ordinate=stiffness * DEPTHS**1.5),
            "torque": Curve(channel="torque", abscissa=ANGLES, ordinate=torque),
        }
    )


class Spongy(IsotropicMaterial):
    name = "spongy"
    summary = "a material of two numbers"
    parameters = (
        Parameter(
            name="stiffness", unit="MPa", lower=0.1, upper=1.0, kind="modulus",
            description="force", physical_lower=0.0,
        ),
        Parameter(
            name="grip", unit="MPa", lower=5.0, upper=50.0, kind="modulus",
            description="torque", physical_lower=0.0,
        ),
    )  # fmt: skip

    def energy(self, stretches, theta):
        return theta[0] * ((stretches - 1.0) ** 2).sum(axis=-1)


class AnalyticSettings(Settings):
    offset: float = Field(default=0.0, description="Added to the force.")
    log: str = Field(default="", description="File that gets a line for each simulation.")


class Analytic(Solver[AnalyticSettings]):
    name = "analytic"
    summary = "closed form"
    provides = Provides(body="layers")

    def simulate(self, job: Job, limb: Limb | None) -> Simulation:
        if self.settings.log:
            with Path(self.settings.log).open("a") as file:
                file.write(f"{job.spot} {job.set_id} {os.getpid()}\n")
        return self.behave(job)

    def behave(self, job: Job) -> Simulation:
        (theta,) = job.thetas.values()
        response = answer(*theta)
        if isinstance(job.protocol, HomogeneousTests):
            response = Response(
                curves={
                    name: Curve(channel=name, abscissa=path, ordinate=theta[0] * path + theta[1] * path**2)
                    for name, path in job.protocol.paths.items()
                }
            )
        return Simulation(job=job, status=Status.OK, response=response, seconds=0.001)


class Faulty(Analytic):
    """Set 1 ends its process, 2 hangs, 3 raises, 4 is cut short, 5 gives no curve; others are fine."""

    name = "faulty"
    summary = "fails in every way"

    def behave(self, job: Job) -> Simulation:
        if job.set_id == 1:
            os._exit(17)
        if job.set_id == 2:
            while True:
                pass
        if job.set_id == 3:
            raise ZeroDivisionError("stretch of zero")
        whole = super().behave(job)
        if job.set_id == 4:
            half = {
                name: Curve(channel=name, abscissa=curve.abscissa[:8], ordinate=curve.ordinate[:8])
                for name, curve in whole.response.curves.items()
            }
            return Simulation(
                job=job, status=Status.DIVERGED, response=Response(curves=half), message="negative Jacobian"
            )
        if job.set_id == 5:
            return Simulation(job=job, status=Status.OK, response=Response(curves={}))
        return whole


class Hopeless(Analytic):
    name = "hopeless"
    summary = "always diverges"

    def behave(self, job: Job) -> Simulation:
        return Simulation(job=job, status=Status.DIVERGED, response=None, message="step too small")


class Batch(Faulty):
    """Takes every job before it answers the first."""

    name = "batch"
    summary = "works on many at once"

    def simulate_many(self, jobs: Iterable[Job], limb: Limb | None) -> Iterator[Simulation]:
        for job in list(jobs):
            yield self.simulate(job, limb)


class Table(ExperimentLoader):
    name = "table"
    summary = "channel,abscissa,ordinate"

    def load(self, path: Path, channel: str | None = None) -> Response:
        rows = [line.split(",") for line in path.read_text().splitlines()]
        names = dict.fromkeys(row[0] for row in rows)
        return Response(
            curves={
                name: Curve(
                    channel=name,
                    abscissa=[float(x) for n, x, _ in rows if n == name],
                    ordinate=[float(y) for n, _, y in rows if n == name],
                )
                for name in names
            }
        )


FORCE = Channel(
    name="force", abscissa="depth_mm", ordinate="force_N",
    abscissa_label="indentation depth [mm]", ordinate_label="normal force [N]",
)  # fmt: skip
TORQUE = Channel(
    name="torque", abscissa="rotation_deg", ordinate="torque_Nmm",
    abscissa_label="rotation [°]", ordinate_label="torque [N·mm]",
)  # fmt: skip


@hookimpl
def palpate_channels():
    return [FORCE, TORQUE]


@hookimpl
def palpate_materials():
    return [Spongy]


@hookimpl
def palpate_experiment_loaders():
    return [Table]


@hookimpl
def palpate_solvers():
    return [Analytic, Faulty, Hopeless, Batch]
