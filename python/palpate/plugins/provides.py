"""Abilities of a solver: a study that asks for more is refused when it is read."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from palpate.domain import HomogeneousTests, Indentation, Job, Protocol
from palpate.domain.channels import PRESS_AND_TWIST
from palpate.domain.curves import Channel
from palpate.domain.material import AnisotropicMaterial, Material
from palpate.domain.waypoints import MOVES
from palpate.errors import PluginError
from palpate.plugins.guard import answering_for

if TYPE_CHECKING:
    from palpate.plugins.interfaces import Solver

BODIES = ("mesh", "layers", "specimen")


@dataclass(frozen=True, slots=True, kw_only=True)
class Provides:
    """Abilities of a solver: by default force and torque of a sphere on the mesh of a limb.

    Parameters
    ----------
    body : str
        ``mesh``: the limb around a spot, in elements. ``layers``: a body of the study's regions without a
        mesh, such as a half-space in closed form. ``specimen``: homogeneous tests, without mesh and protocol.
    max_regions : int, optional
        Most regions of a study, each with its material; None: any number.
    anisotropic : bool
        Whether materials may have directions.
    fields : bool
        Whether materials get the cell fields of the mesh.
    channels : tuple of str
        Channels that it computes, whatever a job asks for.
    columns : tuple of str
        Columns of its equilibrium states: it also computes each channel of these that a job asks for, as
        ``states.observed(job.channels)``.
    indenters : tuple of str, optional
        Names of indenters; None: all, by their distance.
    motions : tuple of str
        Parts of a motion, among :data:`palpate.domain.waypoints.MOVES`.
    slopes : bool
        Whether a job with ``slopes`` gets exact derivatives with its curves; else they are differenced.
    relaxation : bool
        Whether materials may relax in time.
    surface : bool
        Whether a job with ``surface`` gets the states of the skin with its curves.
    contact_penalty : bool
        Whether a penalty, which a protocol may multiply, keeps the indenter out of the tissue: the error
        budget has its effect on the curves. Slopes have one in ``contact_compliance`` then, the factor's
        reciprocal.
    depth_slope : bool
        Whether slopes on a spot's own mesh have one in ``depth_mm``: the change of each state where a press
        of one depth ends deeper, with as many steps.
    accuracy : float
        Scatter of its curves, relative to their size: slopes are differenced over steps that fit it.

    Raises
    ------
    PluginError
        There is no such body, part of a motion, or accuracy.
    """

    body: Literal["mesh", "layers", "specimen"] = "mesh"
    max_regions: int | None = None
    anisotropic: bool = False
    fields: bool = False
    channels: tuple[str, ...] = tuple(channel.name for channel in PRESS_AND_TWIST)
    columns: tuple[str, ...] = ()
    indenters: tuple[str, ...] | None = ("sphere",)
    motions: tuple[str, ...] = ("depth", "rotation")
    slopes: bool = False
    relaxation: bool = False
    surface: bool = False
    contact_penalty: bool = False
    depth_slope: bool = False
    accuracy: float = 1e-4

    def __post_init__(self) -> None:
        if self.body not in BODIES:
            raise PluginError(f"a solver provides no body '{self.body}' (known: {', '.join(BODIES)})")
        if unknown := [part for part in self.motions if part not in MOVES]:
            raise PluginError(f"a motion has no part '{unknown[0]}' (known: {', '.join(MOVES)})")
        if not 0.0 < self.accuracy < 1.0:
            raise PluginError(f"a solver's accuracy is between 0 and 1, not {self.accuracy:g}")

    @property
    def mesh(self) -> bool:
        """Whether it simulates the mesh of a limb, and so needs one."""
        return self.body == "mesh"

    def computes(self, channel: Channel) -> bool:
        """Whether it computes a channel, by name or from the columns of its equilibrium states."""
        return channel.name in self.channels or channel.columns <= set(self.columns)

    def simulates(self, indenter: str) -> bool:
        """Whether it simulates an indenter of this name."""
        return self.indenters is None or indenter in self.indenters

    def other_moves(self, protocol: Protocol | None) -> tuple[str, ...]:
        """Parts of the motion of a press that it does not simulate."""
        moves = protocol.moves if isinstance(protocol, Indentation) else ()
        return tuple(part for part in moves if part not in self.motions)

    def takes_regions(self, n_regions: int) -> bool:
        """Whether it simulates so many regions."""
        return self.max_regions is None or n_regions <= self.max_regions

    def takes_directions(self, material: "Material") -> bool:
        """Whether it simulates the directions of a material, if it has any."""
        return self.anisotropic or not _is_anisotropic(material)

    def missing_fields(self, material: "Material") -> tuple[str, ...]:
        """Cell fields that a material takes and that it does not get."""
        return () if self.fields and _is_anisotropic(material) else material.fields

    def lacks(self, job: Job) -> tuple[str, ...]:
        """Needs of a job that the solver does not provide, in words; empty where it provides all."""
        return tuple(self._lacks(job))

    def _lacks(self, job: Job) -> Iterator[str]:
        press = job.protocol
        if isinstance(press, HomogeneousTests):
            if self.body != "specimen":
                yield "homogeneous tests"
        elif self.body == "specimen":
            yield "indentations"
        elif isinstance(press, Indentation):
            if not self.simulates(press.indenter.name):
                yield f"indenter '{press.indenter.name}'"
            yield from (f"motions with {part}" for part in self.other_moves(press))
        if not self.takes_regions(len(job.materials)):
            yield f"{len(job.materials)} regions"
        for material in job.materials.values():
            if material.relaxation_times_s and not self.relaxation:
                yield "materials that relax"
            if not self.takes_directions(material):
                yield f"anisotropic materials such as '{material.name}'"
            elif missing := self.missing_fields(material):
                yield f"cell data {', '.join(missing)}, which material '{material.name}' takes"


def _is_anisotropic(material: "Material") -> bool:
    return isinstance(material, AnisotropicMaterial)


def provided_by_default(solver: "type[Solver[Any]]") -> Provides | None:
    """Abilities of a solver with its default settings; None where some have no default."""
    declared: object = solver.provides
    if isinstance(declared, Provides):
        return declared
    if any(field.is_required() for field in solver.Settings.model_fields.values()):
        return None
    with answering_for(solver, "asking for its abilities"):
        return solver().provides
