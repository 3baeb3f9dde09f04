"""Colours are read alike in every spelling of scanners; what is no colour is named."""

from pathlib import Path

import numpy as np
import pytest

from palpate.errors import MeshError
from palpate_limb.marks import find_marks
from palpate_limb.surfaces import Surface, read_surface

N_AROUND, N_ALONG = 80, 50


def tube() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, faces and colours, 0 to 255, of a tube with one red mark at (40, 0, 60)."""
    turn, z = np.meshgrid(np.linspace(0, 2 * np.pi, N_AROUND, endpoint=False), np.linspace(0, 120, N_ALONG))
    points = np.column_stack([(40 * np.cos(turn)).ravel(), (36 * np.sin(turn)).ravel(), z.ravel()])
    grid = np.arange(N_AROUND * N_ALONG).reshape(N_ALONG, N_AROUND)
    a, b = grid[:-1].ravel(), np.roll(grid, -1, 1)[:-1].ravel()
    c, d = np.roll(grid, -1, 1)[1:].ravel(), grid[1:].ravel()
    colours = np.tile([217, 184, 163], (len(points), 1))
    colours[np.linalg.norm(points - [40, 0, 60], axis=1) < 8.0] = [230, 26, 26]
    return points, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]), colours


POINTS, FACES, COLOURS = tube()
ONES = np.ones(len(POINTS))


def rows(*columns: np.ndarray, before: str = "") -> str:
    return "".join(f"{before}{' '.join(f'{x:.7g}' for x in row)}\n" for row in np.column_stack(columns))


def obj(*columns: np.ndarray) -> str:
    return rows(*columns, before="v ") + "".join(f"f {a} {b} {c}\n" for a, b, c in FACES + 1)


def off(head: str, *columns: np.ndarray) -> str:
    return f"{head}\n{len(POINTS)} {len(FACES)} 0\n{rows(*columns)}" + rows(np.full(len(FACES), 3), FACES)


def ply(kind: str, names: str, values: np.ndarray) -> str:
    more = "".join(f"property {kind} {name}\n" for name in names.split())
    place = "".join(f"property float {axis}\n" for axis in "xyz")
    head = f"ply\nformat ascii 1.0\nelement vertex {len(POINTS)}\n{place}"
    faces = f"element face {len(FACES)}\nproperty list uchar int vertex_indices\nend_header\n"
    return head + more + faces + rows(POINTS, values) + rows(np.full(len(FACES), 3), FACES)


SPELLINGS = {
    "0_1.obj": obj(POINTS, COLOURS / 255.0),
    "bytes.obj": obj(POINTS, COLOURS),
    "weight.obj": obj(POINTS, ONES, COLOURS / 255.0),
    "weight_bytes.obj": obj(POINTS, ONES, COLOURS),
    "opacity.obj": obj(POINTS, COLOURS, 255 * ONES),
    "weight_opacity.obj": obj(POINTS, ONES, COLOURS / 255.0, ONES),
    "coff.off": off("COFF", POINTS, COLOURS, 255 * ONES),
    "coff_0_1.off": off("COFF", POINTS, COLOURS / 255.0, ONES),
    "cnoff.off": off("CNOFF", POINTS, np.tile([0.0, 0.0, 1.0], (len(POINTS), 1)), COLOURS),
    "uchar.ply": ply("uchar", "red green blue", COLOURS),
    "rgb.ply": ply("uchar", "r g b", COLOURS),
    "diffuse.ply": ply("uchar", "diffuse_red diffuse_green diffuse_blue", COLOURS),
    "capitals.ply": ply("uchar", "Red Green Blue", COLOURS),
    "float.ply": ply("float", "red green blue", COLOURS / 255.0),
    "float_bytes.ply": ply("float", "red green blue", COLOURS),
    "ushort.ply": ply("ushort", "red green blue", COLOURS * 257),
    "opacity.ply": ply("uchar", "red green blue alpha", np.column_stack([COLOURS, 255 * ONES])),
    "turned.ply": ply("uchar", "quality blue green red", np.column_stack([ONES, COLOURS[:, ::-1]])),
}


def read(folder: Path, name: str, text: str) -> Surface:
    (folder / name).write_text(text)
    return read_surface(folder / name)


@pytest.mark.parametrize("name", SPELLINGS)
def test_colours_are_those_that_were_written(tmp_path: Path, name: str) -> None:
    surface = read(tmp_path, name, SPELLINGS[name])
    order = np.lexsort(np.round(surface.points_mm, 3).T)
    assert surface.colours is not None
    expected = COLOURS[np.lexsort(np.round(POINTS, 3).T)] / 255.0
    np.testing.assert_allclose(surface.colours[order], expected, atol=1e-6)
    (mark,) = find_marks(surface)
    assert mark.colour == "red"
    np.testing.assert_allclose(mark.centre_mm, [39.5, 0.0, 60.0], atol=1.0)


def test_colours_of_faces_are_spread_to_their_points(tmp_path: Path) -> None:
    of_faces = COLOURS[FACES].mean(axis=1)
    head = ply("uchar", "", np.empty((len(POINTS), 0))).split("end_header\n")[0]
    names = "".join(f"property uchar {channel}\n" for channel in ("r", "g", "b"))
    table = rows(np.full(len(FACES), 3), FACES, np.round(of_faces))
    surface = read(tmp_path, "m.ply", f"{head}{names}end_header\n{rows(POINTS)}{table}")
    (mark,) = find_marks(surface)
    assert mark.colour == "red"


def test_a_column_that_may_be_two_things_is_a_question(tmp_path: Path) -> None:
    pink = np.column_stack([ONES, COLOURS[:, 1:] / 255.0, ONES])
    with pytest.raises(MeshError, match=r"seven numbers.*write x y z r g b, without a weight"):
        read(tmp_path, "m.obj", obj(POINTS, pink))


def test_properties_that_are_no_colours_are_named(tmp_path: Path) -> None:
    surface = read(tmp_path, "m.ply", ply("uchar", "hue value chroma", COLOURS))
    assert surface.colours is None
    with pytest.raises(MeshError, match=r"no colours \(its points have hue, value, chroma\)"):
        find_marks(surface)
