"""The field that the solver starts from: which side is inside, and how far the surface is.

Signs come from an FFT Poisson solve: the divergence of the oriented normals, each times the area
that its point stands for, is splatted into a grid of cells, and the potential whose Laplacian it is
steps up across the surface (Kazhdan, Bolitho, Hoppe, "Poisson Surface Reconstruction", SGP 2006).
The areas make the step as high where the scan is sparse as where it is dense. The median of the
potential at the points separates inside from outside, and a Euclidean distance transform turns the
signs into distances.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import product

import numpy as np

from visco_core.kernels import Backend
from visco_core.neighbours import Neighbours
from visco_core.progress import Check, never

SMOOTHING = 1.5
"""Standard deviation of the Gaussian that smooths the splatted normals, in cells."""

ROOM = 0.03
"""How far beyond the points' bounding box a surface may go, in units of the cube, whose rim is 0.05
away or more."""

POINTS = 100_000
"""More points would add nothing to signs at this resolution; so many of a larger scan are used."""

NEIGHBOURS = 7
"""Neighbours that tell how large an area a point stands for."""


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
    if len(points) > POINTS:
        chosen = np.sort(np.random.default_rng(0).choice(len(points), POINTS, replace=False))
        points, normals = points[chosen], normals[chosen]
    dipoles = normals * surface_areas(points, backend.threads, check)[:, None]
    outside = potential(backend, points, dipoles, 2 * resolution, check) > 0
    _close(outside, points)
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


def _close(outside: np.ndarray, points: np.ndarray) -> None:
    """Closes a surface that the rim of the cube would cut open.

    Of a scan from one side the potential does not say where the surface closes, and the inside may
    reach the rim. Then everything is put outside that is farther than ``ROOM`` from the box around
    ``points`` (P, 3). Where all of the rim is inside, the scan is that of a cavity.
    """
    rim = np.stack([outside.take(end, axis) for axis in range(3) for end in (0, -1)])
    if rim.all() or not rim.any():
        return
    cells = len(outside)
    low, high = points.min(0) - ROOM, points.max(0) + ROOM
    for axis in range(3):
        across = np.moveaxis(outside, axis, 0)
        across[: max(round(low[axis] * cells), 0)] = True
        across[round(high[axis] * cells) :] = True


def surface_areas(points: np.ndarray, threads: int = -1, check: Check = never) -> np.ndarray:
    """(P,) float32: how much surface each of ``points`` (P, 3) stands for; the usual point 1.

    The squared distance to its last neighbour, as the median of the neighbours has it: beside a
    surface an outlier counts no more than the surface's own points. Rounded to a power of four,
    since such distances scatter also on an even scan, which would roughen its start.
    """
    count = min(NEIGHBOURS + 1, len(points))
    distance, near = Neighbours(points, threads, check).nearest(points, count)
    areas = np.median(np.square(distance[:, -1])[near], axis=1)
    steps = np.log2(np.maximum(areas / max(np.median(areas), 1e-300), 1e-12)) / 2
    return (4.0 ** np.rint(steps)).astype(np.float32)


def potential(
    backend: Backend, points: np.ndarray, dipoles: np.ndarray, cells: int, check: Check = never
) -> np.ndarray:
    """The Poisson potential (cells, cells, cells) float32 at cell centres, zero at the surface.

    dipoles (P, 3): outward normals of the points, as long as their areas.
    """
    kernels, places = backend.kernels, backend.array(points.astype(np.float32))
    sources = backend.numpy(kernels.splat_divergence(places, backend.array(dipoles), cells))
    check()
    full = 2 * np.pi * np.fft.fftfreq(cells).astype(np.float32)
    half = 2 * np.pi * np.fft.rfftfreq(cells).astype(np.float32)
    square = full[:, None, None] ** 2 + full[:, None] ** 2 + half**2
    square[0, 0, 0] = 1
    spectrum = _in_parts(backend.threads, 0, lambda a: np.fft.rfftn(a, axes=(1, 2)), sources)
    check()
    spectrum = _in_parts(backend.threads, 1, lambda a: np.fft.fft(a, axis=0), spectrum)
    check()
    spectrum *= np.exp(-0.5 * SMOOTHING**2 * square) / -square
    spectrum[0, 0, 0] = 0
    check()
    spectrum = _in_parts(backend.threads, 1, lambda a: np.fft.ifft(a, axis=0), spectrum)
    check()
    plane = sources.shape[1:]
    field = _in_parts(backend.threads, 0, lambda a: np.fft.irfftn(a, plane, axes=(1, 2)), spectrum)
    check()
    return field - np.median(sample_cells(field, points))


def _in_parts(
    threads: int, axis: int, transform: Callable[[np.ndarray], np.ndarray], values: np.ndarray
) -> np.ndarray:
    """``transform`` of each part along ``axis``, on so many threads; numpy's transforms use one."""
    with ThreadPoolExecutor(threads) as pool:
        parts = list(pool.map(transform, np.array_split(values, threads, axis)))
    return np.concatenate(parts, axis)


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
