"""A limb of three kinds of elements, its press, and parts of the decks that are written for them."""

import xml.etree.ElementTree as ET

import numpy as np

from palpate.api import relaxing
from palpate.domain import Indentation, Job, Limb, Mesh, Spot
from palpate.domain.indenter import Sphere
from palpate_febio.settings import FebioSettings
from palpate_febio.solver import FebioSolver
from palpate_materials import NeoHookean, Ogden, Yeoh

TWIST = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, -22.5), (2.0, 22.5), (2.0, 0.0)])

THETAS = {
    "skin": np.array([0.16, 6.0, 2.0]),
    "soft tissue": np.array([0.0129, -1e-3, 9.2e-5, 0.6]),
    "fat": np.array([0.0735, 0.4434]),
}

MATERIALS = {"skin": Ogden(), "soft tissue": Yeoh(), "fat": NeoHookean()}


def mixed_limb(spot=None):
    """One element of each kind, side by side."""
    hexes = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    hexes = np.vstack([hexes - [0, 0, 1], hexes])
    tet = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, -1]], dtype=float)
    middles = np.array([(tet[a] + tet[b]) / 2 for a, b in ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))])
    points = np.vstack([hexes, np.vstack([tet, middles]) + np.array([2, 0, 0]), tet + np.array([4, 0, 0])])
    mesh = Mesh(
        points_mm=points,
        cells={"hex8": [range(8)], "tet10": [range(8, 18)], "tet4": [range(18, 22)]},
        cell_regions={"hex8": [0], "tet10": [1], "tet4": [2]},
        regions=("skin", "soft tissue", "fat"),
        node_sets={
            "fixed": np.flatnonzero(points[:, 2] == -1.0),
            "contact": np.flatnonzero(points[:, 2] == 0.0),
        },
    )
    return Limb(spot=spot or Spot(name="p1", position_mm=[0.5, 0.5, 0.0]), mesh=mesh)


def job_of(path=TWIST, friction=1.0):
    protocol = Indentation(indenter=Sphere(radius_mm=7.5), path=path, friction=friction)
    return Job(spot="p1", set_id=0, materials=MATERIALS, thetas=THETAS, protocol=protocol)


SOLVER = FebioSolver(FebioSettings(depth_steps=2, rotation_step_deg=22.5, facet_mm=1.2))

TIMES_S, SHARES = (0.5, 5.0), (0.25 / 1.4, 0.15 / 1.4)

TIMED = Indentation(
    indenter=Sphere(radius_mm=7.5),
    path=np.array([(0.0, 0.0), (3.0, 0.0), (3.0, 0.0), (3.0, -22.5)]),
    friction=1.0,
    time_s=np.array([0.0, 1.0, 5.0, 6.0]),
)

AT_ONCE = {"skin": [0.16, 6.0], "soft tissue": [0.0129, -1e-3, 9.2e-5], "fat": [0.0735]}

REST = {"skin": [2.0], "soft tissue": [0.6], "fat": [0.4434]}


def relaxing_job(isochoric=("skin", "soft tissue"), times_s=TIMES_S, protocol=TIMED):
    """The materials of FEBio's recorded curves of relaxing blocks, in the long term as of ``job_of``."""
    materials = {r: relaxing(m, times_s, r in isochoric) for r, m in MATERIALS.items()}
    thetas = {
        r: np.array([*(v * (1.0 if (r, k) == ("skin", 1) else 1.4) for k, v in enumerate(own)), *REST[r]])
        for r, own in AT_ONCE.items()
    }
    shares = np.resize(SHARES, len(times_s)) * len(SHARES) / len(times_s)
    return Job(
        spot="p1",
        set_id=0,
        materials=materials,
        thetas={r: np.append(theta, shares) for r, theta in thetas.items()},
        protocol=protocol,
    )


def materials_in(deck):
    return {m.get("name"): m for m in ET.fromstring(deck).iterfind("Material/material")}


def numbers(element):
    return {e.tag: float(e.text) for e in element if e.tag not in ("density", "elastic")}
