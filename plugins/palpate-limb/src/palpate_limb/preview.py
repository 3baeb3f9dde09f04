"""A picture of a spot's limb: skin with its mark, normal, sphere, and two cuts with bones and regions.

Drawn by casting rays, so that what is in front hides what is behind; no display is needed.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.api import FloatArray, IntArray
from palpate_limb.from_scan import ScannedLimb
from palpate_limb.surfaces import Surface, joined

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SKIN, SPHERE = (0.87, 0.71, 0.60), (0.35, 0.45, 0.60)
BONE = (0.93, 0.91, 0.84)
REGIONS = ("#c98276", "#e8c39e", "#d9a5a0", "#b7c4a1", "#9fb6c8")


def draw(made: ScannedLimb, path: Path, indenter_radius_mm: float) -> None:
    """Write a PNG of one limb."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.0, 8.4), layout="constrained")
    FigureCanvasAgg(figure)
    axes: Any = figure.subplot_mosaic([["whole", "whole"], ["along", "across"]], height_ratios=[1.2, 1.0])
    _whole(axes["whole"], made, indenter_radius_mm)
    for name, normal in (("along", 1), ("across", 0)):
        _section(axes[name], made, indenter_radius_mm, normal)
    q, found = made.quality, made.found
    figure.suptitle(
        f"{found.spot.name}: {q.n_nodes} nodes, {q.n_cells} elements, edges under the indenter "
        f"{q.contact_edge_mm:.2g} mm, least scaled Jacobian {q.least_scaled_jacobian:.2g}, "
        f"volume {100 * q.volume_error:+.2g} % off the scan's\n"
        f"position ± {found.across_mm:.2g} mm across, ± {found.along_normal_mm:.2g} mm along the normal, "
        f"normal ± {found.normal_deg:.2g}°; "
        f"{'; '.join(f'{n} {100 * s:.0f} %' for n, s in q.regions.items())}"
    )
    figure.savefig(path, dpi=100)


def _whole(ax: "Axes", made: ScannedLimb, radius: float) -> None:
    """The scan from the side and above, the sphere on it and an arrow along the normal."""
    turn = _view(35.0, 30.0)
    sphere = _sphere(radius)
    extent = joined([made.segment.skin, sphere])[0] @ turn.T
    low, high = extent.min(axis=0) - 2.0, extent.max(axis=0) + 2.0
    body = made.limb.mesh
    skin = made.segment.skin
    shown = [
        (skin, SKIN if skin.colours is None else skin.colours),
        (sphere, SPHERE),
        *((bone, BONE) for bone in made.segment.bones),
    ]
    picture = _cast(shown, turn, low, high, 4.0)
    ax.imshow(picture, extent=(low[0], high[0], low[1], high[1]), origin="lower")
    start, end = (np.array([[0, 0, 0], [0, 0, 4.0 * radius]]) @ turn.T)[:, :2]
    ax.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": "black", "lw": 1.6})
    for sign in (-1.0, 1.0):
        _outline(ax, body.points_mm[body.node_sets["cut"]], made, turn, sign)
    ax.set(
        aspect="equal", title="scan with its mark, bones that stand out, normal, sphere, ends of the segment"
    )
    ax.set_axis_off()


def _outline(ax: "Axes", cut: FloatArray, made: ScannedLimb, turn: FloatArray, sign: float) -> None:
    """The outer rim of one cut."""
    from scipy.spatial import ConvexHull

    if not (sign * (cut @ made.segment.axis) > 0.0).any():
        return  # the limb ends there in skin
    flat = (cut[sign * (cut @ made.segment.axis) > 0.0] @ turn.T)[:, :2]
    rim = flat[ConvexHull(flat).vertices]
    ax.plot(*np.vstack([rim, rim[:1]]).T, color="#803030", lw=1.2, ls="--")


