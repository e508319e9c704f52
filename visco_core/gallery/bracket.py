"""A machined part: sharp creases, fillets, bores and a thin web."""

from __future__ import annotations

import numpy as np

from visco_core.gallery import implicit
from visco_core.gallery.shape import Shape

_BASE_HALF_HEIGHT = 0.09
_LUG_Y = 0.36
_LUG_HALF_WIDTH = 0.1
_BORE_CENTER = (0.0, 0.88)
_WEB_HALF_WIDTH = 0.018


def bracket() -> Shape:
    """A bearing bracket of genus 3: two bolt holes, a bored lug, and a web 1 % of the size thick.

    z is up.
    """
    bounds = np.array([[-0.95, -0.6, -_BASE_HALF_HEIGHT], [0.95, 0.6, 1.26]])
    return Shape("bracket", _sdf, bounds, genus=3, color=_color)


def _sdf(points: np.ndarray) -> np.ndarray:
    x, y, z = points.T
    ground, wall = points[:, :2], points[:, [0, 2]]
    corner = 0.2
    plate = implicit.rectangle(ground, (0.0, 0.0), (0.95 - corner, 0.6 - corner)) - corner
    base = implicit.extrude(plate, z, _BASE_HALF_HEIGHT)
    outline = np.minimum(
        implicit.disc(wall, _BORE_CENTER, 0.38), implicit.rectangle(wall, (0.0, 0.44), (0.38, 0.44))
    )
    lug = implicit.extrude(outline, y - _LUG_Y, _LUG_HALF_WIDTH)
    boss = implicit.extrude(implicit.disc(wall, _BORE_CENTER, 0.27), y - _LUG_Y, 0.19)
    solid = implicit.smooth_union(base, lug, 0.12)
    solid = np.minimum(np.minimum(solid, boss), _web(x, y, z))
    for side in (-0.66, 0.66):
        solid = np.maximum(solid, -implicit.disc(ground, (side, -0.1), 0.15))
    solid = np.maximum(solid, -implicit.disc(wall, _BORE_CENTER, 0.16))
    # The fillet also swells the underside; the cut makes it flat again.
    return np.maximum(solid, -_BASE_HALF_HEIGHT - z)


def _web(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """A triangle in the plane x = 0 that stiffens the lug, (P,)."""
    slope = (0.8 * z - 0.6 * (y + 0.5)) / np.hypot(0.8, 0.6)
    sides = [np.abs(x) - _WEB_HALF_WIDTH, slope, y - _LUG_Y, -z]
    return np.max(sides, axis=0)


def _color(points: np.ndarray) -> np.ndarray:
    """Machined faces bright, the cast rest painted, (P, 3) uint8."""
    wall = points[:, [0, 2]]
    bored = implicit.disc(wall, _BORE_CENTER, 0.275) < 0.0
    underside = points[:, 2] < -0.99 * _BASE_HALF_HEIGHT
    paint, metal = np.array([52, 112, 168]), np.array([196, 198, 202])
    return np.where((bored | underside)[:, None], metal, paint).astype(np.uint8)
