"""Light: from what each pixel sees to its color.

All colors are linear, all vectors in the camera's frame (right, up, forward).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from visco_core.kernels.native import library
from visco_core.preview.camera import Camera

_OCCLUSION_SAMPLES = 20


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


def light(surface: Surface, camera: Camera, reach: float) -> np.ndarray:
    """(H, W, 4) float32 linear color times coverage, and coverage, at the picture's size.

    camera: of the supersampled picture; reach: how far ambient occlusion looks, in scene units.
    """
    step = surface.supersample
    height, width = surface.owner.shape
    shape = height // step, width // step
    openness, smooth = np.ones(shape, np.float32), np.ones(shape, np.float32)
    picture = np.zeros((*shape, 4), np.float32)
    center = np.array([0.5 * camera.size[0], 0.5 * camera.size[1], camera.focal])
    spiral = _spiral()
    shape = surface.screen, surface.faces, len(surface.faces), surface.normals
    seen = surface.inverse_depth, surface.owner, width, height, *shape
    library.occlude(*seen, step, center, reach, spiral, len(spiral), openness)
    library.blur(openness, surface.inverse_depth, width, height, step, smooth)
    up = camera.up.astype(np.float32)
    library.shade(*seen, surface.albedo, step, center, up, smooth, picture)
    return picture


def _spiral() -> np.ndarray:
    """Sample offsets (K, 2) in a unit disc, denser toward its middle."""
    index = np.arange(_OCCLUSION_SAMPLES) + 0.5
    radius = (index / _OCCLUSION_SAMPLES) ** 1.3
    angle = np.pi * (1.0 + 5.0**0.5) * index
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1).astype(np.float32)
