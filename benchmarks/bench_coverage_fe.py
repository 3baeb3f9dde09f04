"""Coverage by finite elements, in worlds with independent meshes: ``bench_coverage_fe.py FOLDER``.

Each world is a random Yeoh material of the demo's ranges, pressed at one of the forearm's four spots (with
``--joint`` at all), with noise, drift, onset, gains, friction and bulk modulus off by what the budget has,
times ``--errors``. It is measured on a mesh that was made independently of the study's and bisected to 1.3 mm
at the edge of the contact. The fit has one of two meshes, the demo's or a coarser one of the phantom's own
surfaces, and its correction by the mesh that palpate refines by itself; or the demo's alone. Prints how often
95 % intervals hold the truth, how often a check fails, and which.

Finite elements give the curves of a few materials, with slopes on the meshes of the fit. Between these the
curves are emulated, and so is what the finer meshes add to them. Printed first are the largest errors of a
material that is left out. What is in FOLDER is not simulated again.

    python benchmarks/bench_coverage_fe.py FOLDER --n 120 --errors 1 2
"""

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from bench_inadequate import REGION, Truth, assessed, held, ready, ready_with_fine, say
from bench_wrong import is_flagged
from scipy.interpolate import CubicSpline
from scipy.stats import qmc
from study_mesh_size import RADIUS_MM, exact_segment, meshed
from study_prediction import SPOTS, accepted, emulator, on_grid
from study_stated_mesh import TRUE_EDGE_MM

from palpate import Curve, Job, Limb, Response, Simulation, Status
from palpate.domain import Indentation, Refinement
from palpate.limb.loading import RIM, finer_limb, load_limbs, size_at_contact
from palpate.mesh.refinement import refined
from palpate.plugins.catalogue import Plugins
from palpate.sampling.drawing import accepted_by_all
from palpate.simulation.sweep import Simulations
from palpate.study.model import BudgetTable
from palpate_certainty.held_out import held_out, is_apart
from palpate_certainty.mesh_error import SpotMesh
from palpate_forearm import Phantom

BUDGET = BudgetTable.model_validate({"onset": "0.05 mm", "zero": 0.003, "friction": 0.1})
"""The mesh's error is what palpate finds from its finer mesh, or its default; the rest as palpate assumes."""
N_COARSE, N_FINE, N_DEEPER = {"demo": 16, "other": 8}, {"demo": 8, "other": 6}, 3
"""Materials with slopes on the meshes of the fit, those on its finer meshes, and those pressed deeper."""
TRUE_ROWS = {"p1": (0, 2, 3, 4), "p2": (0, 2, 3, 4), "p3": (0, 1, 2, 3), "p4": (0, 1, 2, 3)}
"""Materials on the meshes of the truth; the fifth of each spot takes more than 600 s."""
DEEPER_MM = 0.3
OTHER_RATIO = 0.5
"""Edge over radius of the second mesh."""
MESHES = ("demo", "other", "demo, not corrected")
AT = {"demo": SPOTS, "other": ("p1",)}
"""Spots with each mesh."""
WIDE = 0.8
"""Width of an interval over the range beyond which it holds a truth of the range by construction."""


