"""Simulations of made-up jobs in a ledger."""

import numpy as np

from palpate.domain import Curve, Job, Response, Simulation, Status
from palpate.run.ledger import Ledger, Writer


def job(set_id=0, spot="p1"):
    return Job(spot=spot, set_id=set_id)


def response(scale=1.0, n=50, std=None):
    x = np.linspace(0.0, 10.0, n)
    return Response(
        curves={
            "torque": Curve(channel="torque", abscissa=x, ordinate=scale * np.sin(x), std=std),
            "force": Curve(channel="force", abscissa=x, ordinate=scale * x**1.5, time_s=2.0 * x),
        }
    )


def finished(set_id, status=Status.OK, **more):
    """Key and simulation."""
    answer = response(1.0 + set_id) if status in (Status.OK, Status.DIVERGED) else None
    simulation = {"response": answer, "message": f"set {set_id}", "seconds": 0.5 + set_id, **more}
    return f"key{set_id}", Simulation(job=job(set_id), status=status, **simulation)


def write(folder, *every):
    with Writer(folder) as writer:
        for each in every:
            writer.store(*each)


def read(folder, *set_ids):
    with Ledger(folder) as ledger:
        return ledger.simulations({f"key{i}": job(i) for i in set_ids})


def same(one, other):
    assert list(one) == list(other)
    for name in one:
        assert np.array_equal(one[name].abscissa, other[name].abscissa)
        assert np.array_equal(one[name].ordinate, other[name].ordinate)
        assert (one[name].std is None) == (other[name].std is None)
        assert np.array_equal(one[name].time_s, other[name].time_s)
