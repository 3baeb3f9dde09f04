"""A limb's mesh as VTU, a note of what it was made from, and a picture that needs no display."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.api import FloatArray, IntArray, Limb
from palpate.api.mesh import CELLS
from palpate_limb.from_scan import ReadScan, ScannedLimb
from palpate_limb.options import ScanOptions
from palpate_limb.surfaces import Surface, joined

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SKIN, SPHERE = (0.87, 0.71, 0.60), (0.35, 0.45, 0.60)
ARROW = {"arrowstyle": "-|>", "color": "black", "lw": 1.6}
REGIONS = ("#c98276", "#e8c39e", "#d9a5a0", "#b7c4a1", "#9fb6c8")

# The phantom's spots p1 and p2 on graded meshes of several sizes against converged curves, and spots of real
# limbs on evenly fine ones (``benchmarks/study_real_mesh.py``): y(h) = y₀ + c hᵖ, extrapolated to h = 0, and
# to the shortest edges by the same power.
RATIOS = (0.169, 0.233, 0.301, 0.409)
"""Mean edge under the sphere over its radius, of the meshes studied."""
FORCE = (
    (0.0047, 0.0088, 0.0124, 0.0220),  # phantom
    (0.002, 0.004, 0.007, 0.013),  # forearm
    (0.0030, 0.0057, 0.0102, 0.0181),  # residual limb: two meshes, order 2
)
"""Largest force over its limit, less one; a row for each limb."""
TORQUE = (
    (0.018, 0.0324, 0.0453, 0.0770),  # phantom: largest error along the loop over its peak
    (0.036, 0.050, 0.066, 0.082),  # forearm: order 1, since none is seen
    (0.0197, 0.0374, 0.0665, 0.1183),  # residual limb: two meshes, order 2
)
"""Half the width of the torque's loop over its limit, less one."""
MEASURED_ON = (
    "the largest of three limbs, one spot each: forearm phantom, real forearm, residual limb; Yeoh's "
    "material, sphere of 7.5 mm pressed 10 mm deep and twisted by 22.5 degrees both ways, friction 1. At "
    "edges of 0.3 radii the torque of real limbs is off by 4 to 7 %, the phantom's by 5 %"
)


def write_limb(path: Path, limb: Limb) -> None:
    """Write a mesh for the limb source ``meshio``: cell data ``region`` and fields, point data for sets."""
    import meshio

    mesh = limb.mesh
    every = np.arange(mesh.n_nodes)
    point_data = {name: np.isin(every, nodes).astype(np.uint8) for name, nodes in mesh.node_sets.items()}
    cell_data = {name: [of[kind] for kind in mesh.cells] for name, of in mesh.cell_fields.items()}
    cell_data["region"] = [mesh.cell_regions[kind].astype(np.int32) for kind in mesh.cells]
    meshio.Mesh(
        mesh.points_mm,
        [(CELLS[kind].meshio, cells) for kind, cells in mesh.cells.items()],
        point_data=point_data,
        cell_data=cell_data,
    ).write(path)


def note(path: Path, options: ScanOptions, scan: ReadScan, made: ScannedLimb) -> dict[str, Any]:
    """Facts of a limb apart from its mesh, as plain values."""
    found = made.found
    return {
        "spot": found.spot.name,
        "scan": path.as_posix(),
        "options": options.model_dump(
            mode="json", exclude_none=True, exclude={"mark" if options.spot else "spot"}
        ),
        "position_in_scan_mm": found.spot.position_mm.tolist(),
        "normal_in_scan": found.spot.normal.tolist(),
        "std_across_mm": found.across_mm,
        "std_along_normal_mm": found.along_normal_mm,
        "std_normal_deg": found.normal_deg,
        "scan_to_mesh": made.segment.to_spot.tolist(),
        "moved_to_touch_mm": made.rise_mm,
        "bones": [bone.name for bone in made.segment.bones],
        "unit": scan.unit,
        "unit_guessed": bool(scan.unit_why),
        "remarks": list(made.segment.remarks),
        "repairs": {s.name: s.repairs for s in (scan.surface, *scan.bones) if s.repairs},
        "bones_to_scan": scan.placement.motion.tolist(),
        "bones_residual_mm": scan.placement.residual_mm,
        "quality": asdict(made.quality),
        "mesh_error": mesh_error(made.quality.contact_edge_mm, options.reach_mm),
    }


