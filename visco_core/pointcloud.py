"""The scan as arrays, and the frame in which it is solved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from visco_core.errors import InputError


@dataclass(frozen=True)
class PointCloud:
    """A scan in its own frame and units.

    points (P, 3) float64; normals (P, 3) float32, pointing out of the solid, or None;
    colors (P, 3) uint8 or None; scalars: name -> (P,) float32, further values a point.
    """

    points: np.ndarray
    normals: np.ndarray | None = None
    colors: np.ndarray | None = None
    scalars: Mapping[str, np.ndarray] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.points)

    def select(self, index: np.ndarray) -> PointCloud:
        """The points at ``index``: a (P,) bool mask or (K,) integers."""
        return PointCloud(
            self.points[index],
            None if self.normals is None else self.normals[index],
            None if self.colors is None else self.colors[index],
            {name: values[index] for name, values in self.scalars.items()},
        )

    def crop(self, box: Sequence[float]) -> PointCloud:
        """The points inside ``box``: x0, y0, z0, x1, y1, z1 in scan units, faces included.

        Raises InputError (``empty_crop``) where none is.
        """
        low, high = np.asarray(box, np.float64).reshape(2, 3)
        inside = np.all((self.points >= low) & (self.points <= high), axis=1)
        if not inside.any():
            corners = [np.nanmin(self.points, axis=0), np.nanmax(self.points, axis=0)]
            spans = ", ".join(f"{a:g} to {b:g}" for a, b in zip(*corners, strict=True))
            raise InputError(
                "empty_crop",
                f"The crop box holds no point; the scan spans {spans} in x, y, z.",
            )
        return self.select(inside)
