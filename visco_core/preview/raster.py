"""Which triangle or point each pixel sees: a z-buffer, compiled by numba.

Rows are split among threads that each walk all primitives and draw only their own rows, so that
the result does not depend on their number.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numba import njit

NOBODY = -1


def see_triangles(
    screen: np.ndarray, faces: np.ndarray, size: tuple[int, int], threads: int
) -> tuple[np.ndarray, np.ndarray]:
    """(inverse depth (H, W) float32, face (H, W) int32 or NOBODY) of the nearest triangles.

    screen (V, 3) float32: column, row, inverse depth; faces (F, 3) int32.
    """
    depth, owner = _empty_buffers(size)
    in_bands(
        lambda first, last: _draw_triangles(screen, faces, depth, owner, first, last),
        size[1],
        threads,
    )
    return depth, owner


def see_points(
    screen: np.ndarray, radius: float, size: tuple[int, int], threads: int
) -> tuple[np.ndarray, np.ndarray]:
    """(inverse depth (H, W) float32, point (H, W) int32 or NOBODY) of the nearest discs.

    screen (P, 3) float32: column, row, inverse depth; radius: of a disc, in pixels at depth 1.
    """
    depth, owner = _empty_buffers(size)
    in_bands(
        lambda first, last: _draw_discs(screen, radius, depth, owner, first, last), size[1], threads
    )
    return depth, owner


def in_bands(draw: Callable[[int, int], None], rows: int, threads: int) -> None:
    """Call ``draw(first, last)`` for bands of rows that together cover them all."""
    edges = np.linspace(0, rows, threads + 1).astype(int)
    if threads == 1:
        draw(0, rows)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(draw, edges[:-1].tolist(), edges[1:].tolist()))


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals (V, 3) float32: the faces' normals, weighted by area."""
    total = np.zeros((len(vertices), 3))
    _add_face_normals(vertices, faces, total)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return (total / np.maximum(length, 1e-300)).astype(np.float32)


def _empty_buffers(size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    shape = (size[1], size[0])
    return np.zeros(shape, dtype=np.float32), np.full(shape, NOBODY, dtype=np.int32)


@njit(cache=True, nogil=True)
def _draw_triangles(screen, faces, depth, owner, first, last):
    width = depth.shape[1]
    for face in range(len(faces)):
        ax, ay, az = screen[faces[face, 0]]
        bx, by, bz = screen[faces[face, 1]]
        cx, cy, cz = screen[faces[face, 2]]
        top = max(int(np.ceil(min(ay, by, cy) - 0.5)), first)
        bottom = min(int(np.floor(max(ay, by, cy) - 0.5)), last - 1)
        if top > bottom:
            continue
        left = max(int(np.ceil(min(ax, bx, cx) - 0.5)), 0)
        right = min(int(np.floor(max(ax, bx, cx) - 0.5)), width - 1)
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if area == 0.0 or left > right:
            continue
        for row in range(top, bottom + 1):
            y = row + 0.5
            for column in range(left, right + 1):
                x = column + 0.5
                u = ((cx - bx) * (y - by) - (cy - by) * (x - bx)) / area
                v = ((ax - cx) * (y - cy) - (ay - cy) * (x - cx)) / area
                w = 1.0 - u - v
                if u < 0.0 or v < 0.0 or w < 0.0:
                    continue
                inverse = u * az + v * bz + w * cz
                if inverse > depth[row, column]:
                    depth[row, column] = inverse
                    owner[row, column] = face


@njit(cache=True, nogil=True)
def _draw_discs(screen, radius, depth, owner, first, last):
    width = depth.shape[1]
    for point in range(len(screen)):
        x, y, inverse = screen[point]
        reach = max(radius * inverse, 0.75)
        top = max(int(np.ceil(y - reach - 0.5)), first)
        bottom = min(int(np.floor(y + reach - 0.5)), last - 1)
        left = max(int(np.ceil(x - reach - 0.5)), 0)
        right = min(int(np.floor(x + reach - 0.5)), width - 1)
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                apart = (column + 0.5 - x) ** 2 + (row + 0.5 - y) ** 2
                # The rim lies a little deeper, so that neighboring discs meet halfway.
                sunk = inverse * (1.0 - 2e-3 * apart / reach**2)
                if apart <= reach**2 and sunk > depth[row, column]:
                    depth[row, column] = sunk
                    owner[row, column] = point


@njit(cache=True, nogil=True)
def _add_face_normals(vertices, faces, total):
    for face in range(len(faces)):
        a, b, c = faces[face]
        ux, uy, uz = vertices[b] - vertices[a]
        vx, vy, vz = vertices[c] - vertices[a]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        for corner in (a, b, c):
            total[corner, 0] += nx
            total[corner, 1] += ny
            total[corner, 2] += nz
