"""Maps of the skin under an indenter, seen along its axis."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation

from palpate.api import FloatArray, IntArray, SurfaceStates


def draw_map(axis: Axes, states: SurfaceStates, at: int, values: FloatArray, most: float) -> Any:  # noqa: ANN401 - of matplotlib
    """Draw smoothed values (n,) on the deformed skin at a state, in the frame of the indenter.

    Parameters
    ----------
    at : int
        Number of the state.
    values : (n,) array
        From 0 to ``most``, one for each node.

    Returns
    -------
    TriContourSet or None
        For a colour bar; None without contact.
    """
    place = (states.points_mm + states.displacements_mm[at] - states.positions_mm[at]) @ states.rotations[at]
    loaded = states.pressures_MPa[at] > 0.0
    # A third more than the farthest node in contact, which one node or a row of them does not have.
    x, y = reach = 1.3 * np.abs(place[loaded, :2]).max(axis=0, initial=1.0)
    # Skin that is far below is the other side of the limb. Twice the skin that is shown fills the corners.
    lowest = place[loaded, 2].min(initial=0.0) - max(x, y)
    near = (np.abs(place[:, :2]) < 2.0 * np.array(reach)).all(axis=1) & (place[:, 2] > lowest)
    shown = states.triangles[near[states.triangles].any(axis=1)]
    if not loaded.any() or not len(shown):
        axis.set_axis_off()
        return None
    grid, values = Triangulation(place[:, 0], place[:, 1], shown), smoothed(values, place, shown)
    levels = MaxNLocator(12).tick_values(0.0, most)
    drawn = axis.tricontourf(grid, values, levels=levels, cmap="viridis")
    axis.set(aspect="equal", xlim=(-x, x), ylim=(-y, y), xlabel="x (mm)", ylabel="y (mm)")
    axis.grid(visible=False)
    return drawn


def smoothed(values: FloatArray, points_mm: FloatArray, triangles: IntArray) -> FloatArray:
    """Values (n,) averaged over the triangles (m, 3) around each node, by their areas.

    Contact tractions at nodes alternate from node to node where the mesh is coarse; a constant stays.
    """
    a, b, c = np.moveaxis(points_mm[triangles], 1, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    nodes, n = triangles.ravel(), len(values)
    totals = np.bincount(nodes, np.repeat(areas * values[triangles].mean(axis=1), 3), n)
    around = np.bincount(nodes, np.repeat(areas, 3), n)
    return np.divide(totals, around, out=values.astype(float), where=around > 0.0)
