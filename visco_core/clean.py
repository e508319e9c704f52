"""Takes out of a scan what no surface can be made of, and says so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from visco_core.box_sum import box_sum
from visco_core.equal_rows import first_of_equals
from visco_core.errors import InputError
from visco_core.pointcloud import PointCloud
from visco_core.progress import Check, never
from visco_core.sides import wrong_sides

_STRAY_SHARE = 0.01
_STRAY_DISTANCE = 10.0
_LEAST_POINTS_FOR_STRAYS = 20
_LEAST_BODY = 10
_BODY_SHARE = 1e-4
_THINNEST = 1e-6
_LARGEST = 1e100
_BAD_NORMALS_TOLERATED = 0.5

_LONELY, _FEWEST_LONELY, _MOSTLY_OFF = 0.15, 5, 0.9
_NEIGHBOURS = 12
_FAR, _OFF_SURFACE = 1.5, 0.3
_APART, _TOGETHER = 16.0, 36
_ROUNDS = 10


@dataclass(frozen=True)
class CleaningReport:
    """How many points there were, how many are left, and what became of the others.

    ``filled_normals`` were missing and taken from the nearest point that has one;
    ``rescaled_normals`` were more than one percent longer or shorter than 1;
    ``turned_normals`` pointed to the wrong side; ``dropped_normals``: so many were missing that all
    were left out.
    """

    read: int
    kept: int
    not_finite: int = 0
    duplicates: int = 0
    outliers: int = 0
    scattered: int = 0
    filled_normals: int = 0
    rescaled_normals: int = 0
    turned_normals: int = 0
    dropped_normals: bool = False

    @property
    def sentences(self) -> list[str]:
        """What was done, for people; empty where the scan was clean."""
        told = {
            "Points dropped for coordinates that are not finite": self.not_finite,
            "Exact duplicates merged": self.duplicates,
            "Stray points dropped, far from all others": self.outliers,
            "Points dropped between surfaces, on none of them": self.scattered,
            "Missing normals taken from the nearest point": self.filled_normals,
            "Normals scaled to unit length": self.rescaled_normals,
        }
        sentences = [
            f"{what}: {count:,} of {self.read:,}." for what, count in told.items() if count
        ]
        if self.turned_normals:
            sentences.append(
                f"Normals turned that pointed to the wrong side: {self.turned_normals:,} of "
                f"{self.read:,}; normals=keep leaves them as they are."
            )
        if self.dropped_normals:
            sentences.append("Most normals are zero or not finite, so all were left out.")
        return sentences


def clean_points(
    cloud: PointCloud,
    *,
    normals: Literal["use", "keep", "estimate", "ignore"] = "use",
    threads: int = -1,
    check: Check = never,
) -> tuple[PointCloud, CleaningReport]:
    """The points that a surface can be made of, in their order, with unit normals or none.

    Drops points that are not finite (or beyond 1e100), merges exact duplicates (normals are added
    up, the first colour and scalars stay) and drops what ``find_strays`` and ``find_scattered``
    find. Coordinates are never changed. Missing normals, zero or not
    finite, are taken from the nearest point that has one; if more than half are missing, all are
    left out, as they are where ``normals`` is ``estimate`` or ``ignore``. ``use`` turns those that
    ``wrong_sides`` finds.

    Raises InputError: ``no_points`` where no point is finite, ``too_few_points`` below four
    distinct ones, ``collinear_points`` where all lie on one line.
    """
    read = len(cloud)
    finite = np.all(np.abs(cloud.points) <= _LARGEST, axis=1)
    if not finite.all():
        cloud = cloud.select(finite)
    if not len(cloud):
        raise InputError(
            "no_points", "No point of the scan has finite coordinates; export the scan again."
        )
    if normals not in ("use", "keep") or cloud.normals is None:
        cloud, lengths = _with_normals(cloud, None), None
    else:
        cloud, lengths = _with_finite_normals(cloud, cloud.normals)
    rescaled = 0 if lengths is None else int(((lengths > 0) & (abs(lengths - 1) > 0.01)).sum())

    check()
    distinct = merge_duplicates(cloud)
    check()
    strays = find_strays(distinct.points)
    check()
    kept = distinct.select(~strays) if strays.any() else distinct
    _require_surface(kept.points)
    check()
    kept, filled = _unit_normals(kept, threads, check)
    between = find_scattered(kept.points, kept.normals, threads, check)
    scattered = int(between.sum())
    kept = kept.select(~between) if scattered else kept
    turned = 0
    if normals == "use" and kept.normals is not None:
        wrong = wrong_sides(kept.points, kept.normals, threads, check)
        turned = int(wrong.sum())
        if turned:
            kept = _with_normals(kept, np.where(wrong[:, None], -kept.normals, kept.normals))
    report = CleaningReport(
        read=read,
        kept=len(kept),
        not_finite=read - len(cloud),
        duplicates=len(cloud) - len(distinct),
        outliers=int(strays.sum()),
        scattered=scattered,
        filled_normals=filled,
        rescaled_normals=rescaled if kept.normals is not None else 0,
        turned_normals=turned,
        dropped_normals=cloud.normals is not None and kept.normals is None,
    )
    return kept, report


def merge_duplicates(cloud: PointCloud) -> PointCloud:
    """Each position once, at its first place in the order; the normals of equals are added up."""
    found = first_of_equals(cloud.points)
    if found is None:
        return cloud
    first, group = found
    merged = cloud.select(first)
    if cloud.normals is None:
        return merged
    sums = [np.bincount(group, cloud.normals[:, axis], len(first)) for axis in range(3)]
    return _with_normals(merged, np.stack(sums, axis=1).astype(np.float32))


def find_strays(points: np.ndarray) -> np.ndarray:
    """(P,) bool: far, lonely points that would only blow up the bounding box.

    points (P, 3), finite and distinct. Distances are largest coordinate differences. Let r be the
    distance from the median within which 99 % of the points lie (all but one, below 200). A point
    is a stray if it is farther than 10 r and has no body around it: points that far are put into
    cells of size r, and touching cells that together hold 10 of them, or 0.01 % of the scan if that
    is more, are a body and stay, however far away. Below 20 points nothing is a stray.
    """
    strays = np.zeros(len(points), bool)
    far, middle, radius = _far_away(points)
    if len(far):
        with np.errstate(over="ignore"):
            cells = np.floor(np.clip((points[far] - middle) / radius, -1e15, 1e15))
        sizes = _group_sizes(cells.astype(np.int64))
        strays[far] = sizes < max(_LEAST_BODY, _BODY_SHARE * len(points))
    return strays


def _far_away(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Indices of the points farther than 10 r from the median, the median (3,), and r."""
    count, middle = len(points), np.median(points, axis=0)
    none = np.empty(0, np.int64)
    if count < _LEAST_POINTS_FOR_STRAYS:
        return none, middle, 0.0
    with np.errstate(over="ignore"):
        distances = np.abs(points[:, 0] - middle[0])
        for axis in (1, 2):
            np.maximum(distances, np.abs(points[:, axis] - middle[axis]), out=distances)
    inner = count - 1 - max(1, int(_STRAY_SHARE * count))
    radius = float(np.partition(distances, inner)[inner])
    with np.errstate(over="ignore"):
        far = np.flatnonzero(distances > _STRAY_DISTANCE * radius)
    return (far if radius > 0 else none), middle, radius


