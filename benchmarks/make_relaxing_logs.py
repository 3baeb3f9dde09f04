"""The logs of the study ``forearm-relaxing``: ``make_relaxing_logs.py``.

The tissue under ``[truth]`` relaxes in the solver, on meshes that are finer than those of the study and
made independently of it, with half its steps. ``simulated_robot.py`` makes logs of it, which replace
those of the study. About 6 minutes.
"""

import argparse
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import polars as pl
from independent_meshes import true_limb
from scipy.interpolate import PchipInterpolator
from simulated_robot import CLEARANCE_MM, RATE_HZ, write_rows

from palpate import Job, Limb, Plugins, Status
from palpate.domain import FloatArray, Indentation
from palpate.study.reading import Study, read_study
from palpate_materials.relaxation import FORCE_OVER_TIME, TORQUE_OVER_TIME

NAME = "forearm-relaxing"
SEEDS = {"p1": 1, "p2": 2}
"""Of bias, drift, noise and place of the robot."""
REST_S, AIR_S = 0.5, 0.5
"""Rest after the twist, and in free air before and after the press."""
SPLITS_S = np.geomspace(0.05, 30.0, 21)
"""Moves that a rest is made of, so that the truth has more steps there."""


def whole(protocol: Indentation) -> Indentation:
    """The motion with a rest and the way back, whose rests are made of several moves."""
    path, time = protocol.path, protocol.time_s
    assert time is not None
    poses, times = [path[:1]], [time[:1]]
    for k in range(1, len(path)):
        at = np.array([time[k]])
        if (path[k] == path[k - 1]).all():
            at = np.append(time[k - 1] + SPLITS_S[time[k] - time[k - 1] - 1e-9 > SPLITS_S], time[k])
        poses.append(np.repeat(path[k : k + 1], at.size, axis=0))
        times.append(at)
    end, press_s = path[-1], time[1]
    back = end.copy()
    back[0] = 0.0
    return replace(
        protocol,
        path=np.vstack([*poses, end, back]),
        time_s=np.concatenate([*times, [time[-1] + REST_S, time[-1] + REST_S + press_s]]),
    )


def simulated(study: Study, spot: str, limb: Limb) -> tuple[Indentation, FloatArray]:
    """The whole motion, and time [s], force [N] and torque [N·mm] (3, n) of its states."""
    (region,) = study.space.regions
    row = np.array([study.truth[p.name] for p in study.space.parameters])
    protocol = whole(study.protocol_at(spot))
    settings = study.solver.settings.model_copy(update={"depth_steps": 20, "rotation_step_deg": 2.25})
    job = Job(
        spot=spot,
        set_id=0,
        materials={region.region: region.material},
        thetas=study.space.thetas(row),
        protocol=protocol,
        channels=(FORCE_OVER_TIME, TORQUE_OVER_TIME),
    )
    found = type(study.solver)(settings).simulate(job, limb)
    assert found.status is Status.OK, found.message
    force, torque = (found.response[channel.name] for channel in job.channels)
    return protocol, np.stack([force.abscissa, force.ordinate, torque.ordinate])


def log_of(path: Path, protocol: Indentation, states: FloatArray, seed: int) -> None:
    """Log free air, the motion, and free air again, in single precision."""
    time_s, way = protocol.time_s, protocol.path
    assert time_s is not None
    speed_mm_s = way[1, 0] / time_s[1]
    above_s = CLEARANCE_MM / speed_mm_s
    at = np.arange(round((2.0 * (above_s + AIR_S) + time_s[-1]) * RATE_HZ)) / RATE_HZ - above_s - AIR_S
    off = np.array([-CLEARANCE_MM, 0.0])
    ends = np.concatenate([[-above_s], time_s, [time_s[-1] + above_s]])
    depth, angle = (np.interp(at, ends, each) for each in np.vstack([off, way, off]).T)
    force, torque = (_between_states(at, states[0], each, time_s) for each in states[1:])
    write_rows(path, depth, angle, np.maximum(force, 0.0), torque, np.random.default_rng(seed))
    pl.read_parquet(path).select(pl.all().cast(pl.Float32)).write_parquet(path, compression="zstd")


def _between_states(
    at: FloatArray, time_s: FloatArray, values: FloatArray, corners_s: FloatArray
) -> FloatArray:
    """Values at times, smooth between the corners of the motion; 0 before and after it."""
    found = np.zeros(at.size)
    for start, end in pairwise(corners_s.tolist()):
        rows, own = (at >= start) & (at <= end), (time_s >= start - 1e-9) & (time_s <= end + 1e-9)
        found[rows] = PchipInterpolator(time_s[own], values[own])(at[rows])
    return found


def main() -> None:
    """Simulate and log every spot."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--into", type=Path, help="folder of the logs; default: that of the study")
    into = parser.parse_args().into
    plugins = Plugins.load()
    study = read_study(Path(plugins.studies[NAME].directory), plugins, need_measured=False)
    for spot, seed in SEEDS.items():
        limb = true_limb(spot)
        protocol, states = simulated(study, spot, limb)
        (file,) = (each for one in study.spots for each in one.files if one.spot.name == spot)
        log_of(into / file.name if into else file, protocol, states, seed)
        sys.stdout.write(
            f"{spot}: {limb.mesh.n_nodes} nodes, {states.shape[1]} states, {states[1].max():.2f} N\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
