"""What chosen presses are worth by finite elements: ``python benchmarks/study_next.py FOLDER``.

Sessions as those of ``bench_next.py`` on the demo's forearm: four spots, each pressed 5 or 10 mm deep without
a twist, with ±22.5° and with ±45°. The truth is a random Yeoh material of the ranges, on other and finer
meshes. Each session has noise, drift, gains, friction and bulk modulus of its own, which the fit does not
know.

Finite elements give the curves of a few materials; between these each is emulated as in
``study_prediction.py``. The tool whose force is predicted is the plate of the ready study, 5 mm deep at p1,
on the mesh of the fit. What is in FOLDER is not simulated again.

    python benchmarks/study_next.py FOLDER --n 50
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import compress, product
from pathlib import Path
from types import SimpleNamespace

import bench_next as sessions
import numpy as np
from bench_inadequate import NOISE, REGION, dense, ready, say
from independent_meshes import true_limb
from study_prediction import BUDGET, N_COARSE, N_FINE, RELATIVE, SPOTS, Channel, accepted, emulator

from palpate import Curve, Job, Response, Simulation, Status
from palpate.domain import Indentation
from palpate.executors import Processes
from palpate.limb.loading import load_limbs
from palpate.plugins.catalogue import Plugins
from palpate.simulation.sweep import Simulations
from palpate.study.reading import StudySpot
from palpate.study.tool import read_tool
from palpate_planning.candidates import CandidatePress

DEPTHS_MM, TWISTS_DEG = (5.0, 10.0), (0.0, 22.5, 45.0)
AT, TOOL_DEPTH_MM = "p1", 5.0


class Phantom:
    """The demo's study and the answers of finite elements at a few materials."""

    def __init__(self, folder: Path) -> None:
        plugins = Plugins.load()
        self.study = replace(ready("forearm-demo", plugins), budget=BUDGET, executor=Processes())
        limbs = load_limbs(self.study)
        limbs |= {f"{spot} true": true_limb(spot) for spot in SPOTS}
        self.rows = accepted(self.study, N_COARSE, np.random.default_rng(0))
        where = Path(str(plugins.studies["forearm-demo"].directory))
        tool = read_tool(where / "plate.toml", self.study, plugins)
        path = np.array([(0.0, 0.0), (TOOL_DEPTH_MM, 0.0)])
        self.tool = replace(tool, protocol=replace(tool.protocol, path=path, loads=None))
        twisted = [key for key in product(SPOTS, DEPTHS_MM, TWISTS_DEG) if key[2]]
        with Simulations(self.study, folder, limbs) as simulations:
            jobs = [self._job(AT, self.tool.protocol, row, slopes=True) for row in self.rows]
            for spot, *press in twisted:
                protocol = self.protocol(spot, *press)
                jobs += [self._job(spot, protocol, row, slopes=True) for row in self.rows]
                jobs += [self._job(f"{spot} true", protocol, row) for row in self.rows[:N_FINE]]
            found = iter(simulations.of([replace(job, set_id=-1 - k) for k, job in enumerate(jobs)]))
            pressed = [_answer(next(found))["force"] for _ in self.rows]
            self.force = self._force(pressed)
            self.channels = {}
            for key in twisted:
                coarse = [_answer(next(found)) for _ in self.rows]
                fine = [_answer(next(found)) for _ in range(N_FINE)]
                self.channels[key] = self._channels(coarse, fine)

    def _channels(self, coarse: Sequence[Response], fine: Sequence[Response]) -> dict[str, Channel]:
        """Curves of a press, by the materials at which it has slopes."""
        has_slopes = [all(curve.slopes for curve in each.curves.values()) for each in coarse]
        used = SimpleNamespace(study=self.study, rows=self.rows[has_slopes])
        chosen = list(compress(coarse, has_slopes))
        with_fine = list(compress(fine, has_slopes))
        return {n: Channel(used, [r[n] for r in chosen], [r[n] for r in with_fine]) for n in coarse[0]}

    def protocol(self, spot: str, depth_mm: float, twist_deg: float) -> Indentation:
        """A press and twist of the study's sphere."""
        usual = self.study.protocol_at(spot)
        assert isinstance(usual, Indentation)
        angles = (-twist_deg, twist_deg, 0.0) if twist_deg else ()
        path = [(0.0, 0.0), (depth_mm, 0.0), *((depth_mm, angle) for angle in angles)]
        return Indentation(indenter=usual.indenter, path=np.array(path), friction=usual.friction)

    def _job(self, limb: str, protocol: Indentation, row: np.ndarray, *, slopes: bool = False) -> Job:
        materials = {region.region: region.material for region in self.study.space.regions}
        thetas = self.study.space.thetas(row)
        return Job(spot=limb, set_id=-1, materials=materials, thetas=thetas, protocol=protocol, slopes=slopes)

    def _force(self, pressed: Sequence[Curve]) -> "emulator":
        """Logarithm of the tool's force at materials (n, 3)."""
        ends = np.array([[curve.ordinate[-1]] for curve in pressed])
        names = self.study.space.names
        rates = np.array([[[c.slopes[n][-1] / c.ordinate[-1] for n in names]] for c in pressed])
        return emulator(self.study, self.rows, np.log(ends), rates)

    def tool_curve(self, row: np.ndarray) -> Curve:
        """Force of the tool over its depth: at its end as emulated, a straight line to there."""
        size = float(np.exp(self.force(row[None])[0, 0]))
        steps = 1e-4 * np.abs(row)
        ahead, behind = (self.force(row[None] + sign * np.diag(steps))[:, 0] for sign in (1, -1))
        rates = size * (ahead - behind) / (2.0 * steps)
        ends = np.array([0.0, 1.0])
        slopes = {name: rate * ends for name, rate in zip(self.study.space.names, rates, strict=True)}
        slopes |= {f"{REGION}.kappa": 0.0 * ends, "friction": 0.0 * ends}
        return Curve(channel="force", abscissa=TOOL_DEPTH_MM * ends, ordinate=size * ends, slopes=slopes)

    def curves(
        self, spot: str, protocol: Indentation, row: np.ndarray, changes: np.ndarray, *, fine: bool
    ) -> Response:
        """A press, with changes of the bulk modulus and the friction; without a twist, as before one."""
        depth, twist = (float(np.abs(column).max()) for column in protocol.path[:, :2].T)
        assert np.array_equal(protocol.path[:, :2], self.protocol(spot, depth, twist).path[:, :2])
        channels = self.channels[spot, depth, twist or min(filter(None, TWISTS_DEG))]
        names = ("force", "torque") if twist else ("force",)
        return Response(curves={n: channels[n].curve(n, row, changes, fine=fine) for n in names})


