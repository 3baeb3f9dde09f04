"""The phantom's surface, bones and spots agree with each other and with their formulae."""

import json
from pathlib import Path

import meshio
import numpy as np
import pytest

from palpate.errors import MeshError
from palpate_forearm import CrossSection, InkMark, Phantom, Scanner, Surface, scan, write_phantom


def enclosed(surface: Surface) -> float:
    """Volume [mm³] by the divergence theorem, positive where faces look outwards."""
    a, b, c = np.moveaxis(surface.points_mm[surface.faces], 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def is_closed(surface: Surface) -> bool:
    """Every edge is used once in each direction."""
    f = surface.faces
    edges = np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]])
    forward = {tuple(e) for e in edges.tolist()}
    return len(forward) == len(edges) and all((b, a) in forward for a, b in forward)


@pytest.mark.slow
def test_surfaces_are_closed_and_have_their_volume() -> None:
    """A cylinder of elliptic section, π a b l; a cone's frustum, π l (r² + r R + R²) / 3."""
    straight = [
        CrossSection(station_mm=s, half_width_mm=30.0, half_height_mm=20.0) for s in (0.0, 50.0, 90.0)
    ]
    marks = (InkMark(name="p1", station_mm=40.0, angle_deg=90.0, colour=(1.0, 0.0, 0.0)),)
    phantom = Phantom(sections=tuple(straight), marks=marks)
    skin = phantom.skin_surface(1.0)
    assert is_closed(skin)
    assert enclosed(skin) == pytest.approx(np.pi * 30 * 20 * 90, rel=1e-3)
    radius = phantom.bone_surface("radius", 0.5)
    length = np.hypot(228.0, np.hypot(3.0, 4.0))
    assert is_closed(radius)
    assert enclosed(radius) == pytest.approx(np.pi * length * (7.5**2 + 7.5 * 5.5 + 5.5**2) / 3, rel=1e-3)
    np.testing.assert_allclose(phantom.spots[0].position_mm, [40.0, 0.0, 20.0], atol=1e-12)
    np.testing.assert_allclose(phantom.spots[0].normal, [0.0, 0.0, 1.0], atol=1e-12)


def test_normals_are_at_right_angles_to_the_surface_and_look_outwards() -> None:
    phantom, h = Phantom(), 1e-5
    for s, t in np.random.default_rng(0).uniform([5.0, 0.0], [215.0, 6.28], (20, 2)):
        normal = phantom.normal(s, t)
        along = phantom.position_mm(s + h, t) - phantom.position_mm(s - h, t)
        around = phantom.position_mm(s, t + h) - phantom.position_mm(s, t - h)
        assert abs(normal @ along) < 1e-9 * 1.0
        assert abs(normal @ around) < 1e-9 * 40.0
        assert normal[1:] @ phantom.position_mm(s, t)[1:] > 0.0


def test_the_scan_is_the_surface_with_ink_light_and_noise() -> None:
    phantom = Phantom()
    coloured = scan(phantom, Scanner(spacing_mm=2.0, noise_mm=0.1, colour_noise=0.0))
    exact = phantom.skin_surface(2.0)
    off = np.linalg.norm(coloured.points_mm - exact.points_mm, axis=1)
    assert off.std() < 0.1
    assert 0.07 < np.sqrt((off**2).mean()) < 0.13
    for mark, spot in zip(phantom.marks, phantom.spots, strict=True):
        nearest = np.linalg.norm(exact.points_mm - spot.position_mm, axis=1).argmin()
        ink = coloured.colours[nearest] / np.array(mark.colour)
        assert np.ptp(ink) < 0.02, "light changes the brightness of ink alone"


def test_a_phantom_that_cannot_be_is_refused() -> None:
    with pytest.raises(MeshError, match="two or more by rising station"):
        Phantom(sections=Phantom().sections[:1])
    with pytest.raises(MeshError, match="move the mark"):
        Phantom(marks=(InkMark(name="p1", station_mm=400.0, angle_deg=0.0, colour=(1, 0, 0)),))


def test_the_files_hold_what_was_made(tmp_path: Path) -> None:
    phantom = Phantom()
    write_phantom(tmp_path / "limb", phantom, Scanner(spacing_mm=4.0))
    ply = meshio.read(tmp_path / "limb" / "scan.ply")
    made = scan(phantom, Scanner(spacing_mm=4.0))
    np.testing.assert_allclose(ply.points, made.points_mm, atol=1e-4)
    np.testing.assert_array_equal(ply.cells_dict["triangle"], made.faces)
    np.testing.assert_array_equal(
        ply.point_data["green"].astype(np.uint8), np.round(255 * made.colours[:, 1])
    )
    stl = meshio.read(tmp_path / "limb" / "ulna.stl")
    assert len(stl.cells_dict["triangle"]) == len(phantom.bone_surface("ulna").faces)
    spots = json.loads((tmp_path / "limb" / "spots.json").read_text())
    assert spots["p2"]["position_mm"] == phantom.spots[1].position_mm.tolist()
