"""Which side of a scan without normals is outside.

The points are grouped into patches whose directions agree (König, Gumhold, "Consistent propagation
of normal orientations in point clouds", VMV 2009, for what agreeing means), and one side is chosen
for each patch. On the surface of a closed body the winding number is ½ (Barill et al., "Fast
winding numbers for soups and clouds", SIGGRAPH 2018); the sides s = ±1 are those that come nearest
to it, as in Lin et al., "Surface reconstruction from point clouds without normals by parametrizing
the Gauss formula" (TOG 2022), with a patch as the unknown in place of a point:

    min Σ_i a_i (½ − f Σ_j W_ij s_j)² + Σ_ij c_ij (s_i − s_j)²/2

W_ij is the winding number that patch j's own side gives on patch i, a_i patch i's share of the
points, c_ij how surely patches i and j continue one another, and f how much the areas are misjudged
where the noise spreads the points. Parallel walls, cavities and separate bodies need no rule.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.linalg import LinearOperator, cg

from visco_core.facing import CLOSED, DENSITIES, OPEN, SOFTENING, disc_areas, side_agreement
from visco_core.neighbours import Neighbours
from visco_core.progress import Check, never

SITES = 30_000
"""So many points stand for all others in the grouping."""

SOURCES = 60_000
"""So many points are asked which points continue the surface around them."""

PATCHES = 1000
SAMPLES = 5000
"""Points that the winding numbers are summed over."""

NEIGHBOURS = 16

NEAR_SITES = 4
"""A point joins one of so many nearest sites: the one that lies in its plane."""

CHAIN = 1e-9
"""Weight of the link from each site to the next one; it only limits the number of patches."""

HOLDS = (1.0, 0.1)
"""How firmly patches are held to their neighbours, which mislead where a wall is thinner than its
points are apart."""

CLEARLY = 0.4
"""Looser holds win where they leave less than this of the misfit: a fifth between close walls, half
where they bend an open surface to close itself."""

OUTVOTED = 0.3
"""A point whose neighbours speak against its side with more than this share of what they can say
turns; those that contradict each other say too little."""

VOTES = 2
"""How often the points are asked, each time of the sides that the last vote left."""

RIDGE = 1e-3
"""Share of the mean eigenvalue that pulls towards the grouping's own sides."""

PIECE = 65536
"""How many points are worked on between two questions whether to stop."""


def outward_signs(
    points: np.ndarray,
    directions: np.ndarray,
    chosen: np.ndarray,
    neighbours: Neighbours,
    threads: int = -1,
    check: Check = never,
) -> np.ndarray:
    """(P,) ±1 that turn the unit ``directions`` (P, 3) at ``points`` (P, 3) outward.

    Whose surface goes on where is asked of the ``neighbours`` among ``points[chosen]`` (C,), which
    are few enough that the noise does not mix them up.
    """
    random = np.random.default_rng(0)
    shuffled = random.permutation(len(points))
    sites, sources = np.sort(shuffled[:SITES]), np.sort(shuffled[:SOURCES])
    site, signs = _joined(points, directions, sites, threads, check)
    around = chosen[neighbours.nearest(points[sources], min(NEIGHBOURS, len(chosen)))[1]]
    source, target = np.repeat(sources, around.shape[1]), around.ravel()
    apart = source != target
    source, target = source[apart], target[apart]
    check()
    grouping, agreement = side_agreement(points, directions, source, target)
    check()
    patch_of_site, turn = _grouped(
        np.append(site[source], np.arange(len(sites) - 1)),
        np.append(site[target], np.arange(1, len(sites))),
        np.append(
            grouping * signs[source] * signs[target],
            CHAIN * np.einsum("si,si->s", directions[sites[:-1]], directions[sites[1:]]),
        ),
        len(sites),
        PATCHES,
        check,
    )
    patch, signs = patch_of_site[site], signs * turn[site]
    count = patch_of_site.max() + 1
    coupling = _coupling(
        patch[source] * count + patch[target], agreement * signs[source] * signs[target], count
    )
    check()
    # Every site is a source, so no patch is without.
    area = disc_areas(points, directions, sources, around)
    area = np.bincount(patch[sources], area, count) / np.bincount(patch[sources], minlength=count)
    shares = np.bincount(patch, minlength=count) / len(points)
    picked = random.permutation(sources)[:SAMPLES]
    picked = np.union1d(picked, sources[np.unique(patch[sources], return_index=True)[1]])
    picked = picked[np.argsort(patch[picked], kind="stable")]
    sampled = np.bincount(patch[picked], minlength=count)
    # What a sample stands for: its patch's area, shared by the patch's samples.
    area = (area * shares * len(chosen) / sampled)[patch[picked]]
    oriented = directions[picked] * signs[picked, None]
    winding = _winding(points[picked], oriented, area, sampled, check)
    facing = np.add.reduceat(oriented * area[:, None], np.append(0, np.cumsum(sampled)[:-1]))
    signs = signs * _sides(winding, coupling, shares, facing / area.sum(), check)[patch]
    return _voted(signs, source, target, agreement)


