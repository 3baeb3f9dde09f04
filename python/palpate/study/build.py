"""From the tables of study.toml to the parts of a Study: what the names in them mean."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import ValidationError

from palpate.domain import Indentation, ParameterSpace, Protocol, Scenario, channel_of, weighed_channels
from palpate.domain.component import Component
from palpate.errors import PalpateError
from palpate.plugins.catalogue import Catalogue, Plugins
from palpate.plugins.guard import answering_for
from palpate.plugins.parametrisation import Parametrisation
from palpate.plugins.score import ScoringRules
from palpate.study.model import ScenarioTable, SelectionTable, StudyFile
from palpate.study.problems import Problems, choice
from palpate.study.source_positions import Key

C = TypeVar("C", bound=Component)


@dataclass(frozen=True, slots=True)
class Context:
    """Context in which every part is built: the study file, what plugins provide, where mistakes go.

    With ``is_copy`` the files that the study names need not exist.
    """

    file: Path
    plugins: Plugins
    problems: Problems
    is_copy: bool = False


def build_components(context: Context, tables: StudyFile) -> dict[str, Any]:
    """Build every component that the file names, except the materials, as the fields of a study.

    None where a problem was found.
    """
    plugins = context.plugins

    def named(
        catalogue: Catalogue[type[C]], table: str, key: str, within: str = "settings", at: Key | None = None
    ) -> C | None:
        given = getattr(tables, table)
        if not (name := getattr(given, key, None)):
            return None
        return build_component(
            context, catalogue, name, getattr(given, within), (table, key), at or (table, within)
        )

    def several(
        catalogue: Catalogue[type[C]], given: Mapping[str, Mapping[str, object]], table: Key
    ) -> tuple[C, ...]:
        places = {name: (*table, name) for name in given}
        built = (build_component(context, catalogue, n, given[n], at, at) for n, at in places.items())
        return tuple(each for each in built if each is not None)

    score, rules = named(plugins.scores, "scoring", "score", at=("scoring",)), tables.scoring
    return {
        "loader": named(plugins.loaders, "experiment", "loader"),
        "limb_source": named(plugins.limb_sources, "limb", "source"),
        "sampler": named(plugins.samplers, "sampling", "sampler"),
        "filters": several(
            plugins.set_filters, tables.sampling.filters if tables.sampling else {}, ("sampling", "filters")
        ),
        "stages": several(plugins.stages, tables.stages, ("stages",)),
        "solver": named(plugins.solvers, "solver", "name"),
        "executor": named(plugins.executors, "executor", "name"),
        "scoring": score
        and ScoringRules(
            score=score, minimum_coverage=rules.minimum_coverage, rank_partial=rules.rank_partial
        ),
        "search": named(plugins.searches, "fit", "search"),
        "parametrisation": named(plugins.parametrisations, "fit", "parametrisation", "searched"),
    }


def build_component(
    context: Context,
    catalogue: Catalogue[type[C]],
    name: str,
    settings: Mapping[str, object],
    key: Key,
    settings_key: Key | None = None,
) -> C | None:
    """Build the component ``name``, which is at ``key``, from its settings next to it."""
    settings_key = settings_key or (*key[:-1], "settings")
    component: type[C] | None = None
    with context.problems.at(*key):
        component = catalogue[name]
    if component is None:
        return None
    files = {"folder": context.file.parent, "must_exist": not context.is_copy}
    try:
        checked = component.Settings.model_validate(dict(settings), context=files)
    except ValidationError as error:
        if other := _fits(catalogue, settings, files):
            context.problems.add(
                settings_key,
                f"these are settings of '{other}', not of '{name}'; name '{other}', or change them",
            )
        else:
            context.problems.add_invalid(settings_key, error, component.Settings)
        return None
    try:
        return component(checked)
    except (Exception, SystemExit) as error:
        why = str(error) if isinstance(error, PalpateError) else f"{type(error).__name__}: {error}"
        context.problems.add(settings_key, f"'{name}' cannot be made from these settings: {why}")
        return None


def _fits(catalogue: Catalogue[type[C]], settings: Mapping[str, object], files: Mapping[str, object]) -> str:
    """Component that settings of more than one key were written for; empty where there is none."""
    for name, component in catalogue.items() if settings else ():
        try:
            checked = component.Settings.model_validate(dict(settings), context=files)
        except ValidationError:
            continue
        if checked.model_fields_set:
            return name
    return ""


def build_scenarios(
    context: Context,
    selection: SelectionTable,
    own: Sequence[ScenarioTable],
    measured: Mapping[str, Collection[str | None]],
) -> tuple[Scenario, ...]:
    """Look up the scenarios to report, among the study's own and the plugins'.

    ``measured`` holds the channels that each spot has files for, None for files of several.
    """
    known: dict[str, Scenario] = dict(context.plugins.scenarios)
    for index, table in enumerate(own):
        if scenario := _own_scenario(context, table, ("scenario", index), known):
            known[scenario.name] = scenario
    chosen = []
    for index, name in enumerate(selection.scenarios):
        key: Key = ("selection", "scenarios", index)
        if name in selection.scenarios[:index]:
            context.problems.add(key, f"'{name}' is listed twice; list each scenario once")
        elif name in known:
            chosen.append(known[name])
            _check_channels(context, known[name], key, measured)
        elif name not in [table.name for table in own]:
            context.problems.add(key, choice(name, known, "scenario"))
    by = selection.generalise_by
    if by is not None and by not in selection.scenarios:
        context.problems.add(
            ("selection", "generalise_by"),
            f"'{by}' is not among the scenarios {', '.join(selection.scenarios)}; choose one of them",
        )
    return tuple(chosen)


def _own_scenario(
    context: Context, table: ScenarioTable, key: Key, known: Mapping[str, Scenario]
) -> Scenario | None:
    if table.name in known:
        context.problems.add((*key, "name"), f"a scenario '{table.name}' already exists; choose another name")
        return None
    known_channels = []
    for name in table.weights:
        with context.problems.at(*key, "weights", name):
            known_channels.append(context.plugins.channels[channel_of(name)])
    if len(known_channels) < len(table.weights):
        return None
    with context.problems.at(*key, "weights"):
        return Scenario(name=table.name, weights=table.weights, description=table.description)
    return None


def _check_channels(
    context: Context, scenario: Scenario, key: Key, measured: Mapping[str, Collection[str | None]]
) -> None:
    """Refuse a scenario of a channel that no spot measures, where the file names those they do."""
    found = set().union(*measured.values())
    if not measured or not found <= set(context.plugins.channels):
        return  # a file of several channels, or a mistake in the spots that is reported already
    missing = [c for c in map(channel_of, scenario.weighed) if c not in found]
    if missing:
        context.problems.add(
            key,
            f"scenario '{scenario.name}' weighs channel '{missing[0]}', which no spot measures; "
            "add its file or leave the scenario out",
        )


def check_parametrisation(
    context: Context,
    parametrisation: Parametrisation,
    tables: StudyFile,
    measured: Mapping[str, Collection[str | None]],
    scenarios: Sequence[Scenario],
) -> None:
    """Refuse what a parametrisation cannot search in this study, as far as the file shows it."""
    found = [channel for spot in measured.values() for channel in spot]
    channels = [] if None in found else weighed_channels(scenarios, filter(None, found))
    with context.problems.at("fit", "searched"), answering_for(parametrisation, "checking its settings"):
        for key, reason in parametrisation.unusable(channels, indents="protocol" in tables.model_fields_set):
            context.problems.add(("fit", "searched", *key), reason)


def check_budget(
    context: Context, tables: StudyFile, space: ParameterSpace, protocols: Iterable[Protocol | None]
) -> None:
    """Refuse spreads of unknown layers and channels, and of parameters that are searched or not physical."""
    budget, every_spot = tables.budget, enumerate(tables.spot)
    indenters = [protocol.indenter for protocol in protocols if isinstance(protocol, Indentation)]
    try:
        for indenter in indenters if budget.radius else ():
            indenter.grown(budget.radius)
            indenter.grown(-budget.radius)
    except PalpateError as error:
        context.problems.add(("budget", "radius"), str(error))
    regions = {region.region: None for region in space.regions}
    layers: list[Key] = [("spot", i, "layers", name) for i, spot in every_spot for name in spot.layers]
    layers += [("budget", "layers", name) for name in budget.layers if name]
    for place in layers if regions else ():
        if (region := str(place[-1])) not in regions:
            context.problems.add(place, choice(region, regions, "region"))
    channels = context.plugins.channels
    for key in ("mesh", "discrepancy"):
        for name in getattr(budget, key):
            if name and name not in channels:
                context.problems.add(("budget", key, name), choice(name, channels, "channel"))
    searched = {p.name for p in space.parameters}
    every = (name for r in space.regions for name in r.full_names.values())
    known = {name: None for name in every if name not in searched}
    room = {r.name_of(name): share for r in space.regions for name, share in r.room.items()}
    for name, sd in budget.parameters.items() if space.regions else ():
        if name in searched:
            reason = "is searched, so that its spread is the result; remove the key"
            context.problems.add(("budget", "parameters", name), reason)
        elif name not in known:
            context.problems.add(("budget", "parameters", name), choice(name, known, "parameter"))
        elif sd > room.get(name, np.inf):
            reason = f"{sd:g} of its value leads out of its physical range; give {room[name]:.2g} or less"
            context.problems.add(("budget", "parameters", name), reason)
