"""Further presses of a small study in closed form: ranked, refused, and made."""

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from pydantic import TypeAdapter

from palpate.domain import (
    Curve,
    Indentation,
    Job,
    Response,
    Simulation,
    Status,
    Waypoints,
)
from palpate.errors import StudyError
from palpate.mesh.specimens.blocks import block
from palpate.plugins.parametrisation import SpotInputs
from palpate.stages import pipeline
from palpate.study.reading import read_options, read_study
from palpate_certainty.laplace import RANGE_SD
from palpate_materials import HolzapfelGasserOgden
from palpate_planning import propose as planning
from palpate_planning.candidates import (
    Allowed,
    CandidatePress,
    described,
    timed,
    turned,
    usual,
    with_presses,
)
from palpate_planning.figure import draw
from palpate_planning.plan import tool_forces
from palpate_planning.presses import observed
from palpate_planning.propose import PlanOptions, propose
from palpate_planning.tables import ProposalOutput, for_robot, proposal_tables

from .proposals import ALLOWED, proposed


def test_press_with_a_twist_tells_what_presses_without_cannot(run):
    found = proposed(run, goal="tissue.nu")
    goals = {
        (each.press.press.keys["depth"], bool(each.press.press.keys["twist"])): each.goal
        for each in found.steps[0].ranked
    }
    for depth in ALLOWED.protocol["depth"]:
        assert goals[depth, True] < goals[depth, False]  # force alone leaves E and nu inseparable
    assert found.steps[0].chosen.goal < 0.95


@pytest.mark.slow
def test_every_step_is_ranked_after_those_before_it(run):
    found = proposed(run, n_presses=3)
    goals = [step.chosen.goal for step in found.steps]
    assert goals[0] < goals[1] < 1.0  # what is known already narrows less
    for step in found.steps:
        assert [each.goal for each in step.ranked] == sorted(each.goal for each in step.ranked)
    widths = proposal_tables(found)["intervals"].filter(parameter="tissue.nu")["width"].to_list()
    # Meshes at their worst may widen one parameter a little where the joint region narrows.
    assert all(later <= 1.01 * earlier for earlier, later in pairwise(widths))


def test_intervals_now_are_those_of_the_fit(run, tmp_path):
    study, _, plugins = run
    fit = pipeline.run_study(study, tmp_path / "again", plugins).fit
    found = proposed((study, tmp_path / "again", plugins))
    rows = fit.intervals.filter(fit="p1", scenario=study.generalise_by)
    now = proposal_tables(found)["intervals"].filter(step=0)
    assert now["parameter"].equals(rows["parameter"])
    for column in ("value", "lower", "upper"):
        np.testing.assert_allclose(now[column], rows[column], rtol=1e-9)


@pytest.mark.slow
def test_goal_of_one_parameter_is_its_own_width(run):
    found = proposed(run, goal="tissue.nu")
    best = found.steps[0].chosen
    assert best.goal == pytest.approx(best.widths[1])
    with pytest.raises(StudyError, match=r"'nu' is no goal; name one of all, worst, tissue\.E"):
        proposed(run, goal="nu")


def test_force_of_a_tool_changes_as_its_gradient_says(run, tool):
    study, _, _ = run
    goal = proposed(run, tool=tool).goal
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
    proposed(run, tool=tool)
    ((design, point),) = asked
    refused = replace(design, estimate=design.problem.box.upper)
    monkeypatch.setattr(type(design.problem), "accepts", lambda self, points: np.zeros(len(points), bool))
    goal = planning._goal(refused, PlanOptions(tool=tool), point)
    assert asked[1][1] is point
    assert np.array_equal(goal.values, refused.estimate)


@pytest.mark.slow
def test_prediction_of_a_tool_is_narrowed(run, tool):
    found = proposed(run, tool=tool)
    tables = proposal_tables(found)
    widths = tables["intervals"].filter(parameter="tool at p1")["width"].to_list()
    assert found.goal.name == "prediction"
    assert widths[0] == 1.0
    # The goal is of a normal density, the width is cut off at the ranges.
    assert widths[1] == pytest.approx(found.steps[0].chosen.goal, rel=0.2)
    by_all = proposed(run).steps[0].ranked
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
        proposed(run, tool=replace(tool, protocol=by_force))


@pytest.mark.slow
@pytest.mark.usefixtures("one_figure")
def test_picture_has_every_spot_with_its_best_candidates(run, tmp_path):
    found = proposed(run)
    limb = block("hex8", n_across=3, n_down=2)
    svg, *_ = draw(found, {"p1": limb}, tmp_path)
    text = svg.read_text()
    best = found.steps[0].chosen
    assert "spot p1" in text
    assert f"{best.goal:.2f}" in text
    assert text.count("depth ") == 6  # of so many candidates, the best first
    assert described(best.press.press).replace(" deg", "°").replace(" -", " −") in text
    assert "mean error of all parameters" in text
    assert text.count("<path") > draw(found, {}, tmp_path / "bare")[0].read_text().count("<path")


@pytest.mark.parametrize(
    ("options", "message"),
    [({"goal": "prediction"}, "needs a tool"), ({"goal": "all", "tool": "given"}, "needs no tool")],
)
def test_goal_and_tool_go_together(tool, options, message):
    with pytest.raises(StudyError, match=message):
        PlanOptions(**({**options, "tool": tool} if "tool" in options else options))


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
        proposed(run, ALLOWED.model_copy(update=changes))


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
    found = proposed(run)
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
        proposed(run, read_options(file, Allowed, {}))
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
    n_each = 4 * (1 if study.solver.provides.slopes else 1 + 2 * len(found.expected.before.sds))
    assert announced == f"about {n_each * len(found.steps[0].ranked)} simulations (--quick is shorter)"
    shares = np.sqrt(np.diag(found.expected.before.covariance))
    assert shares == pytest.approx(RANGE_SD, rel=0.1)  # nothing is known but the ranges
    assert found.steps[0].chosen.press.press.keys["twist"]  # one press of force alone cannot tell both
    assert found.steps[0].chosen.goal < 0.7
    assert found.steps[1].chosen.goal < 1.0