def _joined(
    points: np.ndarray, directions: np.ndarray, sites: np.ndarray, threads: int, check: Check
) -> tuple[np.ndarray, np.ndarray]:
    """Each point's site (P,) and the sign (P,) that turns it to the site's side."""
    count, near = len(points), min(NEAR_SITES, len(sites))
    site, signs = np.empty(count, np.int64), np.empty(count)
    among_sites = Neighbours(points[sites], threads, check)
    for start in range(0, count, PIECE):
        check()
        part = np.arange(start, min(start + PIECE, count))
        around = among_sites.nearest(points[part], near)[1]
        agreement = side_agreement(
            points, directions, np.repeat(part, near), sites[around].ravel()
        )[0]
        agreement = agreement.reshape(-1, near)
        best = np.abs(agreement).argmax(1)[:, None]
        site[part] = np.take_along_axis(around, best, 1)[:, 0]
        signs[part] = np.where(np.take_along_axis(agreement, best, 1)[:, 0] < 0, -1.0, 1.0)
    site[sites], signs[sites] = np.arange(len(sites)), 1.0
    return site, signs


def _coupling(pair: np.ndarray, agreement: np.ndarray, count: int) -> np.ndarray:
    """c (count, count): the agreement between patches, of both signs, a sum of 1 if all were sure.

    ``pair`` (E,) is one patch times ``count`` plus the other. What contradicts itself counts less.
    """
    both = np.bincount(pair, agreement, count**2).reshape(count, count)
    sure = np.bincount(pair, np.abs(agreement), count**2).reshape(count, count)
    both, sure = both + both.T, sure + sure.T
    np.fill_diagonal(both, 0)
    np.fill_diagonal(sure, 0)
    return both * np.abs(both) / np.maximum(sure, 1e-300) / max(sure.sum(), 1e-300)


def _grouped(
    first: np.ndarray, second: np.ndarray, link: np.ndarray, count: int, limit: int, check: Check
) -> tuple[np.ndarray, np.ndarray]:
    """At most ``limit`` groups of ``count`` items, as far as links (E,) reach, and signs (count,).

    Each item joins the one it has the strongest link to, then each group (Borůvka's rounds); links
    between the same two groups are summed, and a negative sum joins them with opposite signs.
    """
    group, signs, size = np.arange(count), np.ones(count), np.ones(count)
    ends = np.append(first, second), np.append(second, first)
    links = csr_array((np.append(link, link), ends), shape=(count, count))
    links.setdiag(0)
    links.eliminate_zeros()
    while len(size) > limit:
        check()
        into, turn = _joined_groups(links, size, len(size) - limit)
        if into.max() + 1 == len(size):
            break
        signs *= turn[group]
        group = into[group]
        size = np.bincount(into, size)
        flat = links.tocoo()
        row, column = into[flat.row], into[flat.col]
        between = row != column
        summed = (flat.data * turn[flat.row] * turn[flat.col])[between]
        ends = row[between], column[between]
        links = coo_array((summed, ends), shape=(len(size),) * 2).tocsr()
    return group, signs


