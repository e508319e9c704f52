"""How far a mesh is from the truth.

Distances are Euclidean, not squared, in the units of the input. The protocol is that of the Surface
Reconstruction Benchmark as the DiGS evaluation code runs it: both surfaces become points, drawn
uniformly by area, and are compared as points.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from visco_core.errors import InputError
from visco_core.pointcloud import PointCloud
from visco_core.result import Mesh

# Fewer ground truth points than this leave gaps that would count as the mesh's error.
_DENSE_POINTS = 100_000
_F_SCORE_FRACTION = 0.005


def sample_surface(
    mesh: Mesh, count: int, seed: int | list[int] = 0, *, smooth: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """(points, unit normals), each (count, 3) float64, uniform by area.

    Normals are the faces', or with ``smooth`` blends of the vertices' (which the mesh must then
    have). Raises InputError (``empty_mesh``) for a mesh without area.
    """
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(first, second)
    doubled_area = np.linalg.norm(across, axis=1)
    until = np.cumsum(doubled_area)
    if not len(until) or not 0.0 < until[-1] < np.inf:
        raise InputError("empty_mesh", "The mesh has no surface to sample; give one with faces.")
    rng = np.random.default_rng(seed)
    face = np.searchsorted(until, until[-1] * rng.random(count), side="right")
    face = np.minimum(face, len(until) - 1)
    u, v = rng.random((2, count))
    outside = u + v > 1.0
    u[outside], v[outside] = 1.0 - u[outside], 1.0 - v[outside]
    points = corners[face, 0] + u[:, None] * first[face] + v[:, None] * second[face]
    if smooth:
        if mesh.normals is None:
            raise InputError("missing_normals", "The mesh has no vertex normals to blend.")
        weights = np.stack([1.0 - u - v, u, v], axis=1)
        normals = np.einsum("pc,pci->pi", weights, mesh.normals[mesh.faces[face]])
        length = np.linalg.norm(normals, axis=1, keepdims=True)
    else:
        normals, length = across[face], doubled_area[face, None]
    return points, normals / np.maximum(length, 1e-300)


def nearest_distance(points: np.ndarray, targets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(distance (P,), index (P,)) from each of points (P, 3) to the nearest of targets (T, 3)."""
    from scipy.spatial import KDTree

    # The sliding-midpoint tree builds twice as fast and answers as fast for points on surfaces.
    tree = KDTree(targets, balanced_tree=False, compact_nodes=False)
    distance, index = tree.query(points, workers=-1)
    return np.asarray(distance), np.asarray(index)


def chamfer_distance(first: np.ndarray, second: np.ndarray) -> float:
    """Two-sided: half the sum of both mean nearest distances between points (P, 3) and (Q, 3)."""
    forth, _ = nearest_distance(first, second)
    back, _ = nearest_distance(second, first)
    return 0.5 * float(forth.mean() + back.mean())


def hausdorff_distance(first: np.ndarray, second: np.ndarray) -> float:
    """Two-sided: the largest nearest distance between points (P, 3) and (Q, 3)."""
    forth, _ = nearest_distance(first, second)
    back, _ = nearest_distance(second, first)
    return float(max(forth.max(), back.max()))


def f_score(recall_distance: np.ndarray, precision_distance: np.ndarray, threshold: float) -> float:
    """Harmonic mean of the shares of truth and result that lie within ``threshold`` of each other.

    recall_distance (P,): from the truth to the result; precision_distance (Q,): back.
    """
    recall = float((recall_distance <= threshold).mean())
    precision = float((precision_distance <= threshold).mean())
    return 2.0 * recall * precision / (recall + precision) if recall + precision else 0.0


def normal_consistency(
    first: np.ndarray, second: np.ndarray, forth: np.ndarray, back: np.ndarray
) -> float:
    """Mean |cosine| between each normal and that of its nearest point, both ways averaged.

    first (P, 3), second (Q, 3): unit normals; forth (P,): index into second; back (Q,) into first.
    """
    there = np.abs(np.einsum("pi,pi->p", first, second[forth])).mean()
    here = np.abs(np.einsum("pi,pi->p", second, first[back])).mean()
    return 0.5 * float(there + here)


def point_to_mesh_distance(points: np.ndarray, mesh: Mesh) -> np.ndarray:
    """Distance (P,) from each of points (P, 3) to the nearest point of any triangle."""
    import igl

    vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int64)
    squared, _, _ = igl.point_mesh_squared_distance(
        np.ascontiguousarray(points, dtype=np.float64), vertices, faces
    )
    return np.sqrt(squared)


