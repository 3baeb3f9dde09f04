"""Abilities of components beyond their duty: they have the method, and inherit nothing for it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from palpate.domain import Channel, Job, Limb, Response, Simulation


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectedTable:
    """A table of text, to be shown."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Inspection:
    """Contents of a file, and how a study might read it.

    Parameters
    ----------
    tables : tuple of InspectedTable
        For a person: channels, units, rates, gaps.
    findings : tuple of str
        What is wrong or doubtful, each a sentence.
    study_text : str
        Tables of study.toml that would read the file; empty if there are none.
    test : str
        Channel of the homogeneous test that the file holds; empty for a press.
    record : mapping
        The same for a script; JSON-able.
    file : Path, optional
        File that a study names, where the one that was given is a folder.
    limb : Limb, optional
        Limb that ``study_text`` reads, of a mesh.
    """

    tables: tuple[InspectedTable, ...] = ()
    findings: tuple[str, ...] = ()
    study_text: str = ""
    test: str = ""
    record: Mapping[str, Any] = field(default_factory=dict)
    file: Path | None = None
    limb: Limb | None = None


@runtime_checkable
class CurveWriter(Protocol):
    """A loader that can also write its files."""

    def save(self, path: Path, response: Response, channel: str | None = None) -> None:
        """Write curves in the form that :meth:`load` reads, for studies that are synthesised.

        Parameters
        ----------
        path : Path
            In a folder that exists.
        channel : str, optional
            As for :meth:`load`.

        Raises
        ------
        CurveError
            This form cannot hold these curves.
        """


@runtime_checkable
class FileInspector(Protocol):
    """A loader, or a limb source, that can look into a file without settings."""

    @classmethod
    def inspect(cls, path: Path, other: Path | None = None) -> Inspection:
        """Look into a file that no study describes yet, for ``inspect`` of experiment and limb.

        Parameters
        ----------
        other : Path, optional
            A second file of the same measurement.

        Raises
        ------
        CurveError, MeshError
            The file cannot be read.
        """


@runtime_checkable
class PressChecker(Protocol):
    """A loader whose settings depend on the press."""

    def press_warnings(self, indenter: str, *, is_on_skin: bool) -> Iterable[str]:
        """Warnings about settings that do not fit a press, each a sentence with what to do.

        Parameters
        ----------
        indenter : str
            Name of the indenter, such as sphere.
        is_on_skin : bool
            Whether the mesh has a layer of skin over other tissue.
        """


@runtime_checkable
class LoadingDrawer(Protocol):
    """A loader that does so much to a file that a person should look at it."""

    def draw(self, path: Path, folder: Path, channel: str | None = None) -> tuple[Path, ...]:
        """Draw how :meth:`load` processes a file.

        Pictures that can be drawn are worth having even of a file that cannot be loaded: draw
        those before raising what :meth:`load` raises. A table ``over_time.csv`` next to them is drawn on
        the page of the experiment: ``time_s`` and quantities named as columns of channels, like ``depth_mm``.

        Parameters
        ----------
        folder : Path
            Exists, is empty, and is for the pictures of this file alone.
        channel : str, optional
            As for :meth:`load`.

        Returns
        -------
        tuple of Path
            What was written to ``folder``, in the order in which to look at it.

        Raises
        ------
        CurveError
            As for :meth:`load`.
        """


@runtime_checkable
class PressDrawer(Protocol):
    """A stage that draws the measured curves of a spot, for ``palpate experiment --plots``."""

    def draw_presses(
        self,
        spot: str,
        presses: Mapping[str, Response],
        mean: Response,
        channels: Mapping[str, Channel],
        notice: str,
        folder: Path,
    ) -> tuple[Path, ...]:
        """Draw what was measured at a spot.

        Parameters
        ----------
        mean : Response
            What becomes of them.
        channels : mapping of name to Channel
            Axes and labels.
        notice : str
            What the picture must state of the data; empty for nothing.

        Returns
        -------
        tuple of Path
            What was written to ``folder``.
        """


@runtime_checkable
class ExperimentDrawer(Protocol):
    """A stage that draws the measured curves of a whole study, for ``palpate experiment --plots``."""

    def draw_experiment(
        self,
        study: str,
        presses: Mapping[str, Mapping[str, Response]],
        pictures: Mapping[str, Path],
        channels: Mapping[str, Channel],
        notice: str,
        page: Path,
    ) -> None:
        """Write one HTML page with all measured curves of a study.

        Parameters
        ----------
        study : str
            Name of the study.
        presses : mapping of spot to mapping of file to Response
            All curves.
        pictures : mapping of spot to Path
            Folders in which the loader drew its files.
        channels, notice
            As for :class:`PressDrawer`.
        page : Path
            File to write.
        """


@runtime_checkable
class RangeProposer(Protocol):
    """A material whose ranges follow from the deformation of a homogeneous test."""

    def proposed_ranges(self, shear_MPa: float, invariant: float) -> Mapping[str, tuple[float, float]]:
        """Ranges by parameter, in the material's units; parameters of the volume are left out.

        Parameters
        ----------
        shear_MPa : float
            Initial shear modulus, about.
        invariant : float
            Largest I1 - 3 of the test, greater than zero.
        """


@runtime_checkable
class Verifier(Protocol):
    """A solver whose answer may be wrong and look right, and that can find out."""

    def verify(self, job: Job, limb: Limb | None, simulation: Simulation) -> Mapping[str, Any]:
        """Verify the result of a selected set, for instance with halved steps.

        Called for selected sets only, so it may cost as much as the simulation did.

        Parameters
        ----------
        simulation : Simulation
            The answer, as it was kept.

        Returns
        -------
        mapping of str to bool, float or str
            ``passed``, ``message`` and any figures; empty where there is nothing to verify.
        """
