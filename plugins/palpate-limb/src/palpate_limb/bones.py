"""Bone models: read, closed if need be, and placed in the frame of the scan."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from palpate.api import FloatArray, MeshError
from palpate_limb.repair import BONE_MM, check_size, closed, largest, parts, repaired, with_repair
from palpate_limb.surfaces import Surface, outwards, read_surface

IN_PLACE: FloatArray = np.eye(4)
IN_PLACE.setflags(write=False)


class Placement(NamedTuple):
    """A rigid motion (4, 4) from the bones' frame to the scan's, and how well it fits.

    ``residual_mm`` is the root mean square distance of landmarks, or of the reference from the scan.
    """

    motion: FloatArray
    residual_mm: float


def read_bones(
    path: Path, unit: str = "mm", names: Sequence[str] = (), *, skin_too: bool = False
) -> tuple[Surface, ...]:
    """Read the bones of a file; openings are closed and crossing faces removed.

    ``names`` name the bones in the file's order. By default one is named after the file, several
    have numbers behind its name. With ``skin_too`` the largest part is the limb's skin, and no bone. A file
    that cannot be repaired, other names, or a bone of no plausible size are MeshErrors.
    """
    pieces = parts(read_surface(path, unit))
    skin = largest(pieces) if skin_too else None
    # Without the parts that lie within a larger one, as the surface of a marrow cavity does.
    shells = [(piece, outwards(closed(piece))) for piece in pieces if piece is not skin]
    found = [
        piece
        for piece, _ in shells
        if not any(other is not piece and whole.contains(piece.points_mm).all() for other, whole in shells)
    ]
    if not found:
        raise MeshError(f"{path}: no bone besides the skin; name another file, or none")
    if names and len(names) != len(found):
        places = "; ".join(
            f"({', '.join(f'{x:.4g}' for x in bone.points_mm.mean(axis=0))}) mm" for bone in found
        )
        raise MeshError(
            f"{path}: {len(found)} bones, in its order about {places}; give each a name, not "
            f"{len(names)} ({', '.join(names)})"
        )
    if not names:
        names = [path.stem] if len(found) == 1 else [f"{path.stem}-{i + 1}" for i in range(len(found))]
    bones = []
    for piece, name in zip(found, names, strict=True):
        whole = outwards(closed(replace(piece, name=name)))
        check_size(whole, BONE_MM, unit)
        bones.append(repaired(whole))
    return tuple(bones)


def covered(bone: Surface, skin: Surface, cover_mm: float) -> Surface:
    """The bone with its points at least so far below the skin; ``repairs`` states which were moved.

    Points out of the skin stay where they are, if they are farther out than that.
    """
    _, gaps = skin.nearest(bone.points_mm)
    near = np.flatnonzero(gaps < cover_mm)
    if not near.size:
        return bone
    points = bone.points_mm.copy()
    for _ in range(3):  # the way inwards is poorly known from close by
        on, gaps = skin.nearest(points[near])
        inward = np.where(skin.contains(points[near]), 1.0, -1.0)[:, None] * (points[near] - on)
        short = gaps < cover_mm
        points[near[short]] = on[short] + cover_mm * inward[short] / np.maximum(gaps[short, None], 1e-9)
    most = float(np.linalg.norm(points - bone.points_mm, axis=1).max())
    repair = (
        f"{near.size} points moved inwards by {most:.2g} mm at most, to be {cover_mm:g} mm below the skin"
    )
    return replace(bone, points_mm=points, repairs=with_repair(bone.repairs, repair))


def read_motion(path: Path) -> Placement:
    """Read a rigid motion: four rows of four numbers, as text; a MeshError where it is none."""
    matrix = _numbers(path, "four rows of four numbers", "write the motion so")
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise MeshError(f"{path}: a matrix of shape {matrix.shape}; write four rows of four finite numbers")
    turn = matrix[:3, :3]
    rigid = np.abs(turn @ turn.T - np.eye(3)).max() <= 1e-3 and np.linalg.det(turn) >= 0.0
    if not rigid or matrix[3].tolist() != [0, 0, 0, 1]:
        raise MeshError(
            f"{path}: not a rigid motion; give a rotation, a translation in mm and the row 0 0 0 1"
        )
    return Placement(motion=matrix, residual_mm=0.0)


def by_landmarks(source_mm: FloatArray, target_mm: FloatArray) -> Placement:
    """The motion that brings landmarks of the bones onto landmarks of the scan, by least squares.

    Both are (n, 3): three landmarks or more, not on one line, or a MeshError.
    """
    from trimesh.registration import procrustes

    if source_mm.shape != target_mm.shape or source_mm.ndim != 2 or source_mm.shape[0] < 3:
        raise MeshError(
            f"landmarks: {len(source_mm)} and {len(target_mm)}; give three or more in both frames"
        )
    for points in (source_mm, target_mm):
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if not spread[1] > 1e-3 * spread[0]:
            raise MeshError("landmarks: all on one line, so the bones could turn about it; add one off it")
    motion, _, _ = procrustes(source_mm, target_mm, reflection=False, scale=False)
    motion = np.asarray(motion, dtype=np.float64)
    off = source_mm @ motion[:3, :3].T + motion[:3, 3] - target_mm
    return Placement(motion=motion, residual_mm=float(np.sqrt((off**2).sum(axis=1).mean())))


def read_landmarks(path: Path) -> Placement:
    """Read landmarks: six numbers a line, a point in the bones' frame and in the scan's [mm]."""
    table = _numbers(path, "six numbers a line", "write x,y,z,x,y,z")
    if table.shape[1] != 6 or not np.isfinite(table).all():
        raise MeshError(
            f"{path}: {table.shape[1]} numbers a line; write x,y,z in the bones' frame and the scan's"
        )
    return by_landmarks(table[:, :3], table[:, 3:])


def _numbers(path: Path, what: str, advice: str) -> FloatArray:
    """Rows of numbers apart by commas or blanks."""
    try:
        return np.loadtxt(path, delimiter="," if "," in path.read_text() else None, ndmin=2)
    except (OSError, ValueError) as error:
        raise MeshError(f"{path}: not {what} ({error}); {advice}") from error


def by_icp(
    reference: Surface, scan: Surface, start: FloatArray = IN_PLACE, n_points: int = 1500
) -> Placement:
    """The motion that lays a reference, known in the bones' frame, onto the scan (iterative closest points).

    ``start`` is a first guess (4, 4), within some 20 degrees; ``n_points`` of the scan are matched. A
    residual above 2 mm is refused by a MeshError.
    """
    from trimesh.registration import icp

    points = scan.points_mm[:: max(1, len(scan.points_mm) // n_points)]
    # Matched from the scan to the reference: a scan may lack a part of the limb.
    motion, _, _ = icp(  # type: ignore[no-untyped-call]
        points,
        reference.trimesh,
        initial=np.linalg.inv(start),
        threshold=1e-4,
        max_iterations=10,
        reflection=False,
        scale=False,
    )
    motion, residual = _slid(np.asarray(motion, dtype=np.float64), points, reference)
    if not residual < 2.0:
        raise MeshError(
            f"{reference.name}: {residual:.2g} mm from {scan.name} after matching; give landmarks to "
            "start from, or check that both show the same limb"
        )
    return Placement(motion=np.asarray(np.linalg.inv(motion), dtype=np.float64), residual_mm=residual)


def _slid(motion: FloatArray, points: FloatArray, reference: Surface) -> tuple[FloatArray, float]:
    """Go on from point to plane, which lets a limb slide along itself: Chen and Medioni's ICP.

    Each step solves Σ (n · (p + ω × p + t − q))² = min for the small turn ω and the shift t.
    """
    from scipy.spatial.transform import Rotation
    from trimesh.proximity import closest_point

    body = reference.trimesh
    for _ in range(12):
        moved = points @ motion[:3, :3].T + motion[:3, 3]
        nearest, _, faces = closest_point(body, moved)  # type: ignore[no-untyped-call]
        normals, off = np.asarray(body.face_normals)[faces], moved - nearest
        columns = np.hstack([np.cross(moved, normals), normals])
        step = np.linalg.lstsq(columns, -np.einsum("ij,ij->i", normals, off), rcond=None)[0]
        change = np.eye(4)
        change[:3, :3] = Rotation.from_rotvec(step[:3]).as_matrix()
        change[:3, 3] = step[3:]
        motion = change @ motion
        if np.abs(step[3:]).max() < 1e-3 and np.abs(step[:3]).max() < 1e-5:
            break
    _, distances = reference.nearest(points @ motion[:3, :3].T + motion[:3, 3])
    return motion, float(np.sqrt((distances**2).mean()))
