"""What relaxation does to 95 % intervals that do not know of it, and to those that do, in closed form.

Experiments of ``bench_coverage.py`` with Yeoh's material, whose curves relax by 10 % with a time constant
of 1 s: pressed, rested for 1 s, twisted. Prints how often the intervals and the joint region hold the
parameters of a fast press (instantaneous) and those of a slow one (long-term, 0.9 times as large). With
``--modelled`` the force in a rest of 60 s is a curve too, and the fit searches the shares: of a tissue that
relaxes by 10 % with 0.3, 3 and 30 s together, with 1 s where that alone is named, or with 1 s where the
decades from 0.1 to 100 s are.

    python benchmarks/study_relaxation.py --modelled together one decades --n 100

``--twist`` compares the convolution of an elastic curve with tissue that relaxes in the solver: the torque of
a punch that sticks to a block, without a press and after a press that is held.
"""

import argparse
import contextlib
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from bench_coverage import NOISE, Layered, experiment, measured_at, study_of

from palpate import Material, PalpateError, Sphere, Status
from palpate.api import relaxing
from palpate.domain import Curve, FloatArray, Indentation, Job, Limb, Response, Scenario, Simulation
from palpate.mesh.specimens import block
from palpate.study.reading import Study
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_materials import NeoHookean, Yeoh
from palpate_materials.relaxation import (
    FORCE_OVER_TIME,
    TORQUE_OVER_TIME,
    Relaxing,
    RelaxingSettings,
    relaxed as convolved,
)

SHARE, TAU_S, REST_S = 0.1, 1.0, 1.0
PRESS_S, TWIST_S = 5.0, 24.0
"""Durations where relaxation is modelled."""
N_STEPS = 8000
ONE = {TAU_S: SHARE}
"""Shares of the moduli by time constant [s]."""
MODELLED = {
    "together": {0.3: 0.03, 3.0: 0.04, 30.0: 0.03},
    "one": ONE,
    "decades": {0.1: 0.0, 1.0: SHARE, 10.0: 0.0, 100.0: 0.0},
}
"""The same of tissues whose relaxation is modelled, with all times that the fit has."""

CASES = {
    "all values fall with time; press 1 s, twist 3 s": (True, 1.0, 3.0),
    "each increment relaxes; press 1 s, twist 3 s": (False, 1.0, 3.0),
    "each increment relaxes; press 5 s, twist 24 s": (False, 5.0, 24.0),
    "each increment relaxes; press 20 s, twist 96 s": (False, 20.0, 96.0),
}
"""Whether relaxation starts at first contact for all, and durations of press and twist [s]."""


def relaxed(
    time_s: FloatArray, values: FloatArray, *, by_time: bool, shares: Mapping[float, float] = ONE
) -> FloatArray:
    """Values (n,) of a tissue that relaxes, of the elastic ones at increasing times (n,)."""
    if by_time:
        found: FloatArray = values * (1.0 - SHARE * (1.0 - np.exp(-time_s / TAU_S)))
        return found
    fine = np.linspace(time_s[0], time_s[-1], N_STEPS)
    elastic = np.interp(fine, time_s, values)
    total = elastic.copy()
    for tau_s, share in shares.items():
        step = float(np.exp(-(fine[1] - fine[0]) / tau_s))
        left, young = 0.0, np.empty_like(elastic)
        for row, change in enumerate(np.diff(elastic, prepend=elastic[0])):
            left = young[row] = step * left + np.sqrt(step) * change
        total += share * (young - elastic)
    return np.interp(time_s, fine, total)


def travelled(curve: Curve) -> FloatArray:
    """Share (n,) of the path of a curve that lies behind each of its points."""
    path = np.cumsum(np.abs(np.diff(curve.abscissa, prepend=curve.abscissa[0])))
    return path / path[-1]


def measured(
    study: Study,
    row: FloatArray,
    rng: np.random.Generator,
    *,
    by_time: bool,
    press_s: float,
    twist_s: float,
    is_long_term: bool,
    shares: Mapping[float, float] = ONE,
    **where: object,
) -> Response:
    """Curves of a tissue that relaxes; ``is_long_term`` has it end at the parameters, else begin there."""
    elastic = measured_at(study, row, rng, **where)
    force, torque = elastic["force"], elastic["torque"]
    # Values that all fall with time do so during the motion alone.
    twist_from_s = press_s + (0.0 if by_time else REST_S)
    times = {
        "force": press_s * force.abscissa / force.abscissa.max(),
        "torque": twist_from_s + twist_s * travelled(torque),
    }
    scale = 1.0 / (1.0 - SHARE) if is_long_term else 1.0
    return Response(
        curves={
            name: replace(
                curve, ordinate=scale * relaxed(times[name], curve.ordinate, by_time=by_time, shares=shares)
            )
            for name, curve in elastic.curves.items()
        }
    )


