"""Normals at the rims of what was scanned, where planes through neighbours lean.

A plane fitted to a point's neighbours has the surface's normal at their middle. Beside a hole, an
occlusion or a crease the neighbours lie on one side, so there every such normal is the one from
some way inside, and the surface is led into the hole at a wrong angle. A quadric follows the
surface up to its rim.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from visco_core.facing import nearest_axis
from visco_core.neighbours import Neighbours
from visco_core.progress import Check, never
from visco_core.quadrics import fit, quadratic_terms

NEIGHBOURS = 128
"""Points that a quadric is fitted through: beside the holes of scans that were put together from
views, fewer tell of how the views differ."""

POINTS = 100_000
"""Neighbours in a larger scan are looked for among so many, so that quadrics still span some of the
coarsest level's voxels."""

ONE_SIDED = 0.2
"""How far from a patch the middle of its neighbours lies at a rim, over their reach; weighted by
their nearness it is 0.34 right at a straight one."""

THINNED, PERHAPS = 4, 0.15
"""One point in so many is looked at first, and the patches so one-sided among these are looked at
again among all: one in six, with 97 of 100 rims."""

SAME_FACE = 0.5
"""Least cosine between the normals of points on the same side of a crease or wall."""

FEWEST = 12
"""Points of the same face that tell twice over what a quadric's six terms are."""

SAMPLES, PLANES = 400, range(6, 41)
"""Points whose normals are compared with planes, and neighbours that planes are tried through."""

APART, AS_ONE = 0.01, 0.1
"""Least angle, in radians, by which a plane and one of double size differ where they can tell
something, and the share of it within which a normal is the plane's."""

PIECE = 2**11