def study_tables(names: Sequence[str], regions: tuple[str, ...], folders: Iterable[Path]) -> str:
    """The tables of study.toml that read the meshes: of ``folders`` the second has the finer ones."""
    spots = [
        f'[[spot]]\nname = "{name}"\n'
        + "".join(
            f'{key} = "{(folder / name).as_posix()}.vtu"\n'
            for key, folder in zip(("mesh", "fine_mesh"), folders, strict=False)
        )
        for name in names
    ]
    numbers = ", ".join(f"{region} = {i}" for i, region in enumerate(regions))
    return "\n".join([*spots, f'[limb]\nsource = "meshio"\n\n[limb.settings]\nregions = {{ {numbers} }}\n'])


def mesh_error(edge_mm: float, radius_mm: float) -> dict[str, Any]:
    """Relative errors of force and torque of a mesh with such edges under the sphere.

    ``force`` and ``torque`` are shares of themselves, interpolated between the sizes studied, with what they
    were measured on; both None for sizes outside of the study.
    """
    ratio = edge_mm / radius_mm
    studied = 0.9 * RATIOS[0] <= ratio <= 1.1 * RATIOS[-1]
    return {
        "edge_over_radius": ratio,
        "force": float(np.interp(ratio, RATIOS, np.max(FORCE, axis=0))) if studied else None,
        "torque": float(np.interp(ratio, RATIOS, np.max(TORQUE, axis=0))) if studied else None,
        "measured_on": MEASURED_ON,
    }


def draw(made: ScannedLimb, path: Path, indenter_radius_mm: float) -> None:
    """Write a PNG of one limb: skin with its mark, normal, sphere, and two cuts with bones and regions."""
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
    import trimesh
    from matplotlib.collections import PolyCollection
    from scipy.spatial import ConvexHull
    from scipy.spatial.transform import Rotation

    # To the picture: x right, y up, z towards the eye.
    turn: FloatArray = Rotation.from_euler("zx", [30.0, -55.0], degrees=True).as_matrix()
    ball, skin = trimesh.creation.icosphere(subdivisions=4, radius=radius), made.segment.skin
    up = np.array([0.0, 0.0, radius])
    sphere = Surface(name="sphere", points_mm=np.asarray(ball.vertices) + up, faces=np.asarray(ball.faces))
    shown = [(skin, SKIN if skin.colours is None else skin.colours), (sphere, SPHERE)]
    shown += [(bone, (0.93, 0.91, 0.84)) for bone in made.segment.bones]
    points, faces = joined([surface for surface, _ in shown])
    colours = np.vstack([np.broadcast_to(colour, surface.points_mm.shape) for surface, colour in shown])
    points = points @ turn.T
    seen = Surface(name="all", points_mm=points, faces=faces)
    normals = seen.face_areas_mm2 / np.maximum(np.linalg.norm(seen.face_areas_mm2, axis=1), 1e-300)[:, None]
    # Faces towards the eye, the farthest first.
    order = np.argsort(points[faces][:, :, 2].mean(axis=1))
    order = order[normals[order, 2] > 0.0]
    shade = 0.45 + 0.55 * np.clip(normals[order] @ [-0.35, 0.5, 0.79], 0.0, 1.0)
    drawn = np.clip(colours[faces[order]].mean(axis=1) * shade[:, None], 0.0, 1.0)
    ax.add_collection(
        PolyCollection(points[faces[order]][:, :, :2], facecolors=drawn, edgecolors=drawn, linewidths=0.2)
    )
    start, end = (np.array([[0, 0, 0], [0, 0, 4.0 * radius]]) @ turn.T)[:, :2]
    ax.annotate("", end, start, arrowprops=ARROW)
    cut = made.limb.mesh.points_mm[made.limb.mesh.node_sets["cut"]]
    for of_end in (cut[cut @ made.segment.axis < 0.0], cut[cut @ made.segment.axis > 0.0]):
        if len(of_end):  # otherwise the limb ends there in skin
            flat = (of_end @ turn.T)[:, :2]
            rim = flat[ConvexHull(flat).vertices]
            ax.plot(*np.vstack([rim, rim[:1]]).T, color="#803030", lw=1.2, ls="--")
    ax.autoscale_view()
    ax.set(
        aspect="equal", title="scan with its mark, bones that stand out, normal, sphere, ends of the segment"
    )
    ax.set_axis_off()


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
    ax.annotate("", (0.0, 3.2 * radius), (0.0, 0.0), arrowprops=ARROW)
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
