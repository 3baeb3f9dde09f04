"""A study that asks for more than its solver or its curves provide."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from palpate.plugins import provides
from palpate.plugins.catalogue import Plugins

from .toy_study import TEXT, line_of, messages, read_text

LIMB_STUDY = TEXT.replace(
    "[sampling]",
    """[limb]
source = "block"

[protocol]
indenter = { shape = "sphere", radius = "7.5 mm" }
depth = "10 mm"
twist = ["-22.5 deg", "0 deg"]
friction = 1.0

[sampling]""",
).replace('"closed_form"', '"on_mesh"')
LIMB_STUDY = LIMB_STUDY.replace('.txt" }', '.txt" }\nmesh = "s1.txt"')


@pytest.mark.parametrize(
    ("old", "new", "key", "remedy"),
    [
        (
            '"10 mm"',
            '"10 apples"',
            "protocol.depth",
            "'10 apples': unknown unit 'apples'; use e.g. \"10 mm\"",
        ),
        ('"10 mm"', '"-10 mm"', "protocol.depth", "greater than 0"),
        ('= "10 mm"', "= 10\n", "protocol.depth", 'write "10 mm"'),
        ('"-22.5 deg"', '"-22.5"', "protocol.twist[0]", 'write "-22.5 deg"'),
        ("friction = 1.0", "friction = -1.0", "protocol.friction", "greater than or equal to 0"),
        ("twist =", "twits =", "protocol.twits", "unknown key; did you mean 'twist'"),
        (
            'depth = "10 mm"',
            'motion = "move"',
            "protocol.motion",
            "no motion 'move' (known:",
        ),
        ('"sphere"', '"spher"', "protocol.indenter.shape", "no indenter 'spher'; did you mean 'sphere'"),
        ('"7.5 mm"', '"7.5 kg"', "protocol.indenter.radius", "not of the kind of mm"),
        ('"7.5 mm"', '"7.5 mm", edge = "1 mm"', "protocol.indenter.edge", "unknown key (known: radius)"),
        ('"7.5 mm"', '"0 mm"', "protocol.indenter.radius", "greater than 0"),
        ('"block"', '"blok"', "limb.source", "did you mean 'block'"),
    ],
)
def test_a_mistake_in_limb_or_protocol(
    tmp_path: Path, plugins: Plugins, old: str, new: str, key: str, remedy: str
) -> None:
    assert old in LIMB_STUDY
    text = LIMB_STUDY.replace(old, new, 1)
    (found,) = messages(tmp_path, plugins, text)
    assert found.startswith(f"{line_of(text, new)}: {key}: ")
    assert remedy in found


def test_a_scenario_needs_channels_that_are_measured(tmp_path: Path, plugins: Plugins) -> None:
    text = TEXT.replace('["pull only"]', '["pull only", "both"]')
    text += '\n[[scenario]]\nname = "both"\nweights = { pull = 1.0, push = 1.0 }\n'
    found = messages(tmp_path, plugins, text)
    where = f"{line_of(text, 'both')}: selection.scenarios[1]: scenario 'both' weighs channel 'push', "
    assert [line.startswith(f"{where}which no spot measures") for line in found] == [True]


def provide(plugins: Plugins, monkeypatch: pytest.MonkeyPatch, name: str, **changes: Any) -> None:
    """Let a solver provide something else."""
    solver = plugins.solvers[name]
    monkeypatch.setattr(solver, "provides", replace(solver.provides, **changes))


def test_a_scenario_needs_channels_that_the_solver_computes(
    tmp_path: Path, plugins: Plugins, monkeypatch: pytest.MonkeyPatch
) -> None:
    provide(plugins, monkeypatch, "closed_form", channels=("push",))
    (message,) = messages(tmp_path, plugins, TEXT)
    assert "selection.scenarios[0]: scenario 'pull only' weights channel 'pull', which solver" in message
    assert message.endswith("does not compute (it has push); choose another of either")


def test_a_solver_refuses_an_indenter_that_it_does_not_simulate(
    tmp_path: Path, plugins: Plugins, monkeypatch: pytest.MonkeyPatch
) -> None:
    provide(plugins, monkeypatch, "on_mesh", indenters=("punch", "cuff"))
    text = LIMB_STUDY + '\n[spot.protocol]\nindenter = { shape = "sphere", radius = "1 mm" }\n'
    whole, own = messages(tmp_path, plugins, text)
    assert whole.startswith(f"{line_of(text, 'shape')}: protocol.indenter.shape: solver 'on_mesh' does not")
    assert "'on_mesh' does not simulate indenter 'sphere' (it has punch, cuff); choose" in whole
    assert own.split(": ")[1] == "spot 's2', protocol.indenter.shape"


def test_a_solver_without_a_mesh_needs_a_protocol_where_it_makes_no_homogeneous_tests(
    tmp_path: Path, plugins: Plugins, monkeypatch: pytest.MonkeyPatch
) -> None:
    provide(plugins, monkeypatch, "closed_form", body="layers")
    (message,) = messages(tmp_path, plugins, TEXT)
    assert "solver.name: solver 'closed_form' needs a [protocol] table; add one" in message


def test_a_solver_without_a_mesh_takes_no_layers(
    tmp_path: Path, plugins: Plugins, monkeypatch: pytest.MonkeyPatch
) -> None:
    provide(plugins, monkeypatch, "closed_form", body="layers")
    text = TEXT.replace("[truth]", '[spot.layers]\nrubber = "2 mm ± 0.2 mm"\n[truth]', 1)
    found = messages(tmp_path, plugins, text)
    assert any("layers: solver 'closed_form' takes no mesh; remove the key" in text for text in found), found


def test_a_solver_refuses_regions_and_materials_that_it_does_not_simulate(
    tmp_path: Path, plugins: Plugins, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = TEXT + '\n[region.skin]\nmaterial = "spring"\nparameters = { k = "1 MPa", a = 0.5 }\n'
    assert read_text(tmp_path, plugins, text)
    provide(plugins, monkeypatch, "closed_form", max_regions=1)
    (message,) = messages(tmp_path, plugins, text)
    assert message.startswith(
        f"{line_of(text, '[region.skin]')}: region.skin: solver 'closed_form' simulates"
    )
    assert message.endswith(
        "1 region, and the study has 2 (rubber, skin); remove a table, or choose another solver"
    )
    monkeypatch.setattr(plugins.materials["spring"], "fields", ("fibre",))
    (message,) = messages(tmp_path, plugins, TEXT)
    assert "region.rubber.material: material 'spring' takes cell data fibre, which solver" in message
    monkeypatch.setattr(provides, "AnisotropicMaterial", plugins.materials["spring"])
    (message,) = messages(tmp_path, plugins, TEXT)
    assert "region.rubber.material: solver 'closed_form' simulates no anisotropic material such as" in message
    provide(plugins, monkeypatch, "closed_form", anisotropic=True)
    (message,) = messages(tmp_path, plugins, TEXT)
    assert message.endswith("which solver 'closed_form' has not; choose another of either")
    provide(plugins, monkeypatch, "closed_form", fields=True)
    assert read_text(tmp_path, plugins, TEXT)


def test_shares_of_the_stress_that_relax_are_parameters_where_the_solver_knows_time(
    tmp_path: Path, plugins: Plugins, monkeypatch: pytest.MonkeyPatch
) -> None:
    material = 'material = "spring"'
    text = TEXT.replace(material, f'{material}\nrelaxation_times = ["0.25 s", "1 min"]')
    (message,) = messages(tmp_path, plugins, text)
    assert (
        "region.rubber.relaxation_times: solver 'closed_form' simulates no material that relaxes" in message
    )
    provide(plugins, monkeypatch, "closed_form", relaxation=True)
    names = read_text(tmp_path, plugins, text).space.names
    assert names == ("rubber.k", "rubber.relaxed_250ms", "rubber.relaxed_60s")
    (message,) = messages(tmp_path, plugins, text.replace("1 min", "250 ms"))
    assert "region.rubber.relaxation_times: time constants are at least 1 ms, and that far apart" in message
    (message,) = messages(
        tmp_path, plugins, TEXT.replace(material, f'{material}\nrelaxing_stress = "isochoric"')
    )
    assert "region.rubber.relaxing_stress: nothing relaxes; give relaxation_times too" in message


def test_a_region_that_relaxes_needs_the_times_of_each_motion(
    tmp_path: Path, plugins: Plugins, monkeypatch: pytest.MonkeyPatch
) -> None:
    provide(plugins, monkeypatch, "on_mesh", relaxation=True)
    material = 'material = "spring"'
    text = LIMB_STUDY.replace(material, f'{material}\nrelaxation_times = ["1 s"]')
    text += '\n[spot.protocol]\ndepth = "5 mm"\n'
    for key, message in zip(
        ("protocol.motion", "spot 's2', protocol.motion"), messages(tmp_path, plugins, text), strict=True
    ):
        assert (
            f"{key}: region 'rubber' relaxes, which needs the times of the motion; name a motion" in message
        )


@pytest.mark.parametrize(("share", "relaxes"), [("0", False), ("0.2", True), ("", True)])
def test_the_model_relaxes_where_a_share_is_searched_or_above_zero(
    tmp_path: Path, plugins: Plugins, monkeypatch: pytest.MonkeyPatch, share: str, relaxes: bool
) -> None:
    provide(plugins, monkeypatch, "closed_form", relaxation=True)
    material = 'material = "spring"'
    text = TEXT.replace(material, f'{material}\nrelaxation_times = ["1 s"]')
    given = "[region.rubber.parameters]\n"
    assert given in text
    text = text.replace(given, f"{given}relaxed_1s = {share}\n" if share else given)
    study = read_text(tmp_path, plugins, text)
    assert study.models_relaxation(study.generalising) is relaxes


def test_a_spot_has_a_motion_of_its_own(
    tmp_path: Path, plugins: Plugins, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = LIMB_STUDY + '\n[spot.protocol]\ndepht = "5 mm"\n'
    (message,) = messages(tmp_path, plugins, text)
    assert "spot 's2', protocol.depht: unknown key; did you mean 'depth'" in message
    provide(plugins, monkeypatch, "on_mesh", motions=("depth",))
    text = LIMB_STUDY.replace('twist = ["-22.5 deg", "0 deg"]\n', "")
    (message,) = messages(tmp_path, plugins, text + '\n[spot.protocol]\ntwist = ["5 deg"]\n')
    assert "spot 's2', protocol.motion: solver 'on_mesh' simulates no motion with rotation" in message


def test_friction_is_that_of_the_protocol_or_of_the_tool(tmp_path: Path, plugins: Plugins) -> None:
    (message,) = messages(tmp_path, plugins, LIMB_STUDY.replace("friction = 1.0", ""))
    assert "protocol.friction: missing; add friction = … here, or to the indenter" in message
    own = LIMB_STUDY.replace("friction = 1.0", "").replace('"7.5 mm"', '"7.5 mm", friction = -1.0')
    (message,) = messages(tmp_path, plugins, own)
    assert "protocol.indenter.friction: -1.0: must be greater than or equal to 0" in message
