"""What the faces of a mesh file give to its points."""

from __future__ import annotations

import numpy as np

from visco_core.equal_rows import first_of_equals
from visco_core.io.source import unreadable
from visco_core.pointcloud import PointCloud


def fan_triangles(counts: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Triangles (F, 3) int64 of polygons, each cut into a fan at its first corner.

    counts (N,): corners of each polygon; corners (sum of counts,): all of them in a row.
    Polygons of fewer than three corners give nothing.
    """
    counts = counts.astype(np.int64)
    triangles = np.maximum(counts - 2, 0)
    first = np.repeat(np.cumsum(counts) - counts, triangles)
    within = np.arange(len(first)) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    index = np.stack([first, first + within + 1, first + within + 2], axis=1)
    return corners.astype(np.int64)[index]


def check_faces(faces: np.ndarray, points: int) -> None:
    """Raises InputError (``unreadable_file``) where a face (F, 3) names a point that is not."""
    if len(faces) and (faces.min() < 0 or faces.max() >= points):
        raise unreadable("A face refers to a point that the file does not hold")


def vertex_normals(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals (P, 3) float32: the sum over each point's faces, weighted by area.

    points (P, 3), faces (F, 3). A point of no face, or of faces without area, gets zeros.
    """
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        doubled_areas = np.cross(b - a, c - a)
        size = np.abs(doubled_areas).max(initial=0.0)
        doubled_areas = doubled_areas / (size or 1.0)
        corners = faces.T.ravel()
        sums = np.stack(
            [
                np.bincount(corners, np.tile(doubled_areas[:, axis], 3), len(points))
                for axis in range(3)
            ],
            axis=1,
        )
        lengths = np.linalg.norm(sums, axis=1, keepdims=True)
        normals = np.where(lengths > 0, sums / lengths, 0.0)
    return np.nan_to_num(normals).astype(np.float32)


def surface_points(
    points: np.ndarray, faces: np.ndarray, colors: np.ndarray | None = None
) -> PointCloud:
    """Each position once, with the normal of all faces (F, 3) that meet there.

    points (P, 3), colors (P, 3) uint8 or None. Raises InputError (``unreadable_file``).
    """
    check_faces(faces, len(points))
    found = first_of_equals(points)
    if found is not None:
        first, group = found
        points, faces = points[first], group[faces]
        colors = None if colors is None else colors[first]
    return PointCloud(points, vertex_normals(points, faces), colors)
