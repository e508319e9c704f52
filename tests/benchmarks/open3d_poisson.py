"""Open3D's screened Poisson, file to file: ``open3d_poisson SCAN OUT --depth 8``."""

from __future__ import annotations

import argparse

import open3d


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scan")
    parser.add_argument("out")
    parser.add_argument("--depth", type=int, default=8)
    arguments = parser.parse_args()
    cloud = open3d.io.read_point_cloud(arguments.scan)
    if not cloud.has_normals():
        cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(16))
        cloud.orient_normals_consistent_tangent_plane(16)
    mesh, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
        cloud, depth=arguments.depth
    )
    if not open3d.io.write_triangle_mesh(arguments.out, mesh):
        raise SystemExit(f"cannot write {arguments.out}")


if __name__ == "__main__":
    main()
