"""Further presses of a small study in closed form: ranked, refused, and made."""

import functools
import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from pydantic import TypeAdapter

from palpate.domain import (
    Channel,
    Curve,
    Indentation,
    Job,
    Response,
    Simulation,
    Status,
    SurfaceStates,
    Waypoints,
)
from palpate.errors import StudyError
from palpate.mesh.specimens.blocks import block
from palpate.plugins.parametrisation import SpotInputs
from palpate.stages import pipeline
from palpate.study.reading import read_options, read_study
from palpate.study.tool import read_tool
from palpate_certainty.laplace import RANGE_SD
from palpate_materials import HolzapfelGasserOgden
from palpate_planning import propose as planning
from palpate_planning.candidates import (
    Allowed,
    CandidatePress,
    Limit,
    candidates,
    limits_of,
    timed,
    turned,
    usual,
    with_presses,
)
from palpate_planning.figure import _words, draw
from palpate_planning.plan import tool_forces
from palpate_planning.presses import bare_problem, observed, simulated_presses
from palpate_planning.pressures import with_pressures
from palpate_planning.propose import PlanOptions, before_any_press, choose_presses, propose
from palpate_planning.tables import ProposalOutput, for_robot, proposal_tables

ALLOWED = Allowed(protocol={"depth": ["1 mm", "2 mm", "4 mm"], "twist": [[], ["20 deg", "0 deg"]]})


def _proposed(run, allowed=ALLOWED, **options):
    study, folder, plugins = run
    return propose(study, folder, plugins, options=PlanOptions(allowed=allowed, n_points=3, **options))


def test_press_with_a_twist_tells_what_presses_without_cannot(run):
    found = _proposed(run, goal="tissue.nu")
    goals = {
        (each.press.press.keys["depth"], bool(each.press.press.keys["twist"])): each.goal
        for each in found.steps[0].ranked
    }
    for depth in ALLOWED.protocol["depth"]:
        assert goals[depth, True] < goals[depth, False]  # force alone leaves E and nu inseparable
    assert found.steps[0].chosen.goal < 0.95


@pytest.mark.slow
def test_every_step_is_ranked_after_those_before_it(run):
    found = _proposed(run, n_presses=3)
    goals = [step.chosen.goal for step in found.steps]
    assert goals[0] < goals[1] < 1.0  # what is known already narrows less
    for step in found.steps:
        assert [each.goal for each in step.ranked] == sorted(each.goal for each in step.ranked)
    widths = proposal_tables(found).intervals.filter(parameter="tissue.nu")["width"].to_list()
    # Meshes at their worst may widen one parameter a little where the joint region narrows.
    assert all(later <= 1.01 * earlier for earlier, later in pairwise(widths))


def test_intervals_now_are_those_of_the_fit(run, tmp_path):
    study, _, plugins = run
    fit = pipeline.run_study(study, tmp_path / "again", plugins).fit
    found = _proposed((study, tmp_path / "again", plugins))
    rows = fit.certainty.intervals.filter(fit="p1", scenario=study.generalise_by)
    now = proposal_tables(found).intervals.filter(step=0)
    assert now["parameter"].equals(rows["parameter"])
    for column in ("value", "lower", "upper"):
        np.testing.assert_allclose(now[column], rows[column], rtol=1e-9)


@pytest.mark.slow
def test_goal_of_one_parameter_is_its_own_width(run):
    found = _proposed(run, goal="tissue.nu")
    best = found.steps[0].chosen
    assert best.goal == pytest.approx(best.widths[1])
    with pytest.raises(StudyError, match=r"'nu' is no goal; name one of all, worst, tissue\.E"):
        _proposed(run, goal="nu")


TOOL = """
[protocol]
indenter = { shape = "sphere", radius = "20 mm" }
depth = "1.5 mm"
friction = 0.5
"""


@pytest.fixture
def tool(run, tmp_path):
    """A larger sphere, read from its file."""
    file = tmp_path / "tool.toml"
    file.write_text(TOOL)
    return read_tool(file, run[0], run[2])


