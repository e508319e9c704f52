"""The pictures of the documents: ``python -m tests.benchmarks.pictures [PICTURE ...] --out DIR``.

sample: the shipped scan, its mesh and how far it is from the truth; holes: the same of a scan with
large holes; sparse: parts of a scan; level-sets: a slice through the field, with and without
losses. All are drawn on white, without a display.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import zoom
from skimage.measure import find_contours

from tests.benchmarks.gallery_scans import gallery_scan
from visco_core import gallery
from visco_core.clock import Clock
from visco_core.config import ReconstructionConfig
from visco_core.frame import Normalisation
from visco_core.io import read_points
from visco_core.kernels import choose_backend
from visco_core.metrics import point_to_mesh_distance
from visco_core.multires import Problem, solve_levels
from visco_core.pointcloud import PointCloud
from visco_core.presets import decide
from visco_core.preview import render_points, render_preview
from visco_core.preview.camera import UpAxis
from visco_core.reconstruction import reconstruct
from visco_core.result import Mesh

LEVEL_SETS = {
    "the profile fast": {},
    "without viscosity": {"lambda_v": 1e-12},
    "with coarea, 1e-5": {"lambda_c": 1e-5},
}
SLICE_VOXELS = 96
LEVEL_SPACING = 0.02
"""Between the drawn level sets, in units of the cube."""

_SLICE_ZOOM = 10
_SHARES = (0.01, 0.1, 0.25)
_HOLE_RADIUS = 17.0
_INSIDE, _OUTSIDE = np.array([[198, 219, 239], [252, 238, 219]])
_DARKER = 0.94
_FADE = 0.07
_NEARLY_WHITE = 249
_INK, _RED = (40, 44, 50), (200, 50, 40)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("pictures", nargs="*", metavar="PICTURE", help=", ".join(PICTURES))
    parser.add_argument("--out", type=Path, default=Path("out/pictures"), help="folder")
    parser.add_argument(
        "--scan", type=Path, default=gallery.sample_scan_path(), help="what sparse is made of"
    )
    parser.add_argument("--up", choices=("x", "y", "z"), default="z", help="up in that scan")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for name in arguments.pictures or PICTURES:
        write_small(PICTURES[name](arguments), arguments.out / f"{name}.png")


def sample(_: argparse.Namespace) -> Image.Image:
    cloud = read_points(gallery.sample_scan_path())
    return _scan_mesh_error(cloud, gallery.octopus().mesh(300), 0.2)


def holes(_: argparse.Namespace) -> Image.Image:
    cloud, truth = holey_scan()
    return _scan_mesh_error(cloud, truth, 2.0, elevation=38.0)


def sparse(arguments: argparse.Namespace) -> Image.Image:
    whole = read_points(arguments.scan)
    view, scans, meshes, captions = _view(arguments.up, (500, 410)), [], [], []
    for share in _SHARES:
        part = gallery.subsample(whole, round(share * len(whole)))
        config = ReconstructionConfig(up_axis=arguments.up)
        scans.append(render_points(part, **view))
        meshes.append(render_preview(reconstruct(part, config).mesh, **view))
        captions.append(f"{100.0 * share:g} %: {len(part):,} points")
    upper, lower = side_by_side(scans, captions), side_by_side(meshes, [""] * len(meshes))
    return stacked([upper, lower])


def level_sets(_: argparse.Namespace) -> Image.Image:
    cloud, _ = holey_scan()
    panels = [level_set_slice(cloud, options) for options in LEVEL_SETS.values()]
    return side_by_side(panels, list(LEVEL_SETS))


PICTURES = {"sample": sample, "holes": holes, "sparse": sparse, "level-sets": level_sets}


def holey_scan() -> tuple[PointCloud, Mesh]:
    """The bumpy torus as scanned, without what lies in two large balls; and the truth."""
    cloud, truth = gallery_scan("bumpy_torus")
    radius = 0.5 * np.ptp(truth.vertices[:, 0]) * 0.97
    kept = np.ones(len(cloud), dtype=bool)
    for angle in np.radians([-60.0, 165.0]):
        center = radius * np.array([np.cos(angle), np.sin(angle), 0.2])
        kept &= np.linalg.norm(cloud.points - center, axis=1) > _HOLE_RADIUS
    return cloud.select(kept), truth


def level_set_slice(cloud: PointCloud, options: dict[str, float]) -> np.ndarray:
    """The field of ``cloud`` on the plane z = ½ of the cube, (H, W, 3) uint8.

    Blue inside; every other step of ``LEVEL_SPACING`` is darker; the surface in black, the scan's
    points near the plane in red.
    """
    config = ReconstructionConfig.from_options({"resolution": SLICE_VOXELS, **options})
    backend = choose_backend(config.backend, config.device, config.threads)
    points = Normalisation.of(cloud.points).to_cube(cloud.points)
    assert cloud.normals is not None, "the scanner gives normals"
    problem = Problem(points, cloud.normals, cloud.normals, decide(config))
    level, _ = solve_levels(backend, problem, Clock(time.monotonic()))
    side = level.grid.side
    values = backend.numpy(level.values)[:-1].reshape(side, side, side)[:, :, side // 2]
    fine = zoom(values, _SLICE_ZOOM, order=1)
    picture = np.where(fine[..., None] < 0.0, _INSIDE, _OUTSIDE).astype(float)
    picture[np.floor(fine / LEVEL_SPACING) % 2 == 1] *= _DARKER
    # Array axes are x and y; a picture's are rows from the top, and columns.
    image = Image.fromarray(np.rot90(np.rint(picture).astype(np.uint8)).copy())
    draw = ImageDraw.Draw(image)
    to_pixels = np.array(fine.shape) - 1.0
    for contour in find_contours(fine, 0.0):
        _polyline(draw, contour, fine.shape[1])
    near = np.abs(points[:, 2] - 0.5) < 0.5 / SLICE_VOXELS
    for x, y in points[near, :2] * to_pixels:
        row = fine.shape[1] - 1 - y
        draw.ellipse((x - 2.5, row - 2.5, x + 2.5, row + 2.5), fill=_RED)
    return np.asarray(image.resize((560, 560), Image.Resampling.LANCZOS))


def _polyline(draw: ImageDraw.ImageDraw, contour: np.ndarray, height: int) -> None:
    line = [(float(x), float(height - 1 - y)) for x, y in contour]
    draw.line(line, fill=_INK, width=5, joint="curve")


def side_by_side(panels: Sequence[np.ndarray], captions: Sequence[str]) -> Image.Image:
    """Pictures (H, W, 3 or 4) uint8 of one size on white, each above its caption."""
    height, width = panels[0].shape[:2]
    gap, below = width // 40, width // 14 if any(captions) else 0
    whole = Image.new("RGB", (len(panels) * (width + gap) - gap, height + below), "white")
    draw, font = ImageDraw.Draw(whole), ImageFont.load_default(width // 26)
    for index, (panel, caption) in enumerate(zip(panels, captions, strict=True)):
        image, left = Image.fromarray(panel), index * (width + gap)
        whole.paste(image, (left, 0), _faded_alpha(image) if image.mode == "RGBA" else None)
        middle = (left + width // 2, height + below // 2)
        draw.text(middle, caption, fill=_INK, font=font, anchor="mm")
    return whole


def _faded_alpha(image: Image.Image) -> Image.Image:
    """The alpha of ``image``, less below and at the right, so that no shadow ends at a line."""
    alpha = np.asarray(image.getchannel("A"))
    from_below, from_right = (np.arange(length)[::-1] for length in alpha.shape)
    rim = np.minimum(from_below[:, None], from_right) / (_FADE * image.width)
    return Image.fromarray((alpha * np.minimum(rim, 1.0)).astype(np.uint8))


def stacked(rows: Sequence[Image.Image]) -> Image.Image:
    """Pictures of one width, one below the other."""
    whole = Image.new("RGB", (rows[0].width, sum(row.height for row in rows)), "white")
    top = 0
    for row in rows:
        whole.paste(row, (0, top))
        top += row.height
    return whole


def write_small(image: Image.Image, path: Path) -> None:
    """A PNG of 256 colors, half as large as one of all; what is nearly white becomes white."""
    chosen = image.quantize(256, Image.Quantize.MEDIANCUT, kmeans=1)
    colors = np.reshape(chosen.getpalette() or [], (-1, 3))
    colors[(colors >= _NEARLY_WHITE).all(axis=1)] = 255
    palette = Image.new("P", (1, 1))
    palette.putpalette(colors.ravel().tolist())
    image.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG).save(path, optimize=True)


def _view(up_axis: UpAxis, size: tuple[int, int]) -> dict:
    return {"up_axis": up_axis, "size": size, "background": "transparent"}


def _scan_mesh_error(
    cloud: PointCloud, truth: Mesh, worst: float, elevation: float = 22.0
) -> Image.Image:
    """The scan, what is made of it, and its distance to the truth up to ``worst``."""
    mesh = reconstruct(cloud).mesh
    view = {**_view("z", (640, 500)), "elevation": elevation}
    error = point_to_mesh_distance(mesh.vertices, truth)
    panels = [
        render_points(cloud, **view),
        render_preview(mesh, **view),
        render_preview(mesh, values=error, value_range=(0.0, worst), label="mm", **view),
    ]
    mean = f"distance to the truth, mean {error.mean():.2f} mm"
    return side_by_side(panels, [f"scan, {len(cloud):,} points", "mesh", mean])


if __name__ == "__main__":
    main()