def _answer(simulation: Simulation) -> Response:
    if simulation.status is not Status.OK or simulation.response is None:
        raise SystemExit(f"{simulation.job.spot}: {simulation.message}")
    return simulation.response


@dataclass
class Emulated:
    """Answers jobs as ``Simulations`` does."""

    phantom: Phantom
    known: dict = field(default_factory=dict)

    def of(self, jobs: Sequence[Job]) -> list[Simulation]:
        """Simulations of jobs, in their order."""
        return [Simulation(job=job, status=Status.OK, response=self._response(job)) for job in jobs]

    def _response(self, job: Job) -> Response:
        phantom, theta = self.phantom, job.thetas[REGION]
        if job.protocol.indenter == phantom.tool.protocol.indenter:
            return Response(curves={"force": phantom.tool_curve(theta[:3])})
        spot = job.spot[:2]
        bulk = phantom.study.space.thetas(theta[:3])[REGION][3]
        changes = np.array(
            [theta[3] - bulk, job.protocol.friction - phantom.study.protocol_at(spot).friction]
        )
        return phantom.curves(spot, job.protocol, theta[:3], changes, fine=False)


class World(sessions.World):
    """What is true in one session on the forearm."""

    def __init__(self, phantom: Phantom, seed: int) -> None:
        self.phantom, self.study, self.tool = phantom, phantom.study, phantom.tool
        self.rng = rng = np.random.default_rng([seed, 4])
        (self.row,) = accepted(self.study, 1, rng)
        self.gain = {name: 1.0 + BUDGET.gain * rng.normal() for name in ("force", "torque")}
        bulk = self.study.space.thetas(self.row)[REGION][3]
        friction = self.study.protocol_at(AT).friction
        self.changes = RELATIVE * rng.normal(size=2) * [bulk, friction]
        self.candidates = [
            CandidatePress(
                name=f"{spot}-{depth:g}-{twist:g}", spot=spot, protocol=phantom.protocol(spot, depth, twist)
            )
            for spot, depth, twist in product(SPOTS, DEPTHS_MM, TWISTS_DEG)
        ]

    def press(self, spot: str, protocol: Indentation) -> Response:
        """Measure a press."""
        true = self.phantom.curves(spot, protocol, self.row, self.changes, fine=True)
        return Response(
            curves={name: self._measured(spot, curve, 0.0) for name, curve in true.curves.items()}
        )

    def _measured(self, spot: str, curve: Curve, onset: float) -> Curve:
        x, y = dense(curve.abscissa), dense(curve.ordinate)
        along, peak = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(x)))]), np.abs(y).max()
        y = self.gain[curve.channel] * y + BUDGET.zero * self.rng.normal() * peak * along / along[-1]
        y = y + NOISE * peak * self.rng.normal(size=x.size)
        return Curve(channel=curve.channel, abscissa=x - onset, ordinate=y).cut(slice(1, None))

    def simulations(self) -> Emulated:
        """What answers jobs."""
        return Emulated(self.phantom)

    def spot(self, name: str, protocol: Indentation) -> StudySpot:
        """A press as a spot of the study, at the place of the same limb."""
        own = next(spot for spot in self.phantom.study.spots if spot.spot.name == name[:2])
        return replace(own, spot=replace(own.spot, name=name), protocol=protocol)

    def tool_force(self, row: np.ndarray) -> float:
        """Force of the tool on a material (3,)."""
        return float(np.exp(self.phantom.force(row[None])[0, 0]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="keeps what is simulated")
    parser.add_argument("--n", type=int, default=50, help="sessions")
    parser.add_argument("--first", type=int, default=0, help="number of the first of them")
    parser.add_argument("--ways", nargs="*", choices=sessions.WAYS, default=list(sessions.WAYS))
    asked = parser.parse_args()
    phantom = Phantom(asked.folder)
    for key, channels in phantom.channels.items():
        errors = [f"{n} {100 * c.errors[0]:.2f}, {100 * c.errors[1]:.2f}" for n, c in channels.items()]
        say(f"{key}: % of the peak for a material left out, and on the finer mesh: {'; '.join(errors)}")
    found = []
    for seed in range(asked.first, asked.first + asked.n):
        found.append(sessions.compared(World(phantom, seed), asked.ways))
        say(f"{seed}: " + "; ".join(f"{way} {np.round(e['widths'], 4)}" for way, e in found[-1].items()))
        if len(found) % 5 == 0:
            sessions.table(found)
    sessions.table(found)
    for way in asked.ways:
        sessions.expectations(way, found)


if __name__ == "__main__":
    main()