LONG_REST_S = 60.0
HELD_S = np.geomspace(0.01, LONG_REST_S, 40)
"""Times of the force in the rest, since its beginning."""


class Timed(Layered):
    """The same with times, and the force in the rest."""

    name = "timed"

    def simulate(self, job: Job, limb: Limb | None) -> Simulation:
        """Simulate one job."""
        found = super().simulate(job, limb)
        force, torque = found.response["force"], found.response["torque"]
        _, press_s, twist_s = job.protocol.time_s[[0, 1, -1]]
        times = press_s * force.abscissa / force.abscissa.max()
        held = np.append(times, press_s + LONG_REST_S)
        over_time = Curve(
            channel=FORCE_OVER_TIME.name,
            abscissa=held,
            ordinate=np.append(force.ordinate, force.ordinate[-1]),
            slopes={name: np.append(slope, slope[-1]) for name, slope in force.slopes.items()},
            time_s=held,
        )
        curves = {
            "force": replace(force, time_s=times),
            "torque": replace(torque, time_s=press_s + (twist_s - press_s) * travelled(torque)),
            FORCE_OVER_TIME.name: over_time,
        }
        return replace(found, response=Response(curves=curves))


def with_rest(
    study: Study, row: FloatArray, rng: np.random.Generator, *, shares: Mapping[float, float], **motion: float
) -> Response:
    """Curves of a tissue that relaxes from the parameters on, with its force in a long rest."""
    found = measured(study, row, rng, by_time=False, is_long_term=False, shares=shares, **motion)
    force, press_s = found["force"], motion["press_s"]
    # Elastic force of the press, without an error of its own, to relax on from its last point.
    pressing = np.linspace(0.0, 1.0, N_STEPS // 8)
    elastic = pressed_force(study, row, pressing * force.abscissa.max())
    time = np.concatenate([press_s * pressing, press_s + HELD_S])
    left = relaxed(time, np.append(elastic, np.full(HELD_S.size, elastic[-1])), by_time=False, shares=shares)
    scale = force.ordinate[-1] / left[pressing.size - 1]
    noise = NOISE * force.ordinate.max() * rng.normal(size=HELD_S.size)
    held = Curve(
        channel=FORCE_OVER_TIME.name,
        abscissa=press_s + HELD_S,
        ordinate=scale * left[pressing.size :] + noise,
    )
    return replace(found, curves={**found.curves, held.channel: held})


def pressed_force(study: Study, row: FloatArray, depth_mm: FloatArray) -> FloatArray:
    """Elastic force (n,) at depths (n,)."""
    materials = {region.region: region.material for region in study.space.regions}
    job = Job(
        spot="p1", set_id=0, materials=materials, thetas=study.space.thetas(row), protocol=study.protocol
    )
    force = Layered().simulate(job, None).response["force"]
    return np.interp(depth_mm, force.abscissa, force.ordinate)


def modelled(seed: int, press_s: float, twist_s: float, shares: Mapping[float, float]) -> dict:
    """One experiment whose fit searches the relaxation."""
    law = Relaxing(RelaxingSettings.model_validate({"relaxation_times": [f"{time} s" for time in shares]}))
    base = study_of("yeoh", Layered())
    turned = press_s + REST_S + twist_s * np.array([0.0, 0.25, 0.75, 1.0])
    protocol = replace(base.protocol, time_s=np.array([0.0, press_s, *turned[1:]]))
    weights = {"force": 1.0, "torque": 1.0, FORCE_OVER_TIME.name: 1.0}
    return experiment(
        "yeoh",
        seed,
        measure=partial(with_rest, press_s=press_s, twist_s=twist_s, shares=shares),
        solver=Timed,
        also=dict(zip(law.times_s, shares.values(), strict=True)),
        protocol=protocol,
        parametrisation=law,
        scenarios=(Scenario(name="I", weights=weights),),
    )


def of_elastic_fits(n: int) -> None:
    """Print a row for each case and kind of parameters, of fits that know of no relaxation."""
    for what, (by_time, press_s, twist_s) in CASES.items():
        for is_long_term in (False, True):
            motion = {"by_time": by_time, "press_s": press_s, "twist_s": twist_s}
            measure = partial(measured, **motion, is_long_term=is_long_term)
            found = []
            for seed in range(n):
                with contextlib.suppress(PalpateError):  # refused an interval: the filters reject the fit
                    found.append(experiment("yeoh", seed, measure=measure))
            of = "long-term" if is_long_term else "instantaneous"
            failed = sum(bool(one["failed"]) for one in found)
            tell(f"{what}: {of}", found, f"; {failed} of {n} inadequate, {n - len(found)} refused")


def of_relaxing_fits(n: int, kinds: Sequence[str]) -> None:
    """Print a row for each kind of tissue, of fits that search the relaxation."""
    for kind in kinds:
        found = [modelled(seed, PRESS_S, TWIST_S, MODELLED[kind]) for seed in range(n)]
        tell(f"{kind}: instantaneous moduli and shares", found)


PUNCH_MM, DEPTH_MM = 5.0, 3.0
"""Radius of the punch that sticks, and its press."""
TWIST_REST_S = 4.0
"""Rest after a twist of 1 s."""
TWIST_SHARES = {0.5: 0.25 / 1.4, 5.0: 0.15 / 1.4}
"""Of the stress at once, by time constant: those of FEBio's recorded curves."""
TISSUES: Mapping[str, tuple[Material, tuple[float, ...], bool]] = {
    "neo-Hookean, all": (NeoHookean(), (0.103, 0.4434), False),
    "Yeoh, isochoric": (Yeoh(), (0.0181, -1.4e-3, 1.3e-4, 0.6), True),
}


def of_twists(n_across: int = 12) -> None:
    """Print a row for each tissue, press and twist: largest difference of the torque over its peak."""
    limb = block(n_across=n_across, n_down=n_across // 2, grading=1.3)
    points = limb.mesh.points_mm
    stuck = (np.hypot(points[:, 0], points[:, 1]) <= PUNCH_MM + 1e-9) & (points[:, 2] == 0.0)
    sets = {**limb.mesh.node_sets, "bonded": np.flatnonzero(stuck)}
    limb = replace(limb, mesh=replace(limb.mesh, node_sets=sets))
    times_s, shares = (np.array(list(each)) for each in (TWIST_SHARES, TWIST_SHARES.values()))
    for name, (elastic, at_once, isochoric) in TISSUES.items():
        tissue = relaxing(elastic, tuple(TWIST_SHARES), isochoric)
        theta = np.array([*at_once, *shares])
        for depth_mm in (0.0, DEPTH_MM):
            for twist_deg in (5.0, 20.0):
                found = _torque(limb, tissue, theta, depth_mm, twist_deg, isochoric)
                plain = _torque(limb, elastic, np.array(at_once), depth_mm, twist_deg, isochoric)
                straight = np.interp(found.abscissa, plain.abscissa, plain.ordinate)
                off = found.ordinate - convolved(found.abscissa, straight, times_s, shares)
                peak, end_s = np.abs(found.ordinate).max(), float(found.abscissa[-1])
                turned = found.abscissa <= end_s - TWIST_REST_S + 1e-9
                rows = (np.abs(off[turned]).max() / peak, np.abs(off[-1]) / peak)
                sys.stdout.write(
                    f"{name}: press of {depth_mm:g} mm, twist of {twist_deg:g} degrees: "
                    f"{100.0 * rows[0]:.2f} % in the twist, {100.0 * rows[1]:.2f} % at the end of the rest\n"
                )
                sys.stdout.flush()


def _torque(
    limb: Limb, material: Material, theta: FloatArray, depth_mm: float, twist_deg: float, isochoric: bool
) -> Curve:
    """Torque over time of a twist, after a press of 1 s and a rest of 4 s if there is a depth."""
    press = [(depth_mm, 0.0, 1.0), (depth_mm, 0.0, 4.0)] if depth_mm else []
    moves = [*press, (depth_mm, -twist_deg, 1.0), (depth_mm, -twist_deg, TWIST_REST_S)]
    (region,) = limb.mesh.regions
    job = Job(
        spot="block",
        set_id=0,
        materials={region: material},
        thetas={region: theta},
        protocol=Indentation(
            indenter=Sphere(radius_mm=7.5),
            path=np.array([(0.0, 0.0), *(move[:2] for move in moves)]),
            friction=0.0,
            time_s=np.cumsum([0.0, *(move[2] for move in moves)]),
        ),
        channels=(TORQUE_OVER_TIME,),
    )
    solver = JaxSolver(JaxSettings(depth_steps=10, rotation_step_deg=1.0, mean_dilatation=isochoric))
    simulation = solver.simulate(job, limb)
    assert simulation.status is Status.OK, simulation.message
    return simulation.response[TORQUE_OVER_TIME.name]


def tell(what: str, found: list[dict], more: str = "") -> None:
    """Print how often the intervals of experiments hold the parameters."""
    if not found:
        sys.stdout.write(f"{what} no interval{more}\n")
        return
    *each, joint = 100.0 * np.nanmean([one["all"] for one in found], axis=0)
    held = ", ".join(f"{share:.0f}" for share in each)
    sys.stdout.write(f"{what} {held} %, joint {joint:.0f} %{more}\n")
    sys.stdout.flush()


def main() -> None:
    """Print a row for each case."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=40, help="experiments of each case")
    parser.add_argument("--modelled", nargs="*", choices=MODELLED, help="of fits that search the relaxation")
    parser.add_argument("--twist", action="store_true", help="of twists in the solver and by convolution")
    given = parser.parse_args()
    if given.twist:
        of_twists()
        return
    if given.modelled is None:
        of_elastic_fits(given.n)
    else:
        of_relaxing_fits(given.n, given.modelled or list(MODELLED))


if __name__ == "__main__":
    main()
