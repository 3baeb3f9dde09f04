"""Meshes that can be refined, and a solver whose answers err by the edges of the mesh."""

from dataclasses import replace

from palpate.api import PRESS_AND_TWIST, Curve, LimbSource, Response, Solver, hookimpl
from palpate.mesh.specimens.blocks import block
from palpate.mesh.spot_frame import RIM, contact_edge_mm
from palpate.testing.bench import HalfSpaceOnMesh

ERROR = {"force": 0.01, "torque": 2.6}
ORDER = {channel.name: channel.mesh.rim_order for channel in PRESS_AND_TWIST}
STEP = 1e-4


class Tetrahedra(LimbSource):
    """A block of tetrahedra, whatever the file holds."""

    name = "tetrahedra"
    summary = "a block of tetrahedra"

    def load(self, path, spot):
        limb = block("tet10", n_across=4, n_down=2)
        return replace(limb, spot=spot, mesh=replace(limb.mesh, regions=("tissue",)))


class ErrsByTheMesh(Solver):
    """The half-space, and more by a power of the edge under the indenter over its radius."""

    name = "errs_by_the_mesh"
    summary = "an indenter on a half-space, stiffer by the edges of the mesh"
    provides = replace(HalfSpaceOnMesh.provides, slopes=True)

    def simulate(self, job, limb):
        radius_mm = job.protocol.indenter.radius_mm
        inner_mm, outer_mm = (share * job.protocol.reach_mm for share in RIM)
        ratio = contact_edge_mm(limb, outer_mm, inner_mm) / radius_mm
        exact = HalfSpaceOnMesh(HalfSpaceOnMesh.Settings())
        found = exact.simulate(job, limb)
        changed = {
            f"{region}.{parameter.name}": i
            for region, material in job.materials.items()
            for i, parameter in enumerate(material.parameters)
        }
        changed["friction"] = None
        slopes = {name: {} for name in found.response}
        for name, i in changed.items() if job.slopes else ():
            ends = [exact.simulate(_shifted(job, name, i, by), limb).response for by in (-STEP, STEP)]
            width = 2.0 * STEP * _value(job, name, i)
            for channel, of_channel in slopes.items():
                of_channel[name] = (ends[1][channel].ordinate - ends[0][channel].ordinate) / width
        curves = {}
        for channel, curve in found.response.curves.items():
            factor = 1.0 + ERROR[channel] * ratio ** ORDER[channel]
            own = {name: factor * slope for name, slope in slopes[channel].items()}
            curves[channel] = Curve(
                channel=channel, abscissa=curve.abscissa, ordinate=factor * curve.ordinate, slopes=own
            )
        return replace(found, response=Response(curves=curves))


def _value(job, name, i):
    return job.protocol.friction if i is None else job.thetas[name.partition(".")[0]][i]


def _shifted(job, name, i, by):
    if i is None:
        return replace(job, protocol=replace(job.protocol, friction=job.protocol.friction * (1.0 + by)))
    region = name.partition(".")[0]
    theta = job.thetas[region].copy()
    theta[i] *= 1.0 + by
    return replace(job, thetas={**job.thetas, region: theta})


@hookimpl
def palpate_limb_sources():
    return [Tetrahedra]


@hookimpl
def palpate_solvers():
    return [ErrsByTheMesh]
