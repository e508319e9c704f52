"""What is done to a mesh after extraction: trimming, decimation, colours and other values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from visco_core.config import ReconstructionConfig
from visco_core.io.faces import vertex_normals
from visco_core.neighbours import Neighbours
from visco_core.pointcloud import PointCloud
from visco_core.progress import Check, never
from visco_core.result import Mesh
from visco_core.trim import trim

CARRIED_FROM = 4
"""How many points a vertex takes its colour from: one alone would leave jagged borders."""


def finish_mesh(
    mesh: Mesh,
    cloud: PointCloud,
    config: ReconstructionConfig,
    threads: int = -1,
    check: Check = never,
) -> Mesh:
    """``mesh`` trimmed, decimated and coloured as the settings and the scan ask."""
    if config.trim is not None:
        mesh = trim(mesh, cloud.points, config.trim, threads, check)
    if config.decimate is not None and len(mesh.faces) > config.decimate:
        mesh = decimate(mesh, config.decimate)
    if cloud.colors is not None or cloud.scalars:
        mesh = carry_attributes(mesh, cloud, threads, check)
    return mesh


def decimate(mesh: Mesh, triangles: int) -> Mesh:
    """``mesh`` reduced to about ``triangles`` faces by quadric edge collapse."""
    import fast_simplification

    center = mesh.vertices.mean(0)
    reduced = fast_simplification.simplify(
        (mesh.vertices - center).astype(np.float32), mesh.faces, target_count=triangles
    )
    vertices, faces = reduced[0], reduced[1]
    return Mesh(vertices + center, faces.astype(np.int32), vertex_normals(vertices, faces))


def carry_attributes(
    mesh: Mesh, cloud: PointCloud, threads: int = -1, check: Check = never
) -> Mesh:
    """``mesh`` with the colours and scalars of the nearest points, weighted by 1 / distance²."""
    count = min(CARRIED_FROM, len(cloud))
    distance, nearest = Neighbours(cloud.points, threads, check).nearest(mesh.vertices, count)
    weights = 1 / np.maximum(distance, 1e-9 * np.ptp(cloud.points, axis=0).max()) ** 2
    weights /= weights.sum(1, keepdims=True)

    def mean(values: np.ndarray) -> np.ndarray:
        check()
        return np.einsum("vk,vk...->v...", weights, values[nearest])

    return replace(
        mesh,
        colors=None if cloud.colors is None else np.rint(mean(cloud.colors)).astype(np.uint8),
        attributes={k: mean(values).astype(np.float32) for k, values in cloud.scalars.items()},
    )


def with_confidence(mesh: Mesh, confidence: np.ndarray) -> Mesh:
    """``mesh`` with confidence (V,) first of its attributes.

    A value of the scan's own by that name is called ``scan_confidence``.
    """
    carried = {
        f"scan_{name}" if name.lower() == "confidence" else name: values
        for name, values in mesh.attributes.items()
    }
    return replace(mesh, attributes={"confidence": confidence, **carried})
