"""An octopus: something grown, with thin curled arms and deep folds between them."""

from __future__ import annotations

import numpy as np

from visco_core.gallery import implicit
from visco_core.gallery.shape import Shape

_SCALE = 40.0
_ARMS = 8
_JOINTS = 22
_WEB = 0.15
_EYES = ((0.255, -0.30, 1.03), (-0.255, -0.30, 1.03))
_EYE_RADIUS = 0.15
_SKIN, _PALE, _SPOT = np.array([[226, 98, 72], [252, 214, 186], [160, 44, 52]], dtype=np.float64)


def octopus() -> Shape:
    """An octopus about 110 units across that sits on its arms; z is up, it looks along -y."""
    arms = [_Arm(index) for index in range(_ARMS)]
    joints = np.concatenate([arm.joints for arm in arms])
    reach = np.concatenate([arm.radii for arm in arms])[:, None]
    low = (joints - reach).min(axis=0)
    high = np.maximum((joints + reach).max(axis=0), [0.0, 0.0, 1.95])
    return Shape(
        "octopus",
        lambda points: _SCALE * _sdf(points / _SCALE, arms),
        _SCALE * np.stack([low, high]),
        color=lambda points: _color(points / _SCALE, arms),
    )


class _Arm:
    """A tapering chain that swings outward, rests on the ground and curls up at its end."""

    def __init__(self, index: int) -> None:
        t = np.linspace(0.0, 1.0, _JOINTS)
        start = 2.0 * np.pi * (index + 0.5) / _ARMS
        swing = 0.75 + 0.2 * np.sin(2.4 * index)
        heading = start + swing * t**1.6 + (0.22 + 0.08 * np.cos(index)) * np.sin(2.0 * np.pi * t)
        distance = 0.2 + 1.2 * t - 0.12 * np.sin(np.pi * t) ** 2
        curl = 0.32 + 0.14 * np.cos(1.9 * index)
        lift = 0.62 * (1.0 - t) ** 2.6 + curl * np.clip((t - 0.6) / 0.4, 0.0, 1.0) ** 2.2
        self.radii = 0.058 + 0.15 * (1.0 - t) ** 1.25
        self.joints = np.stack(
            [distance * np.cos(heading), distance * np.sin(heading), lift + self.radii], axis=1
        )
        self.center = self.joints.mean(axis=0)
        self.reach = float((np.linalg.norm(self.joints - self.center, axis=1) + self.radii).max())

    def sdf(self, points: np.ndarray) -> np.ndarray:
        return implicit.chain(points, self.joints, self.radii)

    def nearest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(distance to the arm, depth below its axis in radii), each (P,)."""
        t, fine = np.arange(_JOINTS), np.linspace(0.0, _JOINTS - 1.0, 8 * _JOINTS)
        joints = np.stack([np.interp(fine, t, self.joints[:, axis]) for axis in range(3)], axis=1)
        radii = np.interp(fine, t, self.radii)
        # The squared distance less the squared radius also decides which piece of the arm is near.
        power = (points**2).sum(axis=1)[:, None] - 2.0 * points @ joints.T
        index = (power + (joints**2).sum(axis=1) - radii**2).argmin(axis=1)
        apart = np.linalg.norm(points - joints[index], axis=1) - radii[index]
        return apart, (joints[index, 2] - points[:, 2]) / radii[index]


def _sdf(points: np.ndarray, arms: list[_Arm]) -> np.ndarray:
    """Distance (P,) in units in which the animal is two high."""
    solid = _head(points)
    for arm in arms:
        beyond = implicit.sphere(points, arm.center, arm.reach)
        near = np.flatnonzero(beyond < solid + _WEB)
        solid[near] = implicit.smooth_union(solid[near], arm.sdf(points[near]), _WEB)
    for eye in _EYES:
        solid = implicit.smooth_union(solid, implicit.sphere(points, eye, _EYE_RADIUS), 0.04)
    return solid


def _head(points: np.ndarray) -> np.ndarray:
    mantle = implicit.ellipsoid(points, (0.0, 0.2, 1.38), (0.46, 0.52, 0.56))
    neck = implicit.sphere(points, (0.0, -0.03, 0.88), 0.36)
    skirt = implicit.ellipsoid(points, (0.0, 0.0, 0.58), (0.46, 0.46, 0.3))
    return implicit.smooth_union(implicit.smooth_union(mantle, neck, 0.25), skirt, 0.3)


def _color(points: np.ndarray, arms: list[_Arm]) -> np.ndarray:
    """Coral skin with dark spots, pale under the arms; white eyes with black pupils."""
    height = points[:, 2]
    waves = np.sin(9.0 * points[:, 0] + 1.3) * np.sin(8.0 * points[:, 1]) * np.sin(9.0 * height)
    spots = _ramp(waves, 0.3, 0.45) * _ramp(height, 1.05, 1.3)
    color = _SKIN + spots[:, None] * (_SPOT - _SKIN)
    color += _underside(points, arms)[:, None] * (_PALE - color)
    for eye in _EYES:
        gaze = np.asarray(eye) + _EYE_RADIUS * np.array([0.35 * np.sign(eye[0]), -0.93, 0.1])
        white = _ramp(implicit.sphere(points, eye, _EYE_RADIUS + 0.004), 0.004, 0.0)[:, None]
        pupil = _ramp(implicit.sphere(points, gaze, 0.07), 0.006, 0.0)[:, None]
        color += white * (245.0 - 221.0 * pupil - color)
    return np.rint(color).astype(np.uint8)


def _underside(points: np.ndarray, arms: list[_Arm]) -> np.ndarray:
    """How far each point lies on the lower half of the nearest arm, 0 to 1."""
    nearest = np.full(len(points), np.inf)
    depth = np.zeros(len(points))
    for arm in arms:
        apart, below = arm.nearest(points)
        closer = apart < nearest
        nearest[closer] = apart[closer]
        depth[closer] = below[closer]
    return _ramp(depth, 0.2, 0.5)


def _ramp(values: np.ndarray, low: float, high: float) -> np.ndarray:
    return np.clip((values - low) / (high - low), 0.0, 1.0)
