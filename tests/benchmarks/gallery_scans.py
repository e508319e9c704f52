"""Scans that need no download, with their ground truth, laid out as the benchmarks read them."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

from visco_core import gallery
from visco_core.gallery import Scanner, scan, write_scan
from visco_core.io import write_mesh
from visco_core.pointcloud import PointCloud
from visco_core.result import Mesh

_SIZE = 40.0
_TRUTH_RESOLUTION = 250
_SCANNERS = {
    "bracket": Scanner(
        views=12, resolution=160, points=60_000, noise=0.0008, registration_degrees=0.05
    ),
    "bumpy_torus": Scanner(
        views=10, resolution=160, points=60_000, noise=0.0008, holes=6, hole_radius=0.06
    ),
}


def write_gallery(folder: Path) -> Path:
    """Writes ``scans/NAME.ply`` and ``gt/NAME_gt_mesh.ply`` under ``folder``, which it returns.

    The shipped sample, a bracket with sharp edges, and a bumpy torus whose scan has holes; all
    about 100 units long.
    """
    for part in ("scans", "gt"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    shutil.copy(gallery.sample_scan_path(), folder / "scans" / "octopus.ply")
    write_mesh(gallery.octopus().mesh(_TRUTH_RESOLUTION), folder / "gt" / "octopus_gt_mesh.ply")
    for name in _SCANNERS:
        cloud, truth = gallery_scan(name)
        write_scan(cloud, folder / "scans" / f"{name}.ply")
        write_mesh(truth, folder / "gt" / f"{name}_gt_mesh.ply")
    return folder


def gallery_scan(name: str) -> tuple[PointCloud, Mesh]:
    """What the virtual scanner sees of the ``bracket`` or the ``bumpy_torus``, and the truth."""
    shape = gallery.SHAPES[name]()
    cloud, truth = scan(shape, _SCANNERS[name]), shape.mesh(_TRUTH_RESOLUTION)
    return (
        dataclasses.replace(cloud, points=_SIZE * cloud.points),
        dataclasses.replace(truth, vertices=_SIZE * truth.vertices),
    )
