"""The sample scan that ships with the package, and how it was made.

``python -m visco_core.gallery`` writes it again, byte for byte.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from visco_core.gallery.octopus import octopus
from visco_core.gallery.scanner import Scanner, scan
from visco_core.pointcloud import PointCloud

_FOLDER = Path(__file__).resolve().parent.parent / "samples"


def sample_scan_path() -> Path:
    """The shipped scan: an octopus in millimeters with normals and colors, binary PLY, z up."""
    return _FOLDER / "octopus.ply"


def make_sample_scan() -> PointCloud:
    """Nine views of the octopus: five around it, one from above, three from beneath.

    Rounding to a micrometer and to 1e-4 in the normals keeps the file the same on processors whose
    sine differs in the last bit.
    """
    rings = [(5, 22.0, 0.0), (1, 75.0, 45.0), (3, -35.0, 30.0)]
    views = np.concatenate([_ring(*ring) for ring in rings])
    scanner = Scanner(
        views=views,
        resolution=210,
        points=50_000,
        noise=0.0003,
        registration_degrees=0.03,
        registration_shift=0.0002,
        colors=True,
    )
    cloud = scan(octopus(), scanner, seed=8)
    # Adding zero makes the zeros positive.
    normals = np.asarray(cloud.normals, dtype=np.float64).round(4) + 0.0
    return PointCloud(cloud.points.round(3) + 0.0, normals.astype(np.float32), cloud.colors)


def _ring(count: int, elevation: float, first: float) -> np.ndarray:
    """Directions (count, 3) around the z axis at one elevation; angles in degrees."""
    around = np.radians(first + 360.0 * np.arange(count) / count)
    above = np.radians(elevation)
    flat = np.cos(above) * np.stack([np.cos(around), np.sin(around)], axis=1)
    return np.column_stack([flat, np.full(count, np.sin(above))])