class Forearm:
    """The demo's study, and the curves of its spots on all meshes at a few materials."""

    def __init__(self, folder: Path, only: Sequence[str]) -> None:
        plugins = Plugins.load()
        self.study = replace(ready("forearm-demo", plugins), budget=BUDGET)
        self.rows = self._rows()
        self.limbs = self._limbs(plugins)
        with Simulations(self.study, folder, self.limbs) as self.simulations:
            self.channels = {(mesh, spot): self._channels(mesh, spot) for mesh in only for spot in AT[mesh]}

    def _rows(self) -> np.ndarray:
        """Materials (n, 3): five at random as ``study_stated_mesh.py`` has them, the rest spread."""
        parameters = self.study.space.parameters
        low, high = (np.array([getattr(p, end) for p in parameters]) for end in ("lower", "upper"))
        spread = low + (high - low) * qmc.LatinHypercube(low.size, rng=1).random(64)
        spread = spread[accepted_by_all(self.study.filters, self.study.space, spread)]
        known = accepted(self.study, 5, np.random.default_rng(1))
        return np.concatenate([known, spread])[: max(N_COARSE.values())]

    def meshes(self, mesh: str, spots: Sequence[str]) -> dict[str, SpotMesh]:
        """Meshes of a fit as far as their error goes."""
        found = {}
        for spot in spots:
            name = self._name(mesh.partition(",")[0], spot)
            edge_mm, finer_mm = (
                size_at_contact(self.study, self.limbs[each]) for each in (name, f"{name}/fine")
            )
            ratio = 1.0 if mesh == MESHES[2] else edge_mm / finer_mm
            between = Refinement(ratio=ratio, at_rim=True)
            found[spot] = SpotMesh(edge_over_radius=edge_mm / RADIUS_MM, refinement=between)
        return found

    @staticmethod
    def _name(mesh: str, spot: str) -> str:
        return spot if mesh == MESHES[0] else f"{spot} {mesh}"

    def _limbs(self, plugins: Plugins) -> dict[str, Limb]:
        """Meshes by name: of the fits, ``/fine`` as palpate refines them, and `` true`` of the truth."""
        study, phantom = self.study, Phantom()
        limbs = load_limbs(study)
        independent = load_limbs(ready_with_fine("robot-log", plugins))
        for spot in study.spots:
            name, reach_mm = spot.spot.name, study.protocol_at(spot.spot.name).reach_mm
            place = next(each for each in phantom.spots if each.name == name)
            limb, _ = meshed(exact_segment(phantom, place), OTHER_RATIO)
            fine = finer_limb(study, spot, {name: limb})
            assert fine is not None
            other = self._name("other", name)
            limbs[other], limbs[f"{other}/fine"] = limb, fine
            truth = independent[f"{name}/fine"]
            limbs[f"{name} true"] = refined(truth, RIM[1] * reach_mm, TRUE_EDGE_MM, RIM[0] * reach_mm)
        return limbs

    def _channels(self, mesh: str, spot: str) -> "dict[str, Channel]":
        """Emulated curves of a spot. The truth is known by what it adds to the demo's finer mesh."""
        name = self._name(mesh, spot)
        coarse = self._simulated(name, spot, self.rows[: N_COARSE[mesh]], slopes=True)
        fine = self._simulated(f"{name}/fine", spot, self.rows[: N_FINE[mesh]])
        deeper = self._simulated(spot, spot, self.rows[:N_DEEPER], deeper_mm=DEEPER_MM)
        at = list(TRUE_ROWS[spot])
        true = self._simulated(f"{spot} true", spot, self.rows[at])
        under = self._simulated(f"{spot}/fine", spot, self.rows[: N_FINE["demo"]])
        not_deeper = self._simulated(spot, spot, self.rows[:N_DEEPER])
        found = {}
        for channel in coarse[0]:
            curves = [
                [each[channel] for each in of] for of in (coarse, fine, under, true, deeper, not_deeper)
            ]
            found[channel] = Channel(self, at, *curves)
        return found

    def _simulated(
        self, limb: str, spot: str, rows: np.ndarray, *, slopes: bool = False, deeper_mm: float = 0.0
    ) -> list[Response]:
        protocol, (region,) = self.study.protocol_at(spot), self.study.space.regions
        assert isinstance(protocol, Indentation)
        path = protocol.path.copy()
        path[path[:, 0] > 0.0, 0] += deeper_mm
        jobs = [
            Job(
                spot=limb,
                set_id=-1 - number,
                materials={REGION: region.material},
                thetas={REGION: self.study.space.thetas(row)[REGION]},
                protocol=replace(protocol, path=path) if deeper_mm else protocol,
                slopes=slopes,
            )
            for number, row in enumerate(rows)
        ]
        responses = []
        for job in jobs:
            (each,) = self.simulations.of([job])
            if each.status is not Status.OK or each.response is None:
                raise SystemExit(f"{limb}: {each.message}")
            responses.append(each.response)
        return responses