def _section(ax: "Axes", made: ScannedLimb, radius: float, normal: int) -> None:
    """The elements cut by a plane through the spot: ``normal`` 0 across the limb, 1 along it."""
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import Circle

    mesh = made.limb.mesh
    ((kind, cells),) = mesh.cells.items()
    u = 1 if normal == 0 else 0
    polygons, owner = _sliced(mesh.points_mm, cells[:, :4], normal)
    ids = mesh.cell_regions[kind][owner]
    order = [len(mesh.regions) - 1, *range(len(mesh.regions) - 1)]  # the lowest region has the first colour
    colour = {region: REGIONS[k % len(REGIONS)] for k, region in enumerate(order)}
    ax.add_collection(
        PolyCollection(
            [p[:, [u, 2]] for p in polygons],
            facecolors=[colour[i] for i in ids],
            edgecolors="#5a3a36",
            linewidths=0.3,
        )
    )
    for i, name in enumerate(mesh.regions):
        ax.plot([], [], "s", color=colour[i], label=name)
    ax.add_patch(Circle((0.0, radius), radius, facecolor=SPHERE, alpha=0.8))
    ax.annotate(
        "", (0.0, 3.2 * radius), (0.0, 0.0), arrowprops={"arrowstyle": "-|>", "color": "black", "lw": 1.6}
    )
    ax.legend(loc="lower right", fontsize=8)
    ax.set(
        aspect="equal",
        xlabel=f"{'xyz'[u]} (mm)",
        ylabel="z (mm)",
        title=("across", "along")[normal] + " the limb",
    )
    ax.autoscale_view()
    ax.set_ylim(top=3.6 * radius)


def _sliced(points: FloatArray, tets: IntArray, normal: int) -> tuple[list[FloatArray], IntArray]:
    """Polygons in which tetrahedra meet the plane where one coordinate is zero, and whose they are."""
    level = points[:, normal] + 1e-9
    signs = level[tets] > 0.0
    crossed = np.flatnonzero(signs.any(axis=1) & ~signs.all(axis=1))
    polygons = []
    for tet in crossed:
        nodes = tets[tet]
        above, below = nodes[signs[tet]], nodes[~signs[tet]]
        pairs = [(a, b) for a in above for b in below]
        if len(above) == 2:
            pairs = [pairs[0], pairs[1], pairs[3], pairs[2]]  # around, not across
        ends = np.array(pairs)
        a, b = level[ends[:, 0]], level[ends[:, 1]]
        share = (a / (a - b))[:, None]
        polygons.append((1.0 - share) * points[ends[:, 0]] + share * points[ends[:, 1]])
    return polygons, crossed


def _view(elevation_deg: float, azimuth_deg: float) -> FloatArray:
    """Rotation (3, 3) to the picture: x right, y up, z towards the eye."""
    from scipy.spatial.transform import Rotation

    turn: FloatArray = Rotation.from_euler(
        "zx", [azimuth_deg, elevation_deg - 90.0], degrees=True
    ).as_matrix()
    return turn


def _sphere(radius: float) -> Surface:
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    return Surface(
        name="sphere",
        points_mm=np.asarray(ball.vertices) + np.array([0.0, 0.0, radius]),
        faces=np.asarray(ball.faces),
    )


def _cast(
    shown: list[tuple[Surface, Any]],
    turn: FloatArray,
    low: FloatArray,
    high: FloatArray,
    pixels_per_mm: float,
) -> FloatArray:
    """Picture (rows, columns, 3) seen along −z after the turn."""
    import trimesh

    points, faces = joined([surface for surface, _ in shown])
    colours = np.vstack([np.broadcast_to(colour, surface.points_mm.shape) for surface, colour in shown])
    body = trimesh.Trimesh(points @ turn.T, faces, process=False)
    n = np.ceil((high - low)[:2] * pixels_per_mm).astype(int)
    x, y = np.meshgrid(np.linspace(low[0], high[0], n[0]), np.linspace(low[1], high[1], n[1]))
    origins = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, high[2] + 10.0)])
    hit = np.asarray(body.ray.intersects_first(origins, np.tile([0.0, 0.0, -1.0], (x.size, 1))))
    seen = hit >= 0
    picture = np.ones((x.size, 3))
    light = np.array([-0.35, 0.5, 0.79])
    shade = 0.45 + 0.55 * np.clip(np.asarray(body.face_normals)[hit[seen]] @ light, 0.0, 1.0)
    picture[seen] = colours[faces[hit[seen]]].mean(axis=1) * shade[:, None]
    return np.clip(picture.reshape(*x.shape, 3), 0.0, 1.0)
