"""Marching cubes over the band."""

from __future__ import annotations

import numpy as np

from visco_core.kernels.native import library


def surface_counts(values, neighbours, counts_of_case):
    n = len(neighbours)
    edges, triangles = np.empty(n, np.uint8), np.empty(n, np.uint8)
    library.surface_counts(values, neighbours, n, counts_of_case, edges, triangles)
    return edges, triangles


def surface_vertices(values, ijk, neighbours, first_vertex):
    vertices, normals = np.empty((2, first_vertex[-1], 3), np.float32)
    library.surface_vertices(
        values, ijk, neighbours, len(neighbours), first_vertex, vertices, normals
    )
    return vertices, normals


def surface_faces(
    values, neighbours, first_vertex, first_triangle, edges_of_case, edge_owner, edge_axis
):
    faces = np.empty((first_triangle[-1], 3), np.int32)
    starts = len(neighbours), first_vertex, first_triangle
    cases = edges_of_case, edges_of_case.shape[1], edge_owner, edge_axis
    library.surface_faces(values, neighbours, *starts, *cases, faces)
    return faces
