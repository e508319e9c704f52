"""Compiled kernels of marching cubes over the band."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from visco_core.kernels.numba_cpu.common import BLOCK, corners_above


@njit(parallel=True, cache=True)
def surface_counts(values, neighbours, counts_of_case):
    n = neighbours.shape[0]
    edge_counts = np.empty(n, np.uint8)
    triangle_counts = np.empty(n, np.uint8)
    for b in prange((n + BLOCK - 1) // BLOCK):
        corners = np.empty(8, np.int32)
        for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
            inside = values[i] < 0
            edges = 0
            for axis in range(3):
                other = neighbours[i, 2 * axis + 1]
                if other < n and (values[other] < 0) != inside:
                    edges += 1
            edge_counts[i] = edges
            triangle_counts[i] = 0
            if corners_above(i, neighbours, corners):
                case = 0
                for c in range(8):
                    if values[corners[c]] < 0:
                        case |= 1 << c
                triangle_counts[i] = counts_of_case[case]
    return edge_counts, triangle_counts


@njit(parallel=True, cache=True)
def surface_vertices(values, ijk, neighbours, first_vertex):
    n = neighbours.shape[0]
    vertices = np.empty((first_vertex[-1], 3), np.float32)
    normals = np.empty((first_vertex[-1], 3), np.float32)
    for b in prange((n + BLOCK - 1) // BLOCK):
        gradient = np.empty((2, 3), np.float32)
        for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
            vertex = first_vertex[i]
            if vertex == first_vertex[i + 1]:
                continue
            for axis in range(3):
                other = neighbours[i, 2 * axis + 1]
                if other == n or (values[other] < 0) == (values[i] < 0):
                    continue
                t = values[i] / (values[i] - values[other])
                t = min(max(t, np.float32(1e-4)), np.float32(1 - 1e-4))
                for end in range(2):
                    node = i if end == 0 else other
                    for a in range(3):
                        low = neighbours[node, 2 * a]
                        high = neighbours[node, 2 * a + 1]
                        low = node if low == n else low
                        high = node if high == n else high
                        span = (high != node) + (low != node)
                        gradient[end, a] = (values[high] - values[low]) / max(span, 1)
                norm = np.float32(0)
                for a in range(3):
                    vertices[vertex, a] = ijk[i, a]
                    g = (1 - t) * gradient[0, a] + t * gradient[1, a]
                    normals[vertex, a] = g
                    norm += g * g
                vertices[vertex, axis] += t
                norm = max(np.sqrt(norm), np.float32(1e-20))
                for a in range(3):
                    normals[vertex, a] /= norm
                vertex += 1
    return vertices, normals


@njit(parallel=True, cache=True)
def surface_faces(
    values, neighbours, first_vertex, first_triangle, edges_of_case, edge_owner, edge_axis
):
    n = neighbours.shape[0]
    faces = np.empty((first_triangle[-1], 3), np.int32)
    for b in prange((n + BLOCK - 1) // BLOCK):
        corners = np.empty(8, np.int32)
        for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
            face = first_triangle[i]
            if face == first_triangle[i + 1]:
                continue
            corners_above(i, neighbours, corners)
            case = 0
            for c in range(8):
                if values[corners[c]] < 0:
                    case |= 1 << c
            for t in range(first_triangle[i + 1] - face):
                for k in range(3):
                    edge = edges_of_case[case, t, k]
                    node = corners[edge_owner[edge]]
                    vertex = first_vertex[node]
                    for axis in range(edge_axis[edge]):
                        other = neighbours[node, 2 * axis + 1]
                        if other < n and (values[other] < 0) != (values[node] < 0):
                            vertex += 1
                    faces[face + t, k] = vertex
    return faces