def test_force_of_a_tool_changes_as_its_gradient_says(run, tool):
    study, _, _ = run
    goal = _proposed(run, tool=tool).goal
    (force,) = goal.predicted
    assert force.name == "tool at p1"
    materials = {region.region: region.material for region in study.space.regions}

    def simulated(values):
        thetas = study.space.thetas(values)
        job = Job(spot="p1", set_id=0, materials=materials, thetas=thetas, protocol=tool.protocol)
        return study.solver.simulate(job, None).response.curves["force"].ordinate.max()

    assert simulated(goal.values) == pytest.approx(force.force_N)
    for step in np.diag(1e-3 * goal.values):
        change = (simulated(goal.values + step) - simulated(goal.values - step)) / (2.0 * force.force_N)
        assert step @ force.gradient == pytest.approx(change, rel=5e-3)  # it is differenced


def test_tool_is_pressed_where_there_is_a_material(run, tool, monkeypatch):
    asked = []

    def recorded(design, tool, point):
        asked.append((design, point))
        return tool_forces(design, tool, point) if len(asked) == 1 else ()  # the workers have ended then

    monkeypatch.setattr(planning, "tool_forces", recorded)
    _proposed(run, tool=tool)
    ((design, point),) = asked
    refused = replace(design, estimate=design.problem.box.upper)
    monkeypatch.setattr(type(design.problem), "accepts", lambda self, points: np.zeros(len(points), bool))
    goal = planning._goal(refused, PlanOptions(tool=tool), point)
    assert asked[1][1] is point
    assert np.array_equal(goal.values, refused.estimate)


@pytest.mark.slow
def test_prediction_of_a_tool_is_narrowed(run, tool):
    found = _proposed(run, tool=tool)
    tables = proposal_tables(found)
    widths = tables.intervals.filter(parameter="tool at p1")["width"].to_list()
    assert found.goal.name == "prediction"
    assert widths[0] == 1.0
    # The goal is of a normal density, the width is cut off at the ranges.
    assert widths[1] == pytest.approx(found.steps[0].chosen.goal, rel=0.2)
    by_all = _proposed(run).steps[0].ranked
    of_same = {each.press.press.name: each.goal for each in found.steps[0].ranked}
    assert found.steps[0].chosen.goal <= of_same[by_all[0].press.press.name]


def test_tool_that_is_pressed_by_force_is_refused_before_anything_is_simulated(run, tool, monkeypatch):
    monkeypatch.setattr(planning, "presses_so_far", None)
    path, loads = np.zeros((2, 6)), np.full((2, 6), np.nan)
    loads[1, 0], path[1, 0] = 3.0, 5.0
    by_force = Indentation.along(
        Waypoints(pose=path, loads=loads), indenter=tool.protocol.indenter, friction=0.5
    )
    with pytest.raises(StudyError, match="'tool' is pressed by force"):
        _proposed(run, tool=replace(tool, protocol=by_force))


@pytest.mark.slow
@pytest.mark.usefixtures("one_figure")
def test_picture_has_every_spot_with_its_best_candidates(run, tmp_path):
    found = _proposed(run)
    limb = block("hex8", n_across=3, n_down=2)
    svg, *_ = draw(found, {"p1": limb}, tmp_path)
    text = svg.read_text()
    best = found.steps[0].chosen
    assert "spot p1" in text
    assert f"{best.goal:.2f}" in text
    assert text.count("depth ") == 6  # of so many candidates, the best first
    assert _words(best) in text
    assert "mean error of all parameters" in text
    assert text.count("<path") > draw(found, {}, tmp_path / "bare")[0].read_text().count("<path")


@pytest.mark.parametrize(
    ("options", "message"),
    [({"goal": "prediction"}, "needs a tool"), ({"goal": "all", "tool": "given"}, "needs no tool")],
)
def test_goal_and_tool_go_together(tool, options, message):
    with pytest.raises(StudyError, match=message):
        PlanOptions(**({**options, "tool": tool} if "tool" in options else options))


@pytest.mark.slow
def test_limits_refuse_what_presses_too_hard(run):
    free = _proposed(run)
    peaks = {each.press.press.name: each.press.peaks["force"] for each in free.steps[0].ranked}
    limit = float(np.median(list(peaks.values())))
    held = _proposed(run, ALLOWED.model_copy(update={"limits": {"force": f"{limit} N"}}))
    kept = {each.press.press.name for each in held.steps[0].ranked}
    assert kept == {name for name, peak in peaks.items() if peak <= limit}
    assert set(held.refused) == peaks.keys() - kept
    with pytest.raises(StudyError, match="none of 6 candidates is possible"):
        _proposed(run, ALLOWED.model_copy(update={"limits": {"force": "1e-6 N"}}))


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
        _proposed(run, ALLOWED.model_copy(update={"limits": {"pressure": "50 kPa"}}))


