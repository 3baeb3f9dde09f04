"""What plugins subclass. Abstract or final, nothing between.

A component is built from its checked settings; the class attributes ``name``
and ``summary`` are what ``palpate plugins`` shows. A study names components by
``name`` and passes their ``settings`` table, which the model of settings checks:
``class Grid(Sampler[GridSettings])``. Every field there needs a description.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from importlib import metadata
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Generic, cast, get_args, get_origin

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, PlainSerializer, ValidationInfo
from typing_extensions import TypeVar, get_original_bases

from palpate.domain import (
    BoolArray,
    FloatArray,
    Job,
    Limb,
    Parameter,
    ParameterSpace,
    Response,
    Simulation,
    Spot,
)
from palpate.errors import MaterialError, ParameterError
from palpate.plugins.fingerprints import CORE, code_fingerprint
from palpate.plugins.provides import Provides

Array = Any
"""An array of the array API: numpy in checks, JAX under differentiation."""

NO_FIELDS: Mapping[str, Array] = MappingProxyType({})
"""Where there is no mesh, or a material that takes nothing from it."""


def _in_folder(given: Path, info: ValidationInfo) -> Path:
    """A path from the study's folder; from the current one outside of a study."""
    context = info.context or {}
    path: Path = context.get("folder", Path()) / given
    if context.get("must_exist", True) and not path.is_file():
        raise ValueError(f"'{given}': no such file (looked for {path}); paths are relative to study.toml")
    return path


InputFile = Annotated[
    Path, AfterValidator(_in_folder), PlainSerializer(lambda path: path.name, return_type=str)
]
"""Type of a setting that names a file. Only its name is in keys and manifests: a component with such a
setting adds the content to its ``fingerprint()``."""


class Settings(BaseModel):
    """Base of every component's settings: frozen, and unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


SettingsT = TypeVar("SettingsT", bound=Settings, default=Settings, covariant=True)
"""Settings of a component."""


class Component(ABC, Generic[SettingsT]):
    """Something that a plugin provides under a name.

    Parameters
    ----------
    settings : Settings, optional
        Of the class in brackets, as in ``Sampler[GridSettings]``, which is also the attribute
        ``Settings``; its defaults when left out.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    Settings: ClassVar[type[Settings]] = Settings

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        bases = [
            base for base in get_original_bases(cls) if issubclass(get_origin(base) or object, Component)
        ]
        for argument in (each for base in bases for each in get_args(base)):
            if isinstance(argument, type) and issubclass(argument, Settings):
                cls.Settings = argument
            elif not isinstance(argument, TypeVar):
                raise TypeError(f"class {cls.__name__}[{argument}]: name a subclass of palpate.api.Settings")

    def __init__(self, settings: SettingsT | None = None) -> None:
        self.settings = cast("SettingsT", self.Settings()) if settings is None else settings

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.settings})"

    def fingerprint(self) -> str:
        """Identity of the code that computes, to which results belong; name and settings count anyway.

        By itself distribution, version and a hash of the code of the class and its bases outside
        palpate: of their whole packages, or of the file of a module outside a package. Override it
        to state by hand which versions give the same results, or to add what else they
        depend on, such as a data file.

        Raises
        ------
        PluginError
            The class is defined in no file, as in a notebook.
        """
        return code_fingerprint(type(self)) or f"{CORE} {metadata.version(CORE)}"


