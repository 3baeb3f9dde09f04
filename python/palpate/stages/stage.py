"""A stage of a study, and the run that it reads: command, files, JSON, status and section follow from it."""

import contextlib
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Self, cast

import polars as pl

from palpate.answer.table import FIT, Results, answer_table, searched_parameters
from palpate.domain import Channel, Design, Limb, Response, Simulation, SurfaceStates
from palpate.domain.component import Component, SettingsT
from palpate.errors import PluginError, StudyError, typed
from palpate.fit.fitted import Fitted, fitted
from palpate.fit.stage import Case
from palpate.fit.surfaces import stored_strains, stored_surfaces
from palpate.limb.loading import load_limbs, with_edges
from palpate.plugins.catalogue import Plugins
from palpate.plugins.guard import answering_for
from palpate.plugins.sections import Section, Summary
from palpate.plugins.table import StageTable
from palpate.progress import SILENT, Progress
from palpate.run.directory import RunDirectory
from palpate.run.keys import answers_key
from palpate.run.provenance import described, fingerprint
from palpate.run.result import FIRST_ANSWER, FitResult, StudyInputs
from palpate.run.result_files import Files
from palpate.run.tables import ASSESSED, OF_A_FIT
from palpate.simulation import jobs as simulation
from palpate.simulation.cost import SWEEP, n_workers
from palpate.simulation.forecast import Forecast, Part
from palpate.simulation.processor_time import ProcessorTime
from palpate.simulation.sweep import Simulations
from palpate.stages.order import in_order
from palpate.study.reading import Study


class Stage(Component[SettingsT]):
    """A step from tables to tables: the core's own, such as ``fit``, or a plugin's.

    ``palpate NAME STUDY`` runs it, and ``palpate run`` does after the stages that it needs where the study
    has a table ``[stages.NAME]``, which holds its settings. Its tables are files of the run directory,
    refused once anything that decided them has changed.
    """

    needs: ClassVar[tuple[str, ...]] = ()
    """Stages whose results it reads."""

    tables: ClassVar[Mapping[str, StageTable]] = MappingProxyType({})
    """Tables that it makes, with their columns; ``name`` is the file ``name.parquet``."""

    may_fail: ClassVar[bool] = True
    """True if ``palpate run`` goes on, with a warning, where it cannot be made."""

    of_every_run: ClassVar[bool] = False
    """True if ``palpate run`` always includes it."""

    comes_last: ClassVar[bool] = False
    """True if ``palpate run`` makes it after all others, whose results it may read."""

    code_decides: ClassVar[bool] = True
    """True if results are stale once its code has changed; a release of palpate keeps those of its own."""

    is_on_page: ClassVar[bool] = False
    """True if the page has sections on its tables, so that its summary is not another one."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        for name, table in cls.tables.items():
            if not isinstance(table, StageTable):
                raise TypeError(f"class {cls.__name__}: table '{name}' is no palpate.api.StageTable")

    def is_in_run(self, study: Study) -> bool:
        """True if ``palpate run`` includes the stage though the study has no table ``[stages.NAME]``."""
        return self.of_every_run

    one_after_other: ClassVar[bool] = False
    """True if a spot's simulations wait for each other, as in a search."""

    def usual_simulations(self, inputs: "Run") -> Mapping[str, int] | None:
        """Usual number of simulations on each mesh, by limb name; None where nobody can know.

        Those that an earlier stage of the run has made do not count.
        """
        return {}

    def check(self, study: Study) -> None:
        """Refuse a study that the stage's settings do not fit, before anything is simulated.

        Raises
        ------
        StudyError
            A setting that does not fit, and what to do.
        """

    def decides(self, study: Study) -> Mapping[str, object]:
        """Plain values of a study that decide the result, by their names in messages.

        What the needed stages have found counts anyway, and the settings and code of a plugin's stage do.
        A value None is not compared.
        """
        return {}

    @abstractmethod
    def run(self, inputs: "Run", progress: Progress) -> Files:
        """Tables by name, made from tables of the needed stages.

        Parameters
        ----------
        inputs : Run
            Study, measured curves, design and limbs; ``inputs.table(name)`` is a table of a needed stage,
            ``inputs.simulations.of(jobs)`` simulates, or finds what has been simulated already.

        Raises
        ------
        PalpateError
            The tables cannot be made, and what to do.
        """

    def show_so_far(self, inputs: "Run", first: Case | None = None) -> None:
        """Show a run that was stopped, or assess or show the ``first`` fit: ``shared[FIRST_ANSWER]``."""

    def again(self, inputs: "Run") -> StudyInputs | None:
        """Inputs with which ``palpate run`` makes the fit, and the stages up to this one, once more.

        None, as here, where the results are good enough.
        """
        return None

    def summarise(self, inputs: "Run") -> Summary:
        """Summary of the tables that the run holds; by itself the tables as they are."""
        found = {name: inputs.table(name) for name in self.tables}
        titles = {name: name.replace("_", " ").capitalize() for name in found}
        return Summary(tables={titles[name]: table for name, table in found.items() if not table.is_empty()})


