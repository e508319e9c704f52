"""A virtual range scanner: what a real one sees of a known surface, and how it errs."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from visco_core.gallery.damage import (
    add_outliers,
    random_directions,
    stream,
    subsample,
    tilt_normals,
)
from visco_core.gallery.range_image import RangeImage, image_normals, take_image
from visco_core.gallery.shape import Shape
from visco_core.pointcloud import PointCloud

_CERTAIN_COSINE = 0.42
_LOST_COSINE = 0.14


@dataclass(frozen=True)
class Scanner:
    """How the scanner looks and errs. Lengths are fractions of the shape's diagonal.

    views: number of viewpoints, spread evenly, or directions (V, 3) from the shape to each.
    resolution: pixels a side of each range image. points: keep this many of all, None for all.
    noise: std of the depth, along the ray. registration_degrees, registration_shift: std of each
    view's rotation about the shape's center and of its shift. missing_views: how many random views
    are lost. holes, hole_radius: balls in which no point is returned. normals: estimated from each
    range image, exact, or none; normal_noise: std of their tilt in degrees. outliers: stray
    points, as a fraction of the others. colors: carry the shape's colors.
    """

    views: int | np.ndarray = 10
    resolution: int = 128
    points: int | None = None
    noise: float = 0.0
    registration_degrees: float = 0.0
    registration_shift: float = 0.0
    missing_views: int = 0
    holes: int = 0
    hole_radius: float = 0.05
    normals: Literal["estimated", "exact", "none"] = "estimated"
    normal_noise: float = 0.0
    outliers: float = 0.0
    colors: bool = False


def scan(shape: Shape, scanner: Scanner | None = None, *, seed: int = 0) -> PointCloud:
    """What ``scanner`` returns of ``shape``; the same seed gives the same scan."""
    scanner = scanner or Scanner()
    rng = stream(seed, "scan")
    views = [_view(shape, scanner, direction, rng) for direction in _directions(scanner, rng)]
    cloud = _joined(views)
    cloud = cloud.select(~_in_holes(cloud.points, shape, scanner, rng))
    if scanner.points is not None:
        cloud = subsample(cloud, scanner.points, seed)
    if cloud.normals is not None and scanner.normal_noise:
        tilted = tilt_normals(cloud.normals, scanner.normal_noise, rng)
        cloud = dataclasses.replace(cloud, normals=tilted.astype(np.float32))
    return add_outliers(cloud, scanner.outliers, seed) if scanner.outliers else cloud


def even_directions(count: int) -> np.ndarray:
    """Unit vectors (count, 3) spread evenly over the sphere: a Fibonacci lattice."""
    index = np.arange(count) + 0.5
    height = 1.0 - 2.0 * index / count
    angle = np.pi * (1.0 + 5.0**0.5) * index
    ring = np.sqrt(1.0 - height**2)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1)


def _directions(scanner: Scanner, rng: np.random.Generator) -> Iterator[np.ndarray]:
    views = scanner.views
    directions = even_directions(views) if isinstance(views, int) else np.asarray(views)
    kept = rng.permutation(len(directions))[scanner.missing_views :]
    if not len(kept):
        raise ValueError("every view is missing")
    yield from directions[np.sort(kept)]


def _view(
    shape: Shape, scanner: Scanner, direction: np.ndarray, rng: np.random.Generator
) -> PointCloud:
    """One range image as points in the common frame."""
    image = take_image(shape, direction, scanner.resolution)
    image = _without_grazing(image, shape, rng)
    truth = image.points()
    noise = scanner.noise * shape.diagonal
    depth = image.depth + noise * rng.standard_normal(image.depth.shape)
    image = dataclasses.replace(image, depth=depth)
    normals, seen = image_normals(image, noise)
    if scanner.normals == "exact":
        normals = shape.normal(truth)
    points = image.points()[seen]
    colors = shape.color(truth[seen]) if scanner.colors and shape.color is not None else None
    turn, shift = _registration_error(scanner, shape, rng)
    points = (points - shape.center) @ turn.T + shape.center + shift
    turned = None if scanner.normals == "none" else (normals[seen] @ turn.T).astype(np.float32)
    return PointCloud(points, turned, colors)


def _without_grazing(image: RangeImage, shape: Shape, rng: np.random.Generator) -> RangeImage:
    """Surfaces seen at a low angle return light less often, and below 8 degrees never."""
    cosine = -(shape.normal(image.points()) * image.rays()).sum(axis=1)
    chance = (cosine - _LOST_COSINE) / (_CERTAIN_COSINE - _LOST_COSINE)
    returned = rng.random(len(cosine)) < chance
    return dataclasses.replace(image, pixels=image.pixels[returned], depth=image.depth[returned])


def _registration_error(
    scanner: Scanner, shape: Shape, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """(rotation (3, 3), shift (3,)) of one view."""
    axis, toward = random_directions(2, rng)
    angle, distance = rng.standard_normal(2)
    turn = rotation(axis, np.radians(scanner.registration_degrees) * angle)
    return turn, toward * distance * scanner.registration_shift * shape.diagonal


def rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation matrix (3, 3) about a unit axis by an angle in radians: Rodrigues' formula."""
    cross = np.cross(np.eye(3), -axis)
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def _in_holes(
    points: np.ndarray, shape: Shape, scanner: Scanner, rng: np.random.Generator
) -> np.ndarray:
    """(P,) bool: inside one of the balls in which nothing is returned."""
    inside = np.zeros(len(points), dtype=bool)
    for center in points[rng.integers(len(points), size=scanner.holes)]:
        distance = np.linalg.norm(points - center, axis=1)
        inside |= distance < scanner.hole_radius * shape.diagonal
    return inside


def _joined(views: list[PointCloud]) -> PointCloud:
    normals = [view.normals for view in views if view.normals is not None]
    colors = [view.colors for view in views if view.colors is not None]
    return PointCloud(
        np.concatenate([view.points for view in views]),
        np.concatenate(normals) if normals else None,
        np.concatenate(colors) if colors else None,
    )
