"""How often bands of predictions hold the truth: ``python benchmarks/study_prediction.py FOLDER``.

The demo's forearm is fitted with the sphere at four spots, and the plate and the cuff of the ready study are
predicted at p1. The truth is a random Yeoh material of the ranges, on other and finer meshes. Errors of each
experiment: noise, drift, gains, friction, the bulk modulus and the mesh; of each prediction: the tool's
friction, the bulk modulus and the mesh. The fit knows none of them.

Finite elements give the curves of a few materials. Between these each is emulated: the meshes of the fit by
values and slopes, the other meshes by their ratio to these. Printed are the largest errors of materials left
out; then, for each tool, how often the bands hold the truth, and the errors of the predicted values. What is
in FOLDER is not simulated again; its cases of another study, tool or budget are left out.

    python benchmarks/study_prediction.py FOLDER --n 40
"""

import argparse
import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from bench_inadequate import REGION, Truth, assessed, ready, say
from independent_meshes import true_limb

from palpate import Curve, Job, Limb, Response, Simulation, Status
from palpate.domain import Indentation, Refinement
from palpate.domain.channels import FORCE
from palpate.limb.loading import load_limbs
from palpate.mesh.refinement import refined
from palpate.mesh.spot_frame import contact_edge_mm
from palpate.plugins.catalogue import Plugins
from palpate.sampling.drawing import accepted_by_all
from palpate.simulation.sweep import Simulations
from palpate.study.model import BudgetTable
from palpate.study.reading import Study
from palpate.study.tool import read_tool
from palpate_certainty.emulator import Emulator, Runs
from palpate_certainty.mesh_error import usual_error
from palpate_prediction.bands import ends, scores
from palpate_prediction.predict import refined_limbs
from palpate_prediction.summary import mesh_error, press_states, with_mesh

SPOTS, AT = ("p1", "p2", "p3", "p4"), "p1"
TOOLS = {"plate": 5.0, "cuff": 3.0}
"""Depths [mm] of the tools."""
N_COARSE, N_FINE = 8, 3
"""Materials that are simulated on the meshes of the fit, and those of them on the finer ones."""
BUDGET = BudgetTable.model_validate({"onset": "0 mm", "zero": 0.003, "mesh": 0.03, "friction": 0.1})
"""The mesh's error as far as force goes: that of the torque is 5 to 10 % on these meshes. The rest as palpate
assumes."""
RELATIVE = 0.1
"""Standard deviation of friction and of the bulk modulus, over their values."""
TRUE_EDGE_MM, TRUE_REACH_MM = 5.0, 25.0
"""Edges under the tools on the finer mesh."""
QUANTITIES = ("force_N", "p95_MPa", "peak_MPa")


def accepted(study: Study, n: int, rng: np.random.Generator) -> np.ndarray:
    """Random materials (n, 3) of the ranges that the filters accept."""
    low, high = (np.array([getattr(p, end) for p in study.space.parameters]) for end in ("lower", "upper"))
    rows = low + (high - low) * rng.uniform(size=(64 * n, low.size))
    return rows[accepted_by_all(study.filters, study.space, rows)][:n]