class Channel:
    """A curve of a spot over materials: on a mesh of the fit, its finer mesh, and that of the truth."""

    def __init__(
        self,
        forearm: Forearm,
        at: Sequence[int],
        coarse: Sequence[Curve],
        fine: Sequence[Curve],
        under: Sequence[Curve],
        true: Sequence[Curve],
        deeper: Sequence[Curve],
        not_deeper: Sequence[Curve],
    ) -> None:
        study, rows = forearm.study, forearm.rows[: len(coarse)]
        self.names = [*study.space.names, f"{REGION}.kappa", "friction"]
        self.x, self.is_force = coarse[0].abscissa, coarse[0].channel == "force"
        values = self._on_grid(coarse)
        slopes = np.stack(
            [self._on_grid([replace(c, ordinate=c.slopes[n]) for c in coarse]) for n in self.names]
        )
        self.value = emulator(study, rows, values, np.moveaxis(slopes[:3], 0, 2))
        self.others = [emulator(study, rows, each) for each in slopes[3:]]
        peaks = np.abs(values).max(axis=1, keepdims=True)
        added = (self._on_grid(fine) - values[: len(fine)]) / peaks[: len(fine)]
        self.added = emulator(study, rows[: len(fine)], added)
        finest = self._on_grid(under)[list(at)]
        beyond = (self._on_grid(true) - finest) / np.abs(finest).max(axis=1, keepdims=True)
        self.beyond = beyond.mean(axis=0)
        self.from_under = emulator(
            study, rows[: len(under)], (self._on_grid(under) - values[: len(under)]) / peaks[: len(under)]
        )
        shallow = self._on_grid(not_deeper)
        more = (self._on_grid(deeper) - shallow) / np.abs(shallow).max(axis=1, keepdims=True) / DEEPER_MM
        self.deeper = more.mean(axis=0)
        self.errors = {
            "value": np.abs(self.value.left_out / peaks).max(),
            "finer": np.abs(self.added.left_out).max(),
            "truth": np.abs(beyond - self.beyond).max() * len(at) / (len(at) - 1),
            "a mm deeper": np.abs(more - self.deeper).max() * len(more) / (len(more) - 1),
        }

    def _on_grid(self, curves: Sequence[Curve]) -> np.ndarray:
        return np.stack([on_grid(curve, self.x) for curve in curves])

    def curve(self, name: str, row: np.ndarray, changes: np.ndarray, by_mm: float, mesh: str) -> Curve:
        """The curve at a material, with changes of bulk modulus and friction, so much deeper, on a mesh."""
        others = np.stack([each(row[None])[0] for each in self.others])
        steps = 1e-4 * np.abs(row)
        rows = row + np.concatenate([np.zeros((1, 3)), np.diag(steps), -np.diag(steps)])
        values = self.value(rows) + changes @ others
        if mesh:
            added = (self.added if mesh == "fine" else self.from_under)(rows)
            values = values + np.abs(values).max(axis=1, keepdims=True) * added
        y, *ends = values
        slopes = np.concatenate([(np.array(ends[:3]) - ends[3:]) / (2.0 * steps[:, None]), others])
        peak = np.abs(y).max()
        if mesh == "true":
            y = y + np.abs(y).max() * self.beyond
        x = self.x
        if self.is_force:
            x = x * (1.0 + by_mm / x[-1])
            y, *slopes = CubicSpline(self.x, np.vstack([y, slopes]), axis=1)(x)
        else:
            y = y + peak * by_mm * self.deeper
        return Curve(channel=name, abscissa=x, ordinate=y, slopes=dict(zip(self.names, slopes, strict=True)))


@dataclass
class Emulated:
    """Answers jobs on one of the meshes as ``Simulations`` does."""

    forearm: Forearm
    mesh: str
    known: dict = field(default_factory=dict)
    limbs: dict = field(default_factory=dict)

    def __post_init__(self) -> None:
        finer = () if self.mesh == MESHES[2] else [f"{spot}/fine" for spot in SPOTS]
        self.limbs = dict.fromkeys([*SPOTS, *finer])

    def of(self, jobs: Sequence[Job]) -> list[Simulation]:
        """Simulations of jobs, in their order."""
        return [Simulation(job=job, status=Status.OK, response=self._response(job)) for job in jobs]

    def _response(self, job: Job) -> Response:
        spot, _, mesh = job.spot.partition(" ")
        study, theta = self.forearm.study, job.thetas[REGION]
        usual = study.protocol_at(spot)
        by_mm = float(job.protocol.path[:, 0].max() - usual.path[:, 0].max())
        bulk = study.space.thetas(theta[:3])[REGION][3]
        changes = np.array([theta[3] - bulk, job.protocol.friction - usual.friction])
        channels = self.forearm.channels[self.mesh.partition(",")[0], spot]
        return Response(
            curves={n: c.curve(n, theta[:3], changes, by_mm, mesh or job.mesh) for n, c in channels.items()}
        )