class HyperelasticMaterial(Component[SettingsT]):
    """What isotropic and anisotropic materials share; subclass one of them.

    A material is given by its energy alone: stress, tangent, initial moduli and stability follow
    in :mod:`palpate.mechanics`. ``parameters`` may be a class attribute, or be set in ``__init__``
    where the settings decide how many there are.
    """

    parameters: tuple[Parameter, ...]

    conventions: Mapping[str, tuple[float, ...]] = MappingProxyType({})
    """Other ways to write the coefficients: textbook value = number × factor, by parameter."""

    fields: tuple[str, ...] = ()
    """Cell fields of the mesh that the energy takes: see :class:`AnisotropicMaterial`."""

    def __eq__(self, other: object) -> bool:
        """Whether both have one class and equal settings, and so one energy: what is compiled is shared."""
        if self is other or not isinstance(other, HyperelasticMaterial):
            return self is other
        return type(self) is type(other) and bool(self.settings == other.settings)

    def __hash__(self) -> int:
        return hash(type(self))

    def to_textbook(self, values: FloatArray, convention: str) -> FloatArray:
        """Convert coefficients (n_parameters,) written in ``convention`` to textbook values.

        Raises
        ------
        MaterialError
            The convention is unknown to this material.
        """
        theta: FloatArray = values * np.array(self._factors(convention))
        return theta

    def from_textbook(self, theta: FloatArray, convention: str) -> FloatArray:
        """Convert textbook values (n_parameters,) to ``convention``."""
        values: FloatArray = theta / np.array(self._factors(convention))
        return values

    def _factors(self, convention: str) -> tuple[float, ...]:
        if convention == "textbook":
            return (1.0,) * len(self.parameters)
        if convention not in self.conventions:
            known = ", ".join(["textbook", *self.conventions])
            raise MaterialError(
                f"material '{self.name}' knows no convention '{convention}'; choose one of: {known}"
            )
        return self.conventions[convention]

    def check(self, theta: FloatArray) -> None:
        """Refuse textbook values outside the physical range of their parameter.

        Raises
        ------
        ParameterError
        """
        if len(theta) != len(self.parameters):
            raise ParameterError(
                f"material '{self.name}' takes {len(self.parameters)} parameters, got {len(theta)}"
            )
        for parameter, value in zip(self.parameters, theta, strict=True):
            parameter.check(float(value))


class IsotropicMaterial(HyperelasticMaterial[SettingsT]):
    """A hyperelastic material without directions: its energy is a function of the principal stretches."""

    @abstractmethod
    def energy(self, stretches: Array, theta: Array) -> Array:
        """Strain energy per reference volume.

        Parameters
        ----------
        stretches : (..., 3) array
            Principal stretches λ1, λ2, λ3; the energy is symmetric in them and zero at rest.
        theta : (n_parameters,) array
            Textbook values in the order of ``parameters``.

        Returns
        -------
        (...,) array
            Energy in MPa. Write it with the array's own namespace
            (``xp = stretches.__array_namespace__()``), so that numpy can check it and
            JAX can differentiate it.
        """


class AnisotropicMaterial(HyperelasticMaterial[SettingsT]):
    """A hyperelastic material with directions of its own, such as fibres.

    Its energy depends on more than the principal stretches, so it is given by the deformation
    gradient: through C = FᵀF and its invariants, I4 = a · C a for a fibre along the unit vector
    a of the undeformed body, all in the frame of the mesh. Everything else follows as for any
    material, by JAX alone.

    A direction that differs from element to element comes with the mesh, as a cell field: name it
    in ``fields``, as a class attribute or in ``__init__``. A study of several spots needs that,
    since each spot's mesh may be in a frame of its own; one direction in the settings is refused
    there, unless the study says that all meshes share a frame.
    """

    @abstractmethod
    def energy_from_F(  # noqa: N802
        self, F: Array, theta: Array, fields: Mapping[str, Array] = NO_FIELDS
    ) -> Array:
        """Strain energy per reference volume.

        Parameters
        ----------
        F : (3, 3) array
            Deformation gradient; the energy is zero at rest and does not change when a
            rotation follows.
        theta : (n_parameters,) array
            Textbook values in the order of ``parameters``.
        fields : mapping of name to () or (3,) array
            Values of this element, vectors in the frame of the mesh, for each name in
            ``self.fields``. Empty where there is no mesh, as when the moduli at rest are checked; a
            material without fields need not take the argument.

        Returns
        -------
        () array
            Energy in MPa, written in ``jax.numpy``.
        """


Material = IsotropicMaterial | AnisotropicMaterial
"""A material of either kind."""


class ExperimentLoader(Component[SettingsT]):
    """Reads measured curves."""

    @abstractmethod
    def load(self, path: Path, channel: str | None = None) -> Response:
        """Read one file.

        Parameters
        ----------
        path : Path
        channel : str, optional
            The study says that this file holds this one channel; otherwise the
            loader's settings say which columns make which channels.

        Raises
        ------
        CurveError
            Naming file, row and column.
        """