class Phantom:
    """The demo's study, its tools, and the meshes: of the fit, of the predictions, and finer ones."""

    def __init__(self, folder: Path) -> None:
        plugins = Plugins.load()
        self.study = replace(ready("forearm-demo", plugins), budget=BUDGET)
        where = Path(str(plugins.studies["forearm-demo"].directory))
        self.tools = {name: read_tool(where / f"{name}.toml", self.study, plugins) for name in TOOLS}
        self.limbs: dict[str, Limb] = load_limbs(self.study)
        self.limbs |= {f"{spot} true": true_limb(spot) for spot in SPOTS}
        for name, tool in self.tools.items():
            self.limbs[f"{name} fine"] = refined_limbs(tool.study(self.study), tool)[AT]
        self.limbs["tool true"] = refined(self.limbs[f"{AT} true"], TRUE_REACH_MM, TRUE_EDGE_MM)
        self.rows = accepted(self.study, N_COARSE, np.random.default_rng(0))
        self.simulations = Simulations(self.study, folder, self.limbs)

    @property
    def made_of(self) -> str:
        """Hash of what a case depends on: study, tools, their depths, and the budget."""
        folder = self.study.file.parent
        texts = [self.study.file.read_text(), *((folder / f"{name}.toml").read_text() for name in TOOLS)]
        return hashlib.sha256(json.dumps([texts, TOOLS, BUDGET.model_dump_json()]).encode()).hexdigest()[:16]

    def refinement(self, name: str) -> float:
        """Size of the elements under a tool over that on the refined mesh."""
        near = self.tools[name].contact_mm(TOOLS[name])
        sizes = [contact_edge_mm(self.limbs[limb], near) for limb in (AT, f"{name} fine")]
        return sizes[0] / sizes[1]

    def press(self, name: str) -> Indentation:
        """The press of a tool to its depth."""
        protocol = self.tools[name].protocol
        path = np.array([(0.0, 0.0), (TOOLS[name], 0.0)])
        return Indentation(indenter=protocol.indenter, path=path, friction=protocol.friction)

    def simulated(
        self,
        limb: str,
        row: np.ndarray,
        protocol: Indentation,
        *,
        skin: bool,
        slopes: bool,
        bulk: float = 1.0,
    ) -> Simulation:
        """One simulation, kept in the folder."""
        (region,) = self.study.space.regions
        theta = self.study.space.thetas(row)[REGION] * np.array([1.0, 1.0, 1.0, bulk])
        job = Job(
            spot=limb,
            set_id=-1,
            materials={REGION: region.material},
            thetas={REGION: theta},
            protocol=protocol,
            slopes=slopes,
            surface=skin,
        )
        (found,) = self.simulations.of([job])
        if found.status is not Status.OK:
            raise SystemExit(f"{limb}: {found.message}")
        return found

    def sphere(self, limb: str, row: np.ndarray, *, slopes: bool = False) -> Response:
        """The press and twist of the experiment."""
        protocol = self.study.protocol_at(limb.partition(" ")[0])
        return self.simulated(limb, row, protocol, skin=False, slopes=slopes).response

    def tool(
        self,
        name: str,
        limb: str,
        row: np.ndarray,
        *,
        slopes: bool = False,
        friction: float = 1.0,
        bulk: float = 1.0,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Logarithms of the quantities of a tool, and slopes (3,) of that of the force."""
        protocol = self.press(name)
        protocol = replace(protocol, friction=protocol.friction * friction)
        found = self.simulated(limb, row, protocol, skin=True, slopes=slopes, bulk=bulk)
        pressed, curve = press_states(found, None), found.response["force"]
        names = self.study.space.names
        rates = [curve.slopes[n][-1] / curve.ordinate[-1] if slopes else 0.0 for n in names]
        return np.log([pressed.value(each) for each in QUANTITIES]), np.array(rates)


# -------------------------------------------------------------------------- emulation


def emulator(
    study: Study, rows: np.ndarray, ordinates: np.ndarray, slopes: np.ndarray | None = None
) -> Emulator:
    """Of ordinates (n, n_points) at materials, with slopes (n, n_points, 3) where they are known."""
    known = np.full((*ordinates.shape, rows.shape[1]), np.nan) if slopes is None else slopes
    scale = np.full(ordinates.shape[1], np.abs(ordinates).max())
    return Emulator(study.space.parameters, Runs(values=rows, ordinates=ordinates, slopes=known), scale)


def on_grid(curve: Curve, x: np.ndarray) -> np.ndarray:
    """Ordinates where a path has its points; a curve that was cut has more of them."""
    along = [np.concatenate([[0.0], np.cumsum(np.abs(np.diff(each)))]) for each in (curve.abscissa, x)]
    return np.interp(along[1], along[0], curve.ordinate)


class Channel:
    """A curve of the sphere at a spot: on the mesh of the fit, and on the finer one."""

    def __init__(self, phantom: Phantom, coarse: Sequence[Curve], fine: Sequence[Curve]) -> None:
        study, rows = phantom.study, phantom.rows
        self.names = [*study.space.names, f"{REGION}.kappa", "friction"]
        self.x = coarse[0].abscissa
        values = np.stack([on_grid(c, self.x) for c in coarse])
        slopes = np.stack(
            [[on_grid(replace(c, ordinate=c.slopes[n]), self.x) for n in self.names] for c in coarse]
        )
        self.value = emulator(study, rows, values, np.moveaxis(slopes[:, :3], 1, 2))
        self.others = [emulator(study, rows, slopes[:, k]) for k in (3, 4)]
        peaks = np.abs(values).max(axis=1)
        apart = np.stack([on_grid(c, self.x) - y for c, y in zip(fine, values, strict=False)])
        self.apart = apart / peaks[: len(apart), None]
        self.errors = (
            np.abs(self.value.left_out / peaks[:, None]).max(),
            np.abs(self.apart - self.apart.mean(axis=0)).max() * len(apart) / (len(apart) - 1),
        )

    def curve(self, name: str, row: np.ndarray, changes: np.ndarray, *, fine: bool) -> Curve:
        """The curve at a material, with changes of the bulk modulus and the friction."""
        others = np.stack([each(row[None])[0] for each in self.others])
        y = self.value(row[None])[0] + changes @ others
        steps = 1e-4 * np.abs(row)
        ends_of = [self.value(row[None] + sign * np.diag(steps)) for sign in (1, -1)]
        slopes = np.concatenate([(ends_of[0] - ends_of[1]) / (2.0 * steps[:, None]), others])
        if fine:
            y = y + np.abs(y).max() * self.apart.mean(axis=0)
        return Curve(
            channel=name, abscissa=self.x, ordinate=y, slopes=dict(zip(self.names, slopes, strict=True))
        )


@dataclass
class Emulated:
    """Answers jobs of the sphere, as ``Simulations`` does."""

    phantom: Phantom
    known: dict = field(default_factory=dict)
    limbs: dict = field(default_factory=dict)

    def __post_init__(self) -> None:
        phantom, self.channels = self.phantom, {}
        for spot in SPOTS:
            coarse = [phantom.sphere(spot, row, slopes=True) for row in phantom.rows]
            fine = [phantom.sphere(f"{spot} true", row) for row in phantom.rows[:N_FINE]]
            self.channels[spot] = {
                n: Channel(phantom, [r[n] for r in coarse], [r[n] for r in fine]) for n in coarse[0]
            }

    def of(self, jobs: Sequence[Job]) -> list[Simulation]:
        """Simulations of jobs, in their order."""
        return [self._simulated(job) for job in jobs]

    def _simulated(self, job: Job) -> Simulation:
        spot, _, mesh = job.spot.partition(" ")
        protocol, theta = self.phantom.study.protocol_at(spot), job.thetas[REGION]
        assert np.array_equal(job.protocol.path, protocol.path)
        bulk = self.phantom.study.space.thetas(theta[:3])[REGION][3]
        changes = np.array([theta[3] - bulk, job.protocol.friction - protocol.friction])
        fine, channels = mesh == "true", self.channels[spot]
        curves = {n: c.curve(n, theta[:3], changes, fine=fine) for n, c in channels.items()}
        return Simulation(job=job, status=Status.OK, response=Response(curves=curves))


class EmulatedTool:
    """A tool at p1: logarithms of its quantities on three meshes."""

    def __init__(self, phantom: Phantom, name: str) -> None:
        rows, study = phantom.rows, phantom.study
        found = [phantom.tool(name, AT, row, slopes=True) for row in rows]
        values, rates = np.stack([v for v, _ in found]), np.stack([r for _, r in found])
        self.force = emulator(study, rows, values[:, :1], rates[:, None, :])
        self.others = emulator(study, rows, values[:, 1:] - values[:, :1])
        self.apart = {
            mesh: np.stack([phantom.tool(name, limb, row)[0] for row in rows[:N_FINE]]) - values[:N_FINE]
            for mesh, limb in (("fine", f"{name} fine"), ("true", "tool true"))
        }
        changed = {"friction": 1.0 - RELATIVE, "bulk": 1.0 + RELATIVE}
        self.rates = {
            cause: (phantom.tool(name, AT, rows[0], **{cause: factor})[0] - values[0]) / np.log(factor)
            for cause, factor in changed.items()
        }
        left_out = np.column_stack([self.force.left_out, self.others.left_out])
        self.errors = (
            np.abs(left_out).max(axis=0),
            *(np.abs(a - a.mean(axis=0)).max(axis=0) * len(a) / (len(a) - 1) for a in self.apart.values()),
        )

    def __call__(self, rows: np.ndarray, mesh: str) -> np.ndarray:
        """Logarithms (n, n_quantities) at materials (n, 3)."""
        force = self.force(rows)
        found = np.concatenate([force, force + self.others(rows)], axis=1)
        return found if mesh == "coarse" else found + self.apart[mesh].mean(axis=0)


# ------------------------------------------------------------------------------ cases


def case_of(emulated: Emulated, tools: dict[str, EmulatedTool], seed: int) -> Iterator[dict]:
    """Fit one experiment, and predict each tool: quantities on each mesh, truth, and the force of draws."""
    study = emulated.phantom.study
    (row,) = accepted(study, 1, np.random.default_rng([seed, 2]))
    (region,) = study.space.regions
    truth = Truth(
        title=f"{seed}",
        limbs={spot: f"{spot} true" for spot in SPOTS},
        materials={REGION: region.material},
        thetas=study.space.thetas(row),
        row=row,
    )
    found = assessed(study, truth, emulated, seed)
    box = found.end.problem.box
    best = box.values(found.end.best.point)
    draws = box.lower + (box.upper - box.lower) * found.density.draws(200)
    errors = np.random.default_rng([seed, 1]).normal(size=4)[3], np.random.default_rng([seed, 3]).normal()
    for name, tool in tools.items():
        bulk, friction = (np.log(1.0 + RELATIVE * each) for each in errors)
        true = tool(row[None], "true")[0] + bulk * tool.rates["bulk"] + friction * tool.rates["friction"]
        step = 1e-4 * np.abs(best)
        ahead, behind = (tool.force(best[None] + sign * np.diag(step))[:, 0] for sign in (1, -1))
        yield {
            "of": emulated.phantom.made_of,
            "seed": seed,
            "tool": name,
            "truth": row.tolist(),
            "fit": best.tolist(),
            **{mesh: tool(best[None], mesh)[0].tolist() for mesh in ("coarse", "fine")},
            "true": true.tolist(),
            "stiffer": (1.0 + (draws - best) @ ((ahead - behind) / (2.0 * step))).tolist(),
            "friction": tool.rates["friction"].tolist(),
        }


# ------------------------------------------------------------------------------ table

BANDS = {
    "draws alone": ("fine", False, False),
    "and friction": ("fine", True, False),
    "and mesh": ("fine", True, True),
    "as it is, friction and mesh": ("coarse", True, True),
}
"""Mesh of the prediction, and what each band has besides the draws: friction, and the error of the mesh."""


def mesh_sd(case: dict, k: int, refinement: float, mesh: str = "fine") -> float:
    """Relative standard deviation by the mesh, as palpate states it: the mesh as it is shows none."""
    value, coarser = (float(np.exp(case[each][k])) for each in ("fine", "coarse"))
    left_over = Refinement(ratio=refinement).left_over(FORCE.mesh)
    least = usual_error(FORCE.name, FORCE.mesh, BUDGET.mesh)
    return mesh_error(value, coarser if mesh == "fine" else None, left_over, least)


def held(case: dict, k: int, refinement: float, band: tuple[str, bool, bool]) -> bool:
    """Whether a band of a quantity holds the truth."""
    mesh, with_friction, has_mesh = band
    drawn = np.array(case["stiffer"])
    if with_friction:  # by the slope of the force, as the band of a prediction has it
        drawn = drawn + RELATIVE * case["friction"][0] * scores(drawn.size, 0)
    sd = mesh_sd(case, k, refinement, mesh) if has_mesh else 0.0
    low, high = ends(with_mesh(np.exp(case[mesh][k]) * drawn, sd))
    return bool(low <= np.exp(case["true"][k]) <= high)


def table(cases: Sequence[dict], refinement: dict[str, float]) -> None:
    """Errors of each tool and quantity on both meshes, the standard deviation by the mesh, and coverage."""
    errors_of = "median and 90th percentile of the error's size, %"
    heads = [f"as it is: {errors_of}", f"refined: {errors_of}", "median mesh's sd %", *BANDS]
    say(f"\n| tool | quantity | {' | '.join(heads)} |")
    say(f"|{'---|' * (2 + len(heads))}")
    for name in TOOLS:
        of_tool = [case for case in cases if case["tool"] == name]
        for k, quantity in enumerate(QUANTITIES):
            cells = []
            for mesh in ("coarse", "fine"):
                errors = 100.0 * np.expm1([case[mesh][k] - case["true"][k] for case in of_tool])
                cells.append(f"{np.median(errors):+.1f}, {np.quantile(np.abs(errors), 0.9):.1f}")
            cells.append(f"{100.0 * np.median([mesh_sd(c, k, refinement[name]) for c in of_tool]):.2g}")
            counts = [sum(held(c, k, refinement[name], band) for c in of_tool) for band in BANDS.values()]
            cells += [f"{count} of {len(of_tool)}" for count in counts]
            say(f"| {name} | {quantity} | {' | '.join(cells)} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="keeps what is simulated, and cases.jsonl")
    parser.add_argument("--n", type=int, default=40, help="experiments")
    chosen = parser.parse_args()
    phantom = Phantom(chosen.folder)
    say(f"nodes: { ({name: limb.mesh.n_nodes for name, limb in phantom.limbs.items()}) }")
    with phantom.simulations:
        emulated = Emulated(phantom)
        tools = {name: EmulatedTool(phantom, name) for name in TOOLS}
    for spot, channels in emulated.channels.items():
        for name, channel in channels.items():
            coarse, fine = channel.errors
            say(f"{spot} {name}: left out {coarse:.2%}, on the finer mesh {fine:.2%} of the peak")
    for name, tool in tools.items():
        of_coarse, *of_others = (" ".join(f"{e:.2%}" for e in each) for each in tool.errors)
        say(f"{name} ({', '.join(QUANTITIES)}): left out {of_coarse}; finer meshes {'; '.join(of_others)}")
    path = chosen.folder / "cases.jsonl"
    cases = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    cases = [case for case in cases if case.get("of") == phantom.made_of]
    known = {(case["seed"], case["tool"]) for case in cases}
    with path.open("a") as file:
        for seed in range(chosen.n):
            if all((seed, name) in known for name in TOOLS):
                continue
            for case in case_of(emulated, tools, seed):
                cases.append(case)
                file.write(json.dumps(case) + "\n")
                file.flush()
    shown = [case for case in cases if case["seed"] < chosen.n]
    table(shown, {name: phantom.refinement(name) for name in TOOLS})


if __name__ == "__main__":
    main()
