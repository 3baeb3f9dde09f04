"""Refuse a study that asks for more than its solver provides, or gives what it would not use."""

from collections.abc import Iterable, Iterator, Sequence

from palpate.domain import Indentation, ParameterSpace, Protocol, Scenario, channel_of
from palpate.domain.indenter import Indenter
from palpate.plugins.interfaces import Solver
from palpate.plugins.parametrisation import Parametrisation
from palpate.study.build import Context
from palpate.study.model import SelectionTable, StudyFile
from palpate.study.source_positions import Key

OTHER = "choose another of either"


def check_solver(
    context: Context,
    solver: Solver,
    tables: StudyFile,
    space: ParameterSpace,
    scenarios: Sequence[Scenario],
    protocols: Sequence[Protocol | None],
) -> None:
    """Refuse what the solver does not provide; first the protocol of the study, then of each spot."""
    _check_body(context, solver, tables)
    _check_regions(context, solver, tables, space)
    check_protocols(context, solver, named_protocols(protocols))
    if tables.selection:
        _check_channels(context, solver, tables.selection, scenarios)


def named_protocols(protocols: Sequence[Protocol | None]) -> Iterator[tuple[Key, Protocol | None]]:
    """Each protocol with the key of its table; first the protocol of the study, then of each spot."""
    keys: list[Key] = [("protocol",), *(("spot", i, "protocol") for i in range(len(protocols) - 1))]
    return zip(keys, protocols, strict=True)


def relaxing_parts(space: ParameterSpace, parametrisation: Parametrisation) -> str:
    """Name of what relaxes in the model: regions, or the tissue; empty where nothing does."""
    regions = [f"'{region.region}'" for region in space.regions if region.material.relaxation_times_s]
    named = f"region{'s' * (len(regions) > 1)} {', '.join(regions)}" if regions else ""
    return named or ("the tissue" if parametrisation.relaxing else "")


def check_times(context: Context, relaxing: str, protocols: Iterable[tuple[Key, Protocol | None]]) -> None:
    """Refuse a motion without times under which something relaxes."""
    for key, protocol in protocols if relaxing else ():
        if isinstance(protocol, Indentation) and protocol.time_s is None:
            context.problems.add(
                (*key, "motion"),
                f"{relaxing} relaxes, which needs the times of the motion; name a motion that has them, such "
                'as "moves" with the duration of each move',
            )


def _check_channels(
    context: Context, solver: Solver, selection: SelectionTable, scenarios: Sequence[Scenario]
) -> None:
    """Refuse a scenario of a channel that the solver does not compute."""
    provides, known = solver.provides, context.plugins.channels
    computed = [name for name, channel in known.items() if provides.computes(channel)]
    for scenario in scenarios:
        missing = [c for c in map(channel_of, scenario.weighed) if c not in computed]
        if missing:
            context.problems.add(
                ("selection", "scenarios", selection.scenarios.index(scenario.name)),
                f"scenario '{scenario.name}' weights channel '{missing[0]}', which solver '{solver.name}' "
                f"does not compute (it has {', '.join(computed) or 'none'}); {OTHER}",
            )


def _check_body(context: Context, solver: Solver, tables: StudyFile) -> None:
    """Refuse a study without the tables and meshes that the solver needs, or with those it does not use."""
    provides, add, name = solver.provides, context.problems.add, f"solver '{solver.name}'"
    needed = {"limb": provides.mesh, "protocol": provides.body != "specimen"}
    for table, is_needed in needed.items():
        if is_needed and table not in tables.model_fields_set:
            add(("solver", "name"), f"{name} needs a [{table}] table; add one")
    if not provides.mesh and tables.limb is not None:
        add(("limb",), f"{name} takes no mesh; remove the table")
    if provides.body == "specimen" and tables.protocol is not None:
        add(("protocol",), f"{name} makes homogeneous tests and has no protocol; remove the table")
    if not provides.mesh and tables.fit.fine_edge not in ("auto", 0.0):
        add(("fit", "fine_edge"), f"{name} takes no mesh; remove the key")
    for index, spot in enumerate(tables.spot):
        if provides.mesh and spot.mesh is None:
            add(("spot", index), f'{name} needs a mesh; add mesh = "…" to the spot')
        for key in ("mesh", "fine_mesh", "layers"):
            if not provides.mesh and getattr(spot, key):
                add(("spot", index, key), f"{name} takes no mesh; remove the key")


def _check_regions(context: Context, solver: Solver, tables: StudyFile, space: ParameterSpace) -> None:
    """Refuse more regions, or other materials, than the solver simulates."""
    provides, add, name = solver.provides, context.problems.add, f"solver '{solver.name}'"
    regions, most = list(tables.region), provides.max_regions
    if most is not None and not provides.takes_regions(len(regions)):
        add(
            ("region", regions[most]),
            f"{name} simulates at most {most} region{'s' * (most > 1)}, and the study has {len(regions)} "
            f"({', '.join(regions)}); remove a table, or choose another solver",
        )
    for region in space.regions:
        key, material = ("region", region.region, "material"), region.material
        if material.relaxation_times_s and not provides.relaxation:
            add((*key[:2], "relaxation_times"), f"{name} simulates no material that relaxes; {OTHER}")
        if not provides.takes_directions(material):
            add(key, f"{name} simulates no anisotropic material such as '{material.name}'; {OTHER}")
        elif missing := provides.missing_fields(material):
            fields = ", ".join(missing)
            add(key, f"material '{material.name}' takes cell data {fields}, which {name} has not; {OTHER}")


def check_protocols(
    context: Context, solver: Solver, protocols: Iterable[tuple[Key, Protocol | None]]
) -> None:
    """Refuse an indenter or a motion that the solver does not simulate.

    Each protocol comes with the key of its table.
    """
    provides, add, name = solver.provides, context.problems.add, f"solver '{solver.name}'"
    if provides.body == "specimen":
        return  # that there is a protocol is reported already
    refused: list[Indenter] = []
    for key, protocol in protocols:
        indenter = protocol.indenter if isinstance(protocol, Indentation) else None
        # Once, where it is named: a spot may change the motion alone.
        if indenter and not provides.simulates(indenter.name) and indenter not in refused:
            refused.append(indenter)
            known, place = ", ".join(provides.indenters or ()), (*key, "indenter", "shape")
            add(place, f"{name} does not simulate indenter '{indenter.name}' (it has {known}); {OTHER}")
        if missing := provides.other_moves(protocol):
            known = ", ".join(provides.motions)
            add(
                (*key, "motion"),
                f"{name} simulates no motion with {', '.join(missing)} (it has {known}); {OTHER}",
            )
