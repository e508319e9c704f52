"""PyMeshLab's methods, file to file: ``pymeshlab_methods poisson|apss SCAN OUT --depth 8``."""

from __future__ import annotations

import argparse

import pymeshlab


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("method", choices=["poisson", "apss"])
    parser.add_argument("scan")
    parser.add_argument("out")
    parser.add_argument("--depth", type=int, default=8)
    arguments = parser.parse_args()
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.load_new_mesh(arguments.scan)
    if not meshes.current_mesh().vertex_normal_matrix().any():
        meshes.compute_normal_for_point_clouds(k=16)
    if arguments.method == "poisson":
        meshes.generate_surface_reconstruction_screened_poisson(
            depth=arguments.depth, preclean=True
        )
    else:
        meshes.generate_marching_cubes_apss(resolution=2**arguments.depth)
    meshes.save_current_mesh(arguments.out, binary=True)


if __name__ == "__main__":
    main()