class LimbSource(Component[SettingsT]):
    """Makes the limb around a spot from a file."""

    @abstractmethod
    def load(self, path: Path, spot: Spot) -> Limb:
        """Read the mesh of one spot.

        Parameters
        ----------
        path : Path
        spot : Spot
            As the study has it; a source that finds the spot in the file may ignore its position and normal.

        Returns
        -------
        Limb
            The spot, with a position [mm] on the surface and the outward normal, and a mesh in mm in
            the same frame, which palpate checks before the first simulation:

            * cells of the kinds in :data:`palpate.mesh.topology.CELLS`, numbered as there, none inverted
              or flat; no node without a cell, and no two nodes where elements should be joined;
            * a region for each cell, with the names of the study's ``[region]`` tables;
            * node sets ``fixed`` (held still; at least three nodes that are not on one line) and
              ``contact`` (the outer surface around the spot; the nearest of its nodes no further from
              the spot than an element), and ``bonded`` for nodes that move with the indenter;
            * for each region in use, the cell fields that its material names.

        Raises
        ------
        MeshError
            Naming the file, element or node.
        """


class Sampler(Component[SettingsT]):
    """Draws points of the unit cube."""

    @abstractmethod
    def draw(self, n_sets: int, n_parameters: int, seed: int) -> FloatArray:
        """Points (n_sets, n_parameters) in (0, 1); the same seed gives the same bits."""

    def extend(self, points: FloatArray, n_total: int, seed: int) -> FloatArray:
        """Go on with a draw, for a study that wants more sets after the filters.

        Override it where the new points should know of the old ones; by itself it adds an
        independent draw.

        Parameters
        ----------
        points : (n, n_parameters) array
            What ``draw``, or this method, returned for the same ``seed``.
        n_total : int
            A multiple of n, at least 2 n.
        seed : int

        Returns
        -------
        (n_total, n_parameters) array
            Begins with ``points``, bit for bit.
        """
        n_points, n_parameters = points.shape
        return np.vstack([points, self.draw(n_total - n_points, n_parameters, seed + n_points)])


class SetFilter(Component[SettingsT]):
    """Keeps the parameter sets that make sense, such as the stable ones."""

    @abstractmethod
    def accept(self, space: ParameterSpace, values: FloatArray) -> BoolArray:
        """Which rows of ``values`` (n_sets, n_parameters), in design columns, to keep: (n_sets,)."""

    def reason(self, space: ParameterSpace, row: FloatArray) -> str:
        """Why a set (n_parameters,) is dropped; shown where all sets are. Override it to say more."""
        return ""


class Solver(Component[SettingsT]):
    """Simulates a job."""

    provides: Provides = Provides()
    """What it simulates; a study that asks for more is refused before the first simulation."""

    def ignored(self, material: Material) -> tuple[str, ...]:
        """Names of the material's parameters that cannot change an answer; a study has to fix them."""
        return ()

    def n_pilots(self, number: int) -> int:
        """How many of the first sets of a design the set of this number, from 0, may start from.

        They become its ``Job.pilots`` and are simulated before it. It never falls as the number grows, and
        is at most the number.
        """
        return 0

    def version(self) -> str:
        """Version of what computes the numbers, part of each simulation's key: by itself that of the code.

        Override it to add a program or a library whose version changes the numbers.
        """
        return self.fingerprint()

    def check(self, job: Job, limb: Limb | None) -> None:
        """Refuse, before the first step, what cannot be simulated.

        Raises
        ------
        PalpateError
            Naming the element, node or parameter.
        """

    @abstractmethod
    def simulate(self, job: Job, limb: Limb | None) -> Simulation:
        """Simulate one job. A failure is a status, never an exception."""

    def simulate_many(self, jobs: Iterable[Job], limb: Limb | None) -> Iterator[Simulation]:
        """Simulate jobs of one limb, yielding each as it ends; override to share work.

        An answer must have the same bits whatever other jobs are given with its own, so that a sweep
        which is stopped, resumed or spread over workers gives the same tables; a solver may offer a
        setting that asks for something else.
        """
        for job in jobs:
            yield self.simulate(job, limb)
