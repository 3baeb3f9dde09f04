"""What two solvers both provide: channels along motions that both simulate; and what they do not share."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from palpate.api import Channel, FloatArray, Limb, Material, Provides, Simulation, Solver, Status
from palpate_validation.comparison import Case, Contender, Row, at

DEPTH_MM = 2.0
SLIDE_MM = 1.0
TILT_DEG = 5.0
N_STEPS = 5
AT_DEPTH = 2
"""Waypoint of a slide and of a tilt at which the press has ended."""

TOLERANCES = {"force": 0.01}
TOLERANCE = 0.05
"""Between two solvers with different contact, one with a faceted sphere."""


def motions() -> dict[str, FloatArray]:
    """Poses (n, 6) by problem, for what the twist does not move."""
    found = {}
    for name, column, most in (("slide", 1, SLIDE_MM), ("tilt", 3, TILT_DEG)):
        pose = np.zeros((AT_DEPTH + 1 + N_STEPS, 6))
        pose[1, 0], pose[AT_DEPTH:, 0] = DEPTH_MM / 2, DEPTH_MM
        pose[AT_DEPTH:, column] = np.linspace(0.0, most, N_STEPS + 1)
        found[name] = pose
    return found


def motion_rows(
    limb: Limb,
    material: Material,
    theta: FloatArray,
    contenders: Mapping[str, Contender],
    channels: Mapping[str, Channel],
    references: Collection[str] = (),
    of: str = "",
) -> Iterator[Row]:
    """Compare along a slide and a tilt the solvers that simulate them, each with the first reference.

    Parameters
    ----------
    limb : Limb
        Every region gets the same material.
    references : collection of str
        Solvers that others may be compared with; any if it is empty.
    of : str
        What is added to the name of the problem in the rows.
    """
    for problem, pose in motions().items():
        case = Case.of_one_material(problem + of, limb, material, theta, pose)
        solvers = {name: make(case.mean_dilatation) for name, make in contenders.items()}
        able = {name: each for name, each in solvers.items() if not each.provides.lacks(case.job())}
        first = next((name for name in able if not references or name in references), None)
        if first is None or len(able) < 2:
            continue
        # Curves over the depth end before the slide or the tilt: those of the twist are the same.
        case = replace(case, channels=moved_channels(case, channels.values(), since=AT_DEPTH))
        answers = {name: case.run(solver) for name, solver in able.items()}
        for name in able:
            if name != first:
                yield from pair_rows(case, able, answers, name, first)


def moved_channels(case: Case, channels: Collection[Channel], since: int = 0) -> tuple[Channel, ...]:
    """Channels whose abscissa a case moves after a waypoint."""
    columns = case.protocol.columns
    return tuple(c for c in channels if c.abscissa in columns and np.ptp(columns[c.abscissa][since:]) > 0.0)


def pair_rows(
    case: Case, solvers: Mapping[str, Solver], answers: Mapping[str, Simulation], name: str, other: str
) -> Iterator[Row]:
    """Compare the channels that two solvers compute where their abscissa is farthest from rest."""
    both = [solvers[each].provides for each in (name, other)]
    for channel in case.channels:
        if not all(provides.computes(channel) for provides in both):
            continue
        path = case.protocol.columns[channel.abscissa]
        place = float(path[np.argmax(np.abs(path))])
        found, expected = (_ordinate(answers[each], channel.name, place) for each in (name, other))
        difference, note = None, ""
        if isinstance(found, str) or isinstance(expected, str):
            note = f"{name}: {found}" if isinstance(found, str) else f"{other}: {expected}"
        elif found == expected:
            difference = 0.0
        elif peak := _peak(answers[other], channel.name):
            difference = abs(found - expected) / peak
        else:
            note = f"{other}: its {channel.name} is zero all along"
        yield case.row(
            solver=name,
            quantity=channel.name,
            against=other,
            difference=difference,
            tolerance=TOLERANCES.get(channel.name, TOLERANCE),
            note=note,
        )


def _ordinate(simulation: Simulation, channel: str, place: float) -> float | str:
    """Ordinate at an abscissa, or why there is none."""
    if simulation.status is not Status.OK or simulation.response is None:
        return simulation.message or simulation.status.value
    if channel not in simulation.response:
        return f"no channel '{channel}' in its result"
    value = float(at(simulation.response[channel], [place])[0])
    return value if np.isfinite(value) else f"its {channel} does not reach {place:g}"


def _peak(simulation: Simulation, channel: str) -> float:
    assert simulation.response is not None
    return float(np.nanmax(np.abs(simulation.response[channel].ordinate)))


def not_shared(solvers: Mapping[str, Provides], channels: Sequence[Channel]) -> list[str]:
    """What one of each two solvers provides alone, in words: that is not compared."""
    names, found = list(solvers), []
    for k, name in enumerate(names):
        for other in names[k + 1 :]:
            for one, two in ((name, other), (other, name)):
                if alone := ", ".join(_alone(solvers[one], solvers[two], channels)):
                    found.append(f"not compared, '{one}' alone and not '{two}': {alone}")
    return found


def _alone(one: Provides, two: Provides, channels: Sequence[Channel]) -> Iterator[str]:
    names = [c.name for c in channels if one.computes(c) and not two.computes(c)]
    if names:
        yield f"channels {', '.join(names)}"
    if motions := [part for part in one.motions if part not in two.motions]:
        yield f"motions with {', '.join(motions)}"
    if two.indenters is not None and one.indenters is None:
        yield f"indenters other than {', '.join(two.indenters)}"
    elif indenters := [name for name in one.indenters or () if not two.simulates(name)]:
        yield f"indenters {', '.join(indenters)}"
    if two.max_regions is not None and (one.max_regions is None or one.max_regions > two.max_regions):
        yield f"more than {two.max_regions} region{'s' * (two.max_regions > 1)}"
    for what in ("anisotropic", "fields", "slopes", "surface"):
        if getattr(one, what) and not getattr(two, what):
            yield {"anisotropic": "anisotropic materials", "fields": "cell fields"}.get(what, what)
