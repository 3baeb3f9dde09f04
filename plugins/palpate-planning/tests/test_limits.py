"""Presses that limits refuse, and tools that cannot be pressed."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from palpate.domain import (
    Channel,
    Response,
    Status,
    SurfaceStates,
)
from palpate.errors import StudyError
from palpate_planning.candidates import (
    Allowed,
    Limit,
    candidates,
    limits_of,
)
from palpate_planning.plan import tool_forces
from palpate_planning.presses import bare_problem, simulated_presses
from palpate_planning.pressures import with_pressures
from palpate_planning.propose import PlanOptions, before_any_press, choose_presses

from .proposals import ALLOWED, proposed


@pytest.mark.slow
def test_limits_refuse_what_presses_too_hard(run):
    free = proposed(run)
    peaks = {each.press.press.name: each.press.peaks["force"] for each in free.steps[0].ranked}
    limit = float(np.median(list(peaks.values())))
    held = proposed(run, ALLOWED.model_copy(update={"limits": {"force": f"{limit} N"}}))
    kept = {each.press.press.name for each in held.steps[0].ranked}
    assert kept == {name for name, peak in peaks.items() if peak <= limit}
    assert set(held.refused) == peaks.keys() - kept
    with pytest.raises(StudyError, match="none of 6 candidates is possible"):
        proposed(run, ALLOWED.model_copy(update={"limits": {"force": "1e-6 N"}}))


def _with_skin(study, jobs):
    """Simulations whose pressure grows like Hertz's, by the cube root of the force."""
    for job in jobs:
        found = study.solver.simulate(replace(job, surface=False), None)
        peak = _largest_pressure(found.response.curves["force"].ordinate.max())
        yield replace(found, job=job, surface=_skin(peak) if job.surface else None)


def _largest_pressure(force):
    return 1e-3 * np.cbrt(force)


def _skin(peak):
    """One triangle under a pressure, in two states."""
    zeros = np.zeros((2, 3, 3))
    return SurfaceStates(
        points_mm=[(0, 0, 0), (1, 0, 0), (0, 1, 0)],
        triangles=[(0, 1, 2)],
        depth_mm=[0.0, 1.0],
        rotation_deg=[0.0, 0.0],
        positions_mm=np.zeros((2, 3)),
        rotations=np.tile(np.eye(3), (2, 1, 1)),
        displacements_mm=zeros,
        areas_mm2=np.ones((2, 3)),
        touching=np.ones((2, 3)),
        pressures_MPa=[[0.0, 0.0, 0.0], [peak, 0.5 * peak, 0.0]],
        shears_MPa=zeros,
        tractions_MPa=zeros,
    )


def test_limit_of_pressure_refuses_what_presses_too_hard_at_any_point(run):
    study, _, plugins = run
    design, points = _first_design(run, functools.partial(_with_skin, study))
    made = candidates(study, plugins, ALLOWED)
    known = with_pressures(design, simulated_presses(design, made, points), points[0])
    for press in known:
        first = press.at[0].peaks
        assert first["pressure"] == pytest.approx(_largest_pressure(first["force"]))
        for at in press.at[1:]:  # solved at the first, and by the force at the others
            share = at.peaks["force"] / first["force"]
            assert at.peaks["pressure"] == pytest.approx(share * first["pressure"])
            assert at.peaks["pressure"] != pytest.approx(_largest_pressure(at.peaks["force"]))
    limit = float(np.median([press.peaks["pressure"] for press in known]))
    found = choose_presses(design, [], made, points, PlanOptions(), {"pressure": Limit(limit, "MPa")})
    over = {press.press.name for press in known if press.peaks["pressure"] > limit}
    assert found.refused.keys() == over != set()
    assert all("the pressure reaches" in why and "MPa" in why for why in found.refused.values())


def _first_design(run, simulate):
    """A study before its first press, with a function from jobs to simulations; and points."""
    study, _, plugins = run
    (scenario,) = (s for s in study.scenarios if s.name == study.generalise_by)
    abscissae = {name: channel.abscissa for name, channel in plugins.channels.items()}
    return before_any_press(study, scenario, lambda jobs: list(simulate(jobs)), abscissae, 3)


def test_presses_go_to_two_places_unless_one_is_asked_for(run):
    """The second press at another place, if there is one: here the same place under two names."""
    study, folder, plugins = run
    (spot,) = study.spots
    both = replace(study, spots=(spot, replace(spot, spot=replace(spot.spot, name="p2"))))
    design, points = _first_design(
        (both, folder, plugins), lambda jobs: (study.solver.simulate(j, None) for j in jobs)
    )
    (press,) = candidates(
        study, plugins, Allowed(protocol={"depth": ["2 mm"], "twist": [["20 deg", "0 deg"]]})
    )
    made = [
        press,
        replace(
            press, name="p2-1", spot="p2", protocol=replace(press.protocol, path=[(0.0, 0.0), (0.2, 0.0)])
        ),
    ]

    def places(n_presses, **asked):
        options = PlanOptions(n_presses=n_presses, allowed=Allowed(**asked))
        found = choose_presses(design, [], made, points, options, {})
        return [step.chosen.press.press.spot for step in found.steps]

    assert places(3) == ["p1", "p2", "p1"]
    assert places(2, places=1) == ["p1", "p1"]


