"""Light: from what each pixel sees to its color.

All colors are linear, all vectors in the camera's frame (right, up, forward).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from visco_core.preview.camera import Camera
from visco_core.preview.raster import in_bands

_OCCLUSION_SAMPLES = 20
_BLUR = 2


@dataclass(frozen=True)
class Surface:
    """What the pixels see, at ``supersample`` times the picture's size.

    inverse_depth (H, W) float32; owner (H, W) int32: face, or point where ``faces`` is empty;
    screen (V, 3), normals (V, 3), albedo (V, 3) float32; faces (F, 3) int32.
    """

    inverse_depth: np.ndarray
    owner: np.ndarray
    screen: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    albedo: np.ndarray
    supersample: int


def light(surface: Surface, camera: Camera, reach: float, threads: int) -> np.ndarray:
    """(H, W, 4) float32 linear color times coverage, and coverage, at the picture's size.

    camera: of the supersampled picture; reach: how far ambient occlusion looks, in scene units.
    """
    step = surface.supersample
    rows, columns = surface.owner.shape[0] // step, surface.owner.shape[1] // step
    openness = np.ones((rows, columns), dtype=np.float32)
    spiral = _spiral()
    arrays = (surface.inverse_depth, surface.owner, surface.screen, surface.faces, surface.normals)
    center = (0.5 * camera.size[0], 0.5 * camera.size[1], camera.focal)
    in_bands(
        lambda first, last: _occlude(*arrays, step, center, reach, spiral, openness, first, last),
        rows,
        threads,
    )
    smooth = np.ones_like(openness)
    in_bands(
        lambda first, last: _blur(openness, surface.inverse_depth, step, smooth, first, last),
        rows,
        threads,
    )
    picture = np.zeros((rows, columns, 4), dtype=np.float32)
    up = camera.up.astype(np.float32)
    in_bands(
        lambda first, last: _shade(
            *arrays, surface.albedo, step, center, up, smooth, picture, first, last
        ),
        rows,
        threads,
    )
    return picture


def _spiral() -> np.ndarray:
    """Sample offsets (K, 2) in a unit disc, denser toward its middle."""
    index = np.arange(_OCCLUSION_SAMPLES) + 0.5
    radius = (index / _OCCLUSION_SAMPLES) ** 1.3
    angle = np.pi * (1.0 + 5.0**0.5) * index
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1).astype(np.float32)


@njit(cache=True, nogil=True)
def _corner_weights(owner, row, column, screen, faces):
    """Perspective-correct weights of the three corners of the face that a pixel sees."""
    ax, ay, az = screen[faces[owner, 0]]
    bx, by, bz = screen[faces[owner, 1]]
    cx, cy, cz = screen[faces[owner, 2]]
    x, y = column + 0.5, row + 0.5
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    u = ((cx - bx) * (y - by) - (cy - by) * (x - bx)) / area * az
    v = ((ax - cx) * (y - cy) - (ay - cy) * (x - cx)) / area * bz
    w = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area * cz
    total = u + v + w
    return u / total, v / total, w / total


@njit(cache=True, nogil=True)
def _interpolate(values, owner, row, column, screen, faces):
    """A (V, 3) attribute where a pixel sees the surface."""
    if len(faces) == 0:
        return values[owner, 0], values[owner, 1], values[owner, 2]
    u, v, w = _corner_weights(owner, row, column, screen, faces)
    a, b, c = faces[owner, 0], faces[owner, 1], faces[owner, 2]
    return (
        u * values[a, 0] + v * values[b, 0] + w * values[c, 0],
        u * values[a, 1] + v * values[b, 1] + w * values[c, 1],
        u * values[a, 2] + v * values[b, 2] + w * values[c, 2],
    )


@njit(cache=True, nogil=True)
def _position(row, column, inverse, center):
    depth = 1.0 / inverse
    x = (column + 0.5 - center[0]) * depth / center[2]
    y = (center[1] - row - 0.5) * depth / center[2]
    return x, y, depth


@njit(cache=True, nogil=True)
def _seen_from_behind(owner, normal, position, screen, faces):
    """Whether a pixel sees the inside: by the face's winding, or the point's normal."""
    if len(faces) == 0:
        away = normal[0] * position[0] + normal[1] * position[1] + normal[2] * position[2]
        # Discs just past the silhouette stick out over it and would fray it with dark spots.
        return away > 0.4 * position[2]
    ax, ay, _ = screen[faces[owner, 0]]
    bx, by, _ = screen[faces[owner, 1]]
    cx, cy, _ = screen[faces[owner, 2]]
    return (bx - ax) * (cy - ay) - (cx - ax) * (by - ay) > 0.0


@njit(cache=True, nogil=True)
def _toward_eye(normal, back):
    """The unit normal on the side that is seen."""
    length = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    sign = (-1.0 if back else 1.0) / max(length, 1e-12)
    return normal[0] * sign, normal[1] * sign, normal[2] * sign


@njit(cache=True, nogil=True)
def _occlude(
    depth, owner, screen, faces, normals, step, center, reach, spiral, openness, first, last
):
    """Screen-space ambient occlusion: the share of the hemisphere that near surfaces hide."""
    height, width = depth.shape
    for i in range(first, last):
        for j in range(openness.shape[1]):
            row, column = i * step, j * step
            if owner[row, column] < 0:
                continue
            px, py, pz = _position(row, column, depth[row, column], center)
            normal = _interpolate(normals, owner[row, column], row, column, screen, faces)
            back = _seen_from_behind(owner[row, column], normal, (px, py, pz), screen, faces)
            nx, ny, nz = _toward_eye(normal, back)
            turn = 0.61803 * ((i % 4) * 4 + (j % 4)) * 2.0 * np.pi
            cosine, sine = np.cos(turn), np.sin(turn)
            pixels = reach * center[2] / pz
            hidden = 0.0
            for k in range(len(spiral)):
                x = int(column + pixels * (cosine * spiral[k, 0] - sine * spiral[k, 1]))
                y = int(row + pixels * (sine * spiral[k, 0] + cosine * spiral[k, 1]))
                if x < 0 or y < 0 or x >= width or y >= height or owner[y, x] < 0:
                    continue
                qx, qy, qz = _position(y, x, depth[y, x], center)
                dx, dy, dz = qx - px, qy - py, qz - pz
                apart = np.sqrt(dx * dx + dy * dy + dz * dz) + 1e-12
                above = (dx * nx + dy * ny + dz * nz) / apart - 0.06
                if above > 0.0 and apart < 2.0 * reach:
                    hidden += above * (1.0 - 0.5 * apart / reach)
            openness[i, j] = max(0.0, 1.0 - 2.6 * hidden / len(spiral))


@njit(cache=True, nogil=True)
def _blur(openness, depth, step, smooth, first, last):
    """Average over the dither pattern's period, not across edges in depth."""
    rows, columns = openness.shape
    for i in range(first, last):
        for j in range(columns):
            here = depth[i * step, j * step]
            if here == 0.0:
                continue
            total, weight = 0.0, 0.0
            for y in range(max(i - _BLUR, 0), min(i + _BLUR, rows)):
                for x in range(max(j - _BLUR, 0), min(j + _BLUR, columns)):
                    there = depth[y * step, x * step]
                    if abs(there - here) < 0.01 * here:
                        total += openness[y, x]
                        weight += 1.0
            if weight > 0.0:
                smooth[i, j] = total / weight


