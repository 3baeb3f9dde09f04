"""Decks of others: templates with placeholders, and limbs; what reaches outside or bombs is refused."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from palpate.domain import Spot
from palpate.errors import MeshError, StudyError
from palpate.specimens import block
from palpate.testing import LimbSourceContract
from palpate_febio.deck_reader import read_deck
from palpate_febio.limb_source import FebioDeckSettings, FebioDeckSource
from palpate_febio.settings import FebioSettings
from palpate_febio.solver import FebioSolver
from palpate_indentation import MeshioSource
from palpate_limb.limb_files import write_limb
from palpate_validation import certify

from .test_deck import SOLVER, job_of, mixed_limb

SPOT = Spot(name="p1")


@pytest.fixture
def deck(tmp_path):
    file = tmp_path / "limb.feb"
    file.write_bytes(SOLVER.write_deck(job_of(), mixed_limb()))
    return file


SOURCE = FebioDeckSource(FebioDeckSettings(contact="skin_surface"))


class TestFebioDeckSource(LimbSourceContract):
    @pytest.fixture
    def limb_source(self):
        return SOURCE

    @pytest.fixture
    def good_file(self, tmp_path):
        made = block(n_across=2, n_down=3, layers_mm={"skin": 6.0, "soft tissue": 6.0})
        limb = replace(made, mesh=replace(made.mesh, regions=("skin", "soft tissue", "fat")))
        (tmp_path / "good.feb").write_bytes(SOLVER.write_deck(job_of(), limb))
        return tmp_path / "good.feb"

    @pytest.fixture
    def bad_files(self, tmp_path, deck):
        text = deck.read_text()
        spoiled = {
            "empty": "",
            "half": text[: len(text) // 2],
            "other": "<html></html>",
            "old": text.replace('version="4.0"', 'version="1.2"'),
            "bomb": '<!DOCTYPE a [<!ENTITY b "b">]>' + text.split("\n", 1)[1],
            "include": text.replace("<Mesh>", "<Include>x</Include><Mesh>"),
            "from": text.replace("<Mesh>", '<Mesh from="/etc/passwd">'),
            "file": text.replace('file="rigid.csv"', 'file="../rigid.csv"'),
            "drive": text.replace('file="rigid.csv"', 'file="C:rigid.csv"'),
            "no_mesh": text.replace("Mesh>", "Mess>"),
            "no_surface": text.replace("skin_surface", "other_surface"),
            "not_held": text.replace("zero displacement", "zero fluid pressure"),
            "text_node": text.replace('<node id="1">-0.5', '<node id="1">here'),
            "nan_node": text.replace('<node id="1">-0.5', '<node id="1">nan'),
            "no_id": text.replace('<node id="1">', '<node id=" ">'),
            "same_id": text.replace('<node id="2">', '<node id="1">'),
            "two_numbers": text.replace('<node id="1">-0.5,', '<node id="1">'),
            "no_such_node": text.replace('<elem id="1">1,', '<elem id="1">999999,'),
            "word_in_cell": text.replace('<elem id="1">1,', '<elem id="1">one,'),
            "short_cell": text.replace('<elem id="1">1,', '<elem id="1">'),
            "kind": text.replace('type="hex8"', 'type="hex20"'),
            "no_material": text.replace('mat="1_skin"', 'mat="none"'),
            "no_name": text.replace('<NodeSet name="fixed"', "<NodeSet"),
            "face": text.replace("tri6", "tri99"),
            "nested": "<febio_spec version='4.0'>" + "<a>" * 100 + "</a>" * 100 + "</febio_spec>",
        }
        assert all(v != text for v in spoiled.values())
        files = [tmp_path / f"{name}.feb" for name in spoiled]
        for file, content in zip(files, spoiled.values(), strict=True):
            file.write_text(content)
        return files


def test_the_limb_is_the_one_that_was_written(deck):
    found, limb = SOURCE.load(deck, SPOT).mesh, mixed_limb()
    assert found.regions == ("1_skin", "2_soft_tissue", "3_fat")
    np.testing.assert_allclose(found.points_mm, limb.mesh.points_mm - [0.5, 0.5, 0.0], atol=1e-11)
    for kind in limb.mesh.cells:
        np.testing.assert_array_equal(found.cells[kind], limb.mesh.cells[kind])
        np.testing.assert_array_equal(found.cell_regions[kind], limb.mesh.cell_regions[kind])
    np.testing.assert_array_equal(found.node_sets["fixed"], limb.mesh.node_sets["fixed"])
    np.testing.assert_array_equal(found.node_sets["contact"], np.sort(limb.mesh.node_sets["contact"]))


def test_the_skin_is_the_decks_contact_surface(deck):
    named = SOURCE.load(deck, SPOT).mesh.node_sets["contact"]
    np.testing.assert_array_equal(FebioDeckSource().load(deck, SPOT).mesh.node_sets["contact"], named)
    deck.write_text(deck.read_text().replace("SurfacePair", "SurfaceTwo"))
    with pytest.raises(MeshError, match=r"'contact'.*skin_surface"):
        FebioDeckSource().load(deck, SPOT)


def test_regions_units_and_sets_by_name(deck):
    settings = FebioDeckSettings(
        unit="m",
        regions={"outer": "1_skin", "inner": "2_soft_tissue_tet10", "fat": "3_fat"},
        fixed="fixed",
        contact="skin_surface",
    )
    found = FebioDeckSource(settings).load(deck, SPOT).mesh
    assert found.regions == ("outer", "inner", "fat")
    assert np.ptp(found.points_mm[:, 2]) == pytest.approx(1000.0)
    with pytest.raises(MeshError, match="named by no region"):
        FebioDeckSource(replace_settings(settings, regions={"outer": "1_skin"})).load(deck, SPOT)


def test_a_mesh_is_compared_as_one_material_for_any_regions(tmp_path):
    write_limb(tmp_path / "limb.vtu", block(n_across=2, n_down=2, layers_mm={"skin": 2.0}))
    plugins = SimpleNamespace(limb_sources={"meshio": MeshioSource, "febio_deck": FebioDeckSource})
    assert certify._read(plugins, tmp_path / "limb.vtu").mesh.regions == ("soft_tissue",)


def replace_settings(settings, **change):
    return settings.model_copy(update=change)


@pytest.mark.parametrize(
    "held",
    [
        '<bc type="fix" node_set="base"><dofs>x,y,z</dofs></bc>',
        '<fix bc="x,y,z" node_set="base"/><fix bc="x" node_set="top"/>',
    ],
)
def test_decks_of_febio_3_and_2_5(tmp_path, held):
    file = tmp_path / "old.feb"
    file.write_text(
        """<febio_spec version="2.5"><Material><material id="3" name="fat" type="neo-Hookean"><E>0.1</E>
        <v>0.45</v></material></Material><Geometry><Nodes name="n"><node id="5">0,0,0</node>
        <node id="6">1,0,0</node><node id="7">0,1,0</node><node id="9">0,0,1</node></Nodes>
        <Elements type="tet4" mat="3" name="p"><elem id="1">5,6,7,9</elem></Elements>
        <NodeSet name="base"><node id="5"/><node id="6"/><node id="7"/></NodeSet>
        <NodeSet name="top"><node id="9"/></NodeSet></Geometry>
        <Boundary>"""
        + held
        + "</Boundary></febio_spec>"
    )
    limb = FebioDeckSource(FebioDeckSettings(contact="top")).load(file, SPOT)
    assert limb.mesh.regions == ("fat",)
    assert limb.mesh.node_sets["fixed"].tolist() == [0, 1, 2]
    assert limb.mesh.node_sets["contact"].tolist() == [3]
    assert read_deck(file).materials["fat"].values == {"E": 0.1, "v": 0.45}


# ------------------------------------------------------------------- template


def with_placeholders(text):
    """The written deck as a template: its numbers and curves replaced by placeholders."""
    pairs = {
        "<c1>0.16<": "<c1>{{skin.c1}}<",
        "<m1>6<": "<m1>{{ skin.m1 }}<",
        "<k>2<": "<k>{{skin.k}}<",
        "<c1>0.0129<": "<c1>{{soft tissue.c1}}<",
        "<c2>-0.002<": "<c2>{{soft tissue.c2}}<",
        "<c3>0.000276<": "<c3>{{soft tissue.c3}}<",
        "<k>0.6<": "<k>{{soft tissue.k}}<",
        "<E>0.0735<": "<E>{{fat.E}}<",
        "<v>0.4434<": "<v>{{fat.v}}<",
        "<time_steps>6<": "<time_steps>{{n_steps}}<",
        "<fric_coeff>1<": "<fric_coeff>{{friction}}<",
        'file="rigid.csv"': 'file="{{record}}"',
    }
    for old, new in pairs.items():
        assert old in text, old
        text = text.replace(old, new)
    for name in ("depth", "rotation", "steps"):
        start = text.index("<points>\n    <pt>")
        end = text.index("</points>", start)
        text = f"{text[:start]}<points>{{{{{name}}}}}{text[end:]}"
    return text


@pytest.fixture
def template(tmp_path, deck):
    file = tmp_path / "template.feb"
    file.write_text(with_placeholders(deck.read_text()))
    return file


def filled(file, **settings):
    given = SOLVER.settings.model_dump() | {"template": str(file)} | settings
    return FebioSolver(FebioSettings(**given)).write_deck(job_of(), mixed_limb()).decode()


def test_a_template_is_filled_with_the_jobs_numbers(template, deck):
    assert "".join(filled(template).split()) == "".join(deck.read_text().split())
    assert filled(template, depth_steps=8) != filled(template)


@pytest.mark.parametrize(
    ("old", "new", "error", "words"),
    [
        ("{{fat.E}}", "0.1", StudyError, r"lacks the placeholder \{\{fat.E\}\}"),
        ("{{depth}}", "<pt>0,0</pt>", StudyError, "lacks"),
        ("{{fat.E}}", "{{fat.F}}", StudyError, "line 59.*'fat.F' is not known"),
        ("{{record}}", "{{record}}.txt", StudyError, "no record of the indenter"),
        ("<Mesh>", "<Include>all.feb</Include><Mesh>", MeshError, "Include"),
        ("<Mesh>", '<Mesh from="../mesh.feb">', MeshError, "reaches outside"),
        ("<logfile>", '<logfile file="/tmp/x">', MeshError, "reaches outside"),
        ("</Mesh>", "", MeshError, "line"),
    ],
)
def test_a_template_that_cannot_be_trusted_is_refused(template, old, new, error, words):
    text = template.read_text()
    assert old in text
    template.write_text(text.replace(old, new))
    with pytest.raises(error, match=words):
        filled(template)


def test_a_changed_template_is_another_solver_and_its_files_are_copied(
    template, tmp_path, monkeypatch, install_febio
):
    monkeypatch.setenv("FAKE_FEBIO", "")
    program = install_febio(tmp_path / "bin")
    given = SOLVER.settings.model_dump() | {"template": str(template), "executable": str(program)}
    template.write_text(template.read_text().replace("<logfile>", '<logfile file="mine.log">'))
    solver, seen = FebioSolver(FebioSettings(**given)), set()
    (tmp_path / "other.log").write_text("not named")
    for text in ("precious", "more precious"):
        (tmp_path / "mine.log").write_text(text)
        seen.add(solver.version())
    template.write_text(template.read_text() + "<!-- -->")
    seen.add(solver.version())
    assert len(seen) == 3
    assert solver._beside_template() == [tmp_path / "mine.log"]


def test_a_missing_template_is_named(tmp_path):
    with pytest.raises(StudyError, match=r"no\.feb"):
        filled(tmp_path / "no.feb")


def test_bonded_nodes_are_no_part_of_an_import(deck):
    limb = mixed_limb()
    sets = {**limb.mesh.node_sets, "bonded": [4, 5]}
    deck.write_bytes(SOLVER.write_deck(job_of(), replace(limb, mesh=replace(limb.mesh, node_sets=sets))))
    assert read_deck(deck).node_sets["bonded"].tolist() == [4, 5]
