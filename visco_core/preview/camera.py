"""Where the picture is taken from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

UpAxis = Literal["x", "y", "z"]

_HALF_ANGLE = np.radians(13.0)
_MARGIN = 0.08


_X, _Y, _Z = np.eye(3)
_AXES = {"x": (_X, _Y, -_Z), "y": (_Y, _X, _Z), "z": (_Z, _X, -_Y)}


@dataclass(frozen=True)
class Camera:
    """A pinhole camera.

    frame (3, 3): rows right, up, forward; eye (3,); focal: in pixels; size: width and height in
    pixels; up (3,): the scene's up axis in the camera's frame.
    """

    frame: np.ndarray
    eye: np.ndarray
    focal: float
    size: tuple[int, int]
    up: np.ndarray

    def to_frame(self, points: np.ndarray) -> np.ndarray:
        """Points (P, 3) in the camera's frame, float32; the third coordinate is the depth."""
        # This order of factors is several times faster than (points - eye) @ frame.T.
        local = self.frame @ points.T - (self.frame @ self.eye)[:, None]
        return np.ascontiguousarray(local.T, dtype=np.float32)

    def turn(self, vectors: np.ndarray) -> np.ndarray:
        """Directions (P, 3) in the camera's frame, float32."""
        return np.ascontiguousarray((self.frame @ vectors.T).T, dtype=np.float32)

    def to_screen(self, local: np.ndarray) -> np.ndarray:
        """(P, 3) float32: column and row in pixels, inverse depth; of points from ``to_frame``."""
        inverse = 1.0 / local[:, 2]
        screen = np.empty_like(local)
        screen[:, 0] = 0.5 * self.size[0] + self.focal * local[:, 0] * inverse
        screen[:, 1] = 0.5 * self.size[1] - self.focal * local[:, 1] * inverse
        screen[:, 2] = inverse
        return screen


def frame_points(
    points: np.ndarray, size: tuple[int, int], up_axis: UpAxis, azimuth: float, elevation: float
) -> Camera:
    """The camera nearest to ``points`` (P, 3) that sees them all, from angles in degrees.

    Azimuth 0 is the front as modelling programs have it: -y for z up, +z for y up, -z for x up;
    growing angles walk to the right around the scene.
    """
    up, side, front = _AXES[up_axis]
    around, above = np.radians(azimuth), np.radians(elevation)
    level = np.sin(around) * side + np.cos(around) * front
    forward = -(np.cos(above) * level + np.sin(above) * up)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    frame = np.stack([right, np.cross(right, forward), forward])
    center = np.mean(extent(points), axis=0)
    local = frame @ points.T - (frame @ center)[:, None]
    slopes = np.tan(_HALF_ANGLE) * (1.0 - 2.0 * _MARGIN) * np.array(size) / max(size)
    # A point at depth z of a camera at (c, -d) is seen when |x - c| <= slope (z + d): two
    # half-planes an axis, of which the tightest decide c and d.
    ahead = (local[:2] - slopes[:, None] * local[2]).max(axis=1)
    behind = (-local[:2] - slopes[:, None] * local[2]).max(axis=1)
    distance = float(((ahead + behind) / (2.0 * slopes)).max())
    # A single point has no extent to decide the distance.
    distance = max(distance, -1.01 * float(local[2].min())) or 1.0
    eye = center + np.array([*(0.5 * (ahead - behind)), -distance]) @ frame
    focal = 0.5 * max(size) / np.tan(_HALF_ANGLE)
    return Camera(frame, eye, float(focal), size, frame @ up)


def extent(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Low and high corner, each (3,), of the box around points (P, 3)."""
    # Columns one by one: a reduction over the long axis of a (P, 3) array is ten times slower.
    low = [column.min() for column in points.T]
    return np.array(low), np.array([column.max() for column in points.T])
