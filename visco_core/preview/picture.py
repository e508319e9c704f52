"""Pictures of meshes and scans, without a display or a graphics card."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal

import numpy as np

from visco_core.errors import InputError
from visco_core.io.faces import vertex_normals
from visco_core.kernels.native import set_threads
from visco_core.pointcloud import PointCloud
from visco_core.preview.camera import Camera, UpAxis, extent, frame_points
from visco_core.preview.colormap import ColorMapName, colors_of, draw_legend
from visco_core.preview.ground import ground_shadow
from visco_core.preview.raster import see_points, see_triangles
from visco_core.preview.shading import Surface, light
from visco_core.result import Mesh

Background = Literal["light", "transparent"]
_CLAY = (0.80, 0.775, 0.745)
_OCCLUSION_REACH = 0.09
_THREADS = 2


def render_preview(
    mesh: Mesh,
    path: str | os.PathLike[str] | None = None,
    *,
    size: tuple[int, int] = (1280, 960),
    up_axis: UpAxis = "z",
    azimuth: float = 35.0,
    elevation: float = 22.0,
    values: np.ndarray | None = None,
    value_range: tuple[float, float] | None = None,
    colormap: ColorMapName = "heat",
    label: str = "",
    background: Background = "light",
    supersample: int = 2,
    threads: int = _THREADS,
) -> np.ndarray:
    """A three-quarter view of ``mesh`` as RGBA (H, W, 4) uint8, also written to ``path`` as PNG.

    size: width and height in pixels; azimuth and elevation in degrees, azimuth 0 from the front
    (for z up, from -y), growing to the right. values (V,): colors each vertex by ``colormap`` over
    ``value_range`` (all of them by default) with a legend titled ``label``; else the mesh's own
    colors, else clay. Raises InputError (``empty_mesh``).
    """
    if not len(mesh.faces):
        raise InputError("empty_mesh", "The mesh has no faces to draw; give one with faces.")
    set_threads(threads)
    large = (size[0] * supersample, size[1] * supersample)
    camera = frame_points(mesh.vertices, large, up_axis, azimuth, elevation)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int32)
    normals = mesh.normals
    if normals is None:
        normals = vertex_normals(mesh.vertices, faces)
    if values is not None and value_range is None:
        value_range = (float(np.nanmin(values)), float(np.nanmax(values)))
    if values is not None and value_range is not None:
        shades = colors_of(values, *value_range, colormap)
    else:
        shades = _own_colors(mesh.colors, len(mesh.vertices))
    screen = camera.to_screen(camera.to_frame(mesh.vertices))
    depth, owner = see_triangles(screen, faces, large)
    turned = camera.turn(normals)
    surface = Surface(depth, owner, screen, faces, turned, _linear(shades), supersample)
    shadow = ground_shadow(mesh.vertices, faces, camera, size, up_axis)
    picture = _compose(surface, camera, mesh.vertices, shadow, background)
    if value_range is not None and values is not None:
        picture = draw_legend(picture, *value_range, label, colormap)
    return _written(picture, path)


def render_points(
    cloud: PointCloud,
    path: str | os.PathLike[str] | None = None,
    *,
    size: tuple[int, int] = (1280, 960),
    up_axis: UpAxis = "z",
    azimuth: float = 35.0,
    elevation: float = 22.0,
    background: Background = "light",
    supersample: int = 2,
    threads: int = _THREADS,
) -> np.ndarray:
    """A three-quarter view of a scan, as ``render_preview`` gives it of a mesh.

    Points are discs about as large as their spacing. A few far outliers stay out of the frame.
    Raises InputError (``empty_scan``).
    """
    if not len(cloud):
        raise InputError("empty_scan", "The scan has no points to draw.")
    set_threads(threads)
    large = (size[0] * supersample, size[1] * supersample)
    bulk = _bulk(cloud.points)
    camera = frame_points(bulk, large, up_axis, azimuth, elevation)
    local = camera.to_frame(cloud.points)
    ahead = local[:, 2] > 0.1 * np.median(local[:, 2])
    cloud, local = cloud.select(ahead), local[ahead]
    screen = camera.to_screen(local)
    radius = 0.8 * _spacing(cloud.points) * camera.focal
    depth, owner = see_points(screen, radius, large)
    if cloud.normals is None:
        turned = -local / np.linalg.norm(local, axis=1, keepdims=True)
    else:
        turned = camera.turn(cloud.normals)
    shades = _linear(_own_colors(cloud.colors, len(cloud)))
    faces = np.empty((0, 3), dtype=np.int32)
    surface = Surface(depth, owner, screen, faces, turned, shades, supersample)
    shadow = np.zeros((size[1], size[0]), dtype=np.float32)
    return _written(_compose(surface, camera, bulk, shadow, background), path)


def _compose(
    surface: Surface,
    camera: Camera,
    points: np.ndarray,
    shadow: np.ndarray,
    background: Background,
) -> np.ndarray:
    """Surface over ground shadow over background, as sRGB (H, W, 4) uint8.

    ``points`` set the scale at which surfaces darken each other.
    """
    low, high = extent(points)
    reach = _OCCLUSION_REACH * float(np.linalg.norm(high - low))
    lit = light(surface, camera, reach)
    coverage = lit[..., 3:]
    darkness = shadow[..., None] * (1.0 - coverage)
    if background == "transparent":
        alpha = coverage + darkness
        color = lit[..., :3] / np.maximum(alpha, 1e-6)
    else:
        ramp = np.linspace(0.93, 0.76, lit.shape[0], dtype=np.float32)[:, None, None]
        backdrop = ramp * np.array([0.985, 0.99, 1.0], dtype=np.float32)
        alpha = np.ones_like(coverage)
        color = lit[..., :3] + (1.0 - coverage - darkness) * backdrop
    rgba = np.concatenate([_encoded(color), alpha], axis=2)
    return np.rint(255.0 * np.clip(rgba, 0.0, 1.0)).astype(np.uint8)


def _own_colors(colors: np.ndarray | None, count: int) -> np.ndarray:
    if colors is None:
        return np.broadcast_to(np.array(_CLAY, dtype=np.float32), (count, 3))
    return colors.astype(np.float32) / 255.0


def _linear(srgb: np.ndarray) -> np.ndarray:
    """sRGB 0 to 1 as linear light, float32 (IEC 61966-2-1)."""
    low, high = srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4
    return np.where(srgb <= 0.04045, low, high).astype(np.float32)


def _encoded(linear: np.ndarray) -> np.ndarray:
    linear = np.maximum(linear, 0.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)


def _bulk(points: np.ndarray) -> np.ndarray:
    """The points without the far tenth of a percent on each side."""
    low, high = np.quantile(points, [0.001, 0.999], axis=0)
    margin = 0.02 * (high - low)
    return points[((points >= low - margin) & (points <= high + margin)).all(axis=1)]


def _spacing(points: np.ndarray) -> float:
    """Typical distance between neighbors on the surface, from a subsample of it."""
    from scipy.spatial import KDTree

    count = min(len(points), 100_000)
    if count < 2:
        return 1.0
    chosen = points[np.random.default_rng(0).choice(len(points), count, replace=False)]
    nearest = KDTree(chosen).query(chosen, k=min(7, count))[0][:, -1]
    return float(np.median(nearest)) * np.sqrt(count / len(points)) / 1.3


def _written(picture: np.ndarray, path: str | os.PathLike[str] | None) -> np.ndarray:
    """Write the PNG beside its name first, so that a reader never sees half of it."""
    if path is not None:
        from PIL import Image

        target = Path(path)
        partial = target.with_name(f".{target.name}.{os.getpid()}.part")
        try:
            Image.fromarray(picture).save(partial, format="PNG", compress_level=4)
            os.replace(partial, target)
        finally:
            partial.unlink(missing_ok=True)
    return picture
