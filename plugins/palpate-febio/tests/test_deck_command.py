"""``palpate febio-deck``."""

DECK = """<febio_spec version="4.0"><Material>
<material id="1" name="silicone" type="Yeoh"><c1>0.0129</c1><c2>-2.016e-3</c2>
<c3>2.7623e-4</c3><k>0.6</k></material>
<material id="2" name="skin" type="Ogden"><c1>0.1</c1><m1>2</m1><c2>0.1</c2><m2>-2</m2><k>1</k></material>
<material id="3" name="odd" type="lung"><E>1</E></material>
<material id="4" name="tool" type="rigid body"/></Material>
<Mesh><Nodes name="n"><node id="1">0,0,0</node><node id="2">1,0,0</node><node id="3">0,1,0</node>
<node id="4">0,0,1</node></Nodes><Elements type="tet4" name="part"><elem id="1">1,2,3,4</elem></Elements>
<NodeSet name="base">1,2,3</NodeSet></Mesh>
<MeshDomains><SolidDomain name="part" mat="silicone"/></MeshDomains></febio_spec>"""


def test_a_decks_coefficients_are_shown_as_lines_of_a_study(call, tmp_path):
    (tmp_path / "limb.feb").write_text(DECK)
    found = call("febio-deck", "limb.feb", "--json", plugin=None).json
    assert found["parts"] == {"part": 1}
    assert found["node_sets"] == {"base": 3}
    assert set(found["materials"]) == {"silicone", "skin", "odd"}
    assert found["materials"]["silicone"]["study"].splitlines() == [
        "[region.silicone]",
        'material = "yeoh"',
        'convention = "febio4"',
        "settings = { terms = 3 }",
        "[region.silicone.parameters]",
        'c1 = "0.0129 MPa"',
        'c2 = "-0.002016 MPa"',
        'c3 = "0.00027623 MPa"',
        'kappa = "0.6 MPa"',
    ]
    assert "terms = 2" in found["materials"]["skin"]["study"]
    assert found["materials"]["odd"]["study"] is None
    shown = call("febio-deck", "limb.feb", plugin=None)
    assert shown.code == 0
    assert "no material of palpate is FEBio's lung" in shown.out


def test_a_deck_that_cannot_be_read_ends_with_code_2(call, tmp_path):
    (tmp_path / "bad.feb").write_text("<febio_spec")
    assert call("febio-deck", "bad.feb", plugin=None).code == 2
    assert "bad.feb" in call("febio-deck", "bad.feb", plugin=None).err
