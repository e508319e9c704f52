"""Takes out of a scan what no surface can be made of, and says so."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from visco_core.equal_rows import first_of_equals
from visco_core.errors import InputError
from visco_core.neighbours import Neighbours
from visco_core.pointcloud import PointCloud
from visco_core.progress import Check, never
from visco_core.sides import wrong_sides
from visco_core.strays import find_scattered, find_strays

_THINNEST = 1e-6
_LARGEST = 1e100
_BAD_NORMALS_TOLERATED = 0.5


@dataclass(frozen=True)
class CleaningReport:
    """How many points there were, how many are left, and what became of the others.

    ``off_surface`` are those that were dropped between surfaces.
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
    filled_normals: int = 0
    rescaled_normals: int = 0
    turned_normals: int = 0
    dropped_normals: bool = False
    off_surface: PointCloud = field(default_factory=lambda: PointCloud(np.empty((0, 3))))

    @property
    def scattered(self) -> int:
        return len(self.off_surface)

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
    off_surface = kept.select(between)
    kept = kept.select(~between) if len(off_surface) else kept
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
        filled_normals=filled,
        rescaled_normals=rescaled if kept.normals is not None else 0,
        turned_normals=turned,
        dropped_normals=cloud.normals is not None and kept.normals is None,
        off_surface=off_surface,
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
    found = Neighbours(points[among], threads, check).nearest(points[of])[1]
    return np.flatnonzero(among)[found[:, 0]]


def _with_normals(cloud: PointCloud, normals: np.ndarray | None) -> PointCloud:
    return PointCloud(cloud.points, normals, cloud.colors, cloud.scalars)