def _joined_groups(links: csr_array, size: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """One round: each group's new one (N,) and sign (N,); ``most`` may join, small ones first."""
    count, degree = len(size), np.diff(links.indptr)
    strength = np.abs(links.data)
    linked = degree > 0
    peak = np.zeros(count)
    peak[linked] = np.maximum.reduceat(strength, links.indptr[:-1][linked])
    row = np.repeat(np.arange(count), degree)
    strongest = np.flatnonzero((strength == peak[row]) & (strength > 0))
    item, once = np.unique(row[strongest], return_index=True)
    strongest = strongest[once]
    partner = links.indices[strongest]
    # Only upwards in strength, and among equals downwards in number: no rings.
    rank = peak[partner] - peak[item]
    upward = (rank > 0) | ((rank == 0) & (partner < item))
    item, partner, strongest = item[upward], partner[upward], strongest[upward]
    chosen = np.argsort(size[item], kind="stable")[:most]
    item, partner, strongest = item[chosen], partner[chosen], strongest[chosen]
    parent, turn = np.arange(count), np.ones(count)
    parent[item] = partner
    turn[item] = np.where(links.data[strongest] < 0, -1.0, 1.0)
    while (parent[parent] != parent).any():
        turn *= turn[parent]
        parent = parent[parent]
    return np.unique(parent, return_inverse=True)[1], turn


def _winding(
    points: np.ndarray, normals: np.ndarray, area: np.ndarray, sampled: np.ndarray, check: Check
) -> np.ndarray:
    """W (count, count): the winding number that patch j gives on patch i, a mean over its samples.

    The samples (S, 3) come patch by patch, ``sampled`` (count,) of each, with their ``area`` (S,).
    """
    first = np.append(0, np.cumsum(sampled)[:-1])
    softening = np.float32(SOFTENING**2 * np.median(area))
    places = points.astype(np.float32)
    pull = (normals * area[:, None] / (4 * np.pi)).astype(np.float32)
    own = np.einsum("si,si->s", pull, places)
    square = np.einsum("si,si->s", places, places)
    rows = np.empty((len(points), len(sampled)), np.float32)
    for start in range(0, len(points), 256):
        check()
        part = slice(start, start + 256)
        # einsum, since a BLAS that starts threads for products this thin mostly waits for them.
        product = np.einsum("qi,si->qs", places[part], places)
        distance = square[part, None] + square - 2 * product + softening
        distance = np.maximum(distance, softening)
        shown = own - np.einsum("qi,si->qs", places[part], pull)
        shown /= distance * np.sqrt(distance)
        rows[part] = np.add.reduceat(shown, first, axis=1)
    return np.add.reduceat(rows.astype(float), first, axis=0) / sampled[:, None]


def _sides(
    winding: np.ndarray,
    coupling: np.ndarray,
    shares: np.ndarray,
    facing: np.ndarray,
    check: Check,
) -> np.ndarray:
    """s (count,) ±1 of each patch, nearest to a winding number of ½ on all of them.

    First only whole parts of the scan may turn, a part being what the coupling connects; then each
    patch may. The second answer holds where it is nearer, and near enough for a closed surface,
    whose normals have a mean of 0; ``facing`` (count, 3) is what each patch adds to it.
    """
    count = len(shares)
    links = coo_array(coupling)
    part, grouped = _grouped(links.row, links.col, links.data, count, 1, check)
    parts = np.zeros((count, part.max() + 1))
    parts[np.arange(count), part] = grouped

    def nearest(
        basis: np.ndarray, smooth: np.ndarray, start: np.ndarray
    ) -> tuple[float, float, np.ndarray]:
        """The smallest misfit over the densities, the density, and its sides."""
        shown = winding @ basis
        ridge = RIDGE * (shares @ np.square(shown)).mean() + 1e-12
        answers = []
        for density in DENSITIES:
            check()
            system = _System(density * shown, density**2 * ridge, shares, smooth)
            sides = basis @ system.solved(0.5, start)
            sides = np.where(sides == 0, grouped, np.where(sides < 0, -1.0, 1.0))
            misfit = shares @ np.square(0.5 - density * _times(winding, sides))
            answers.append((float(misfit), density, sides))
        return min(answers, key=lambda answer: answer[:2])

    whole = nearest(parts, np.zeros((parts.shape[1],) * 2), np.zeros(parts.shape[1]))
    smooth = np.diag(np.abs(coupling).sum(1)) - coupling
    free, *looser = (nearest(np.eye(count), hold * smooth, grouped) for hold in HOLDS)
    for other in looser:
        free = other if other[0] < CLEARLY * free[0] else free
    opening = float(np.linalg.norm(free[2] @ facing))
    return free[2] if free[0] < min(CLOSED, whole[0]) and opening < OPEN else whole[2]


def _voted(
    signs: np.ndarray, source: np.ndarray, target: np.ndarray, agreement: np.ndarray
) -> np.ndarray:
    """``signs`` (P,) ±1, less those that neighbours clearly contradict; agreement (E,) of edges.

    Patches turn as a whole, but between close walls a few points have joined the other wall's, and
    each of them opens a gap in a wall that few points hold.
    """
    most = OUTVOTED * np.bincount(source, np.abs(agreement), len(signs))
    for _ in range(VOTES):
        support = signs * np.bincount(source, agreement * signs[target], len(signs))
        signs = np.where(support < -most, -signs, signs)
    return signs


@dataclass(frozen=True)
class _System:
    """min Σ_i a_i (w − A s)_i² + ridge ‖s − start‖² + s·L s."""

    matrix: np.ndarray
    ridge: float
    shares: np.ndarray
    smooth: np.ndarray

    def solved(self, winding: float, start: np.ndarray) -> np.ndarray:
        """s, to a thousandth: only its signs matter. Conjugate gradients, some 20 iterations."""
        size = self.matrix.shape[1]
        diagonal = self.shares @ np.square(self.matrix) + self.ridge + np.diag(self.smooth)
        right = _times(self.matrix.T, winding * self.shares) + self.ridge * start
        return cg(
            LinearOperator((size, size), self._applied),
            right,
            rtol=1e-3,
            maxiter=200,
            M=LinearOperator((size, size), lambda v: v.ravel() / diagonal),
        )[0]

    def _applied(self, sides: np.ndarray) -> np.ndarray:
        fitted = _times(self.matrix.T, self.shares * _times(self.matrix, sides.ravel()))
        return fitted + self.ridge * sides.ravel() + _times(self.smooth, sides.ravel())


def _times(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """matrix · vector without BLAS, whose threads wait long for each other on a busy machine."""
    return np.einsum("ij,j->i", matrix, vector)
