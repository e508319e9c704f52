"""What the tests of the benchmarks share."""

from __future__ import annotations

from pathlib import Path

import pytest

from visco_core import gallery
from visco_core.gallery import uniform_scan, write_scan
from visco_core.io import write_mesh


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """A folder of one scan, a ball, with its ground truth."""
    for folder in ("scans", "gt"):
        (tmp_path / folder).mkdir()
    mesh = gallery.sphere().mesh(32)
    write_scan(uniform_scan(mesh, 500), tmp_path / "scans" / "ball.ply")
    write_mesh(mesh, tmp_path / "gt" / "ball_gt_mesh.ply")
    write_mesh(gallery.sphere(1.1).mesh(32), tmp_path / "larger.ply")
    return tmp_path
