"""Normals where the scan has none: planes through neighbours, then one side for all.

Directions are the smallest principal axis of the nearest points. Signs are carried along a minimum
spanning tree of the neighbour graph whose edges cost 1 − |n·n'| (Hoppe et al., "Surface
reconstruction from unorganized points", SIGGRAPH 1992); each connected part is then turned so that
it bounds a positive volume.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import bmat, csr_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.spatial import KDTree

NEIGHBOURS = 16


def estimate_normals(points: np.ndarray) -> np.ndarray:
    """Unit outward normals (P, 3) float32 of ``points`` (P, 3)."""
    count = min(NEIGHBOURS, len(points))
    nearest = np.asarray(KDTree(points).query(points, count, workers=-1)[1])
    directions = _principal_directions(points, nearest)
    return (directions * _orientation(points, directions, nearest)[:, None]).astype(np.float32)


def _principal_directions(points: np.ndarray, nearest: np.ndarray) -> np.ndarray:
    """(P, 3) unit normals, of either sign, of the planes through each point's neighbours."""
    directions = np.empty_like(points)
    for start in range(0, len(points), 65536):
        part = slice(start, start + 65536)
        around = points[nearest[part]]
        around = around - around.mean(1, keepdims=True)
        directions[part] = np.linalg.eigh(np.einsum("pki,pkj->pij", around, around))[1][:, :, 0]
    return directions


def _orientation(points: np.ndarray, directions: np.ndarray, nearest: np.ndarray) -> np.ndarray:
    """(P,) ±1 that turn ``directions`` outward on each connected part."""
    tree = _spanning_tree(directions, nearest)
    parts, part = connected_components(tree, directed=False)
    signs = _carried_signs(tree, directions, np.unique(part, return_index=True)[1])
    centers = np.stack([np.bincount(part, p, parts) for p in points.T], 1)
    centers /= np.bincount(part, minlength=parts)[:, None]
    flux = np.einsum("pi,pi->p", directions, points - centers[part]) * signs
    return np.where(np.bincount(part, flux, parts) < 0, -1.0, 1.0)[part] * signs


def _spanning_tree(directions: np.ndarray, nearest: np.ndarray) -> csr_matrix:
    """The neighbour graph's minimum spanning forest, both ways, for the cost 1 − |n·n'|."""
    count = len(directions)
    source = np.repeat(np.arange(count), nearest.shape[1] - 1)
    target = nearest[:, 1:].ravel()
    alike = np.abs(np.einsum("pi,pi->p", directions[source], directions[target]))
    # A cost of zero would mean no edge at all.
    graph = csr_matrix((1.0001 - alike, (source, target)), shape=(count, count))
    tree = minimum_spanning_tree(graph.maximum(graph.T))
    return csr_matrix(tree + tree.T)


def _carried_signs(tree: csr_matrix, directions: np.ndarray, roots: np.ndarray) -> np.ndarray:
    """(P,) ±1 along the tree: each point agrees with its parent, each root keeps its sign."""
    count = len(directions)
    root = csr_matrix((np.ones(len(roots)), (np.zeros_like(roots), roots)), shape=(1, count))
    forest = bmat([[tree, root.T], [root, None]], format="csr")
    order, parent = breadth_first_order(forest, count, directed=False)
    below = np.append(directions, np.zeros((1, 3)), 0)
    agree = np.einsum("pi,pi->p", directions[order[1:]], below[parent[order[1:]]])
    signs = np.ones(count + 1)
    for node, up, same in zip(order[1:], parent[order[1:]], agree >= 0, strict=True):
        signs[node] = signs[up] if same else -signs[up]
    return signs[:-1]
