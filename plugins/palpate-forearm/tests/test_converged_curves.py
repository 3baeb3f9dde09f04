"""Curves of the ready study's meshes against the converged curves that are its data."""

from dataclasses import replace

import numpy as np
import pytest

from palpate import Job, Plugins, Status
from palpate.domain import FloatArray
from palpate.limb.loading import load_limbs, refinement
from palpate.study.reading import read_study

TRUTH = {"c1": 0.0141, "c2": -0.0011, "c3": 1.05e-4}


@pytest.fixture(scope="module")
def study():
    plugins = Plugins.load()
    return read_study(plugins.studies["forearm-demo"].directory, plugins)


def along(abscissa: FloatArray) -> FloatArray:
    """Travel up to each point."""
    return np.concatenate([[0.0], np.cumsum(np.abs(np.diff(abscissa)))])


def simulated(study, limb, measured, *, penalty=1.0, by=None):
    """Ordinates of force and torque, or their slopes ``by`` something, at the measured points."""
    protocol = replace(study.protocol_at("p1"), contact_penalty=penalty)
    (region,) = study.space.regions
    row = np.array([TRUTH[p.name.rpartition(".")[2]] for p in study.space.parameters])
    job = Job(
        spot="p1",
        set_id=0,
        materials={region.region: region.material},
        thetas=study.space.thetas(row),
        protocol=protocol,
        slopes=by is not None,
    )
    found = study.solver.simulate(job, limb)
    assert found.status is Status.OK
    wanted = {
        name: (each.abscissa, each.slopes[by] if by else each.ordinate)
        for name, each in found.response.curves.items()
    }
    return {
        name: np.interp(along(curve.abscissa), along(wanted[name][0]), wanted[name][1])
        for name, curve in measured.items()
    }


def test_a_stiffer_contact_raises_the_force_by_less_and_less(study):
    limb, measured = load_limbs(replace(study, fine_runs=0))["p1"], read(study)
    forces = [simulated(study, limb, measured, penalty=p)["force"][-1] for p in (1.0, 2.0, 4.0)]
    first, second = np.diff(forces)
    assert 0.0 < second < first < 0.005 * forces[0]


@pytest.mark.slow
def test_extrapolated_curves_are_near_the_converged_ones_along_the_whole_path(study):
    limbs, measured = load_limbs(study), read(study)
    coarse, fine = (simulated(study, limbs[name], measured) for name in ("p1", "p1/fine"))
    softer = simulated(study, limbs["p1/fine"], measured, by="contact_compliance")
    left_over = study.left_over(refinement(study, limbs)["p1"])
    off = {}
    for name, curve in measured.items():
        corrected = fine[name] + left_over[name] * (fine[name] - coarse[name]) - softer[name]
        off[name] = np.abs(corrected - curve.ordinate).max() / np.abs(curve.ordinate).max()
    assert off["force"] < 0.005  # 0.003, and chords between states
    assert off["torque"] < 0.010


def read(study):
    """Measured curves of the first spot by channel."""
    spot = study.spots[0]
    (files,) = spot.measured.values()
    return dict(study.loader_at("p1").load(files[0]).curves)