@dataclass(kw_only=True, eq=False)
class Run:
    """A run directory read back by a study, as a context where anything is simulated.

    Parameters
    ----------
    study : Study
        With the answers of earlier code that the run trusts.
    channels : mapping of name to Channel
        Those that plugins declare.
    sections : mapping of name to type of Section
        Sections of the page.
    check_lock : callable
        Raises where the lock on the folder, which the caller holds, is lost.
    fresh : StudyInputs, optional
        Inputs as the study's files are now, if just read.
    is_copy : bool
        Whether the study is the run's copy: meshes need not exist; simulations are the last sweep's.
    more_limbs : mapping of limb name to Limb
        Those that are simulated besides the study's.
    forecast : Forecast
        Simulations that the command has still to make.
    is_quick : bool
        Whether the command ends with the first answer.
    is_again : bool
        Whether all its simulations are kept, so that none is forecast.
    """

    study: Study
    directory: RunDirectory
    stages: "Mapping[str, Stage]" = field(default_factory=dict)
    channels: Mapping[str, Channel] = field(default_factory=dict)
    sections: Mapping[str, type[Section]] = field(default_factory=dict)
    progress: Progress = SILENT
    check_lock: Callable[[], None] = lambda: None
    fresh: StudyInputs | None = None
    is_copy: bool = False
    more_limbs: Mapping[str, Limb] = field(default_factory=dict)
    forecast: Forecast = field(default_factory=Forecast)
    is_quick: bool = False
    is_again: bool = False
    shared: dict[str, Any] = field(default_factory=dict)
    """Values that a stage leaves in memory for those after it."""
    _opened: contextlib.ExitStack = field(default_factory=contextlib.ExitStack)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self._opened.__exit__(*raised)  # type: ignore[arg-type]

    @cached_property
    def inputs(self) -> StudyInputs:
        """Design and measured curves as they were stored, limbs as their files are now.

        Raises
        ------
        StudyError
            They were made from other inputs than the study has now.
        """
        if self.fresh is not None:
            return self.fresh
        study, stored = self.study, self.directory
        design, measured = stored.design(), stored.measured(study.spot_names)
        if not self.is_copy:
            self.check("experiment", "sample")
        chosen = self.current("fine_meshes")
        edges_mm = {row["spot"]: row["edge_mm"] for row in chosen.iter_rows(named=True)}
        limbs = load_limbs(with_edges(study, edges_mm), to_show=self.is_copy)
        shown = study.spot_names if self.is_copy and study.solver.provides.mesh else ()
        for name in (each for each in shown if each not in limbs):
            self.progress.note(f"warning: no limb is shown at spot '{name}': its mesh is missing")
        return StudyInputs(measured=measured, limbs=limbs, design=design, edges_mm=edges_mm)

    def with_inputs(self, inputs: StudyInputs) -> Self:
        """The run with other inputs, from which nothing has been made; it lets its workers go."""
        self._opened.close()
        run = replace(self, fresh=inputs, shared={})
        run.spent = self.spent
        return run

    @property
    def measured(self) -> Mapping[str, Response]:
        """Measured curves by spot."""
        return self.inputs.measured

    @property
    def design(self) -> Design:
        """Parameter sets of the sweep."""
        return self.inputs.design

    @property
    def limbs(self) -> Mapping[str, Limb]:
        """Limbs by name, empty where the solver needs none."""
        return self.inputs.limbs

    @cached_property
    def simulations(self) -> Simulations:
        """Simulations, each made once and kept in the run; open until the run's context ends."""
        limbs = {**self.limbs, **self.more_limbs}
        given = self.study, self.directory.folder, limbs, self.progress, self.check_lock, self.forecast
        return self._opened.enter_context(Simulations(*given, self.spent.simulated))

    @cached_property
    def spent(self) -> ProcessorTime:
        """Processor time that this command spends on the run."""
        return ProcessorTime.of_command(self.directory.folder, self.progress)

    def expect(self, stages: Iterable[Stage]) -> None:
        """Forecast the simulations of the stages that are to come."""
        parts = [] if self.is_again else self.parts(stages)
        self.forecast.expect(parts, self.limbs if any(part.n for part in parts) else {})
        if self.forecast.is_whole:
            self.progress.expect(self.forecast.n_left, self.forecast.seconds_left)

    def parts(self, stages: Iterable[Stage]) -> list[Part]:
        """Usual simulations of each of these stages, of those that simulate."""
        n_spots = len(self.study.spots)
        found = []
        for stage in stages:
            with answering_for(stage, "asking how many simulations it needs"):
                counts = stage.usual_simulations(self)
            if counts != {}:
                at_once = n_spots if stage.one_after_other else 0
                found.append(Part(stage=stage.name, counts=counts, side_by_side=at_once))
        return found

    def swept(self) -> tuple[Simulation, ...]:
        """Simulations of the sweep that have ended."""
        if SWEEP not in self.shared:
            limbs = None if self.is_copy else self.limbs
            folder = self.directory.folder
            self.shared[SWEEP] = simulation.stored(self.study, self.design, limbs, self.measured, folder)
        return cast("tuple[Simulation, ...]", self.shared[SWEEP])

    def table(self, name: str, stage: str = "") -> pl.DataFrame:
        """Table by name; without rows where there is none, unless ``stage`` names the stage that makes it.

        Raises
        ------
        StudyError
            Its file is damaged, or missing and must be there.
        """
        found = self.directory.table(name, stage)
        return found if found.width else self._empty(name)

    def current(self, name: str) -> pl.DataFrame:
        """Table that was made from what the stages before its own have now; else without rows."""
        made = any(map(self.directory.records.is_current, self._makers(name)))
        return self.table(name) if made else self._empty(name)

    def _makers(self, *names: str) -> list[str]:
        return [stage.name for stage in self.stages.values() if not stage.tables.keys().isdisjoint(names)]

    def _empty(self, name: str) -> pl.DataFrame:
        declared = (stage.tables.get(name) for stage in self.stages.values())
        return next(filter(None, declared), ASSESSED.get(name, StageTable(""))).empty()

    def fitted(self) -> Fitted:
        """Values that the run has found for all spots together."""
        self.check("select")
        chosen, general = (self.table(name, "select") for name in ("selection", "generalisation"))
        fit, folder, records = self.fit(), self.directory.folder, self.directory.records
        if fit.table.is_empty() and chosen.is_empty() and general.is_empty() and records.is_going_on:
            raise StudyError(
                f"{folder}: the run has not ended, and nothing is fitted or selected yet; finish the run: "
                f"`palpate run {typed(folder)}`"
            )
        found = fitted(self.study, chosen, general, fit)
        return replace(found, source=FIRST_ANSWER) if found.source == FIT and self.is_first_answer else found

    @property
    def is_first_answer(self) -> bool:
        """True if the fit is the first answer of a run whose whole fit has not ended."""
        records, stage = self.directory.records, self.stages.get("fit")
        if stage is None or not records.has(FIRST_ANSWER):
            return False
        try:
            records.check(FIRST_ANSWER, self.made_from(stage))
        except StudyError:
            return False
        return True

    def fit(self) -> FitResult:
        """Result of the fit, or else its first answer, with intervals where their stage is installed.

        Empty where there is none.
        A StudyError where it, or its intervals, were made from something else than the study has now.
        """
        if self.is_first_answer:
            return self.directory.fit(is_first=True)
        assessors = self._makers(*OF_A_FIT)
        self.check(*filter(self.directory.records.has, ("fit", *assessors)))
        found = self.directory.fit()
        return found if assessors else found.without_assessment()

    def answer(self) -> pl.DataFrame:
        """Every value that was found, with the columns of :data:`palpate.answer.table.OF_ANSWER`.

        In the units of the materials; by the present fit, intervals and sweep.
        """
        self.check("select")
        chosen, general = (self.table(name, "select") for name in ("selection", "generalisation"))
        study, design, fit = self.study, self.design, self.fit()
        found = answer_table(
            Results(
                study=study,
                spots=tuple(self.measured),
                searched=searched_parameters(study, design, fit),
                design=design,
                selection=chosen,
                generalisation=general,
                identifiability=self.current("identifiability"),
                fit=fit,
            )
        )
        if self.is_first_answer:
            return found.with_columns(pl.col("source").replace(FIT, FIRST_ANSWER))
        return found

    def surfaces(self) -> Mapping[str, SurfaceStates]:
        """States of the skin by spot, as ``palpate surface`` has simulated them; empty where it has not."""
        return stored_surfaces(self.directory.folder, self.current("surface"))

    def strains(self) -> dict[str, dict[str, Any]]:
        """Strains by spot and region under that press; empty without ``palpate surface``."""
        return stored_strains(self.directory.folder, self.current("surface"))

    # ------------------------------------------------------------------ what results were made from

    def made_from(self, stage: "Stage") -> dict[str, str]:
        """Fingerprints of all that decides the result of a stage, by what messages call it."""
        with answering_for(stage, "asking for its inputs"):
            values = stage.decides(self.study)
        found = {what: "" if value is None else fingerprint(value) for what, value in values.items()}
        found |= {f"results of `palpate {need}`": self._fingerprint(need) for need in stage.needs}
        if stage.code_decides:
            found["settings or code of the stage"] = fingerprint(described(stage))
        return found

    def _fingerprint(self, stage: str) -> str:
        return answers_key(self.swept()) if stage == SWEEP else self.directory.records.fingerprint(stage)

    def check(self, *names: str) -> None:
        """Refuse results that were made from something else than the study has now, the earliest first.

        Raises
        ------
        StudyError
            A result is missing or stale, and which stage makes it again.
        """
        for stage in in_order(self.stages, names):
            if self.is_copy and not stage.needs:
                continue  # the files of the study need not exist
            self._require(stage)
            if stage.name == "score":
                self._check_simulated()
            if stage.tables:
                self.directory.records.check(stage.name, self.made_from(stage))

    def require(self, *names: str) -> None:
        """Refuse to continue where a needed stage has not been run: a StudyError with the earliest to run."""
        for stage in in_order(self.stages, names):
            self._require(stage)

    def _require(self, stage: "Stage") -> None:
        if stage.tables and not self.directory.records.has(stage.name):
            # Without a sweep most of the stages make empty tables, which nobody calls one by one.
            command = stage.name if self.study.n_sets else "run"
            self.directory.records.refuse_missing(stage.name, next(iter(stage.tables)), command)

    def _check_simulated(self) -> None:
        """Refuse scores of simulations that are not the study's."""
        n_found = len(self.swept())
        n_scored = self.table("scores").select("spot", "set_id").n_unique()
        if n_found < n_scored:
            raise StudyError(
                f"{self.directory.folder}: {n_scored - n_found} of {n_scored} scored simulations do not "
                "belong to the present study: a mesh, a material, the solver, its settings or a version has "
                "changed since; run `palpate run` again; add `--fork FOLDER` to keep this run"
            )

    def make(self, stage: "Stage", made_from: Mapping[str, str] | None = None) -> None:
        """Run a stage, and write its tables with what they were made from.

        Parameters
        ----------
        made_from : mapping, optional
            As :meth:`made_from` returned it before the files of the study were read.

        Raises
        ------
        PalpateError
            The stage cannot be run, or its plugin made a mistake.
        """
        made_from = self.made_from(stage) if made_from is None else made_from
        with self.spent.charging(stage.name), answering_for(stage, "running it"):
            found = stage.run(self, self.progress)
        for name, table in found.items():
            if name.partition(".")[0].partition("/")[0] not in stage.tables:
                raise PluginError(
                    f"stage '{stage.name}' made table '{name}', which it does not declare in `tables`"
                )
            if not isinstance(table, Mapping if name.endswith(".json") else (pl.DataFrame, Path)):
                raise PluginError(
                    f"stage '{stage.name}' gave {type(table).__name__} as table '{name}'; give a DataFrame "
                    "of polars"
                )
        if stage.tables:
            self.directory.write_stage(stage.name, found, made_from)


def read_run(
    study: Study,
    directory: RunDirectory,
    plugins: Plugins,
    progress: Progress = SILENT,
    *,
    is_copy: bool = True,
    check_lock: Callable[[], None] = lambda: None,
    more_limbs: Mapping[str, Limb] = MappingProxyType({}),
) -> Run:
    """Run directory read back, by default by its own copy of the study; arguments as of :class:`Run`."""
    trusted = directory.with_trusted_code(study)
    return Run(
        study=trusted,
        directory=directory,
        stages=stages_of(trusted, plugins),
        channels=plugins.channels,
        sections=plugins.sections,
        progress=progress,
        is_copy=is_copy,
        check_lock=check_lock,
        more_limbs=more_limbs,
        forecast=Forecast(n_workers=n_workers(study)),
    )


def stages_of(study: Study, plugins: Plugins) -> dict[str, Stage]:
    """Stages by name: with the settings of a study where it has some, else with their defaults."""
    given = {stage.name: stage for stage in study.stages}
    for stage in given.values():
        stage.check(study)
    return {
        name: given.get(name) or kind()
        for name, kind in plugins.stages.items()
        if name in given or not any(f.is_required() for f in kind.Settings.model_fields.values())
    }
