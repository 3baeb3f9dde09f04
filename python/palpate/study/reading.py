"""study.toml → Study: every name, unit and range checked, with the line in the message."""

import re
import tomllib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import TypeAdapter, ValidationError

from palpate.domain import (
    Channel,
    Indentation,
    MeshConvergence,
    ParameterSpace,
    Protocol,
    Refinement,
    Scenario,
)
from palpate.domain.channels import EQUILIBRIUM_CHANNELS, PRESS_AND_TWIST
from palpate.errors import PluginError, StudyError
from palpate.plugins.catalogue import Plugins
from palpate.plugins.execution import Executor
from palpate.plugins.interfaces import ExperimentLoader, LimbSource, Sampler, SetFilter, Solver
from palpate.plugins.parametrisation import Parametrisation
from palpate.plugins.registry import suggestion
from palpate.plugins.score import ScoringRules
from palpate.plugins.search import Search
from palpate.study.build import (
    Context,
    build_components,
    build_scenarios,
    check_budget,
    check_parametrisation,
)
from palpate.study.model import BudgetTable, ExecutorTable, LimbTable, StudyFile
from palpate.study.problems import ModelT, Problems
from palpate.study.regions import build_space, build_truth, display_units
from palpate.study.solver_checks import check_solver, check_times, named_protocols, relaxing_parts
from palpate.study.source_positions import MOST_SIMULATIONS, KeyLines, check_plain, dotted
from palpate.study.spots import StudySpot, build_protocol, build_spots
from palpate.toml_text import ASKED

