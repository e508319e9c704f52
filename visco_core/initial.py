"""The field that the solver starts from: which side is inside, and how far the surface is.

Signs come from an FFT Poisson solve: oriented normals are splatted into a grid of cells, and the
potential whose Laplacian is their divergence steps up across the surface (Kazhdan, Bolitho, Hoppe,
"Poisson Surface Reconstruction", SGP 2006). The median of the potential at the points separates
inside from outside, and a Euclidean distance transform turns the signs into distances.
"""

from __future__ import annotations

import numpy as np
import scipy.fft
from scipy import ndimage

from visco_core.kernels import Backend
from visco_core.progress import Check, never

SMOOTHING = 1.5
"""Standard deviation of the Gaussian that smooths the splatted normals, in cells."""


def starting_values(
    backend: Backend,
    points: np.ndarray,
    normals: np.ndarray,
    resolution: int,
    check: Check = never,
) -> np.ndarray:
    """A signed distance (side³ + 1,) float32 on the nodes of a dense grid of ``resolution`` voxels.

    points (P, 3) in [0, 1]³; normals (P, 3), outward. In units of the cube, negative inside.
    """
    outside = potential(backend, points, normals, 2 * resolution, check) > 0
    squared = backend.kernels.squared_distance
    to_inside = squared(backend.array(outside))
    check()
    to_outside = squared(backend.array(~outside))
    check()
    distance = np.sqrt(backend.numpy(to_inside)) - np.sqrt(backend.numpy(to_outside))
    # No cell is farther than the cube is wide, also where there is nothing on the other side.
    distance = np.clip(distance - 0.5 * np.sign(distance), -2 * resolution, 2 * resolution)
    at_nodes = _nodes_from_cells(distance / (2 * resolution))
    return np.append(at_nodes, np.float32(0))


def potential(
    backend: Backend, points: np.ndarray, normals: np.ndarray, cells: int, check: Check = never
) -> np.ndarray:
    """The Poisson potential (cells, cells, cells) float32 at cell centres, zero at the surface."""
    spread = backend.numpy(
        backend.kernels.splat(
            backend.array(points.astype(np.float32)), backend.array(normals), cells
        )
    )[:3]
    check()
    full = 2 * np.pi * np.fft.fftfreq(cells).astype(np.float32)
    half = 2 * np.pi * np.fft.rfftfreq(cells).astype(np.float32)
    frequencies = (full[:, None, None], full[:, None], half)
    square = frequencies[0] ** 2 + frequencies[1] ** 2 + frequencies[2] ** 2
    square[0, 0, 0] = 1
    spectrum = np.asarray(scipy.fft.rfftn(spread, axes=(1, 2, 3), workers=backend.threads))
    check()
    divergence = np.asarray(sum(k * part for k, part in zip(frequencies, spectrum, strict=True)))
    divergence *= -1j * np.exp(-0.5 * SMOOTHING**2 * square) / square
    divergence[0, 0, 0] = 0
    field = np.asarray(scipy.fft.irfftn(divergence, s=(cells,) * 3, workers=backend.threads))
    check()
    return field - np.median(sample_cells(field, points))


def sample_cells(field: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Trilinear values (P,) at points (P, 3) in [0, 1]³ of a field given at cell centres."""
    return ndimage.map_coordinates(
        field, points.T * len(field) - 0.5, order=1, mode="nearest", output=np.float32
    )


def _nodes_from_cells(cells: np.ndarray) -> np.ndarray:
    """Values at every second cell corner, flattened: the mean of the eight cells around it."""
    padded = np.pad(cells, 1, mode="edge")
    for axis in range(3):
        low = np.take(padded, np.arange(0, padded.shape[axis], 2), axis)
        high = np.take(padded, np.arange(1, padded.shape[axis], 2), axis)
        padded = (low + high) / 2
    return padded.ravel()
