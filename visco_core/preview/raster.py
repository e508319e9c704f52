"""Which triangle or point each pixel sees: a z-buffer."""

from __future__ import annotations

import numpy as np

from visco_core.kernels.native import library

NOBODY = -1


def see_triangles(
    screen: np.ndarray, faces: np.ndarray, size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """(inverse depth (H, W) float32, face (H, W) int32 or NOBODY) of the nearest triangles.

    screen (V, 3) float32: column, row, inverse depth; faces (F, 3) int32.
    """
    depth, owner = _empty_buffers(size)
    library.draw_triangles(screen, faces, len(faces), depth, owner, *size)
    return depth, owner


def see_points(
    screen: np.ndarray, radius: float, size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """(inverse depth (H, W) float32, point (H, W) int32 or NOBODY) of the nearest discs.

    screen (P, 3) float32: column, row, inverse depth; radius: of a disc, in pixels at depth 1.
    """
    depth, owner = _empty_buffers(size)
    library.draw_discs(screen, len(screen), radius, depth, owner, *size)
    return depth, owner


def _empty_buffers(size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    shape = (size[1], size[0])
    return np.zeros(shape, dtype=np.float32), np.full(shape, NOBODY, dtype=np.int32)