def _diverged(study, jobs):
    """Partial simulations of the jobs that press deeper than 3 mm."""
    for job in jobs:
        found = study.solver.simulate(job, None)
        is_deep = job.protocol.path[:, 0].max() > 3.0
        yield replace(found, status=Status.DIVERGED, message="stopped") if is_deep else found


def test_partial_simulation_is_no_candidate_even_where_it_is_ranked(run):
    study, folder, plugins = run
    study = replace(study, scoring=replace(study.scoring, rank_partial=True))
    design, points = _first_design((study, folder, plugins), functools.partial(_diverged, study))
    made = candidates(study, plugins, ALLOWED)
    found = choose_presses(design, [], made, points, PlanOptions(), {})
    assert found.refused.keys() == {each.name for each in made if each.keys["depth"] == "4 mm"}
    assert all(why == "diverged: stopped" for why in found.refused.values())


def test_tool_that_is_not_pressed_to_its_end_is_refused(run, tool):
    study, _, _ = run
    deep = replace(tool, protocol=replace(tool.protocol, path=[(0.0, 0.0), (4.0, 0.0)]))
    design, points = _first_design(run, functools.partial(_diverged, study))
    assert tool_forces(design, tool, points[0])
    with pytest.raises(StudyError, match=r"tool at p1 cannot be predicted: diverged: stopped"):
        tool_forces(design, deep, points[0])


def _lost_skin(study, jobs):
    """Simulations that end before the peak where the skin is asked for."""
    for found in _with_skin(study, jobs):
        ended = replace(found, status=Status.DIVERGED, message="stopped")
        yield ended if found.job.surface else found


def test_pressure_of_a_press_that_ends_before_its_peak_is_not_known(run):
    study, _, plugins = run
    design, points = _first_design(run, functools.partial(_lost_skin, study))
    (known, *_) = simulated_presses(design, candidates(study, plugins, ALLOWED)[:1], points)
    (found,) = with_pressures(design, [known], points[0])
    assert known.at
    assert not found.at
    assert found.failure == "its pressure is not known: stopped"


def test_pressure_is_not_known_without_a_force(run):
    study, _, plugins = run
    design, points = _first_design(run, functools.partial(_with_skin, study))
    (known, *_) = simulated_presses(design, candidates(study, plugins, ALLOWED)[:1], points)
    without = replace(known, at=tuple(replace(at, peaks={**at.peaks, "force": 0.0}) for at in known.at))
    (found,) = with_pressures(design, [without], points[0])
    assert not found.at
    assert "its force is not known" in found.failure


def _stiffer_in_a_twist(study, jobs):
    """Simulations whose force doubles in the twist."""
    for job in jobs:
        found = study.solver.simulate(job, None)
        curves = dict(found.response.curves)
        if twisted := curves.get("force by rotation_deg"):
            curves[twisted.channel] = replace(twisted, ordinate=2.0 * twisted.ordinate)
        yield replace(found, response=Response(curves=curves))


def test_force_is_limited_in_a_twist_too(run):
    study, _, plugins = run
    design, points = _first_design(run, functools.partial(_stiffer_in_a_twist, study))
    made = candidates(study, plugins, ALLOWED)
    free = {each.press.name: each.peaks["force"] for each in simulated_presses(design, made, points)}
    found = choose_presses(design, [], made, points, PlanOptions(), {"force": Limit(1e3, "N")})
    for each in found.steps[0].ranked:
        press = each.press.press
        times = 2.0 if press.keys["twist"] else 1.0
        assert each.press.peaks["force"] == pytest.approx(times * free[press.name])


def test_slide_counts_where_the_scenario_weighs_it(run):
    """The spot itself has measured none."""
    study, _, plugins = run
    design, _ = _first_design(run, lambda jobs: (study.solver.simulate(j, None) for j in jobs))
    lateral = replace(
        plugins.channels["force"], name="lateral_force", abscissa="slide_mm", ordinate="lateral_force_N"
    )
    study = replace(study, channels={**study.channels, "lateral_force": lateral})
    weighed = replace(design.scenario, weights={"force": 1.0, "lateral_force": 1.0})
    slid = replace(design, study=study, scenario=weighed)
    (press,) = candidates(study, plugins, Allowed(protocol={"depth": ["2 mm"]}))
    names = [
        [channel.name for channel in bare_problem(each, press).terms[0].channels] for each in (slid, design)
    ]
    assert names == [["force", "torque", "lateral_force"], ["force", "torque"]]


def test_pressure_needs_a_solver_that_gives_it(run):
    with pytest.raises(
        StudyError, match=r"limits\.pressure: solver '.*' does not give the states of the skin"
    ):
        proposed(run, ALLOWED.model_copy(update={"limits": {"pressure": "50 kPa"}}))


def test_limit_of_a_channel_that_the_solver_does_not_compute_is_refused(run):
    study, _, plugins = run
    heat = Channel(
        name="heat", abscissa="depth_mm", ordinate="heat_N", abscissa_label="mm", ordinate_label="N"
    )
    limited = Allowed(limits={"heat": "1 N"})
    with pytest.raises(StudyError, match=r"limits\.heat: solver 'half_space' does not compute this channel"):
        limits_of(limited, study, {**plugins.channels, "heat": heat})