def is_inside(points: np.ndarray, mesh: Mesh) -> np.ndarray:
    """(P,) bool: whether the mesh winds around each of points (P, 3).

    Source: Barill et al., Fast winding numbers for soups and clouds, SIGGRAPH 2018.
    """
    import igl

    winding = igl.fast_winding_number(
        np.ascontiguousarray(mesh.vertices, dtype=np.float64),
        np.ascontiguousarray(mesh.faces, dtype=np.int64),
        np.ascontiguousarray(points, dtype=np.float64),
    )
    return np.asarray(winding) > 0.5


def occupancy_iou(mesh: Mesh, points: np.ndarray, inside: np.ndarray) -> float:
    """Intersection over union of the mesh's inside and labels (P,) bool, counted on points (P, 3).

    1 where both are empty.
    """
    found = is_inside(points, mesh)
    union = np.count_nonzero(found | inside)
    return np.count_nonzero(found & inside) / union if union else 1.0


def evaluate(
    mesh: Mesh,
    ground_truth: Mesh | PointCloud,
    scan: PointCloud | None = None,
    *,
    samples: int = 1_000_000,
    seed: int = 0,
) -> dict[str, Any]:
    """Every distance between ``mesh`` and the truth, as JSON-able values.

    ``samples`` points stand for the mesh, and for a ground truth mesh; ground truth points stand
    for themselves. Sparse ones (under 100,000) cannot tell how far the mesh strays, so what is
    measured from the mesh to them, and with it d_C, d_H and the rest, is None. ``one_sided`` is
    from points to points; ``point_to_triangle`` needs no samples on the receiving side and so has
    no floor. Raises InputError (``empty_mesh``, ``empty_scan``).
    """
    found = PointCloud(*sample_surface(mesh, samples, [seed, 1]))
    truth = _as_points(ground_truth, samples, seed)
    forth, forth_index = nearest_distance(truth.points, found.points)
    one_sided = {"gt_to_mesh": _deviation(forth), "mesh_to_gt": None, "scan_to_mesh": None}
    exact = {
        "gt_to_mesh": _deviation(point_to_mesh_distance(truth.points, mesh)),
        "mesh_to_gt": None,
        "scan_to_mesh": None,
    }
    two_sided: dict[str, Any] = dict.fromkeys(("d_C", "d_H", "f_score", "normal_consistency"))
    if isinstance(ground_truth, Mesh) or len(truth) >= _DENSE_POINTS:
        back, back_index = nearest_distance(found.points, truth.points)
        one_sided["mesh_to_gt"] = _deviation(back)
        two_sided = _two_sided(truth, found, (forth, back), (forth_index, back_index))
    if isinstance(ground_truth, Mesh):
        exact["mesh_to_gt"] = _deviation(point_to_mesh_distance(found.points, ground_truth))
    if scan is not None:
        if not len(scan):
            raise InputError("empty_scan", "The scan has no points to measure from.")
        one_sided["scan_to_mesh"] = _deviation(nearest_distance(scan.points, found.points)[0])
        exact["scan_to_mesh"] = _deviation(point_to_mesh_distance(scan.points, mesh))
    parts = {"one_sided": one_sided, "point_to_triangle": exact}
    return {**two_sided, **parts, "samples": samples, "seed": seed}


def _as_points(surface: Mesh | PointCloud, samples: int, seed: int) -> PointCloud:
    if isinstance(surface, Mesh):
        return PointCloud(*sample_surface(surface, samples, [seed, 2]))
    if not len(surface):
        raise InputError("empty_scan", "The ground truth has no points to measure from.")
    return surface


def _two_sided(
    truth: PointCloud,
    found: PointCloud,
    distances: tuple[np.ndarray, np.ndarray],
    indices: tuple[np.ndarray, np.ndarray],
) -> dict[str, Any]:
    """What needs both directions; ``distances`` and ``indices``: truth to found, and back."""
    threshold = _F_SCORE_FRACTION * float(np.linalg.norm(np.ptp(truth.points, axis=0)))
    consistency = None
    if truth.normals is not None and found.normals is not None:
        consistency = normal_consistency(truth.normals, found.normals, *indices)
    return {
        "d_C": 0.5 * float(distances[0].mean() + distances[1].mean()),
        "d_H": float(max(distances[0].max(), distances[1].max())),
        "f_score": {"threshold": threshold, "value": f_score(*distances, threshold)},
        "normal_consistency": consistency,
    }


def _deviation(distances: np.ndarray) -> dict[str, float]:
    return {"mean": float(distances.mean()), "max": float(distances.max())}
