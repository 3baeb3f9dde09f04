"""A run read back from its folder, for notebooks and scripts."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
import polars as pl

from palpate.answer.table import IN_FULL
from palpate.domain import FloatArray, RegionMaterial
from palpate.domain.material import IsotropicMaterial
from palpate.errors import MaterialError, PluginError, StudyError
from palpate.fit.fitted import Fitted, inputs_at
from palpate.mechanics.homogeneous import nominal_stress
from palpate.plugins.catalogue import Plugins
from palpate.run.directory import RunDirectory
from palpate.run.kept_inputs import study_file
from palpate.run.result import FitResult
from palpate.run.result_files import curves_of
from palpate.stages.stage import Run, read_run
from palpate.study.reading import Study, read_study

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@runtime_checkable
class CurveDrawer(Protocol):
    """A stage that draws the curves of a run, for :meth:`SavedRun.plot`."""

    def draw_curves(self, run: Run) -> "Figure":
        """Figure of the measured and the fitted curves of each spot."""


@dataclass(frozen=True, kw_only=True)
class FittedMaterial:
    """The material of one region, with the values that a run has found.

    Parameters
    ----------
    values : mapping of name to float
        All of the material's parameters in the units of the study's ``[region]``, fixed and tied ones too.
    intervals : DataFrame
        Rows of :attr:`SavedRun.intervals` on this region.
    """

    region: RegionMaterial
    values: Mapping[str, float]
    intervals: pl.DataFrame

    def __repr__(self) -> str:
        values = ", ".join(f"{name}={value:.6g}" for name, value in self.values.items())
        return f"FittedMaterial({self.region.region}, {self.region.material.name}: {values})"

    def stress(self, stretch: float | FloatArray, mode: str = "uniaxial") -> FloatArray:
        """Nominal stress of a homogeneous test, as if the material kept its volume.

        Parameters
        ----------
        stretch : float or (n,) array
            Stretch, or the amount of shear of ``simple_shear``.
        mode : str
            ``uniaxial``, ``equibiaxial``, ``pure_shear``, ``simple_shear`` or ``confined_compression``.

        Returns
        -------
        () or (n,) array
            Stress [MPa].

        Raises
        ------
        MaterialError
            The material has directions, there is no such mode, or a stretch is not positive.
        """
        material = self.region.material
        if not isinstance(material, IsotropicMaterial):
            raise MaterialError(
                f"material '{material.name}' of region '{self.region.region}' has directions: its stress "
                "depends on them; simulate a test with a mesh"
            )
        amounts = np.asarray(stretch, dtype=np.float64)
        wrong = amounts[~np.isfinite(amounts) | ((amounts <= 0.0) & (mode != "simple_shear"))]
        if wrong.size:
            raise MaterialError(
                f"no stress at {wrong[0]:g} of '{mode}'; give finite amounts, a stretch as new length / "
                "initial length > 0"
            )
        theta = self.region.theta(dict(self.values))
        return nominal_stress(material, theta, mode, np.atleast_1d(amounts)).reshape(amounts.shape)


@dataclass(frozen=True, kw_only=True)
class SavedRun:
    """A run as its folder has it: nothing is simulated, nothing is written."""

    run: Run

    def __repr__(self) -> str:
        return f"SavedRun({self.study.name}, {self.run.directory.folder})"

    @property
    def study(self) -> Study:
        """The run's own copy of its study."""
        return self.run.study

    @cached_property
    def _found(self) -> FitResult:
        return self.run.fit()

    @cached_property
    def headline(self) -> Fitted:
        """The joint fit, or else the best set for all spots."""
        return self.run.fitted()

    @property
    def fit(self) -> pl.DataFrame:
        """A row for each fit, scenario and spot: reported values, and Fopt, NMSE and R² of these; or none."""
        return self._found.estimates

    @property
    def intervals(self) -> pl.DataFrame:
        """A row for each fit, scenario and parameter with its 95 % interval and the word for it; or none."""
        return self._found.intervals.with_columns(IN_FULL)

    @property
    def answer(self) -> pl.DataFrame:
        """A row for each value that is reported, with its ends, verdict, marks and reason."""
        return self.run.answer().filter("reported").with_columns(IN_FULL)

    @property
    def scores(self) -> pl.DataFrame:
        """A row for each spot, set and channel of the sweep."""
        return self.run.table("scores")

    @cached_property
    def curves(self) -> pl.DataFrame:
        """Measured and fitted curves.

        A row for each point: spot, source (``measured`` or ``fitted``), scenario (null where measured),
        channel, point, abscissa and ordinate, in the units of the channel. Fits to one spot alone are left
        out where there is a joint one.
        """
        fitted, keys = self._found.curves, ("spot", "source", "scenario")
        joint = {scenario: fit for fit, scenario, spot in fitted if fit != spot}
        measured = (((spot, "measured", None), response) for spot, response in self.run.measured.items())
        shown = (
            ((spot, "fitted", scenario), response)
            for (fit, scenario, spot), response in fitted.items()
            if joint.get(scenario, fit) == fit
        )
        found = curves_of((*measured, *shown), keys)
        return found.select(*keys, "channel", "point", "abscissa", "ordinate")

    def material(self, region: str | None = None, *, spot: str | None = None) -> FittedMaterial:
        """Material of a region with the values of :attr:`headline`.

        Parameters
        ----------
        region : str, optional
            May be left out where the study has one.
        spot : str, optional
            Whose own values count where a parameter differs from spot to spot; the first when left out.

        Raises
        ------
        StudyError
            There is no such region or spot, or nothing was found.
        """
        regions = {each.region: each for each in self.study.space.regions}
        if (region is None and len(regions) > 1) or (region is not None and region not in regions):
            given = f"no region '{region}'" if region else "several regions"
            raise StudyError(f"{self.study.file}: {given}; name one of {', '.join(regions)}")
        spots = self.headline.spots
        if spot is not None and spot not in spots:
            raise StudyError(f"{self.study.file}: no fitted spot '{spot}'; name one of {', '.join(spots)}")
        chosen = regions[region or next(iter(regions))]
        inputs = inputs_at(self.study, spot or spots[0], self.headline.values, self.run.measured)
        every = self.study.space.written(inputs.thetas)
        values = {name: every[full] for name, full in chosen.full_names.items()}
        known = self.intervals.filter(pl.col("parameter").str.starts_with(f"{chosen.region}."))
        return FittedMaterial(region=chosen, values=values, intervals=known)

    def plot(self) -> "Figure":
        """Figure of the measured and the fitted curves of each spot, as the report draws it.

        Raises
        ------
        PluginError
            No installed plugin draws it.
        """
        for stage in self.run.stages.values():
            if isinstance(stage, CurveDrawer):
                return stage.draw_curves(self.run)
        raise PluginError("no plugin that draws curves is installed: pip install 'palpate[standard]'")


def open_run(folder: Path | str, plugins: Plugins | None = None) -> SavedRun:
    """Read a run from its folder; neither the study's files nor its meshes need exist.

    Parameters
    ----------
    folder : Path or str
        Run directory.
    plugins : Plugins, optional
        The installed ones when left out; a run with plugin files needs ``Plugins.load([file])``.

    Raises
    ------
    PalpateError
        The folder is no run, or its study cannot be read.
    """
    plugins = plugins or Plugins.load()
    return SavedRun(run=read_run(copied_study(Path(folder), plugins), RunDirectory(Path(folder)), plugins))


def copied_study(folder: Path, plugins: Plugins) -> Study:
    """A run's own copy of its study, with the original's files, or those that the run keeps."""
    original = study_file(folder, RunDirectory(folder).manifest())
    return read_study(folder / "study.toml", plugins, copy_of=original)