def are_planes(
    points: np.ndarray, normals: np.ndarray, threads: int = -1, check: Check = never
) -> bool:
    """Whether unit normals (P, 3) were made by fitting planes to neighbours in ``points`` (P, 3).

    Such normals say nothing that the points do not, so they may be replaced; a scanner's own may
    not. Where planes of every size agree, on exact faces, nothing can be told.
    """
    if len(points) < 2 * PLANES.stop:
        return False
    step = max(len(points) // SAMPLES, 1)
    near = Neighbours(points, threads, check).nearest(points[::step], 2 * PLANES.stop)[1]
    around, given = points[near], normals[::step].astype(np.float64)
    for count in PLANES:
        check()
        plane, wider = _plane(around[:, :count]), _plane(around[:, : 2 * count])
        apart, usual = _sine(given, plane), _sine(plane, wider)
        telling = usual > APART
        if telling.mean() > AS_ONE and np.median(apart[telling] / usual[telling]) < AS_ONE:
            return True
    return False


def _plane(around: np.ndarray) -> np.ndarray:
    """Unit normals (S, 3), of either sign, of the planes through S neighbourhoods (S, K, 3)."""
    away = around - around.mean(1, keepdims=True)
    return np.linalg.eigh(np.einsum("ski,skj->sij", away, away))[1][:, :, 0]


def _sine(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.cross(one, other), axis=1)


def straighten_rims(
    points: np.ndarray, normals: np.ndarray, threads: int = -1, check: Check = never
) -> np.ndarray:
    """``normals`` (P, 3) float32, unit, those at rims of ``points`` (P, 3) replaced by quadrics'.

    A small patch is at a rim if the middle of its neighbours of the same face lies to one side.
    """
    among = np.arange(len(points))
    if len(points) > POINTS:
        among = np.sort(np.random.default_rng(0).choice(len(points), POINTS, replace=False))
    patch, middle, facing = _patches(points, normals, check)

    def seen(patches: np.ndarray, thinned: int) -> Iterator[_Around]:
        chosen = among[::thinned]
        look_up, count = Neighbours(points[chosen], threads, check), NEIGHBOURS // thinned
        for start in range(0, len(patches) or 1, PIECE):
            check()
            part = patches[start : start + PIECE]
            near = chosen[look_up.nearest(middle[part], min(count, len(chosen)))[1]]
            yield _Around.of(points[near] - middle[part, None], normals[near], facing[part])

    rims = np.arange(len(middle))
    rims = rims[np.concatenate([each.one_sided > PERHAPS for each in seen(rims, THINNED)])]
    there, frames, fits = zip(*[_quadrics(each) for each in seen(rims, 1)], strict=True)
    quadrics = np.concatenate(frames), np.concatenate(fits)
    check()
    return _along_quadrics(points, normals, patch, middle, rims[np.concatenate(there)], *quadrics)


def _patches(
    points: np.ndarray, normals: np.ndarray, check: Check
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of a cell that face the same of six axes: the patch (P,) of each, middles, normals.

    A cell holds some 20 points of a surface, or more where it would be finer than the coarsest
    level's voxels. Middles (G, 3); unit normals (G, 3).
    """
    side = int(np.clip(np.sqrt(len(points) / 20), 4, 64))
    scaled = (points - points.min(0)) / np.ptp(points, axis=0).max() * side
    cell = np.minimum(scaled.astype(np.int64), side - 1)
    key = np.ravel_multi_index((*cell.T, nearest_axis(normals)), (side, side, side, 6))
    check()
    used = np.bincount(key, minlength=6 * side**3)
    patch = (np.cumsum(used > 0) - 1)[key]
    check()
    counts = used[used > 0]
    middle = np.stack([np.bincount(patch, values) / counts for values in points.T], 1)
    check()
    facing = np.stack([np.bincount(patch, values) for values in normals.T], 1)
    return patch, middle, facing / np.linalg.norm(facing, axis=1, keepdims=True)


@dataclass(frozen=True)
class _Around:
    """The K neighbours of S patches: where they lie, seen from the middles, and their normals.

    away, normals (S, K, 3); weight (S, K), 0 for those of another face; reach (S,): the distance of
    the farthest of the same face; one_sided (S,): that of their weighted middle, over the reach.
    """

    away: np.ndarray
    normals: np.ndarray
    weight: np.ndarray
    reach: np.ndarray
    one_sided: np.ndarray

    @classmethod
    def of(cls, away: np.ndarray, normals: np.ndarray, facing: np.ndarray) -> _Around:
        same = np.einsum("ski,si->sk", normals, facing) > SAME_FACE
        squared = np.einsum("ski,ski->sk", away, away)
        reach = np.max(squared * same, axis=1, initial=1e-30)
        weight = same * (1 - np.minimum(squared / reach[:, None], 1))
        aside = np.einsum("sk,ski->si", weight, away) / np.maximum(weight.sum(1), 1e-9)[:, None]
        aside -= np.einsum("si,si->s", aside, facing)[:, None] * facing
        reach = np.sqrt(reach)
        return cls(away, normals, weight, reach, np.linalg.norm(aside, axis=1) / reach)


def _quadrics(around: _Around) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which of the patches are at rims (S,), the frames of these (R, 3, 3), and quadrics (R, 6).

    The columns of a frame are two tangents and the normal; a quadric is its height over 1, x, y,
    x², xy and y².
    """
    there = (around.one_sided > ONE_SIDED) & ((around.weight > 0).sum(1) >= FEWEST)
    away, weight, reach = around.away[there], around.weight[there], around.reach[there]
    up = np.einsum("sk,ski->si", weight, around.normals[there])
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    right = np.cross(up, np.eye(3)[np.abs(up).argmin(1)])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    frame = np.stack([right, np.cross(up, right), up], 2)
    x, y, z = np.moveaxis(away @ frame / reach[:, None, None], 2, 0)
    fitted = fit(z[..., None], quadratic_terms(x, y), weight)[..., 0]
    fitted[:, 3:] /= reach[:, None]
    return there, frame, fitted


def _along_quadrics(
    points: np.ndarray,
    normals: np.ndarray,
    patch: np.ndarray,
    middle: np.ndarray,
    rims: np.ndarray,
    frames: np.ndarray,
    fits: np.ndarray,
) -> np.ndarray:
    """``normals``, but on the patches ``rims`` (R,) those of the patch's quadric at each point."""
    order = np.full(len(middle), -1)
    order[rims] = np.arange(len(rims))
    changed = np.flatnonzero(order[patch] >= 0)
    quadric = order[patch[changed]]
    frame, (_, a, b, aa, ab, bb) = frames[quadric], fits[quadric].T
    place = np.einsum("pi,pij->jp", points[changed] - middle[patch[changed]], frame)
    slope = [-a - 2 * aa * place[0] - ab * place[1], -b - ab * place[0] - 2 * bb * place[1]]
    upward = np.einsum("pij,jp->pi", frame, np.stack([*slope, np.ones_like(a)]))
    straight = normals.copy()
    straight[changed] = upward / np.linalg.norm(upward, axis=1, keepdims=True)
    return straight