def find_scattered(
    points: np.ndarray,
    normals: np.ndarray | None = None,
    threads: int = -1,
    check: Check = never,
) -> np.ndarray:
    """(P,) bool: points in the space between surfaces, where a scanner's noise has put them.

    points (P, 3), finite and distinct; normals (P, 3), unit, of either side, or None for those of
    planes through neighbours. A point is off the surface if half of its 12 nearest lie more than
    17° (sine 0.3) off its own plane, or it off theirs. Scans are left alone unless five points or
    more lie in lonely places, which coarse cells tell, and nine in ten of these are off the
    surface: elsewhere the scan is only sparse. (Once some are found, one lonely point is enough to
    go on.) Then all points go that are 1.5 times farther from
    their 12 nearest than is usual, and off, or 16 times farther than one of 36 nearest is from its
    own: fewer together are no surface. What is left is looked at again while that finds more, up
    to ten times in all: among many such points some look like a surface until the others are gone.
    A body so far away that ``find_strays`` has judged it is left alone.
    """
    scattered = np.zeros(len(points), bool)
    bodies = _far_away(points)[0]
    for _ in range(_ROUNDS):
        kept = np.flatnonzero(~scattered)
        known = bool(scattered.any())
        left = None if normals is None else normals[kept]
        found = _off_and_far(points[kept], left, known, threads, check)
        if not len(found):
            break
        scattered[kept[found]] = True
        scattered[bodies] = False
    return scattered


def _off_and_far(
    points: np.ndarray, normals: np.ndarray | None, known: bool, threads: int, check: Check
) -> np.ndarray:
    """Indices of what one look finds; ``known``: the scan has such points, an earlier one found."""
    none = np.empty(0, np.int64)
    if len(points) <= _NEIGHBOURS:
        return none
    around = _count_around(points)
    lonely = np.flatnonzero(around < _LONELY * np.median(around))
    if len(lonely) < (1 if known else _FEWEST_LONELY):
        return none
    from visco_core.neighbours import Neighbours

    look_up = Neighbours(points, threads, check)
    planes = _planes(points, normals, threads, check)

    def off_surface(chosen: np.ndarray) -> np.ndarray:
        distance, near = (
            found[:, 1:] for found in look_up.nearest(points[chosen], _NEIGHBOURS + 1)
        )
        offset = points[near] - points[chosen, None]
        both = planes(np.column_stack([near, chosen]))
        sines = [
            np.abs((offset * plane).sum(2)) / distance for plane in (both[:, :-1], both[:, -1:])
        ]
        return np.max([np.median(sine, axis=1) for sine in sines], axis=0) > _OFF_SURFACE

    if not known and off_surface(lonely).mean() <= _MOSTLY_OFF:
        return none
    reach = look_up.nearest(points, _NEIGHBOURS + 1)[0][:, -1]
    far = np.flatnonzero(reach > _FAR * np.median(reach))
    near = look_up.nearest(points[far], min(_TOGETHER, len(points)))[1]
    apart = reach[near].min(1) < reach[far] / _APART
    return far[off_surface(far) | apart]