def test_limit_of_a_channel_that_the_solver_does_not_compute_is_refused(run):
    study, _, plugins = run
    heat = Channel(
        name="heat", abscissa="depth_mm", ordinate="heat_N", abscissa_label="mm", ordinate_label="N"
    )
    limited = Allowed(limits={"heat": "1 N"})
    with pytest.raises(StudyError, match=r"limits\.heat: solver 'half_space' does not compute this channel"):
        limits_of(limited, study, {**plugins.channels, "heat": heat})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"spots": ["p9"]}, "no spot 'p9'"),
        ({"protocol": {"depht": ["1 mm"]}}, "depht"),
        ({"protocol": {"depth": ["1 N"]}}, "depth"),
        ({"protocol": {"depth": []}}, "allow 1 to 500"),
        ({"limits": {"power": "1 N"}}, "no such channel"),
        ({"limits": {"force": "1 mm"}}, r"limits\.force"),
    ],
)
def test_what_is_not_allowed_is_named(run, changes, message):
    with pytest.raises(StudyError, match=message):
        _proposed(run, ALLOWED.model_copy(update=changes))


def test_file_of_candidates_names_its_mistake(tmp_path):
    file = tmp_path / "allowed.toml"
    with pytest.raises(StudyError, match="no such file of options"):
        read_options(file, Allowed, {})
    file.write_text("spot = ['p1']")
    with pytest.raises(StudyError, match=r"allowed\.toml:1: spot: unknown key.*spots, protocol, limits"):
        read_options(file, Allowed, {})
    file.write_text("spots = ['p1'\n")
    with pytest.raises(StudyError, match="invalid TOML"):
        read_options(file, Allowed, {})


def test_usual_candidates_are_shares_of_each_spots_press(run):
    study, _, _ = run
    depths, twists = ["1 mm", "1.5 mm", "2 mm"], [[], ["2 deg"], ["4 deg"]]
    assert usual(study) == [("p1", {"depth": d, "twist": t}) for d in depths for t in twists]
    text = study.file.read_text()
    study.file.write_text(f'{text}protocol = {{ depth = "0.5 mm" }}\n')
    assert {keys["depth"] for _, keys in usual(study)} == {"0.25 mm", "0.375 mm", "0.5 mm"}


def test_presses_of_a_tissue_that_relaxes_are_tried_with_other_durations():
    moves = [{"depth": "2 mm", "duration": "1 s"}, {"duration": "3 s"}]
    tried = [[move["duration"] for move in each] for each in timed(moves)]
    assert tried == [["1 s", "3 s"], ["1 s", "30 s"], ["5 s", "3 s"], ["0.2 s", "3 s"]]
    repeated = [{"repeat": 3, "moves": moves[:1]}]
    tried = [each[0]["moves"][0]["duration"] for each in timed(repeated)]
    assert tried == ["1 s", "5 s", "0.2 s"]  # there is no rest
    assert [each[0]["depth"] for each in timed(moves)] == ["2 mm"] * 4


def test_slides_on_fibres_are_tried_in_other_directions(run):
    moves = [{"depth": "2 mm"}, {"slide": ["4 mm", "0 mm"]}, {"slide": ["0 mm", "0 mm"]}]
    tried = [[move.get("slide") for move in each] for each in turned(moves)]
    assert [each[1] for each in tried] == [["4 mm", "0 mm"], ["2.82843 mm", "2.82843 mm"], ["0 mm", "4 mm"]]
    assert [each[2] for each in tried] == [["0 mm", "0 mm"]] * 3
    pushed = [{"repeat": 2, "moves": [{"slide_force": ["0 N", "1 N"]}]}]
    assert [each[0]["moves"][0]["slide_force"] for each in turned(pushed)][2] == ["-1 N", "0 N"]
    assert list(turned(moves[:1])) == [moves[:1]]

    study, _, _ = run
    text = study.file.read_text()
    way = "[{ depth = '2 mm' }, { slide = ['1 mm', '0 mm'] }]"
    study.file.write_text(f"{text}protocol = {{ motion = 'moves', moves = {way} }}\n")
    (region,) = study.space.regions
    fibres = replace(study.space, regions=(replace(region, material=HolzapfelGasserOgden()),))
    assert not any("moves" in keys for _, keys in usual(study))
    slides = [keys["moves"][1]["slide"] for _, keys in usual(replace(study, space=fibres))]
    assert {tuple(way) for way in slides} == {
        ("1 mm", "0 mm"),
        ("0.707107 mm", "0.707107 mm"),
        ("0 mm", "1 mm"),
    }


