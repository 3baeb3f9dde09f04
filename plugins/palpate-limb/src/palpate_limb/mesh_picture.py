"""A picture of a mesh: its outer surface from four sides, what is fixed, in contact and free in colours."""

import errno
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.api import FloatArray, Limb, Mesh
from palpate.api.mesh import surface_faces

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = {"fixed": "#b5443c", "in contact": "#3b6ea5", "free": "#c9c9c4", "fixed in part": "#e8a33d"}
VIEWS = {
    "from +z": (0, 1, 2, 1.0),
    "from -z (mirrored)": (0, 1, 2, -1.0),
    "from -y": (0, 2, 1, -1.0),
    "from +x": (1, 2, 0, 1.0),
}
"""Axes to the right, up and of the eye, and on which side of the limb the eye is."""


def draw_limb(limb: Limb, path: Path) -> bool:
    """Write the picture as PNG; False if there is nothing to draw.

    Raises
    ------
    FileExistsError
        The path is a file of the user.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    faces, states = _faces(limb.mesh)
    if not faces:
        return False
    software = "palpate limb inspect"  # which the picture names in itself
    if path.exists() and software.encode() not in path.read_bytes():
        raise FileExistsError(errno.EEXIST, "a file of yours is there; rename it")
    figure = Figure(figsize=(16.0, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    for axes, (title, turn) in zip(figure.subplots(1, len(VIEWS)), VIEWS.items(), strict=True):
        _view(axes, limb, faces, states, turn)
        axes.set_title(title)
    for state, colour in COLOURS.items():
        figure.axes[0].plot([], [], "s", color=colour, label=state)
    figure.axes[0].legend(loc="best", fontsize=8)
    figure.suptitle(f"{limb.spot.name}: {limb.mesh.n_nodes} nodes, {limb.mesh.n_cells} elements")
    figure.savefig(path, dpi=100, metadata={"Software": software})
    return True


def _faces(mesh: Mesh) -> tuple[list[FloatArray], list[str]]:
    """Corners of each outer face, and whether it is fixed, in contact, free or fixed in part."""
    corners, states = list[FloatArray](), list[str]()
    fixed, contact = (np.isin(np.arange(mesh.n_nodes), mesh.node_sets[name]) for name in ("fixed", "contact"))
    for faces, n in surface_faces(mesh):
        whole, part = fixed[faces].all(axis=1), fixed[faces].any(axis=1)
        touched = contact[faces].all(axis=1)
        # A free face next to a fixed side has fixed nodes along its edge alone.
        within = part & (np.count_nonzero(fixed[faces[:, :n]], axis=1) == n) & ~whole
        corners += list(mesh.points_mm[faces[:, :n]])
        states += np.select(
            [whole, within, touched], ["fixed", "fixed in part", "in contact"], "free"
        ).tolist()
    return corners, states


def _view(
    axes: "Axes", limb: Limb, faces: list[FloatArray], states: list[str], turn: tuple[int, int, int, float]
) -> None:
    """Faces towards the eye, the farthest first, and the spot."""
    from matplotlib.collections import PolyCollection

    right, up, eye, sign = turn
    towards = [np.cross(face[1] - face[0], face[-1] - face[0])[eye] for face in faces]
    seen = [k for k in range(len(faces)) if sign * towards[k] > 0.0]
    seen.sort(key=lambda k: sign * float(faces[k][:, eye].mean()))
    axes.add_collection(
        PolyCollection(
            [faces[k][:, [right, up]] for k in seen],
            facecolors=[COLOURS[states[k]] for k in seen],
            edgecolors="#555555",
            linewidths=0.2,
        )
    )
    axes.plot(*limb.spot.position_mm[[right, up]], "k+", markersize=12)
    axes.autoscale_view()
    axes.set(aspect="equal", xlabel=f"{'xyz'[right]} (mm)", ylabel=f"{'xyz'[up]} (mm)")
