"""The soft shadow that an object leaves on the ground below it."""

from __future__ import annotations

import numpy as np

from visco_core.preview.camera import Camera, UpAxis, extent
from visco_core.preview.raster import see_triangles

_CELLS = 256
_PAD = 0.5
# Weight, blur and the height at which the shadow has faded, both in object widths: the dark line
# of contact and the wide soft shade.
_LAYERS = ((0.45, 0.012, 0.03), (0.5, 0.09, 0.6))


def ground_shadow(
    vertices: np.ndarray,
    faces: np.ndarray,
    camera: Camera,
    size: tuple[int, int],
    up_axis: UpAxis,
) -> np.ndarray:
    """Share of the light that the ground loses at each pixel, (H, W) float32.

    ``camera`` is the supersampled picture's, ``size`` the final picture's width and height.
    """
    from scipy.ndimage import map_coordinates

    axis = "xyz".index(up_axis)
    flat = [(axis + 1) % 3, (axis + 2) % 3]
    low, high = extent(vertices)
    width = float((high - low)[flat].max())
    if width <= 0.0 or camera.eye[axis] <= low[axis]:
        return np.zeros((size[1], size[0]), dtype=np.float32)
    cell = width * (1.0 + 2.0 * _PAD) / _CELLS
    corner = 0.5 * (low + high)[flat] - 0.5 * _CELLS * cell
    shade = _shade_map(
        (vertices[:, flat] - corner) / cell, (vertices[:, axis] - low[axis]) / width, faces
    )
    column, row = np.meshgrid(*[(np.arange(n) + 0.5) * camera.size[0] / size[0] for n in size])
    local = np.stack([column - 0.5 * camera.size[0], 0.5 * camera.size[1] - row], axis=-1)
    rays = local @ camera.frame[:2] + camera.focal * camera.frame[2]
    fall = rays[..., axis]
    along = (low[axis] - camera.eye[axis]) / np.where(fall < 0.0, fall, np.inf)
    hit = camera.eye + along[..., None] * rays
    place = (hit[..., flat] - corner) / cell - 0.5
    found = map_coordinates(shade, [place[..., 1], place[..., 0]], order=1, cval=0.0)
    return np.where(fall < 0.0, found, 0.0).astype(np.float32)


def _shade_map(plan: np.ndarray, height: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(cells, cells) shade on the ground from the lowest surface above each cell.

    plan (V, 2): in cells; height (V,): above the ground, in object widths.
    """
    from scipy.ndimage import gaussian_filter

    screen = np.column_stack([plan, np.exp(-height)]).astype(np.float32)
    nearness, owner = see_triangles(screen, faces, (_CELLS, _CELLS))
    above = -np.log(np.maximum(nearness, 1e-30))
    shade = np.zeros((_CELLS, _CELLS), dtype=np.float32)
    cells_a_width = _CELLS / (1.0 + 2.0 * _PAD)
    for weight, blur, faded in _LAYERS:
        dark = np.where(owner >= 0, np.exp(-above / faded), 0.0)
        shade += weight * gaussian_filter(dark, blur * cells_a_width)
    return np.minimum(shade, 0.85)