def test_a_planned_curve_is_as_the_parametrisation_has_it(run):
    """What relaxes is planned as relaxed."""
    study, _, _ = run
    halved = Response(curves={"force": Curve(channel="force", abscissa=np.arange(2.0), ordinate=np.ones(2))})

    class Term:
        spot = "p1"

    class Stated:
        terms = (Term(),)

        def inputs(self, spot, point):
            return SpotInputs(thetas={}, protocol=study.protocol, observe=lambda response: halved)

    found = Simulation(job=None, status=Status.OK, response=Response(curves={}))
    assert observed(Stated(), None, found).response is halved
    failed = replace(found, response=None, status=Status.DIVERGED)
    assert observed(Stated(), None, failed) is failed


def test_robot_gets_the_whole_path(run):
    found = _proposed(run)
    written = json.loads((run[1] / "next.json").read_text())
    (press,) = written["presses"]
    chosen = found.steps[0].chosen.press.press
    assert press["depth_mm"] == chosen.protocol.path[:, 0].tolist()
    assert press["rotation_deg"] == chosen.protocol.path[:, 1].tolist()
    assert written["goal"] == "all"
    assert for_robot(found, {})["ranking"] == written["ranking"]
    TypeAdapter(ProposalOutput).validate_python({**written, "warnings": []}, strict=True)


def test_mistake_in_a_file_names_the_file_once(run, tmp_path):
    file = tmp_path / "allowed.toml"
    file.write_text('[protocol]\ndepht = ["1 mm", "2 mm"]\n')
    with pytest.raises(StudyError, match=r"allowed\.toml: protocol\.depht") as raised:
        _proposed(run, read_options(file, Allowed, {}))
    assert str(raised.value).count("\n") == 0
    assert "/study.toml" not in str(raised.value)


def test_study_keeps_what_was_written_by_hand(run):
    def press(name, spot="p1", protocol=None):
        return CandidatePress(name=name, spot=spot, keys=protocol or {}, measured=f"more/{name}.csv")

    text = run[0].file.read_text() + "# the end\n"
    added = with_presses(text, [press("p1-2", protocol={"depth": "3 mm", "twist": ["5 deg"]})])
    assert "# the end" in added
    assert added.count("[[spot]]") == 2
    with pytest.raises(StudyError, match="already exists"):
        with_presses(text, [press("p1-2"), press("p1-2")])
    with pytest.raises(StudyError, match="no spot 'p7'"):
        with_presses(text, [press("p1-3", spot="p7")])
    inline = 'spot = [{ name = "p1", measured = "p1.csv" }]\n'
    assert with_presses(inline, [press("p2")]).count("name") == 2


def test_first_presses_are_planned_over_the_ranges(run, tmp_path, notes):
    study, _, plugins = run
    unmeasured = read_study(study.file, plugins, need_measured=False)
    found = propose(
        unmeasured,
        tmp_path / "plan",
        plugins,
        notes,
        PlanOptions(allowed=ALLOWED, n_points=4, n_presses=2),
    )
    (announced,) = (text for text in notes.texts if text.startswith("about"))
    n_each = 4 * (1 if study.solver.provides.slopes else 1 + 2 * len(found.expected.before))
    assert announced == f"about {n_each * len(found.steps[0].ranked)} simulations (--quick is shorter)"
    shares = np.sqrt(np.diag(found.expected.before))
    assert shares == pytest.approx(RANGE_SD, rel=0.1)  # nothing is known but the ranges
    assert found.steps[0].chosen.press.press.keys["twist"]  # one press of force alone cannot tell both
    assert found.steps[0].chosen.goal < 0.7
    assert found.steps[1].chosen.goal < 1.0
