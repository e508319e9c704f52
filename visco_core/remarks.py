"""What the owner of a scan should know of the mesh that came of it, in sentences with advice."""

from __future__ import annotations

import numpy as np

from visco_core.neighbours import Neighbours
from visco_core.pointcloud import PointCloud
from visco_core.progress import Check, never
from visco_core.result import Mesh

UNSUPPORTED, SUPPORTED = 0.05, 0.5
"""Confidence below which the surface is a guess, and above which the scan says where it is."""

MUCH = 0.1
"""Share of the surface that may be guessed without a word: holes that a scanner leaves are less."""

SAMPLES = 20_000

PIECE = 2**17
"""Faces between two questions for a stop request."""

BEYOND = 2.0
"""Distance at which trimming is advised, over the 99.9 % quantile of that of supported vertices."""


def remarks(
    mesh: Mesh, confidence: np.ndarray, cloud: PointCloud, threads: int = -1, check: Check = never
) -> list[str]:
    """Sentences on a closed mesh with confidence (V,) made of ``cloud``, in the same units."""
    volume = whole = guessed = 0.0
    # Axis by axis, which is several times as fast as by rows.
    places = np.ascontiguousarray((mesh.vertices - mesh.vertices.mean(0)).T, np.float32)
    for start in range(0, len(mesh.faces), PIECE):
        check()
        corners = mesh.faces[start : start + PIECE].T
        first, second, third = (places[:, corner] for corner in corners)
        x, y, z = zip(second - first, third - first, strict=True)
        across = np.stack(
            [y[0] * z[1] - z[0] * y[1], z[0] * x[1] - x[0] * z[1], x[0] * y[1] - y[0] * x[1]]
        )
        volume += np.einsum("if,if->", first, across, dtype=np.float64)
        area = np.sqrt(np.einsum("if,if->f", across, across))
        whole += area.sum(dtype=np.float64)
        sure = sum(confidence[corner] for corner in corners)
        guessed += area[sure < 3 * UNSUPPORTED].sum(dtype=np.float64)
    said = []
    if volume < 0:
        told = "; give the scan normals if they should not."
        if cloud.normals is not None:
            told = ", as the scan's normals do; normals=estimate may turn them."
        said.append(f"The mesh's faces point into what it encloses{told}")
    supported = np.flatnonzero(confidence > SUPPORTED)
    if guessed > MUCH * whole and len(supported):
        chosen = mesh.vertices[supported[:: len(supported) // SAMPLES + 1]]
        distance = Neighbours(cloud.points, threads, check).nearest(chosen)[0]
        said.append(
            f"{100 * guessed / whole:.0f} % of the surface lies where the scan has no points; "
            f"trim={BEYOND * np.quantile(distance, 0.999):.2g} cuts it off."
        )
    return said
