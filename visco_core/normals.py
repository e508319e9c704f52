"""Normals where the scan has none: planes through neighbours, then one side for all.

Directions are the smallest principal axis of the nearest points. Signs are carried along a minimum
spanning tree of the neighbour graph whose edges cost 1 − |n·n'| (Hoppe et al., "Surface
reconstruction from unorganized points", SIGGRAPH 1992); each connected part is then turned so that
it bounds a positive volume.
"""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import numpy as np
from scipy.sparse import bmat, csr_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

from visco_core.neighbours import Neighbours
from visco_core.progress import Check, attend, never

NEIGHBOURS = 16

PIECE = 65536
"""How many points are worked on between two questions whether to stop."""

EDGE_SHARES = (0.05, 0.1, 0.2, 0.3, 0.5, 0.7)
"""The spanning tree takes up the neighbour graph's edges in turn, up to each of these shares."""


def estimate_normals(points: np.ndarray, threads: int = -1, check: Check = never) -> np.ndarray:
    """Unit outward normals (P, 3) float32 of ``points`` (P, 3)."""
    count = min(NEIGHBOURS, len(points))
    nearest = Neighbours(points, threads, check).nearest(points, count)[1]
    directions = _principal_directions(points, nearest, check)
    signs = _orientation(points, directions, nearest, check)
    return (directions * signs[:, None]).astype(np.float32)


def _principal_directions(points: np.ndarray, nearest: np.ndarray, check: Check) -> np.ndarray:
    """(P, 3) unit normals, of either sign, of the planes through each point's neighbours."""
    directions = np.empty_like(points)
    for start in range(0, len(points), PIECE):
        check()
        part = slice(start, start + PIECE)
        around = points[nearest[part]]
        around = around - around.mean(1, keepdims=True)
        directions[part] = np.linalg.eigh(np.einsum("pki,pkj->pij", around, around))[1][:, :, 0]
    return directions


def _orientation(
    points: np.ndarray, directions: np.ndarray, nearest: np.ndarray, check: Check
) -> np.ndarray:
    """(P,) ±1 that turn ``directions`` outward on each connected part."""
    tree, part = _spanning_tree(directions, nearest, check)
    roots = np.unique(part, return_index=True)[1]
    parts = len(roots)
    check()
    signs = _carried_signs(tree, directions, roots, check)
    check()
    centers = np.stack([np.bincount(part, p, parts) for p in points.T], 1)
    centers /= np.bincount(part, minlength=parts)[:, None]
    flux = np.einsum("pi,pi->p", directions, points - centers[part]) * signs
    return np.where(np.bincount(part, flux, parts) < 0, -1.0, 1.0)[part] * signs


def _spanning_tree(
    directions: np.ndarray, nearest: np.ndarray, check: Check
) -> tuple[csr_matrix, np.ndarray]:
    """The neighbour graph's minimum spanning forest, both ways, and each point's tree (P,).

    An edge costs 1 − |n·n'|. The cheapest edges come first, and of the later ones only those that
    still join two trees.
    """
    count = len(directions)
    cost = np.empty((count, nearest.shape[1] - 1))
    for start in range(0, count, PIECE):
        check()
        part = slice(start, start + PIECE)
        others = directions[nearest[part, 1:]]
        # A cost of zero would mean no edge at all.
        cost[part] = 1.0001 - np.abs(np.einsum("pi,pki->pk", directions[part], others))
    tree = csr_matrix((count, count))
    group = np.arange(count)
    limits = np.quantile(cost[:: max(count // 10_000, 1)], EDGE_SHARES)
    for low, high in pairwise([-np.inf, *limits, np.inf]):
        source, target, price = _edges_between(group, nearest, cost, (low, high), check)
        tree = tree + csr_matrix((price, (source, target)), shape=(count, count))
        tree = attend(partial(minimum_spanning_tree, tree), check)
        check()
        group = connected_components(tree, directed=False)[1]
    return csr_matrix(tree + tree.T), group


def _edges_between(
    group: np.ndarray,
    nearest: np.ndarray,
    cost: np.ndarray,
    limits: tuple[float, float],
    check: Check,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Both ends and the cost of the edges that join two groups and whose cost is in ``limits``."""
    ends = []
    for start in range(0, len(cost), PIECE):
        check()
        price = cost[start : start + PIECE]
        point, neighbour = np.nonzero((price >= limits[0]) & (price < limits[1]))
        source, target = point + start, nearest[point + start, neighbour + 1]
        crossing = group[source] != group[target]
        found = source[crossing], target[crossing], price[point, neighbour][crossing]
        ends.append(found)
    source, target, price = (np.concatenate(column) for column in zip(*ends, strict=True))
    return source, target, price


def _carried_signs(
    tree: csr_matrix, directions: np.ndarray, roots: np.ndarray, check: Check
) -> np.ndarray:
    """(P,) ±1 along the tree: each point agrees with its parent, each root keeps its sign."""
    count = len(directions)
    root = csr_matrix((np.ones(len(roots)), (np.zeros_like(roots), roots)), shape=(1, count))
    forest = bmat([[tree, root.T], [root, None]], format="csr")
    check()
    order, parent = breadth_first_order(forest, count, directed=False)
    below = np.append(directions, np.zeros((1, 3)), 0)
    signs = np.ones(count + 1)
    for start in range(1, len(order), PIECE):
        check()
        nodes = order[start : start + PIECE]
        above = parent[nodes]
        agree = np.einsum("pi,pi->p", directions[nodes], below[above]) >= 0
        for node, up, same in zip(nodes, above, agree, strict=True):
            signs[node] = signs[up] if same else -signs[up]
    return signs[:-1]
