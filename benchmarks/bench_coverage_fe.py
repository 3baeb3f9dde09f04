"""Coverage by finite elements, and stated against true mesh errors: ``bench_coverage_fe.py FOLDER``.

Yeoh materials of the ranges of ``forearm-demo``, one of them at half the friction too, at its four spots,
each on two meshes: the demo's, and one of the exact surfaces that ``palpate limb`` makes with edges of half
the radius. palpate refines both to edges of ``--fine`` mm at the edge of the contact. The true curves are
those of a third mesh with edges of 1.0 mm, moved by the difference of the demo's converged data from that
mesh at the demo's material.

A world is a material, some spots on meshes of one kind, and errors drawn from the study's budget:
onset, gains, friction, bulk modulus, and noise of 0.5 % of the peak. ``--errors`` multiplies them, but for
the noise, and the difference of the true from the corrected curves, the error of mesh, contact and steps.
Around the true material curves are linear, with the exact slopes of the first mesh: a fit starts there, and
is palpate's own, with its intervals and its checks, but for the study's filter, which would only cut
intervals (and takes nine tenths of the time). No model error is drawn, although the budget states one.

Printed are the stated and the true error of each mesh; how often joint regions and intervals hold the truth,
how often a check fails (*flagged*), and which. Simulations take 35 minutes of processor time and are kept in
FOLDER: half a minute for each spot, mesh and material, and as much for each true curve. Worlds take 0.2 s
with one spot, 2.4 s with four.

    python benchmarks/bench_coverage_fe.py FOLDER --cases demo:base other:base --errors 1 2
"""

import argparse
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from bench_inadequate import NOISE, REGION, fitted, held, say
from bench_wrong import is_flagged
from independent_meshes import other_limb, true_limb
from scipy.interpolate import CubicSpline
from study_prediction import SPOTS, accepted, on_grid

from palpate import Curve, Job, Limb, Response, Simulation, Status
from palpate.answer.words import Adequacy
from palpate.domain import COMPLIANCE, DEEPER, Indentation
from palpate.experiment.measured import load_measured
from palpate.fit.spot_term import pieces
from palpate.limb.loading import finer_limb, load_limbs, refinement, size_at_contact
from palpate.plugins.catalogue import Plugins
from palpate.study.reading import Study, read_study
from palpate_certainty.assumptions import ASSUMED
from palpate_certainty.error_sources import MESH, error_budget, error_sources_of
from palpate_certainty.held_out import held_out, is_apart
from palpate_certainty.mesh_error import N_SCATTER, SpotMesh
from palpate_certainty.tables import Assessed
from palpate_limb.limb_files import write_limb

MESHES = ("demo", "other")
TRUE_MM = {"true": 1.0, "finer": 0.7}
"""Edges of the meshes of the truth at the edge of the contact, in mm."""
CONVERGED = {"depth_steps": 20, "rotation_step_deg": 2.25}
"""Load steps of the truth."""
HALF = 0.5
"""Friction of the last material."""
READ = 15
"""Points between two equilibrium states, on cubics, by which a simulated curve is read."""
MOST_POINTS = 100
"""More than a measured curve has."""
HALVES = {"p1, p3": ("p1", "p3"), "p2, p4": ("p2", "p4")}
"""Spots at which orders and scatter were chosen, and the others."""
WIDE = 0.8
"""Width of an interval over the range beyond which it holds a truth of the range by construction."""