__all__ = ["Study", "StudySpot", "read_options", "read_study", "relative", "with_study_plugins"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """A checked study, with its components built from their settings.

    Parameters
    ----------
    file : Path
        The study file; paths inside it are relative to its folder.
    data : {"measured", "simulated"}
        Whether the experiment is real; shown wherever results are.
    loader, protocol
        What the study does wherever a spot does not say otherwise: see :meth:`loader_at` and
        :meth:`protocol_at`. No protocol: homogeneous tests along the measured abscissae.
    scoring : ScoringRules
        How simulated curves are compared with measured ones.
    generalise_by : str
        Name of the scenario whose mean over the spots decides the generalised set.
    truth : mapping of full parameter name to value
        Known answer of a simulated experiment, in the region's convention; empty otherwise.
    units : mapping of full parameter name to unit
        In which its range is written, where that is not the material's; reports have it.
    n_workers : int
        Local worker processes; 0: one per core, as far as there is memory for them.
    time_limit_s : float
        Longest time that one simulation may take.
    executor : Executor, optional
        Where the simulations run; by itself in worker processes of this machine.
    memory_limit_MB : float
        Most memory that one simulation may take; 0: no limit.
    n_attempts : int
        Worker crashes tolerated per job.
    meshes : LimbTable
        Treatment of the meshes that the limb source reads.
    cache : Path, optional
        Folder of results shared with other studies.
    channels : mapping of name to Channel
        Those that plugins declare.
    search, parametrisation
        How a fit is found, and what it searches.
    noise : float
        Relative misfit (root of NMSE) that one standard deviation of a prior is worth.
    fine_runs : int
        Most simulations of each spot's finer mesh that correct a fit.
    fine_nodes : int
        Nodes up to which a run refines its finer meshes further by itself.
    budget : BudgetTable
        What the curves and the model may be wrong by.
    stages : tuple of Component
        Stages that a run includes besides its own, with their settings.
    n_total : int
        Sets that the design of ``n_sets`` is extended, or cut, to; 0: neither.
    trusted : mapping of component to fingerprint
        Fingerprints of earlier code whose results count as results of the present code, by
        ``material:NAME`` or ``solver:NAME``.
    """

    name: str
    description: str
    file: Path
    data: Literal["measured", "simulated"]
    spots: tuple[StudySpot, ...]
    loader: ExperimentLoader
    limb_source: LimbSource | None
    protocol: Protocol | None
    space: ParameterSpace
    sampler: Sampler
    n_sets: int
    max_draws: int = 0
    seed: int
    filters: tuple[SetFilter, ...]
    solver: Solver
    scoring: ScoringRules = field(default_factory=ScoringRules)
    scenarios: tuple[Scenario, ...]
    generalise_by: str
    truth: Mapping[str, float]
    n_workers: int
    time_limit_s: float
    plugin_files: tuple[Path, ...]
    executor: Executor | None = None
    memory_limit_MB: float = 0.0
    n_attempts: int = 2
    meshes: LimbTable = field(default_factory=lambda: LimbTable(source=""))
    cache: Path | None = None
    channels: Mapping[str, Channel] = field(
        default_factory=lambda: {channel.name: channel for channel in EQUILIBRIUM_CHANNELS}
    )
    search: Search
    parametrisation: Parametrisation
    units: Mapping[str, str] = field(default_factory=dict)
    noise: float = 0.01
    fine_runs: int = 3
    fine_nodes: int = 0
    budget: BudgetTable = field(default_factory=BudgetTable)
    stages: tuple[Any, ...] = ()
    n_total: int = 0
    trusted: Mapping[str, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        searched = ", ".join(p.name for p in self.space.parameters)
        return (
            f"Study({self.name!r}: {self.n_total or self.n_sets} sets of {searched} at {len(self.spots)} "
            f"spot{'' if len(self.spots) == 1 else 's'}, solver {self.solver.name})"
        )

    def models_relaxation(self, scenario: Scenario) -> bool:
        """True if a region relaxes, or the parametrisation has the relaxation of what a scenario weighs."""
        return self.space.relaxes or self.parametrisation.models_relaxation(scenario)

    @property
    def relaxes(self) -> bool:
        """True if moduli are those at once, since something relaxes: all of them, or a region's stress."""
        return bool(self.parametrisation.times_s) or self.space.relaxes

    @property
    def modulus_unit(self) -> str:
        """Unit of the first searched modulus that the study has one for; else MPa."""
        moduli = (p.name for p in self.space.parameters if p.kind == "modulus")
        return next((self.units[name] for name in moduli if name in self.units), "MPa")

    @property
    def given_plugins(self) -> list[Path]:
        """Plugin files that the study does not name, so that a command on it has to name them."""
        try:
            named = {path.resolve() for path in study_plugins(self.file)}
        except StudyError:  # the file is not there any more, or is being edited
            named = set()
        return [path for path in self.plugin_files if path.resolve() not in named]

    @property
    def record_s(self) -> float:
        """End of the longest motion [s]; 0 where none has times."""
        protocols = map(self.protocol_at, self.spot_names)
        times = (p.time_s for p in protocols if isinstance(p, Indentation))
        return max((float(each[-1]) for each in times if each is not None), default=0.0)

    @property
    def folder(self) -> Path:
        """Folder of the study file."""
        return self.file.parent

    @property
    def spot_names(self) -> tuple[str, ...]:
        """Names of the spots, in the order of the study file."""
        return tuple(spot.spot.name for spot in self.spots)

    @property
    def generalising(self) -> Scenario:
        """Scenario whose mean Fopt over the spots decides the generalised set."""
        return next(s for s in self.scenarios if s.name == self.generalise_by)

    @property
    def notice(self) -> str:
        """Notice on every picture of the data."""
        return "simulated data, not a measurement" if self.data == "simulated" else ""

    def loader_at(self, spot: str) -> ExperimentLoader:
        """Loader of the files of a spot."""
        return self._at(spot).loader or self.loader

    def protocol_at(self, spot: str) -> Protocol | None:
        """Motion at a spot; None for homogeneous tests."""
        return self._at(spot).protocol or self.protocol

    def degree(self, channel: str) -> int:
        """Degree of a channel in the moduli."""
        return self.channels[channel].degree if channel in self.channels else 1

    def mesh_convergence(self, channel: str) -> MeshConvergence:
        """Error of a channel's curve by the mesh, and its fall with the element size."""
        return self.channels[channel].mesh if channel in self.channels else MeshConvergence()

    def left_over(self, refinement: Refinement) -> dict[str, float]:
        """Error of a finer mesh over the difference of both meshes, by channel."""
        return {name: refinement.left_over(channel.mesh) for name, channel in self.channels.items()}

    def observed(self, channels: Iterable[str]) -> tuple[Channel, ...]:
        """Columns of equilibrium states that a job asks for, so that it answers these channels.

        These are force and torque, and each of ``channels`` that the solver does not declare by name and
        has the columns of.
        """
        provides, more = self.solver.provides, dict.fromkeys(channels)
        for name in [*provides.channels, *(channel.name for channel in PRESS_AND_TWIST)]:
            more.pop(name, None)
        known = [self.channels[name] for name in more if name in self.channels]
        return (*PRESS_AND_TWIST, *(c for c in known if provides.computes(c)))

    def site_of(self, name: str) -> str:
        """Return the first spot at the same place of the same limb: its presses share a discrepancy."""
        spot = self._at(name)
        return next(each.spot.name for each in self.spots if each.is_where(spot))

    def measured_layers_mm(self, name: str) -> dict[str, tuple[float, float]]:
        """Thickness of layers at a spot's place with its standard deviation, where it was measured."""
        here = [spot for spot in self.spots if spot.is_where(self._at(name))]
        return {region: found for spot in reversed(here) for region, found in spot.layers_mm.items()}

    def place(self, *key: str | int) -> str:
        """File, line and name of a key, as messages start; without the line where the file is gone."""
        try:
            text, raw = parse_toml(self.file)
        except StudyError:
            return f"{self.file}: {dotted(key)}"
        return Problems(self.file, KeyLines(text), raw).place(key)

    def _at(self, name: str) -> StudySpot:
        return next(spot for spot in self.spots if spot.spot.name == name)


def read_study(
    path: Path | str,
    plugins: Plugins | None = None,
    *,
    need_measured: bool = True,
    copy_of: Path | None = None,
) -> Study:
    """Read and check a study file.

    Parameters
    ----------
    path : Path or str
        A study.toml, or the folder that holds one.
    plugins : Plugins, optional
        Where the names in the file are looked up; the installed ones when left out.
    need_measured : bool
        Whether the files of measured curves must exist; False before an experiment.
    copy_of : Path, optional
        The study file that ``path`` is a run's copy of. Its folder is the one that paths are
        relative to, no file that it names must exist, and ``plugins`` has its plugin files.

    Raises
    ------
    StudyError
        Listing everything that is wrong, each with line, key and what to do.
    """
    path = _study_file(path)
    if copy_of is None or plugins is None:
        plugins = with_study_plugins(path, plugins)
    text, raw = parse_toml(path)
    problems = Problems(path, KeyLines(text), raw)
    context = Context((copy_of or path).resolve(), plugins, problems, is_copy=copy_of is not None)
    return _build(context, _tables(raw, problems, text), need_measured)


def with_study_plugins(path: Path | str, plugins: Plugins | None = None) -> Plugins:
    """Add the one-file plugins that a study names to others, the installed ones when left out.

    A StudyError where the study file cannot be read, or a plugin file does not exist.
    """
    plugins = plugins or Plugins.load()
    try:
        return plugins.with_files(study_plugins(path))
    except PluginError as error:
        raise StudyError(f"{_study_file(path)}: [study] plugins: {error}") from None


def study_plugins(path: Path | str) -> list[Path]:
    """Plugin files that a study names, none of which is executed; a StudyError where it cannot be read."""
    path = _study_file(path)
    header = parse_toml(path)[1].get("study")
    named = header.get("plugins", []) if isinstance(header, dict) else []
    is_list = isinstance(named, list) and all(isinstance(name, str) for name in named)
    return [path.parent / name for name in named] if is_list else []  # the check of the tables reports it


def read_options(path: Path | None, model: type[ModelT], given: Mapping[str, Any]) -> ModelT:
    """Options of a command, from a TOML file and from those ``given`` on the command line, which come first.

    Validators find in their context the ``file`` and its ``folder``, and ``given``.

    Raises
    ------
    StudyError
        Everything that is wrong, with line, key and what to do.
    """
    if path is not None and not path.is_file():
        raise StudyError(f"{path}: no such file of options; check the path")
    text, raw = parse_toml(path) if path is not None else ("", {})
    folder = Path() if path is None else path.parent
    problems = Problems(path or folder, KeyLines(text), raw, given)
    return problems.validated(model, {**raw, **given}, {"file": path, "folder": folder, "given": given})


def _study_file(path: Path | str) -> Path:
    return Path(path) / "study.toml" if Path(path).is_dir() else Path(path)


def relative(file: Path, folder: Path) -> str:
    """Path from the study's folder; the bare name of a file in another folder."""
    inside = file.resolve().is_relative_to(folder.resolve())
    return file.resolve().relative_to(folder.resolve()).as_posix() if inside else file.name


def parse_toml(path: Path) -> tuple[str, dict[str, Any]]:
    """Text of a TOML file and what it holds; a StudyError where it is none."""
    try:
        text = path.read_bytes().decode("utf-8-sig").replace("\r\n", "\n")
        raw = tomllib.loads(text)
        check_plain(raw)
        return text, raw
    except FileNotFoundError:
        raise StudyError(f"{path}: no such file; `palpate init` makes a study to start from") from None
    except OSError as error:
        raise StudyError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    except UnicodeDecodeError as error:
        raise StudyError(f"{path}: byte {error.start} is not UTF-8; save the file as UTF-8 text") from None
    except tomllib.TOMLDecodeError as error:
        raise StudyError(f"{path}: invalid TOML: {error}; fix the syntax") from None
    except RecursionError:
        raise StudyError(f"{path}: tables or arrays nested too deep; make them flatter") from None
    except ValueError as error:
        raise StudyError(f"{path}: {error}") from None


def _tables(raw: Mapping[str, Any], problems: Problems, text: str) -> StudyFile:
    """Check the shape of a study file, table by table, so that one bad table hides no other.

    A required table that is absent or not valid is None or empty, another one has its defaults.
    """
    valid: dict[str, Any] = {"spot": [], "region": {}}
    for name, declared in StudyFile.model_fields.items():
        if declared.is_required():
            valid.setdefault(name, None)
        try:
            if name in raw:
                table: Any = Annotated[declared.annotation, declared]
                valid[name] = TypeAdapter(table).validate_python(raw[name])
            elif declared.is_required():
                commented = re.search(rf"((?:^#.*\n)+)# \[{name}\]$", text, re.MULTILINE)
                asked = re.findall(f"^# {ASKED}: (.+)", commented[1], re.MULTILINE) if commented else []
                how = f"is in comments; {ASKED}: {'; '.join(asked)}; then remove the # before its lines"
                problems.add((), f"table [{name}] {how}" if asked else f"missing table [{name}]; add it")
        except ValidationError as error:
            problems.add_invalid((name,), error, declared.annotation)
    for name in raw.keys() - StudyFile.model_fields.keys():
        known = tuple(StudyFile.model_fields)
        problems.add((name,), f"unknown table{suggestion(name, known)} (known: {', '.join(known)})")
    return StudyFile.model_construct(_fields_set=set(raw), **valid)


def _build(context: Context, tables: StudyFile, need_measured: bool) -> Study:
    header, sampling, selection = tables.study, tables.sampling, tables.selection
    parts = build_components(context, tables)
    spots = build_spots(context, tables, need_measured)
    protocol = build_protocol(context, tables.protocol) if tables.protocol else None
    states = {each.spot.name: each.state for each in spots if each.state}
    space = replace(build_space(context, tables.region), states=states)
    measured = {spot.spot.name: spot.measured.keys() for spot in spots}
    scenarios = build_scenarios(context, selection, tables.scenario, measured) if selection else ()
    truth = build_truth(context, tables, space)
    presses = [protocol, *(each.protocol for each in spots)]
    _refuse_problems(context, tables, parts, space, scenarios, presses, measured)
    fit, limits = tables.fit, tables.executor or ExecutorTable()
    return Study(
        **parts,
        name=header.name,
        description=header.description,
        file=context.file,
        data=header.data,
        spots=spots,
        protocol=protocol,
        space=space,
        n_sets=sampling.n_sets,
        max_draws=sampling.max_draws,
        seed=sampling.seed,
        scenarios=scenarios,
        generalise_by=selection.generalise_by or scenarios[0].name,
        truth=truth,
        units=display_units(tables.region, space),
        n_workers=tables.solver.n_workers,
        time_limit_s=tables.solver.time_limit,
        plugin_files=context.plugins.files,
        channels=dict(context.plugins.channels),
        meshes=tables.limb or LimbTable(source=""),
        noise=fit.noise,
        fine_runs=fit.fine_runs,
        fine_nodes=fit.fine_nodes,
        budget=tables.budget,
        memory_limit_MB=limits.memory_limit or 0.0,
        n_attempts=limits.attempts,
        cache=context.file.parent / limits.cache if limits.cache else None,
    )


def _refuse_problems(
    context: Context,
    tables: StudyFile,
    parts: Mapping[str, Any],
    space: ParameterSpace,
    scenarios: tuple[Scenario, ...],
    protocols: Sequence[Protocol | None],
    measured: Mapping[str, Collection[str | None]],
) -> None:
    """Refuse a study with problems, those too of tables that do not go together."""
    _check_sizes(context, tables, parts["executor"])
    check_budget(context, tables, space, protocols)
    if parts["solver"]:
        check_solver(context, parts["solver"], tables, space, scenarios, protocols)
    if parametrisation := parts["parametrisation"]:
        check_times(context, relaxing_parts(space, parametrisation), named_protocols(protocols))
        check_parametrisation(context, parametrisation, tables, measured, scenarios)
    context.problems.raise_if_any()


def _check_sizes(context: Context, tables: StudyFile, executor: Executor | None) -> None:
    """Refuse too many simulations or draws, and limits that the executor does not keep."""
    n_simulations = len(tables.spot) * (tables.sampling.n_sets if tables.sampling else 0)
    if n_simulations > MOST_SIMULATIONS:
        context.problems.add(
            ("sampling", "n_sets"),
            f"{n_simulations} simulations, and a study has at most {MOST_SIMULATIONS}; use fewer sets",
        )
    if tables.sampling and 0 < tables.sampling.max_draws < tables.sampling.n_sets:
        context.problems.add(("sampling", "max_draws"), "less than n_sets; raise it, or leave it out")
    limit = tables.executor and tables.executor.memory_limit
    if executor and limit is not None and not executor.holds_limits:
        context.problems.add(
            ("executor", "memory_limit"),
            f"executor '{executor.name}' holds no job to it; leave it out, or name another executor",
        )
