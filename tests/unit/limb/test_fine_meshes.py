"""Finer meshes of spots: those that a study names, and those that are made of the coarser ones."""

from dataclasses import replace

import pytest

from palpate.domain import Indentation, Spot
from palpate.domain.indenter import Sphere
from palpate.errors import MeshError
from palpate.fit.least_squares import LeastSquares
from palpate.fit.searches import BestSet
from palpate.limb.checks import check_fine
from palpate.limb.loading import limb_warnings, load_limbs, refinement, size_at_contact
from palpate.mesh.specimens.blocks import block
from palpate.plugins.interfaces import LimbSource
from palpate.plugins.provides import Provides


class Blocks(LimbSource):
    name, summary = "blocks", "a block of hexahedra or tetrahedra"

    def load(self, path, spot):
        return replace(block("hex8" if path.name == "hex.vtu" else "tet10"), spot=spot)


def moved(limb, *, by_mm=(0.0, 0.0, 0.0), times=1.0):
    return replace(limb, mesh=replace(limb.mesh, points_mm=limb.mesh.points_mm * times + by_mm))


LAYERS = {"skin": 6.0}
FINE = block(n_across=12, n_down=6, layers_mm=LAYERS)


@pytest.mark.parametrize(
    ("fine", "match"),
    [
        (
            block(n_across=12, n_down=6),
            r"another region set \(soft_tissue, where the mesh has skin",
        ),
        (
            block(n_across=12, n_down=6, layers_mm={"skin": 3.0}),
            "region 'skin' ends 3 mm from where",
        ),
        (moved(FINE, by_mm=(5.0, 0.0, 0.0)), "another limb or frame: node set 'fixed' ends 5 mm from where"),
        (moved(FINE, times=1e-3), "another limb or frame"),
        (moved(FINE, by_mm=(0.0, 0.0, -0.7)), "the skin at the spot ends 0.7 mm from where it ends"),
        (
            block(n_across=6, n_down=12, layers_mm=LAYERS),
            r"not finer under the indenter: edges of 6.00 mm, where the mesh has 6.00 mm; at most 5.40 mm",
        ),
    ],
)
def test_a_fine_mesh_is_finer_and_of_the_same_limb_in_its_frame(fine, match):
    coarse = block(layers_mm=LAYERS)
    check_fine(coarse, FINE, 9.0, "study.toml:9: spot 'p1', fine_mesh: fine.vtu")
    with pytest.raises(MeshError, match=f"^study.toml:9: spot 'p1', fine_mesh: fine.vtu: .*{match}"):
        check_fine(coarse, fine, 9.0, "study.toml:9: spot 'p1', fine_mesh: fine.vtu")


def test_a_fine_mesh_is_a_limb_of_its_own(make_study, tissue, tmp_path):
    class Meshed(tissue.Analytic):
        provides = Provides()

    class TwoSizes(Blocks):
        def load(self, path, spot):
            return replace(block(n_across=12 if "fine" in path.name else 6), spot=spot)

    spots = tuple(
        replace(s, spot=Spot(name=s.spot.name), mesh=tmp_path / "a.vtu", fine_mesh=tmp_path / "fine.vtu")
        for s in make_study().spots[:1]
    )
    study = make_study(solver=Meshed(), limb_source=TwoSizes(), spots=spots)
    limbs = load_limbs(study)
    assert {name: limb.mesh.n_nodes for name, limb in limbs.items()} == {"p1": 196, "p1/fine": 676}
    assert limb_warnings(study, limbs) == []
    assert load_limbs(study, to_show=True) == {}
    for name in ("a.vtu", "fine.vtu"):
        (tmp_path / name).touch()
    swapped = [replace(s, mesh=s.fine_mesh, fine_mesh=s.mesh, place="study.toml:9") for s in spots]
    with pytest.raises(MeshError, match=r"^study\.toml:9: .*a\.vtu: not finer under the indenter: edges of"):
        load_limbs(replace(study, spots=tuple(swapped)))
    # What has been simulated is not judged again.
    assert list(load_limbs(replace(study, spots=tuple(swapped)), to_show=True)) == ["p1"]


def test_a_mesh_is_refined_where_the_study_asks_for_shorter_edges(make_study, tissue, tmp_path):
    class Meshed(tissue.Analytic):
        provides = Provides()

    spot = replace(make_study().spots[0], spot=Spot(name="p1"), mesh=tmp_path / "a.vtu", place="study.toml:9")
    pressed = Indentation(indenter=Sphere(radius_mm=7.5), path=[(0, 0), (5.0, 0)], friction=0.0)

    def loaded(edge_mm, mesh="a.vtu"):
        given = replace(spot, fine_edge_mm=edge_mm, mesh=tmp_path / mesh)
        study = make_study(solver=Meshed(), limb_source=Blocks(), spots=(given,), protocol=pressed)
        return study, load_limbs(study)

    study, limbs = loaded(4.0)
    assert limbs.keys() == {"p1", "p1/fine"}
    assert size_at_contact(study, limbs["p1"]) == pytest.approx(6.8, abs=0.3)
    assert size_at_contact(study, limbs["p1/fine"]) <= 4.0
    with pytest.raises(MeshError, match=r"^study\.toml:9: not finer under the indenter: edges of"):
        loaded(9.0)
    with pytest.raises(MeshError, match=r"^study\.toml:9: elements of kind hex8 cannot be refined"):
        loaded(4.0, "hex.vtu")


@pytest.mark.parametrize(
    ("mesh", "changes", "is_refined"),
    [
        ("a.vtu", {}, True),
        ("hex.vtu", {}, False),
        ("a.vtu", {"fine_runs": 0}, False),
        ("a.vtu", {"search": BestSet()}, False),
        ("a.vtu", {"protocol": None}, False),
    ],
)
def test_a_mesh_is_refined_to_the_size_of_the_contact_where_a_fit_can_use_it(
    make_study, tissue, tmp_path, mesh, changes, is_refined
):
    class Meshed(tissue.Analytic):
        provides = Provides(slopes=True)

    pressed = Indentation(indenter=Sphere(radius_mm=7.5), path=[(0, 0), (8.0, 0)], friction=0.0)
    spot = replace(
        make_study().spots[0], spot=Spot(name="p1"), mesh=tmp_path / mesh, fine_edge_mm=None, protocol=None
    )
    settings = {"protocol": pressed, "search": LeastSquares(), "fine_runs": 1, "spots": (spot,), **changes}
    study = make_study(solver=Meshed(), limb_source=Blocks(), **settings)
    limbs = load_limbs(study)
    assert ("p1/fine" in limbs) is is_refined
    if is_refined:
        assert size_at_contact(study, limbs["p1/fine"]) <= 2.5
        assert refinement(study, limbs)["p1"].ratio > 2.0
        assert refinement(study, limbs)["p1"].at_rim
        assert 0.1 < refinement(study, limbs)["p1"].finer_over_reach < 0.24
        slopeless = replace(study, solver=type("Slopeless", (Meshed,), {"provides": Provides()})())
        assert load_limbs(slopeless).keys() == {"p1"}