class Forearm:
    """Simulations of the demo's forearm, each kept in a folder."""

    def __init__(self, folder: Path, fine_mm: float) -> None:
        plugins = Plugins.load()
        study = read_study(Path(plugins.studies["forearm-demo"].directory) / "study.toml", plugins)
        main = tuple(each for each in study.scenarios if each.name == study.generalise_by)
        spots = tuple(replace(each, fine_edge_mm=fine_mm) for each in study.spots)
        self.study = replace(study, scenarios=main, spots=spots, filters=())
        self.fine = f"fine {fine_mm:g} mm"
        self.folder = folder
        self.converged = load_measured(study, study.channels)
        true = np.array([study.truth[name] for name in study.space.names])
        rows = accepted(study, 5, np.random.default_rng(7))
        self.rows = {"base": true, **{f"y{k}": row for k, row in enumerate(rows)}, "half": true}
        self.friction = {name: HALF if name == "half" else 1.0 for name in self.rows}
        self._limbs: dict[str, Limb] = {}
        self._presses: dict[tuple[str, ...], Press] = {}
        folder.mkdir(parents=True, exist_ok=True)

    def limb(self, spot: str, mesh: str) -> Limb:
        """Mesh of a spot: ``demo``, ``other``, either with ``/fine`` as palpate refines it, or a true one."""
        if (name := f"{spot} {mesh}") not in self._limbs:
            of = next(each for each in self.study.spots if each.spot.name == spot)
            if mesh.endswith("/fine"):
                coarse = self.limb(spot, mesh.removesuffix("/fine"))
                limb = finer_limb(self.study, of, {spot: coarse})
                assert limb is not None
                self._limbs[name] = limb
            elif mesh == "demo":
                self._limbs |= {f"{key} demo": limb for key, limb in load_limbs(self.study).items()}
            else:
                file = self.folder / f"{name}.vtu"
                if not file.is_file():  # the mesher makes another mesh each time
                    made = true_limb(spot, TRUE_MM[mesh]) if mesh in TRUE_MM else other_limb(spot)
                    write_limb(file, made)
                assert self.study.limb_source is not None
                self._limbs[name] = self.study.limb_source.load(file, of.spot)
        return self._limbs[name]

    def spot_mesh(self, spot: str, mesh: str) -> SpotMesh:
        """Mesh of a fit as far as its error goes."""
        coarse, fine = self.limb(spot, mesh), self.limb(spot, f"{mesh}/fine")
        one = replace(self.study, spots=tuple(s for s in self.study.spots if s.spot.name == spot))
        (between,) = refinement(one, {spot: coarse, f"{spot}/fine": fine}).values()
        radius_mm = self.protocol(spot, "base").indenter.radius_mm
        return SpotMesh(edge_over_radius=size_at_contact(self.study, coarse) / radius_mm, refinement=between)

    def protocol(self, spot: str, material: str) -> Indentation:
        """Press and twist of a spot."""
        protocol = self.study.protocol_at(spot)
        assert isinstance(protocol, Indentation)
        return replace(protocol, friction=self.friction[material])

    def curves(self, spot: str, mesh: str, material: str) -> Response:
        """Curves of a material on a mesh, with slopes on both meshes of a fit; kept in the folder."""
        file = self.folder / f"{spot} {mesh.replace('/fine', f' {self.fine}')} {material}.npz"
        if not file.is_file():
            (region,) = self.study.space.regions
            job = Job(
                spot=spot,
                set_id=-1,
                materials={REGION: region.material},
                thetas={REGION: self.study.space.thetas(self.rows[material])[REGION]},
                protocol=self.protocol(spot, material),
                slopes=mesh not in TRUE_MM,
            )
            solver, settings = self.study.solver, {"warm_starts": False}
            settings |= CONVERGED if mesh in TRUE_MM else {}
            solver = type(solver)(solver.settings.model_copy(update=settings))
            made = solver.simulate(
                job.on_finer_mesh() if mesh.endswith("/fine") else job, self.limb(spot, mesh)
            )
            if made.status is not Status.OK or made.response is None:
                raise SystemExit(f"{file.stem}: {made.message}")
            say(f"{file.stem}: simulated")
            parts = {
                f"{name}/{key}": values
                for name, curve in made.response.curves.items()
                for key, values in {"x": curve.abscissa, "y": curve.ordinate, **curve.slopes}.items()
            }
            np.savez_compressed(file, **parts)
        with np.load(file) as kept:
            parts = {tuple(key.split("/")): kept[key] for key in kept.files}
        curves = {}
        for channel in dict.fromkeys(name for name, _ in parts):
            of = {key: values for (name, key), values in parts.items() if name == channel}
            x, y = of.pop("x"), of.pop("y")
            curves[channel] = Curve(channel=channel, abscissa=x, ordinate=y, slopes=of)
        return Response(curves=curves)

    def of(self, material: str, spots: Sequence[str]) -> Study:
        """The study of some spots, with the friction of a material."""
        kept = tuple(each for each in self.study.spots if each.spot.name in spots)
        return replace(self.study, spots=kept, protocol=self.protocol(spots[0], material))

    def press(self, *case: str) -> "Press":
        """Curves of a spot on a mesh at a material."""
        if case not in self._presses:
            self._presses[case] = Press(self, *case)
        return self._presses[case]


