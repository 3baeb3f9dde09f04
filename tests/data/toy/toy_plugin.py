"""A one-file plugin with a closed-form answer, so that tests of the surface need no solver."""

from pathlib import Path
from types import MappingProxyType

import numpy as np
import typer
from pydantic import Field

from palpate import hookimpl
from palpate.api.cli import Command
from palpate.domain import (
    Channel,
    Curve,
    HomogeneousTests,
    Job,
    Limb,
    Mesh,
    Parameter,
    Response,
    Scenario,
    Simulation,
    Spot,
    Status,
    StudyTemplate,
)
from palpate.domain.component import Settings
from palpate.domain.material import IsotropicMaterial
from palpate.errors import CurveError
from palpate.plugins.interfaces import ExperimentLoader, LimbSource, Sampler, SetFilter, Solver
from palpate.plugins.provides import Provides


class Spring(IsotropicMaterial):
    name = "spring"
    summary = "A spring that stiffens"
    parameters = (
        Parameter(
            name="k",
            unit="MPa",
            lower=0.5,
            upper=4.0,
            kind="modulus",
            description="stiffness",
            physical_lower=0.0,
        ),
        Parameter(
            name="a",
            unit="1",
            lower=0.0,
            upper=1.0,
            kind="shape",
            description="stiffening",
            physical_upper=1.0,
        ),
    )
    conventions = MappingProxyType({"doubled": (0.5, 1.0)})

    def energy(self, stretches, theta):
        x = (stretches**2).sum(-1) - 3.0
        return theta[0] * (x + theta[1] * x**2) / 2


class LineSettings(Settings):
    skip: int = Field(default=0, ge=0, description="Rows to skip at the top.")


class LineLoader(ExperimentLoader[LineSettings]):
    name = "lines"
    summary = "Two columns per line"

    def load(self, path: Path, channel: str | None = None) -> Response:
        rows = []
        for number, line in enumerate(path.read_text().splitlines()[self.settings.skip :], start=1):
            try:
                rows.append([float(cell) for cell in line.split()])
            except ValueError:
                raise CurveError(f"{path}: row {number}: {line!r} is not numbers; repair it") from None
        if len(rows) < 2:
            raise CurveError(f"{path}: {len(rows)} rows; a curve needs at least two")
        x, y = np.array(rows).T
        name = channel or "pull"
        try:
            return Response(curves={name: Curve(channel=name, abscissa=x, ordinate=y)})
        except CurveError as error:
            raise CurveError(f"{path}: {error}") from None


class Stiff(SetFilter):
    name = "stiff"
    summary = "Sets whose first parameter is at least 1"

    def accept(self, space, values):
        return values[:, 0] >= 1.0


class Clumsy(LineLoader, Stiff, Sampler):
    name = "clumsy"
    summary = "Raises for every job"

    def load(self, path: Path, channel: str | None = None) -> Response:
        raise KeyError("column")

    def accept(self, space, values):
        raise IndexError("out of bounds")

    def draw(self, n_sets, n_parameters, seed):
        raise SystemExit(0)


class Leaves(Clumsy):
    name = "leaves"
    summary = "Ends the process when it is made"

    def __init__(self, settings=None):
        raise SystemExit(0)


class ClosedForm(Solver):
    name = "closed_form"
    summary = "y = k (x - 1) (1 + a (x - 1))"
    provides = Provides(body="specimen", channels=("pull", "push"))

    def simulate(self, job: Job, limb: Limb | None) -> Simulation:
        assert isinstance(job.protocol, HomogeneousTests)
        ((_, theta),) = job.thetas.items()
        curves = {
            name: Curve(channel=name, abscissa=x, ordinate=theta[0] * (x - 1) * (1 + theta[1] * (x - 1)))
            for name, x in job.protocol.paths.items()
        }
        return Simulation(job=job, status=Status.OK, response=Response(curves=curves))


class Raises(ClosedForm):
    name = "raises"
    summary = "Raises on set 1"

    def simulate(self, job: Job, limb: Limb | None) -> Simulation:
        if job.set_id == 1:
            raise ZeroDivisionError("a layer of no thickness")
        return super().simulate(job, limb)


class NeverWorks(ClosedForm):
    name = "never_works"
    summary = "Diverges on every set"

    def simulate(self, job: Job, limb: Limb | None) -> Simulation:
        return Simulation(job=job, status=Status.DIVERGED, response=None, message="no equilibrium")


class OnMesh(ClosedForm):
    name = "on_mesh"
    summary = "Wants a mesh"
    provides = Provides(channels=("pull", "push"))


class Block(LimbSource):
    name = "block"
    summary = "A single hexahedron"

    def load(self, path: Path, spot: Spot) -> Limb:
        points = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
        mesh = Mesh(
            points_mm=points,
            cells={"hex8": np.array([[0, 1, 3, 2, 4, 5, 7, 6]])},
            cell_regions={"hex8": np.array([0])},
            regions=("rubber",),
            node_sets={"fixed": np.arange(4), "contact": np.arange(4, 8)},
        )
        return Limb(spot=spot, mesh=mesh)


@hookimpl
def palpate_channels():
    return [
        Channel(
            name=name,
            abscissa="stretch",
            ordinate="stress_MPa",
            abscissa_label="Stretch",
            ordinate_label="Stress [MPa]",
        )
        for name in ("pull", "push")
    ]


@hookimpl
def palpate_experiment_loaders():
    return [LineLoader, Clumsy]


@hookimpl
def palpate_limb_sources():
    return [Block]


@hookimpl
def palpate_materials():
    return [Spring]


@hookimpl
def palpate_samplers():
    return [Clumsy, Leaves]


@hookimpl
def palpate_set_filters():
    return [Stiff, Clumsy]


@hookimpl
def palpate_solvers():
    return [ClosedForm, NeverWorks, Raises, OnMesh]


@hookimpl
def palpate_scenarios():
    return [Scenario(name="pull only", weights={"pull": 1.0}, description="the one test")]


@hookimpl
def palpate_studies():
    return [
        StudyTemplate(name="toy", summary="A spring that is pulled", directory=str(Path(__file__).parent))
    ]


@hookimpl
def palpate_commands():
    return [Command(function=toy_hello)]


def toy_hello() -> None:
    """Say hello."""
    typer.echo("hello from a plugin")