def _planes(
    points: np.ndarray, normals: np.ndarray | None, threads: int, check: Check
) -> Callable[[np.ndarray], np.ndarray]:
    """What gives the planes' normals (..., 3) of points by their indices, estimated if need be."""
    if normals is not None:
        return lambda indices: normals[indices]
    from visco_core.normals import plane_finder

    planes_at = plane_finder(points, threads, check)

    def estimated(indices: np.ndarray) -> np.ndarray:
        needed, place = np.unique(indices, return_inverse=True)
        return planes_at(points[needed])[place.reshape(indices.shape)]

    return estimated


def _count_around(points: np.ndarray) -> np.ndarray:
    """(P,) how many points share each one's cell and the 26 around it, some 60 on a surface."""
    cells = int(np.clip(np.sqrt(len(points) / 20), 4, 64))
    low = points.min(axis=0)
    width = np.ptp(points, axis=0).max() / cells
    cell = np.minimum(((points - low) / width).astype(np.int64), cells - 1)
    place = (cell[:, 0] * cells + cell[:, 1]) * cells + cell[:, 2]
    counts = np.bincount(place, minlength=cells**3).reshape((cells,) * 3)
    return box_sum(counts, 3).ravel()[place]


def _group_sizes(cells: np.ndarray) -> np.ndarray:
    """(K,) for cells (K, 3): how many entries lie in the group of touching cells of each."""
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    distinct, cell = np.unique(cells, axis=0, return_inverse=True)
    tree = KDTree(distinct.astype(np.float64))
    touching = tree.sparse_distance_matrix(tree, 1.5, p=np.inf, output_type="coo_matrix")
    touching.data[:] = 1
    _, group = connected_components(touching, directed=False)
    group = group[cell.ravel()]
    return np.bincount(group)[group]


def _require_surface(points: np.ndarray) -> None:
    if len(points) < 4:
        raise InputError(
            "too_few_points",
            f"Only {len(points)} distinct points are left and a surface needs at least 4; "
            "scan more of the part.",
        )
    offsets = points - points.mean(axis=0)
    offsets /= np.abs(offsets).max()
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(offsets.T @ offsets), 0))
    if spread[1] <= _THINNEST * spread[2]:
        raise InputError(
            "collinear_points",
            "All points lie on one line, which has no surface; check the scan's y and z columns.",
        )


def _with_finite_normals(cloud: PointCloud, normals: np.ndarray) -> tuple[PointCloud, np.ndarray]:
    """The cloud with zeros for normals that are not finite, and the lengths (P,) of all."""
    lengths = np.sqrt(np.einsum("pi,pi->p", normals, normals, dtype=np.float64))
    finite = np.isfinite(lengths)
    if finite.all():
        return cloud, lengths
    filled = np.where(finite[:, None], normals, np.float32(0))
    return _with_normals(cloud, filled), np.where(finite, lengths, 0.0)


def _unit_normals(cloud: PointCloud, threads: int, check: Check) -> tuple[PointCloud, int]:
    """Unit normals, missing ones filled, or none at all; and how many were filled."""
    if cloud.normals is None:
        return cloud, 0
    normals = cloud.normals.astype(np.float64)
    lengths = np.sqrt(np.einsum("pi,pi->p", normals, normals))
    missing = lengths == 0
    if missing.mean() > _BAD_NORMALS_TOLERATED:
        return _with_normals(cloud, None), 0
    if missing.any():
        nearest = _nearest(cloud.points, ~missing, missing, threads, check)
        normals[missing], lengths[missing] = normals[nearest], lengths[nearest]
    unit = (normals / lengths[:, None]).astype(np.float32)
    return _with_normals(cloud, unit), int(missing.sum())


def _nearest(
    points: np.ndarray, among: np.ndarray, of: np.ndarray, threads: int, check: Check
) -> np.ndarray:
    """For each point of mask ``of``, the index of the nearest one of mask ``among``."""
    from visco_core.neighbours import Neighbours

    found = Neighbours(points[among], threads, check).nearest(points[of])[1]
    return np.flatnonzero(among)[found[:, 0]]


def _with_normals(cloud: PointCloud, normals: np.ndarray | None) -> PointCloud:
    return PointCloud(cloud.points, normals, cloud.colors, cloud.scalars)