class Press:
    """One spot on one mesh: its curves, and the truth at the measured points, around a material."""

    def __init__(self, forearm: Forearm, spot: str, mesh: str, material: str) -> None:
        self.spot = spot
        self.mesh, self.row = forearm.spot_mesh(spot, mesh), forearm.rows[material]
        self.protocol = forearm.protocol(spot, material)
        self.bulk = float(forearm.study.space.thetas(self.row)[REGION][-1])
        self.coarse, self.fine = (forearm.curves(spot, each, material) for each in (mesh, f"{mesh}/fine"))
        left_over = forearm.study.left_over(self.mesh.refinement)
        true, at_base = (forearm.curves(spot, "true", each) for each in (material, "base"))
        self.true, self.corrected = {}, {}
        for name, data in forearm.converged[spot].curves.items():
            x, peak = data.abscissa, np.abs(data.ordinate).max()
            y, base, coarse, fine = (read(of, name, x) for of in (true, at_base, self.coarse, self.fine))
            self.true[name] = replace(data, ordinate=y + np.abs(y).max() / peak * (data.ordinate - base))
            self.corrected[name] = fine + left_over[name] * (fine - coarse) + rigid(self.fine, name, x)

    def response(self, job: Job) -> Response:
        """Curves of a job, on the first mesh with slopes, or on the finer one."""
        theta, protocol, curves = job.thetas[REGION], job.protocol, {}
        assert isinstance(protocol, Indentation)
        by_mm = float(protocol.path[:, 0].max() - self.protocol.path[:, 0].max())
        changes = [
            *(theta[:-1] - self.row),
            theta[-1] - self.bulk,
            protocol.friction - self.protocol.friction,
            protocol.contact_compliance - self.protocol.contact_compliance,
            by_mm,
        ]
        for name, curve in (self.fine if job.mesh else self.coarse).curves.items():
            slopes = np.stack(list(curve.slopes.values()))
            longer = 1.0 + by_mm / curve.abscissa[-1] if name == "force" and not job.mesh else 1.0
            ordinate = curve.ordinate + np.array(changes)[: len(slopes)] @ slopes
            curves[name] = replace(curve, abscissa=longer * curve.abscissa, ordinate=ordinate)
        return Response(curves=curves)

    def measured(self, errors: Mapping[tuple[str, str], float], times: float, noise: np.ndarray) -> Response:
        """Measured curves with errors by cause, and the error of the mesh ``times`` as large as it is."""
        curves, onset_mm = {}, errors["onset", self.spot]
        for (name, true), white in zip(self.true.items(), noise, strict=True):
            x, own = true.abscissa, self.coarse[name].densified(READ)
            bulk, friction = (
                on_grid(replace(own, ordinate=own.slopes[key]), x) for key in (f"{REGION}.kappa", "friction")
            )
            y = self.corrected[name] + times * (true.ordinate - self.corrected[name])
            y = y + self.bulk * errors["fixed", f"{REGION}.kappa"] * bulk + errors["friction", ""] * friction
            if name == "force":
                y = CubicSpline(x, y)(x + onset_mm)
            else:
                deeper = self.coarse[name].slopes[DEEPER]
                deeper = replace(self.coarse[name], ordinate=deeper, slopes={})
                y = y + onset_mm * on_grid(deeper.densified(READ), x)
            y = (1.0 + errors["gain", name]) * y + NOISE * np.abs(y).max() * white[: y.size]
            curves[name] = replace(true, ordinate=y).cut(slice(1, None))
        return Response(curves=curves)


def read(response: Response, channel: str, x: np.ndarray) -> np.ndarray:
    """Ordinates of a simulated curve at measured points, as palpate reads it."""
    return on_grid(response[channel].densified(READ), x)


def rigid(response: Response, channel: str, x: np.ndarray) -> np.ndarray:
    """Change of a simulated curve at measured points by a rigid contact, to first order."""
    curve = response[channel]
    by_contact = replace(curve, ordinate=-curve.slopes[COMPLIANCE], slopes={})
    return on_grid(by_contact.densified(READ), x)


class Emulated:
    """Answers jobs as ``Simulations`` does, by the presses of a world."""

    def __init__(self, presses: Mapping[str, Press]) -> None:
        self.presses, self.known = presses, {}
        self.limbs = dict.fromkeys([*presses, *(f"{spot}/fine" for spot in presses)])

    def of(self, jobs: Sequence[Job]) -> list[Simulation]:
        """Simulations of jobs, in their order."""
        found = [self.presses[job.spot].response(job) for job in jobs]
        return [
            Simulation(job=job, status=Status.OK, response=each)
            for job, each in zip(jobs, found, strict=True)
        ]


