"""Every condition of a deck that holds nodes of the limb is used or named, however FEBio spells it."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate.domain import Spot
from palpate.errors import MeshError
from palpate.limb.checks import check_limb
from palpate_febio.limb_source import FebioDeckSettings, FebioDeckSource

DATA = Path(__file__).parent / "data" / "decks_of_others"
SPOT = Spot(name="p1")
PLAIN = (DATA / "deck40_zero_in_a_step.feb").read_text()
RIGID = (DATA / "deck40_rigid_bone_shares_nodes.feb").read_text()
OLD = (DATA / "deck25_more_dofs.feb").read_text()
ZERO = (
    '<bc name="{0}" node_set="{0}" type="zero displacement">'
    "<x_dof>1</x_dof><y_dof>1</y_dof><z_dof>1</z_dof></bc>"
)
CUTS = f"<Boundary>{ZERO.format('cuts')}</Boundary>"
FACES = "".join(
    f"<quad4 id='{k + 1}'>{n},{n + 1},{n + 6},{n + 5}</quad4>"
    for k, n in enumerate(5 * row + column + 1 for row in range(4) for column in range(4))
)
SETS = f'<Surface name="base">{FACES}</Surface></Mesh>'
DOFS = "".join(f"<R{dof}_dof>1</R{dof}_dof>" for dof in "xyzuvw")


def deck_of(folder, text, conditions):
    """A deck with other conditions in the place of its own."""
    start = text.index("<Boundary>")
    file = folder / "deck.feb"
    file.write_text(text[:start].replace("</Mesh>", SETS) + conditions + "</febio_spec>")
    return file


def load(file, **settings):
    return FebioDeckSource(FebioDeckSettings(**settings)).load(file, SPOT)


def counts(limb):
    sets = limb.mesh.node_sets
    return len(sets["fixed"]), len(sets["contact"])


@pytest.mark.parametrize("file", sorted(DATA.glob("*.feb")), ids=lambda file: file.stem)
def test_the_supports_of_each_spelling_are_read(file):
    limb = load(file)
    check_limb(limb, limb.mesh.regions)
    assert counts(limb) == (45, 25)
    z, x = limb.mesh.points_mm[limb.mesh.node_sets["fixed"]][:, [2, 0]].T
    assert ((z == -20.0) | (np.abs(x) == 20.0)).all()
    assert any("fixes 45 nodes of the limb" in remark for remark in limb.remarks)
    assert limb.warnings == ()


NEW = {
    "dofs of version 3": '<bc type="fix" node_set="bone"><dofs>z, y,x</dofs></bc>',
    "dofs with shells": '<bc type="fix" node_set="bone"><dofs>sx,x,sy,y,sz,z</dofs></bc>',
    "displacement of version 3": '<bc type="fixed displacement" node_set="bone"><dofs>x,y,z</dofs></bc>',
    "prescribed in version 3": "".join(
        f'<bc type="prescribe" node_set="bone"><dof>{a}</dof><scale lc="1">0.0</scale></bc>' for a in "zxy"
    ),
    "a surface": ZERO.format("@surface:base"),
    "two axes and one": ZERO.format("bone").replace("<x_dof>1", "<x_dof>0")
    + ZERO.format("@surface:base").replace("<y_dof>1", "<y_dof>0").replace("<z_dof>1", "<z_dof>0"),
}


@pytest.mark.parametrize("condition", NEW.values(), ids=NEW)
@pytest.mark.parametrize("where", ["", "<Step>", "<Step><step>", "<Step id='1'><Control/>"])
def test_siblings_in_the_deck_and_in_a_step(tmp_path, condition, where):
    tags = re.findall(r"<(\w+)[^>/]*>", where)
    inside = f"{where}<Boundary>{condition}</Boundary>{''.join(f'</{tag}>' for tag in tags[::-1])}"
    limb = load(deck_of(tmp_path, PLAIN, CUTS + inside))
    assert counts(limb) == (45, 25)
    assert limb.warnings == ()


@given(st.permutations(["x", "y", "z", "sx", "sy", "sz", "p"]), st.sampled_from([",", ", ", " "]))
def test_dofs_of_version_2_5_in_any_order(tmp_path_factory, dofs, comma):
    bone = f'<fix bc="{comma.join(dofs)}" node_set="bone"/>'
    held = f'<Boundary><fix bc="x,y,z" node_set="cuts"/>{bone}</Boundary>'
    assert counts(load(deck_of(tmp_path_factory.mktemp("deck"), OLD, held))) == (45, 25)


@pytest.mark.parametrize(
    "body",
    [
        f'<Rigid><rigid_bc type="rigid_fixed"><rb>bone</rb>{DOFS}</rigid_bc></Rigid>',
        '<Rigid><rigid_constraint type="fix"><rb>2</rb><dofs>Rx,Ry,Rz,Ru,Rv,Rw</dofs>'
        "</rigid_constraint></Rigid>",
        "<Rigid>"
        + "".join(
            f'<rigid_bc type="{kind}"><rb>bone</rb><dof>{axis}</dof><value lc="1">0</value></rigid_bc>'
            for kind in ("rigid_displacement", "rigid_rotation")
            for axis in "xyz"
        )
        + "</Rigid>",
        "<Boundary><rigid_body mat='2'>"
        + "".join(f"<fixed bc='{dof}'/>" for dof in ("x", "y", "z", "Rx", "Ry", "Rz"))
        + "</rigid_body></Boundary>",
    ],
    ids=["4.0", "3.0", "prescribed 0", "2.5"],
)
def test_a_bone_that_is_a_rigid_body_is_fixed_if_the_deck_holds_it(tmp_path, body):
    limb = load(deck_of(tmp_path, RIGID, CUTS + body))
    assert counts(limb) == (45, 25)
    assert "the rigid part 'Part2' is left out" in limb.remarks
    free = load(
        deck_of(tmp_path, RIGID, CUTS + body.replace("Rw", "Rv").replace("Rz'", "Ry'").replace(">z<", ">y<"))
    )
    assert counts(free)[0] == 30
    assert "25 nodes of the limb" in free.warnings[0]
    assert "name the body's part in the setting fixed" in free.warnings[0]
    assert counts(load(tmp_path / "deck.feb", fixed=["cuts", "Part2"])) == (45, 25)


HELD = f'<Rigid><rigid_bc type="rigid_fixed"><rb>bone</rb>{DOFS}</rigid_bc></Rigid>'


def with_own_nodes(text):
    """The deck whose rigid bone has its own copies, 201 to 225, of the nodes 1 to 25 that it shares."""
    start = text.index('name="Part2"')
    end = text.index("</Elements>", start)
    bone = re.sub(r"(?<=[>,])(\d|1\d|2[0-5])(?=[,<])", lambda n: str(200 + int(n[0])), text[start:end])
    rows = {int(n): row for n, row in re.findall(r'<node id="(\d+)">(.*?)</node>', text)}
    copies = "".join(f'<node id="{200 + n}">{rows[n]}</node>' for n in range(1, 26))
    top = re.sub(r"(?<=[>,])\d+", lambda n: str(200 + int(n[0])), f'<Surface name="top">{FACES}</Surface>')
    pair = '<SurfacePair name="p"><primary>base</primary><secondary>top</secondary></SurfacePair>'
    text = text[:start] + bone + text[end:]
    return text.replace("</Nodes>", f"{copies}</Nodes>", 1).replace("</Mesh>", f"{top}{pair}</Mesh>")


def test_tissue_that_is_tied_to_a_held_bone_is_fixed(tmp_path):
    """By a tied contact, and by a condition on a node set; without either, the bone holds nothing."""
    text = with_own_nodes(RIGID)
    glue = '<bc name="glue" type="rigid" node_set="@surface:base"><rb>bone</rb></bc>'
    contact = '<Contact><contact name="tie" type="tied-elastic" surface_pair="p"/></Contact>'
    assert counts(load(deck_of(tmp_path, text, CUTS + HELD))) == (30, 25)
    for conditions in (CUTS + HELD + contact, CUTS.replace("</Boundary>", f"{glue}</Boundary>") + HELD):
        limb = load(deck_of(tmp_path, text, conditions))
        check_limb(limb, limb.mesh.regions)
        assert counts(limb) == (45, 25)
    free = load(deck_of(tmp_path, text, CUTS + contact))
    assert counts(free) == (30, 25)
    assert "contact 'tie' ties nodes to rigid body 'bone'" in free.warnings[0]


@pytest.mark.parametrize("body", ["bone", "2", "other"])
def test_nodes_of_a_rigid_body_without_elements_are_fixed_or_named(tmp_path, body):
    text = re.sub(r'<Elements type="\w+" name="Part2".*?</Elements>', "", RIGID, flags=re.DOTALL)
    text = re.sub(r'<SolidDomain name="Part2"[^>]*/>', "", text)
    glue = f'<bc name="glue" type="rigid" node_set="@surface:base"><rb>{body}</rb></bc></Boundary>'
    limb = load(deck_of(tmp_path, text, CUTS.replace("</Boundary>", glue) + HELD))
    assert counts(limb) == ((30 if body == "other" else 45), 25)
    assert any("'glue' ties nodes to rigid body 'other'" in w for w in limb.warnings) == (body == "other")
    absent = load(deck_of(tmp_path, text, CUTS.replace("</Boundary>", glue.replace("base", "none")) + HELD))
    assert any(
        "'glue' of '@surface:none', which is not there, is not understood" in w for w in absent.warnings
    )


def test_a_list_of_parts_is_a_set_of_nodes(tmp_path):
    parts = '<PartList name="all">Part1</PartList></Mesh>'
    held = ZERO.format("@part_list:all").replace("<x_dof>1", "<x_dof>0")
    text = deck_of(tmp_path, PLAIN, f"<Boundary>{ZERO.format('bone')}{ZERO.format('cuts')}{held}</Boundary>")
    text.write_text(text.read_text().replace("</Mesh>", parts))
    limb = load(text)
    assert counts(limb) == (45, 25)
    assert "30 nodes are held in y and z alone by '@part_list:all'" in " ".join(limb.warnings)
    text.write_text(text.read_text().replace(parts, parts.replace("Part1", "Part1, Part9")))
    with pytest.raises(MeshError, match="part list 'all' names the part 'Part9', which is not there"):
        load(text)


def test_a_list_of_parts_may_name_a_rigid_one(tmp_path):
    held = CUTS.replace("</Boundary>", ZERO.format("@part_list:bones") + "</Boundary>")
    file = deck_of(tmp_path, RIGID, held)
    file.write_text(file.read_text().replace("</Mesh>", '<PartList name="bones">Part2</PartList></Mesh>'))
    assert counts(load(file)) == (45, 25)


@pytest.mark.parametrize("how", ['<Mesh from="mesh.feb"/>', "<Include>mesh.feb</Include>"])
def test_sections_in_files_of_the_folder_are_read(tmp_path, how):
    start, end = PLAIN.index("<Mesh>"), PLAIN.index("</Mesh>") + len("</Mesh>")
    (tmp_path / "deck.feb").write_text(PLAIN[:start] + how + PLAIN[end:])
    with pytest.raises(MeshError, match=r"> names the file 'mesh.feb'; put it next to the deck"):
        load(tmp_path / "deck.feb")
    (tmp_path / "mesh.feb").write_text(f'<febio_spec version="4.0">{PLAIN[start:end]}</febio_spec>')
    assert counts(load(tmp_path / "deck.feb")) == (45, 25)
    (tmp_path / "mesh.feb").write_text(f'<febio_spec version="4.0">{how}</febio_spec>')
    with pytest.raises(MeshError, match=r"mesh.feb: <\w+> names the file 'mesh.feb'"):
        load(tmp_path / "deck.feb")


@pytest.mark.parametrize("how", ['<Mesh from="more.feb"/>', "<Include>more.feb</Include>"])
@pytest.mark.parametrize("second", ["<Elements", '<NodeSet name="bone"', "<Surface"])
def test_the_meshes_of_several_files_are_one(tmp_path, how, second):
    start, end = PLAIN.index(second), PLAIN.index("</Mesh>")
    (tmp_path / "deck.feb").write_text(f"{PLAIN[:start]}</Mesh>{how}{PLAIN[end + len('</Mesh>') :]}")
    more = f'<febio_spec version="4.0"><Mesh>{PLAIN[start:end]}</Mesh></febio_spec>'
    (tmp_path / "more.feb").write_text(more)
    assert counts(load(tmp_path / "deck.feb")) == (45, 25)
    (tmp_path / "more.feb").write_text(more.replace("</Mesh>", '<NodeSet name="cuts">1</NodeSet></Mesh>'))
    with pytest.raises(MeshError, match="two <NodeSet> have the name 'cuts'"):
        load(tmp_path / "deck.feb")


@pytest.mark.parametrize(
    ("section", "why"), [(CUTS, "the deck has one too"), ("<Boundary></Boundary>", "the file has none")]
)
def test_a_section_is_in_the_file_that_the_deck_names(tmp_path, section, why):
    deck = deck_of(tmp_path, PLAIN, section.replace("<Boundary>", '<Boundary from="other.feb">'))
    (tmp_path / "other.feb").write_text('<febio_spec version="4.0"><boundary/></febio_spec>')
    with pytest.raises(MeshError, match=f"deck.feb: <Boundary> is to come from 'other.feb', but {why}; "):
        load(deck)
    (tmp_path / "other.feb").write_text(CUTS)
    with pytest.raises(MeshError, match=r"other.feb: <Boundary> where febio_spec is needed"):
        load(deck)


@pytest.mark.parametrize("attribute", ["from", "file"])
def test_supports_in_another_file_are_read(tmp_path, attribute):
    deck = deck_of(tmp_path, PLAIN, f'<Boundary {attribute}="held.feb"/>')
    held = f"<Boundary>{ZERO.format('cuts')}{ZERO.format('bone')}</Boundary>"
    (tmp_path / "held.feb").write_text(f'<febio_spec version="4.0">{held}</febio_spec>')
    assert counts(load(deck)) == (45, 25)


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ('<material id="9" name="tissue" type="rigid body"/>', "the name 'tissue'"),
        ('<material id="1" name="gel" type="rigid body"/>', "the id '1'"),
    ],
)
def test_two_materials_of_one_name_or_id_are_refused(tmp_path, more, why):
    held = f"<Boundary>{ZERO.format('cuts')}{ZERO.format('bone')}</Boundary>"
    deck = deck_of(tmp_path, PLAIN, f"<Include>more.feb</Include>{held}")
    same = re.search(r"<material.*?</material>", PLAIN, re.DOTALL)[0]
    for material in (same, more):
        section = f"<Material>{material}</Material>"
        (tmp_path / "more.feb").write_text(f'<febio_spec version="4.0">{section}</febio_spec>')
        if material is same:
            assert counts(load(deck)) == (45, 25)
    with pytest.raises(MeshError, match=f"two materials have {why}; give each its own"):
        load(deck)


def test_files_that_include_each_other_manifold_are_refused(tmp_path, monkeypatch):
    for k in range(4):
        includes = f"<Include>{k + 1}.feb</Include>" * 10
        (tmp_path / f"{k}.feb").write_text(f'<febio_spec version="4.0">{includes}</febio_spec>')
    (tmp_path / "4.feb").write_text('<febio_spec version="4.0"/>')
    with pytest.raises(MeshError, match=r"\d.feb: the deck includes more than 100 files; save it as fewer"):
        load(tmp_path / "0.feb")
    monkeypatch.setattr("palpate_febio.deck_reader.LARGEST_FILE_BYTES", 1000)
    with pytest.raises(MeshError, match=r"\d.feb: larger than 1,000 bytes with the \d files read before it"):
        load(tmp_path / "0.feb")


def test_what_is_not_used_is_named(tmp_path):
    roller = ZERO.format("bone").replace("<x_dof>1", "<x_dof>0").replace("<y_dof>1", "<y_dof>0")
    push = (
        '<bc name="push" node_set="bone" type="prescribed displacement">'
        '<dof>z</dof><value lc="1">-2</value></bc>'
    )
    odd = '<bc name="odd" node_set="bone" type="prescribed deformation"/>'
    wet = '<bc name="wet" node_set="bone" type="zero fluid pressure"/>'
    plane = '<Constraints><constraint type="symmetry plane" surface="base"/></Constraints>'
    conditions = f"<Boundary>{ZERO.format('cuts')}{roller}{push}{odd}{wet}</Boundary>{plane}"
    limb = load(deck_of(tmp_path, PLAIN, conditions))
    assert counts(limb)[0] == 30
    text = "\n".join(limb.warnings)
    assert "held in z alone by 'bone'" in text
    assert "'push' moves 25 nodes of the limb in z" in text
    assert "'odd' of type 'prescribed deformation' is not understood" in text
    assert "symmetry plane" in text
    assert "wet" not in text


def test_a_setting_that_leaves_out_a_support_is_a_warning(tmp_path):
    file = deck_of(tmp_path, PLAIN, f"<Boundary>{ZERO.format('cuts')}{ZERO.format('bone')}</Boundary>")
    assert "holds 15 more nodes by 'bone'" in load(file, fixed="cuts").warnings[0]
    assert load(file, fixed=["cuts", "@surface:base"]).warnings == ()


def test_nothing_that_holds_the_limb_is_refused_with_what_the_deck_has(tmp_path):
    roller = ZERO.format("bone").replace("<x_dof>1", "<x_dof>0")
    with pytest.raises(MeshError, match=r"held in y and z alone by 'bone'.*setting fixed .there: cuts, bone"):
        load(deck_of(tmp_path, PLAIN, f"<Boundary>{roller}</Boundary>"))


def test_parts_that_are_no_limb_are_left_out_by_name(tmp_path):
    shell = '<Elements type="quad4" name="plate"><elem id="99">1,2,7,6</elem></Elements><NodeSet name="cuts"'
    text = PLAIN.replace('<NodeSet name="cuts"', shell).replace(
        "</MeshDomains>", '<ShellDomain name="plate" mat="tissue"/></MeshDomains>'
    )
    file = deck_of(tmp_path, text, f"<Boundary>{ZERO.format('cuts')}{ZERO.format('bone')}</Boundary>")
    with pytest.raises(MeshError, match=r"elements 'plate' are shells.*setting leave_out"):
        load(file)
    limb = load(file, leave_out=["plate", "plat", "1"])
    assert counts(limb) == (45, 25)
    assert limb.absent == ("plat", "1")


def test_several_materials_are_one_region(tmp_path):
    limb = load(DATA / "deck40_zero_in_a_step.feb", regions={"muscle": ["tissue", "other"]})
    assert limb.mesh.regions == ("muscle",)


def test_wedges_are_cut_into_tetrahedra_and_stay_whole(tmp_path):
    """Each hexahedron of the block as two wedges."""
    text = re.sub(
        r'<elem id="(\d+)">([\d,]+)</elem>',
        lambda found: "".join(
            f'<elem id="{2 * int(found[1]) + k}">{",".join(found[2].split(",")[n] for n in nodes)}</elem>'
            for k, nodes in enumerate(((0, 1, 2, 4, 5, 6), (0, 2, 3, 4, 6, 7)))
        ),
        PLAIN.replace('type="hex8"', 'type="penta6"'),
    )
    limb = load(deck_of(tmp_path, text, f"<Boundary>{ZERO.format('cuts')}{ZERO.format('bone')}</Boundary>"))
    check_limb(limb, limb.mesh.regions)
    assert {kind: len(cells) for kind, cells in limb.mesh.cells.items()} == {"tet4": 32 * 6}
    assert counts(limb) == (45, 25)
    assert "elements penta6 are cut into 192 tetrahedra" in limb.remarks


def test_an_edge_and_a_set_of_elements_hold_nodes_too(tmp_path):
    sets = (
        '<Edge name="line"><line2 id="1">1,2</line2><line2 id="2">2,3</line2></Edge>'
        '<ElementSet name="low">1,2</ElementSet></Mesh>'
    )
    text = PLAIN.replace("</Mesh>", sets)
    held = ZERO.format("@edge:line") + ZERO.format("@elem_set:low")
    limb = load(deck_of(tmp_path, text, f"<Boundary>{held}</Boundary>"))
    assert counts(limb) == (12, 25)
