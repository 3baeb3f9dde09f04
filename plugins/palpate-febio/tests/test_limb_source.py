"""Limbs from decks of others; what reaches outside or bombs is refused."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.domain import Spot
from palpate.errors import MeshError
from palpate.mesh.specimens import block
from palpate.testing import LimbSourceContract
from palpate_febio.deck_reader import read_deck
from palpate_febio.limb_source import FebioDeckSettings, FebioDeckSource

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
            "kind": text.replace('type="hex8"', 'type="hex64"'),
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
    assert "fat" in {part.material for part in read_deck(file).parts}


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<febio_spec", '<!DOCTYPE a [<!ENTITY b "b">]><febio_spec', "document type.*remove it"),
        ("<febio_spec", '<!DOCTYPE a SYSTEM "file:///etc/passwd"><febio_spec', "document type.*remove it"),
        ("<Mesh>", "<Mesh>&b;", "not XML that can be read.*line"),
        ("</Mesh>", "", "not XML that can be read.*line"),
        ("<Mesh>", "<Include>all.feb</Include><Mesh>", "Include"),
        ("<Mesh>", '<Mesh from="../mesh.feb">', "reaches outside"),
        ("<logfile>", '<logfile file="/elsewhere/x">', "reaches outside"),
        ('encoding="ISO-8859-1"', 'encoding="klingon"', "not XML that can be read"),
        ("<Mesh>", "<a>" * 200_000 + "</a>" * 200_000 + "<Mess>", "not XML that can be read"),
    ],
)
def test_a_deck_that_cannot_be_trusted_is_refused(deck, old, new, words):
    text = deck.read_text()
    assert old in text
    deck.write_text(text.replace(old, new))
    with pytest.raises(MeshError, match=words):
        read_deck(deck)


def test_a_deck_as_deep_as_it_is_long_is_read_without_a_crash(deck):
    deck.write_text(deck.read_text().replace("<Mesh>", "<a>" * 200_000 + "</a>" * 200_000 + "<Mesh>"))
    assert len(read_deck(deck).parts) == 3


def test_a_deck_that_is_too_large_is_refused(deck, monkeypatch):
    monkeypatch.setattr("palpate_febio.deck_reader.LARGEST_FILE_BYTES", 100)
    with pytest.raises(MeshError, match="larger than 100 bytes"):
        read_deck(deck)


def test_bonded_nodes_are_no_part_of_an_import(deck):
    limb = mixed_limb()
    sets = {**limb.mesh.node_sets, "bonded": [4, 5]}
    deck.write_bytes(SOLVER.write_deck(job_of(), replace(limb, mesh=replace(limb.mesh, node_sets=sets))))
    assert read_deck(deck).node_sets["bonded"].tolist() == [4, 5]