def assessed(
    forearm: Forearm, material: str, meshes: Mapping[str, str], seed: int, times: float
) -> tuple[Study, Assessed]:
    """Measure the spots of a world, fit, and assess the fit."""
    rng = np.random.default_rng([seed, 5])
    presses = {spot: forearm.press(spot, mesh, material) for spot, mesh in meshes.items()}
    study = forearm.of(material, list(meshes))
    clean = {spot: forearm.converged[spot] for spot in meshes}
    errors = {
        (each.kind, each.of): times * each.sd * rng.normal()
        for each in error_sources_of(study, clean, study.space.names)
    }
    measured = {
        spot: press.measured(errors, times, rng.normal(size=(2, MOST_POINTS)))
        for spot, press in presses.items()
    }
    start = dict(zip(study.space.names, forearm.rows[material].tolist(), strict=True))
    of_spots = {spot: press.mesh for spot, press in presses.items()}
    return study, fitted(study, measured, Emulated(presses), of_spots, start)


def world(forearm: Forearm, material: str, meshes: Mapping[str, str], seed: int, times: float) -> dict:
    """One world: which intervals hold the truth, which are wide, and which checks fail."""
    _, found = assessed(forearm, material, meshes, seed, times)
    low, high = found.density.interval(found.point)
    result = {
        "holds": held(forearm.rows[material], found),
        "wide": np.append(high - low > WIDE, False),
        "failed": [check.name for check in found.checks if check.verdict is not Adequacy.DESCRIBES],
        "apart": is_apart(held_out(found)),
    }
    return result | {"flagged": is_flagged(result, len(meshes))}


def row_of(title: str, found: Sequence[dict]) -> str:
    """One line of the table."""
    held_by, wide = (np.array([each[key] for each in found]) for key in ("holds", "wide"))
    cells = []
    for k in range(wide.shape[1]):
        at = ~wide[:, k]
        cells.append(f"{100.0 * held_by[at, k].mean():.0f} of {at.sum()}" if at.any() else "wide")
    flagged = np.array([each["flagged"] for each in found])
    either = flagged | (held_by[:, -1] == 1)
    counts = Counter(name for each in found for name in dict.fromkeys(each["failed"]))
    counts["held out"] = sum(each["apart"] for each in found)
    checks = ", ".join(f"{name} {count}" for name, count in counts.items() if count) or "–"
    ends = [f"{100.0 * flagged.mean():.0f}", f"{100.0 * either.mean():.0f}", checks]
    return f"| {' | '.join([title, str(len(found)), *cells, *ends])} |"


@dataclass(frozen=True, kw_only=True)
class MeshError:
    """Error of a corrected curve by the mesh, against a rigid contact; relative to the curve.

    Parameters
    ----------
    share, stated_share : float
        In proportion to the curve, and one standard deviation of that as the budget states it.
    norm, stated_norm : float
        Of the whole error, and of one standard deviation.
    waves : (n,) array
        Of the scatter, as the budget has them: each over the stated one.
    amplitude : float
        Of the extrapolation's error, over its change of the finer mesh's curve.
    varying : float
        Error of the first mesh's curve that is not in its proportion, over the part that is.
    """

    share: float
    stated_share: float
    norm: float
    stated_norm: float
    waves: np.ndarray
    amplitude: float
    varying: float


def mesh_errors(forearm: Forearm, spot: str, mesh: str, material: str) -> dict[str, MeshError]:
    """Errors of the curves of a press by channel."""
    press = forearm.press(spot, mesh, material)
    study, found = assessed(forearm, material, {spot: mesh}, 0, 0.0)
    terms, residuals = found.end.problem.terms, found.end.at_end().residuals
    clean = {spot: forearm.converged[spot]}
    known = error_budget(study, clean, terms, residuals, {}, {spot: press.mesh})[MESH]
    rows = {}
    for term, name, at, scale in pieces(terms):
        true, inside = press.true[name], term.counted(name)
        coarse = read(press.coarse, name, true.abscissa) + rigid(press.coarse, name, true.abscissa)
        errors = press.corrected[name] - true.ordinate, coarse - true.ordinate
        y, error, of_one = ((scale * each[1:])[inside] for each in (true.ordinate, *errors))
        columns = {key: each[at] for key, each in known.items()}
        every, size = np.stack(list(columns.values()), axis=1), np.linalg.norm(y)
        whole = columns.pop("extrapolation") / ASSUMED.extrapolation
        waves = np.stack([columns[f"{name} {k}"] for k in range(N_SCATTER)], axis=1)
        found_waves = np.linalg.lstsq(waves / np.sqrt(ASSUMED.mesh_shared), error, rcond=None)[0]
        share = of_one @ y / size**2
        rows[name] = MeshError(
            share=float(error @ y / size**2),
            stated_share=float(np.linalg.norm(y @ every) / size**2),
            norm=float(np.linalg.norm(error) / size),
            stated_norm=float(np.linalg.norm(every) / size),
            waves=found_waves,
            amplitude=float(error @ whole / (whole @ whole)),
            varying=float(np.linalg.norm(of_one - share * y) / size / abs(share)),
        )
    return rows


