"""One range image: rays traced to the surface, and normals as a scanner estimates them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from visco_core.gallery.shape import Shape

_DISTANCE = 1.5
_MAX_STEPS = 120
_WINDOW = 2
_MIN_NEIGHBORS = 6


@dataclass(frozen=True)
class RangeImage:
    """The pixels of a pinhole camera whose rays meet the surface.

    eye (3,); frame (3, 3): rows right, up, forward; half_width: tangent of half the field of view;
    resolution: pixels a side; pixels (P,) int: flat indices, ascending; depth (P,): length of the
    ray.
    """

    eye: np.ndarray
    frame: np.ndarray
    half_width: float
    resolution: int
    pixels: np.ndarray
    depth: np.ndarray

    def rays(self) -> np.ndarray:
        """Unit directions (P, 3) from the eye."""
        row, column = np.divmod(self.pixels, self.resolution)
        across = (2.0 * column + 1.0) / self.resolution - 1.0
        upward = 1.0 - (2.0 * row + 1.0) / self.resolution
        local = np.stack([across, upward, np.full(len(row), 1.0 / self.half_width)], axis=1)
        directions = local @ self.frame
        return directions / np.linalg.norm(directions, axis=1, keepdims=True)

    def points(self) -> np.ndarray:
        """Where the rays end, (P, 3)."""
        return self.eye + self.depth[:, None] * self.rays()


def take_image(shape: Shape, direction: np.ndarray, resolution: int) -> RangeImage:
    """The noiseless range image of ``shape`` from ``direction``; occlusion by construction."""
    toward = direction / np.linalg.norm(direction)
    distance = _DISTANCE * shape.diagonal
    eye = shape.center + distance * toward
    radius = 0.5 * shape.diagonal
    frame = _frame(-toward)
    corners = np.stack(np.meshgrid(*shape.bounds.T), axis=-1).reshape(-1, 3)
    seen = (corners - eye) @ frame.T
    half_width = float(np.abs(seen[:, :2] / seen[:, 2:]).max())
    pixels = np.arange(resolution**2)
    start = np.full(len(pixels), distance - radius)
    image = RangeImage(eye, frame, half_width, resolution, pixels, start)
    depth, hit = _trace(shape, eye, image.rays(), start, distance + radius)
    return RangeImage(eye, frame, half_width, resolution, pixels[hit], depth[hit])


def _frame(forward: np.ndarray) -> np.ndarray:
    upward = np.array([0.0, 0.0, 1.0]) if abs(forward[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    right = np.cross(forward, upward)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(right, forward), forward])


def _trace(
    shape: Shape, eye: np.ndarray, rays: np.ndarray, start: np.ndarray, end: float
) -> tuple[np.ndarray, np.ndarray]:
    """(depth (P,), indices (H,) of the rays that meet the surface) by sphere tracing.

    Source: Hart, Sphere tracing, The Visual Computer 1996.
    """
    depth = start.copy()
    active = np.arange(len(rays))
    arrived = []
    for _ in range(_MAX_STEPS):
        value = shape.sdf(eye + depth[active, None] * rays[active])
        close = value < 1e-4 * shape.diagonal
        arrived.append(active[close])
        depth[active] += value
        active = active[~close & (depth[active] < end)]
        if not len(active):
            break
    hit = np.sort(np.concatenate(arrived))
    return depth, hit[_sharpen(shape, eye, rays, depth, hit)]


def _sharpen(
    shape: Shape, eye: np.ndarray, rays: np.ndarray, depth: np.ndarray, hit: np.ndarray
) -> np.ndarray:
    """Bring ``depth[hit]`` to the exact crossing by Newton's method; (H,) bool where it arrived."""
    step = 1e-6 * shape.diagonal
    for _ in range(5):
        points = eye + depth[hit, None] * rays[hit]
        ahead, behind = shape.sdf(points + step * rays[hit]), shape.sdf(points - step * rays[hit])
        slope = np.minimum((ahead - behind) / (2.0 * step), -0.01)
        depth[hit] -= shape.sdf(points) / slope
    return np.abs(shape.sdf(eye + depth[hit, None] * rays[hit])) < 1e-9 * shape.diagonal


def image_normals(image: RangeImage, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """(unit normals (P, 3) toward the eye, trusted (P,) bool), from planes fitted to 5×5 pixels.

    ``noise``: std of the depth. Neighbors across a jump in depth are left out; a pixel with too
    few of them is not trusted.
    """
    side = image.resolution + 2 * _WINDOW
    row, column = np.divmod(image.pixels, image.resolution)
    place = (row + _WINDOW) * side + column + _WINDOW
    index = np.full(side * side, -1)
    index[place] = np.arange(len(place))
    points = image.points()
    pixel = 2.0 * image.half_width / image.resolution * image.depth
    jump = 3.0 * _WINDOW * pixel + 4.0 * noise
    count = np.zeros(len(points))
    total = np.zeros((len(points), 3))
    outer = np.zeros((len(points), 3, 3))
    for offset in [i * side + j for i in range(-2, 3) for j in range(-2, 3)]:
        neighbor = index[place + offset]
        near = (neighbor >= 0) & (np.abs(image.depth[neighbor] - image.depth) < jump)
        step = np.where(near[:, None], points[neighbor] - points, 0.0)
        count += near
        total += step
        outer += step[:, :, None] * step[:, None, :]
    mean = total / count[:, None]
    covariance = outer / count[:, None, None] - mean[:, :, None] * mean[:, None, :]
    spread, axes = np.linalg.eigh(covariance)
    trusted = (count >= _MIN_NEIGHBORS) & (spread[:, 1] > 0.1 * pixel**2)
    normals = axes[:, :, 0]
    toward_eye = (normals * image.rays()).sum(axis=1, keepdims=True) < 0.0
    return np.where(toward_eye, normals, -normals), trusted
