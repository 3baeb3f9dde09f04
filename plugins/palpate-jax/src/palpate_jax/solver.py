"""The embedded finite element solver, as a plugin sees it.

JAX is imported by the first check or simulation: a list of solvers needs none.
"""

from functools import cached_property
from typing import TYPE_CHECKING

from palpate.api import Job, Limb, MeshError, Provides, Simulation, Solver, StudyError, mechanics
from palpate.api.experiment import STATE_COLUMNS
from palpate.api.mesh import indentation_of
from palpate_jax.contact import CONTACT
from palpate_jax.footprint import check_footprint, check_touch
from palpate_jax.settings import JaxSettings as JaxSettings

if TYPE_CHECKING:
    from palpate_jax.path_simulation import PathSimulations

GROUPS = (12, 36, 108)
"""Where groups of a sweep's sets end: the first start alone, each other from all sets of those before it."""


class JaxSolver(Solver[JaxSettings]):
    """Quasi-static finite elements of a limb under a rigid indenter, with friction and its history."""

    name = "jax"
    summary = "finite elements (hex8, tet10, tet4) under a rigid indenter, friction with history; embedded"
    provides = Provides(
        anisotropic=True,
        fields=True,
        columns=(*STATE_COLUMNS, *CONTACT),
        indenters=None,
        motions=("depth", "rotation", "shift", "tilt", "load"),
        slopes=True,
        relaxation=True,
        surface=True,
        contact_penalty=True,
        depth_slope=True,
    )

    def __reduce__(self) -> tuple[type["JaxSolver"], tuple[JaxSettings]]:
        """Class and settings: what it keeps of limbs and states stays in this process."""
        return type(self), (self.settings,)

    def n_warm_starts(self, number: int) -> int:
        """Number of warm starts of a set: all sets of the largest group that ends before it."""
        return max(n for n in (0, *GROUPS) if n <= number) if self.settings.warm_starts else 0

    def check(self, job: Job, limb: Limb | None) -> None:
        """Refuse a job that cannot be simulated, before the first step.

        Raises
        ------
        StudyError
            No limb, another protocol than an indentation, or a setting that names
            a region which the mesh does not have, or a folder that cannot be made.
        MeshError
            A region without material, a surface that does not touch the indenter at
            depth 0 or at all, or one that ends within its reach.
        MaterialError
            Parameters outside their physical range or without a stable reference state.
        """
        protocol, limb = indentation_of(job, limb, self.name)
        check_footprint(limb, protocol)
        check_touch(limb, protocol)
        for region in limb.mesh.regions:
            if region not in job.materials:
                raise MeshError(
                    f"spot '{job.spot}': region '{region}' has no material; give it one in the study"
                )
            material = job.materials[region]
            mechanics.check_reference_state(material, job.thetas[region])
            if material.relaxation_times_s and protocol.time_s is None:
                raise StudyError(
                    f"region '{region}' relaxes, which needs the times of its press; give durations: "
                    'motion = "moves"'
                )
        named = self.settings.mean_dilatation
        for region in () if isinstance(named, bool) else named:
            if region not in limb.mesh.regions:
                raise StudyError(
                    f"spot '{limb.spot.name}': setting mean_dilatation names region '{region}', and the mesh "
                    f"has {', '.join(limb.mesh.regions)}; correct the name"
                )
        if self.settings.fields != "none":
            folder = self.settings.folder_of(job.spot)
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise StudyError(
                    f"{folder}: fields cannot be written there ({error.strerror}); name another fields_folder"
                ) from None

    def simulate(self, job: Job, limb: Limb | None) -> Simulation:
        """Simulate the protocol's path; if it cannot be finished, ``diverged`` with partial curves.

        With warm starts every state starts from a guess, which changes no result by more than the tolerance,
        as long as ``n_cuts`` is 0 without warm starts too. Where a guess avoids halving a step, friction
        follows the longer step.
        """
        return self._paths.simulate(job, limb)

    @cached_property
    def _paths(self) -> "PathSimulations":
        from palpate_jax.path_simulation import PathSimulations

        return PathSimulations(self)