def print_mesh_errors(forearm: Forearm, cases: Sequence[tuple[str, str, str]]) -> None:
    """Print a row for each curve, how often the true error is within twice the stated one, and what the
    errors say of the budget's assumptions."""
    say("| spot, mesh, material | channel | error % | stated sd | over sd | norm % | stated | over |")
    say(f"|{'---|' * 8}")
    found: dict[str, list[MeshError]] = {}
    for case in cases:
        for name, row in mesh_errors(forearm, *case).items():
            found.setdefault(name, []).append(row)
            sizes = [f"{100.0 * row.share:+.2f}", f"{100.0 * row.stated_share:.2f}"]
            sizes += [f"{row.share / row.stated_share:+.1f}", f"{100.0 * row.norm:.2f}"]
            sizes += [f"{100.0 * row.stated_norm:.2f}", f"{row.norm / row.stated_norm:.1f}"]
            say(f"| {', '.join(case)} | {name} | {' | '.join(sizes)} |")
    for channel, rows in found.items():
        shares = np.array([each.share / each.stated_share for each in rows])
        norms = np.array([each.norm / each.stated_norm for each in rows])
        say(
            f"{channel}: of {shares.size} {(np.abs(shares) <= 2.0).sum()} within twice the stated in "
            f"proportion ({(shares > 0.0).sum()} too large), {(norms <= 2.0).sum()} as a whole; root "
            f"mean squares {rms(shares):.2f} and {rms(norms):.2f}"
        )
        of_mesh: dict[tuple[str, ...], list[np.ndarray]] = {}
        for case, each in zip(cases, rows, strict=True):
            of_mesh.setdefault(case[:2], []).append(each.waves)
        means, n = np.array([np.mean(each, axis=0) for each in of_mesh.values()]), len(of_mesh)
        common = (np.sum(means.sum(axis=0) ** 2) - np.sum(means**2)) / max(n - 1, 1) / np.sum(means**2)
        say(
            f"{channel}: scatter over the stated {rms(np.array([e.waves for e in rows])):.2f}, common to "
            f"{n} meshes {100.0 * common:.0f} % of its variance; amplitude of the extrapolation "
            f"{rms(np.array([e.amplitude for e in rows])):.2f}; error of one mesh along the path over that "
            f"in proportion {np.median([e.varying for e in rows]):.2f}"
        )


def rms(values: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def spots_of(seed: int) -> list[str]:
    """Spots of a world: one or two of them, and all in every tenth."""
    n = len(SPOTS) if seed % 10 == 9 else 1 + seed % 2
    return sorted(np.random.default_rng([seed, 7]).choice(SPOTS, n, replace=False).tolist())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="keeps what is simulated")
    parser.add_argument("--fine", type=float, default=1.8, help="longest edges of the finer meshes, in mm")
    parser.add_argument(
        "--n", type=int, default=20, help="worlds of each mesh, material and size of the errors"
    )
    parser.add_argument("--errors", type=float, nargs="*", default=[1.0, 2.0], help="over the budget's")
    parser.add_argument("--cases", nargs="*", help="meshes and materials such as demo:base; default: all")
    chosen = parser.parse_args()
    forearm = Forearm(chosen.folder, chosen.fine)
    every = [f"{mesh}:{material}" for material in forearm.rows for mesh in MESHES]
    cases = [tuple(each.split(":")) for each in chosen.cases or every]
    for title, half in HALVES.items():
        say(f"\nMesh errors at {title}")
        print_mesh_errors(forearm, [(spot, *case) for case in cases for spot in half])
    heads = [*forearm.study.space.names, "joint region", "flagged", "holds or flagged"]
    say(f"\n| spots, errors over the budget's | worlds | {' | '.join(heads)} | checks |\n|{'---|' * 9}")
    for times in chosen.errors:
        found = [
            (spots, world(forearm, material, dict.fromkeys(spots, mesh), seed, times))
            for k, (mesh, material) in enumerate(cases)
            for seed in range(k * chosen.n, (k + 1) * chosen.n)
            for spots in [spots_of(seed)]
        ]
        for title, half in {**HALVES, "all": SPOTS}.items():
            say(row_of(f"{title}, {times:g}", [each for spots, each in found if {*spots} <= {*half}]))


if __name__ == "__main__":
    main()
