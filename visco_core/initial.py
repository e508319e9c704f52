"""The field that the solver starts from: which side is inside, and how far the surface is.

Signs come from an FFT Poisson solve: the divergence of the oriented normals is splatted into a grid
of cells, and the potential whose Laplacian it is steps up across the surface (Kazhdan, Bolitho,
Hoppe, "Poisson Surface Reconstruction", SGP 2006). The median of the potential at the points
separates inside from outside, and a Euclidean distance transform turns the signs into distances.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from visco_core.kernels import Backend
from visco_core.progress import Check, never

SMOOTHING = 1.5
"""Standard deviation of the Gaussian that smooths the splatted normals, in cells."""

ENOUGH = 100_000
"""Of more points than this, only every so many are asked where the surface's potential lies."""


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
    kernels, places = backend.kernels, backend.array(points.astype(np.float32))
    sources = backend.numpy(kernels.splat_divergence(places, backend.array(normals), cells))
    check()
    full = 2 * np.pi * np.fft.fftfreq(cells).astype(np.float32)
    half = 2 * np.pi * np.fft.rfftfreq(cells).astype(np.float32)
    square = full[:, None, None] ** 2 + full[:, None] ** 2 + half**2
    square[0, 0, 0] = 1
    spectrum = np.fft.rfftn(sources)
    check()
    spectrum *= np.exp(-0.5 * SMOOTHING**2 * square) / -square
    spectrum[0, 0, 0] = 0
    check()
    field = np.fft.irfftn(spectrum, sources.shape, axes=(0, 1, 2))
    check()
    return field - np.median(sample_cells(field, points[:: -(-len(points) // ENOUGH)]))


def sample_cells(field: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Trilinear values (P,) at points (P, 3) in [0, 1]³ of a field given at cell centres."""
    last = len(field) - 1
    scaled = np.clip(points * len(field) - 0.5, 0, last)
    base = np.minimum(scaled.astype(np.int64), last - 1)
    above = scaled - base
    found = np.zeros(len(points))
    for corner in product((0, 1), repeat=3):
        weight = np.where(corner, above, 1 - above).prod(1)
        found += weight * field[tuple((base + corner).T)]
    return found.astype(np.float32)


def _nodes_from_cells(cells: np.ndarray) -> np.ndarray:
    """Values at every second cell corner, flattened: the mean of the eight cells around it."""
    padded = np.pad(cells, 1, mode="edge")
    for axis in range(3):
        low = np.take(padded, np.arange(0, padded.shape[axis], 2), axis)
        high = np.take(padded, np.arange(1, padded.shape[axis], 2), axis)
        padded = (low + high) / 2
    return padded.ravel()
