"""Force and torque of any isotropic material at the strains under a sphere, in a millisecond.

Not a simulation: the tissue is a few strips that a depth compresses and a rotation shears, each by its own
share, and W(depth, rotation) is the sum of their energies. Force and torque are its derivatives. So the
answers depend on the material's parameters much as those of a finite element solver do.
"""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from pydantic import Field

from palpate import Curve, Indentation, Job, Limb, Response, Settings, Simulation, Solver, Status
from palpate.domain import ParameterSpace, RegionMaterial, Scenario, Spot
from palpate.domain.indenter import Sphere
from palpate.executors import InProcess
from palpate.fit.box import Box
from palpate.fit.least_squares import LeastSquares
from palpate.fit.parametrisation import StandardParametrisation
from palpate.plugins.interfaces import ExperimentLoader, SetFilter
from palpate.plugins.provides import Provides
from palpate.sampling.drawing import accepted_by_all
from palpate.sampling.samplers import LatinHypercube
from palpate.study.reading import Study, StudySpot

DEPTHS = np.linspace(0.5, 10.0, 20)
ANGLES = np.concatenate(
    [np.linspace(0, -22.5, 11), np.linspace(-22.5, 22.5, 21)[1:], np.linspace(22.5, 0, 11)[1:]]
)
COMPRESSED = np.array([0.01, 0.02, 0.035, 0.055])  # logarithmic strain of each strip per mm
SHEARED = np.array([0.3, 0.6, 0.9, 1.2])  # shear of each strip per radian
VOLUMES_MM3 = np.array([4000.0, 2000.0, 1000.0, 500.0])
CONFINED = 0.45  # lateral over axial strain: some volume is lost
SCENARIO = Scenario(name="I", weights={"force": 1.0, "torque": 1.0})


STEP = 1e-30j
"""A complex step gives a first derivative without any loss of digits."""


def energy(material, depth, rotation, theta, volumes=VOLUMES_MM3, lateral=None):
    """W of all strips, for each depth (mm) and rotation (radians); ``lateral`` stretches may be given."""
    log = -COMPRESSED * depth[:, None]
    axial, lateral = np.exp(log), np.exp(-CONFINED * log) if lateral is None else lateral
    shear = SHEARED * rotation[:, None]
    mean = (lateral**2 + axial**2 + shear**2) / 2.0
    root = np.sqrt(mean**2 - (axial * lateral) ** 2)
    squares = np.stack([mean + root, mean - root, lateral**2], axis=-1)
    return (volumes * material.energy(np.sqrt(squares), theta)).sum(axis=-1)


def answers(material, theta):
    """Force (20,) and torque (41,)."""
    force = energy(material, DEPTHS + STEP, np.zeros(DEPTHS.size), theta).imag / STEP.imag
    deepest = np.full(ANGLES.size, DEPTHS[-1])
    torque = energy(material, deepest, np.radians(ANGLES) + STEP, theta).imag / STEP.imag
    return force, torque


def derivatives(material, theta):
    """Slopes of force and torque, each (n_points, n_parameters)."""
    columns = []
    for k, value in enumerate(theta):
        step = np.zeros(theta.size)
        step[k] = 1e-5 * abs(value)
        ahead, behind = answers(material, theta + step), answers(material, theta - step)
        columns.append([(a - b) / (2.0 * step[k]) for a, b in zip(ahead, behind, strict=True)])
    return [np.stack(each, axis=1) for each in zip(*columns, strict=True)]


class Rising(SetFilter):
    """Stresses rise with strain in tension and in compression, along one axis and along two."""

    name, summary = "rising", "stresses that rise with strain"

    def accept(self, space, values):
        (region,) = space.regions
        thetas = [space.thetas(row)[region.region] for row in values]
        return np.array([self._rises(region.material, theta) for theta in thetas], dtype=bool)

    @staticmethod
    def _rises(material, theta):
        strain = np.linspace(np.log(0.3), np.log(3.0), 40) + STEP
        one = np.exp(np.stack([strain, -strain / 2.0, -strain / 2.0], axis=-1))
        stress = material.energy(one, theta).imag / STEP.imag
        return bool((np.diff(stress) > 0.0).all())


class PressedSettings(Settings):
    exact: bool = Field(default=True, description="Whether slopes are given.")
    stiffer: float = Field(default=0.0, description="Relative error of the coarse mesh.")


