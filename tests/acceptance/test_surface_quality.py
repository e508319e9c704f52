"""Real range scans against their ground truth by the benchmark's own protocol, with defaults."""

from dataclasses import replace
from pathlib import Path

import pytest

from visco_core import Mesh, PointCloud, evaluate, read_mesh, read_points, reconstruct
from visco_core.mesh_health import mesh_health

pytestmark = pytest.mark.realdata


def surface_of(realdata: Path, name: str, *, normals: bool = True) -> tuple[PointCloud, Mesh]:
    scan = read_points(realdata / "srb" / "scans" / f"{name}.ply")
    return scan, reconstruct(scan if normals else replace(scan, normals=None)).mesh


@pytest.mark.parametrize(
    ("name", "normals", "chamfer", "hausdorff"),
    [
        ("anchor", True, 0.235, 4.0),
        ("dc", True, 0.170, 2.0),
        ("anchor", False, 0.26, None),
        ("dc", False, 0.20, None),
    ],
)
def test_a_range_scan_becomes_a_surface_as_good_as_the_paper_s(
    realdata: Path, name: str, normals: bool, chamfer: float, hausdorff: float | None
) -> None:
    _, mesh = surface_of(realdata, name, normals=normals)
    found = evaluate(mesh, read_mesh(realdata / "srb" / "gt" / f"{name}_gt_mesh.ply"))
    assert found["d_C"] <= chamfer
    assert hausdorff is None or found["d_H"] <= hausdorff
    health = mesh_health(mesh)
    assert health["watertight"]
    assert health["outward"]
    assert health["components"] == 1


def test_a_scan_without_full_ground_truth_lies_on_its_surface(realdata: Path) -> None:
    scan, mesh = surface_of(realdata, "gargoyle")
    truth = read_points(realdata / "srb" / "gt" / "gargoyle_gt_points3k.ply")
    found = evaluate(mesh, truth, scan)
    assert found["one_sided"]["scan_to_mesh"]["mean"] <= 0.11
    assert mesh_health(mesh)["watertight"]