# ----------------------------------------------------------------------------- worlds


def world(emulated: Emulated, spots: Sequence[str], seed: int, times: float) -> dict:
    """One world: which intervals hold the truth, which are wide, and which checks fail."""
    forearm = emulated.forearm
    study = replace(
        forearm.study, spots=tuple(spot for spot in forearm.study.spots if spot.spot.name in spots)
    )
    (row,) = accepted(study, 1, np.random.default_rng([seed, 5]))
    truth = Truth(
        title=f"{seed}",
        limbs={spot: f"{spot} true" for spot in spots},
        materials={REGION: study.space.regions[0].material},
        thetas=study.space.thetas(row),
        row=row,
    )
    meshes = forearm.meshes(emulated.mesh, spots)
    found = assessed(study, truth, emulated, seed, times=times, meshes=meshes)
    low, high = found.density.interval(found.point)
    result = {
        "holds": held(truth, found),
        "wide": np.append(high - low > WIDE, False),
        "failed": [check.name for check in found.checks if check.is_failed],
        "apart": is_apart(held_out(found)),
        "width": high - low,
    }
    return result | {"flagged": is_flagged(result, len(spots))}


def row_of(title: str, found: Sequence[dict]) -> str:
    """One line of the table."""
    held_by, wide = (np.array([each[key] for each in found]) for key in ("holds", "wide"))
    cells = []
    for k in range(wide.shape[1]):
        at = ~wide[:, k]
        cells.append(f"{100.0 * held_by[at, 0, k].mean():.0f} of {at.sum()}" if at.any() else "wide")
    flagged = np.array([each["flagged"] for each in found])
    either = flagged | (held_by[:, 0, -1] == 1)
    by_noise = f"{100.0 * held_by[:, 1, -1].mean():.0f}"
    counts = Counter(name for each in found for name in dict.fromkeys(each["failed"]))
    counts["held out"] = sum(each["apart"] for each in found)
    checks = ", ".join(f"{name} {count}" for name, count in counts.items() if count) or "–"
    ends = [f"{100.0 * flagged.mean():.0f}", f"{100.0 * either.mean():.0f}", by_noise, checks]
    return f"| {' | '.join([title, str(len(found)), *cells, *ends])} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="keeps what is simulated")
    parser.add_argument("--n", type=int, default=120, help="worlds of each size of the errors")
    parser.add_argument("--errors", type=float, nargs="*", default=[1.0, 2.0], help="over the budget's")
    parser.add_argument("--meshes", nargs="*", choices=MESHES, default=list(MESHES))
    parser.add_argument("--joint", action="store_true", help="all spots in each world")
    chosen = parser.parse_args()
    forearm = Forearm(chosen.folder, list(dict.fromkeys(mesh.partition(",")[0] for mesh in chosen.meshes)))
    for key, channels in forearm.channels.items():
        for name, channel in channels.items():
            errors = ", ".join(f"{what} {100.0 * error:.2f}" for what, error in channel.errors.items())
            say(f"{', '.join(key)}, {name}: % of the peak where a material is left out: {errors}")
    heads = [*forearm.study.space.names, "joint region", "flagged", "holds or flagged", "joint by the noise"]
    say(f"\n| mesh, errors over the budget's | worlds | {' | '.join(heads)} | checks |\n|{'---|' * 10}")
    for times in chosen.errors:
        every = []
        for number, mesh in enumerate(chosen.meshes):
            emulated, found = Emulated(forearm, mesh), []
            for seed in range(number, chosen.n, len(chosen.meshes)):
                at = AT[mesh.partition(",")[0]]
                spots = at if chosen.joint else (at[seed // len(chosen.meshes) % len(at)],)
                found.append(world(emulated, spots, seed, times))
            say(row_of(f"{mesh}, {times:g}", found))
            every += found
        say(row_of(f"all, {times:g}", every))


if __name__ == "__main__":
    main()