class Pressed(Solver[PressedSettings]):
    name, summary = "pressed", "strips of tissue"

    @property
    def provides(self):
        return Provides(body="layers", slopes=self.settings.exact)

    def simulate(self, job: Job, limb: Limb | None) -> Simulation:
        ((region, material),) = job.materials.items()
        theta = job.thetas[region]
        slopes = derivatives(material, theta) if job.slopes else None
        found = {}
        parts = zip(("force", "torque"), (DEPTHS, ANGLES), answers(material, theta), strict=True)
        for i, (name, x, y) in enumerate(parts):
            # A coarse mesh is stiffer, and the more so the larger its strains are.
            factor = 1.0 + (0.0 if job.mesh else self.settings.stiffer) * (
                1.0 + (np.abs(x) / np.abs(x).max())
            )
            by_name = {
                f"{region}.{p.name}": factor * slopes[i][:, k]
                for k, p in enumerate(material.parameters)
            } if slopes else {}  # fmt: skip
            by_name |= {"friction": np.zeros(x.size)} if slopes else {}
            found[name] = Curve(channel=name, abscissa=x, ordinate=factor * y, slopes=by_name)
        return Simulation(job=job, status=Status.OK, response=Response(curves=found), seconds=1e-3)


class NoFiles(ExperimentLoader):
    name, summary = "no_files", "curves that are in memory"

    def load(self, path: Path, channel: str | None = None) -> Response:
        raise AssertionError(path)


@dataclass
class Here:
    """Simulates in this process, each job once, and counts."""

    solver: Solver
    limbs: dict[str, Limb] = field(default_factory=dict)
    n_coarse: int = 0
    n_fine: int = 0
    known: dict = field(default_factory=dict)

    def of(self, jobs: Sequence[Job]) -> list[Simulation]:
        return [replace(self._of(job), job=job) for job in jobs]

    def _of(self, job: Job) -> Simulation:
        key = (job.spot, *(theta.tobytes() for theta in job.thetas.values()), job.slopes, job.mesh)
        if key not in self.known:
            self.known[key] = self.solver.simulate(job, self.limbs.get(job.limb_name))
            self.n_fine += bool(job.mesh)
            self.n_coarse += not job.mesh
        return self.known[key]


def study_of(material, searched, filters=(), solver=None, spots=("p1",), **changes) -> Study:
    """A study of one region; parameters that are not searched are in the middle of their ranges."""
    fixed = {p.name: (p.lower + p.upper) / 2.0 for p in material.parameters if p.name not in searched}
    region = RegionMaterial(
        region="tissue",
        material=material,
        searched=tuple(p for p in material.parameters if p.name in searched),
        fixed=fixed,
    )
    study = Study(
        name="pressed",
        description="strips of tissue",
        file=Path(tempfile.gettempdir()) / "study.toml",
        data="simulated",
        spots=tuple(StudySpot(spot=Spot(name=name), measured={}, mesh=None) for name in spots),
        loader=NoFiles(),
        limb_source=None,
        protocol=Indentation(
            indenter=Sphere(radius_mm=7.5),
            path=[(0, 0), (10, 0), (10, -22.5), (10, 22.5), (10, 0)],
            friction=1.0,
        ),
        space=ParameterSpace(regions=(region,)),
        sampler=LatinHypercube(),
        n_sets=0,
        seed=1,
        filters=tuple(filters),
        solver=solver or Pressed(),
        scenarios=(SCENARIO,),
        generalise_by="I",
        search=LeastSquares(),
        parametrisation=StandardParametrisation(),
        truth={},
        n_workers=1,
        time_limit_s=60.0,
        plugin_files=(),
        executor=InProcess(),
    )
    return replace(study, **changes)


def truths(study, n, seed):
    """Draw sets (n_searched,) that the filters accept, not at a bound, moduli in logarithms."""
    box, rng = Box(study.space.parameters), np.random.default_rng(seed)
    while n:
        row = box.values(rng.uniform(0.03, 0.97, len(box.names)))
        if accepted_by_all(study.filters, study.space, row[None])[0]:
            n -= 1
            yield row


def measured_at(study, row, noise=0.0, seed=1, *, fine=False) -> Response:
    """Curves of a set (n_searched,) with noise, relative to the largest ordinate of each."""
    region = study.space.regions[0]
    job = Job(
        spot="p1",
        set_id=0,
        materials={region.region: region.material},
        thetas=study.space.thetas(np.asarray(row)),
        protocol=study.protocol,
        mesh="fine" if fine else "",
    )
    rng = np.random.default_rng(seed)
    response = study.solver.simulate(job, None).response
    curves = {
        name: replace(
            c, ordinate=c.ordinate + noise * np.abs(c.ordinate).max() * rng.normal(size=c.ordinate.size)
        )
        for name, c in response.curves.items()
    }
    return Response(curves=curves)
