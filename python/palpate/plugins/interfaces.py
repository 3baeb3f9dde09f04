"""Bases for plugins, but for materials, indenters and motions. Abstract or final, nothing between."""

from abc import abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np

from palpate.domain import BoolArray, FloatArray, Job, Limb, ParameterSpace, Response, Simulation, Spot
from palpate.domain.component import Component, SettingsT
from palpate.domain.material import Material
from palpate.plugins.provides import Provides


class ExperimentLoader(Component[SettingsT]):
    """Reads measured curves."""

    @abstractmethod
    def load(self, path: Path, channel: str | None = None) -> Response:
        """Read one file.

        Parameters
        ----------
        channel : str, optional
            The study states that this file holds this one channel; otherwise the
            loader's settings say which columns make which channels.

        Raises
        ------
        CurveError
            Naming file, row and column.
        """

    def load_presses(self, path: Path, channel: str | None = None) -> Mapping[str, Response]:
        """Read every press of one file that may hold several of one spot; by default there is one.

        The parameters of :meth:`load`, which gives the last press.

        Returns
        -------
        mapping of str to Response
            By name, such as ``cycle_2``; a single press has none.
        """
        return {"": self.load(path, channel)}


class LimbSource(Component[SettingsT]):
    """Makes the limb around a spot from a file.

    Attributes
    ----------
    suffixes : frozenset of str
        Of the files that it reads, in small letters with their point, for ``palpate limb inspect``.
    """

    suffixes: frozenset[str] = frozenset()

    @abstractmethod
    def load(self, path: Path, spot: Spot) -> Limb:
        """Read the mesh of one spot.

        Parameters
        ----------
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
        """Mask (n_sets,) of the rows to keep of ``values`` (n_sets, n_parameters), in design columns."""

    def reason(self, space: ParameterSpace, row: FloatArray) -> str:
        """Reason to drop a set (n_parameters,), shown where too few are left. Override it to say more."""
        return ""


class Solver(Component[SettingsT]):
    """Simulates a job."""

    provides: Provides = Provides()
    """What it simulates; a study that asks for more is refused before the first simulation."""

    def ignored(self, material: Material) -> tuple[str, ...]:
        """Names of the material's parameters that cannot change an answer; a study has to fix them."""
        return ()

    def n_warm_starts(self, number: int) -> int:
        """Number of the first sets of a design that the set of this number, from 0, may start from.

        They become its ``Job.warm_starts`` and are simulated before it. It never falls as the number grows,
        and is at most the number.
        """
        return 0

    def version(self) -> str:
        """Version of the program that computes the numbers, part of each simulation's key.

        Override it to add a program or a library whose version changes the numbers.
        """
        return self.fingerprint()

    def check(self, job: Job, limb: Limb | None) -> None:
        """Refuse a job that cannot be simulated, before the first step.

        Raises
        ------
        PalpateError
            Naming the element, node or parameter.
        """

    def locking(self, job: Job, limb: Limb) -> float:
        """Relative error of the curves by elements that lock, which is added to the mesh's error."""
        return 0.0

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