@njit(cache=True, nogil=True)
def _shade(
    depth,
    owner,
    screen,
    faces,
    normals,
    albedo,
    step,
    center,
    up,
    openness,
    picture,
    first,
    last,
):
    """A warm key light, a cool fill, a rim from behind, and the sky."""
    for i in range(first, last):
        for j in range(picture.shape[1]):
            for row in range(i * step, (i + 1) * step):
                for column in range(j * step, (j + 1) * step):
                    seen = owner[row, column]
                    if seen < 0:
                        continue
                    position = _position(row, column, depth[row, column], center)
                    normal = _interpolate(normals, seen, row, column, screen, faces)
                    back = _seen_from_behind(seen, normal, position, screen, faces)
                    nx, ny, nz = _toward_eye(normal, back)
                    red, green, blue = _interpolate(albedo, seen, row, column, screen, faces)
                    if back:
                        red, green, blue = 0.35 * red, 0.3 * green, 0.28 * blue
                    open_sky = openness[i, j]
                    key = max(-0.51 * nx + 0.62 * ny - 0.6 * nz, 0.0) * (0.4 + 0.6 * open_sky)
                    fill = max(0.86 * nx + 0.17 * ny - 0.47 * nz, 0.0) * open_sky
                    rim = max(0.35 * nx + 0.61 * ny + 0.71 * nz, 0.0)
                    sky = 0.5 + 0.5 * (nx * up[0] + ny * up[1] + nz * up[2])
                    sky = (0.35 + 0.65 * sky) * open_sky
                    # Half way between the key light and the eye, for a soft gloss.
                    gloss = max(-0.285 * nx + 0.347 * ny - 0.894 * nz, 0.0) ** 36 * 0.10
                    rim *= rim
                    light_red = 1.02 * key + 0.15 * fill + 0.30 * rim + 0.29 * sky
                    light_green = 0.97 * key + 0.17 * fill + 0.31 * rim + 0.31 * sky
                    light_blue = 0.90 * key + 0.20 * fill + 0.33 * rim + 0.35 * sky
                    gloss *= open_sky
                    picture[i, j, 0] += _soft(red * light_red + gloss)
                    picture[i, j, 1] += _soft(green * light_green + gloss)
                    picture[i, j, 2] += _soft(blue * light_blue + gloss)
                    picture[i, j, 3] += 1.0
            for channel in range(4):
                picture[i, j, channel] /= step * step


@njit(cache=True, nogil=True)
def _soft(value):
    """Roll off highlights instead of clipping them."""
    if value <= 0.7:
        return value
    return 0.7 + 0.3 * (1.0 - np.exp(-(value - 0.7) / 0.3))
