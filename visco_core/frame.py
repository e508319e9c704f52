"""The frame in which a scan is solved: the unit cube, reached by a float64 shift and scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FILL = 0.9
"""Share of the cube that the scan's longest side takes; the rest is room around the surface."""


@dataclass(frozen=True)
class Normalisation:
    """cube = (scan − center) / scale + ½, with center (3,) and scale in scan units, float64."""

    center: np.ndarray
    scale: float

    @classmethod
    def of(cls, points: np.ndarray) -> Normalisation:
        """Centres the bounding box of ``points`` (P, 3); its longest side becomes FILL."""
        low, high = points.min(0), points.max(0)
        return cls(low + (high - low) / 2, float((high - low).max()) / FILL)

    def to_cube(self, points: np.ndarray) -> np.ndarray:
        return (points - self.center) / self.scale + 0.5

    def to_scan(self, points: np.ndarray) -> np.ndarray:
        return (points - 0.5) * self.scale + self.center
