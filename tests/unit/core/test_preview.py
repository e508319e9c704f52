"""Pictures show what is there: in the frame, lit, upright, in color."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from visco_core import gallery
from visco_core.errors import InputError
from visco_core.pointcloud import PointCloud
from visco_core.preview import render_points, render_preview
from visco_core.preview.camera import UpAxis, frame_points
from visco_core.preview.colormap import colors_of
from visco_core.preview.ground import ground_shadow
from visco_core.result import Mesh

SIZE = (160, 120)


@pytest.fixture(scope="module")
def ball() -> Mesh:
    return gallery.sphere().mesh(40)


def covered(picture: np.ndarray) -> np.ndarray:
    """Pixels of a transparent picture that the object fills."""
    return picture[..., 3] == 255


def stacked(lower: Mesh, upper: Mesh, height: float) -> Mesh:
    """Both as one mesh, the upper one raised."""
    raised = upper.vertices + np.array([0.0, 0.0, height])
    faces = np.concatenate([lower.faces, upper.faces + len(lower.vertices)])
    return Mesh(np.concatenate([lower.vertices, raised]), faces)


def test_ball_fills_a_disc_in_the_middle_of_the_frame(ball: Mesh) -> None:
    picture = render_preview(ball, size=SIZE, background="transparent")
    rows, columns = np.nonzero(covered(picture))
    assert picture.shape == (120, 160, 4)
    assert picture.dtype == np.uint8
    assert abs(columns.mean() - 79.5) < 1.5
    height, width = np.ptp(rows) + 1, np.ptp(columns) + 1
    assert abs(height - width) <= 3
    assert 0.75 * 120 < height < 0.9 * 120
    assert covered(picture).sum() == pytest.approx(np.pi / 4.0 * height * width, rel=0.05)


def test_light_comes_from_the_upper_left(ball: Mesh) -> None:
    picture = render_preview(ball, size=SIZE).astype(int)
    upper_left, lower_right = picture[35, 55, :3].sum(), picture[80, 100, :3].sum()
    assert upper_left > 1.2 * lower_right


@pytest.mark.parametrize("up_axis", ["x", "y", "z"])
def test_up_axis_points_up(up_axis: UpAxis) -> None:
    axis = "xyz".index(up_axis)
    half = np.full(3, 0.3)
    half[axis] = 1.0
    tower = gallery.box((half[0], half[1], half[2])).mesh(32)
    vertices = tower.vertices.copy()
    heavy_end = vertices[:, axis] < 0.0
    vertices[heavy_end] *= np.where(np.arange(3) == axis, 1.0, 2.0)
    mesh = Mesh(vertices, tower.faces)
    mask = covered(render_preview(mesh, size=SIZE, up_axis=up_axis, background="transparent"))
    rows = np.flatnonzero(mask.any(axis=1))
    middle = (rows[0] + rows[-1]) // 2
    assert np.ptp(rows) > mask.any(axis=0).sum() * 0.9
    assert mask[middle + 10 :].sum() > 1.3 * mask[: middle - 10].sum()


def test_near_surface_hides_the_far_one() -> None:
    mesh = gallery.box((0.1, 1.0, 1.0)).mesh(32)
    colors = np.where(mesh.vertices[:, :1] > 0.0, [[255, 0, 0]], [[0, 0, 255]]).astype(np.uint8)
    picture = render_preview(
        Mesh(mesh.vertices, mesh.faces, colors=colors), size=SIZE, azimuth=90.0, elevation=0.0
    )
    red, _, blue, _ = picture[60, 80].astype(int)
    assert red > 3 * blue


def test_background_is_opaque_or_transparent_as_asked(ball: Mesh) -> None:
    assert (render_preview(ball, size=SIZE)[..., 3] == 255).all()
    assert render_preview(ball, size=SIZE, background="transparent")[0, 0, 3] == 0


def test_object_casts_a_shadow_on_the_ground_below_it(ball: Mesh) -> None:
    picture = render_preview(ball, size=SIZE, background="transparent")
    soft = (picture[..., 3] > 0) & ~covered(picture)
    rows, _ = np.nonzero(soft & (picture[..., :3].sum(axis=2) < 30))
    assert len(rows) > 100
    assert rows.mean() > 75


def test_shadow_fades_with_height() -> None:
    def shade(height: float) -> float:
        pole = gallery.box((0.02, 0.02, height)).mesh(64)
        roof = gallery.box((0.5, 0.5, 0.05)).mesh(32)
        mesh = stacked(pole, roof, height)
        camera = frame_points(gallery.sphere().bounds, SIZE, "z", 0.0, 30.0)
        return float(ground_shadow(mesh.vertices, mesh.faces, camera, SIZE, "z").sum())

    assert shade(0.6) < 0.7 * shade(0.1)


def test_floor_is_darker_beside_a_wall_than_in_the_open() -> None:
    wall, floor = gallery.box((0.1, 0.8, 0.4)).mesh(48), gallery.box((0.9, 0.9, 0.02)).mesh(48)
    mesh = stacked(floor, wall, 0.4)
    picture = render_preview(mesh, size=SIZE, azimuth=90.0, elevation=45.0).astype(int)
    wall_foot, open_floor = picture[66, 80, :3].sum(), picture[85, 80, :3].sum()
    assert wall_foot < 0.95 * open_floor


def test_edges_are_smooth(ball: Mesh) -> None:
    from_above = {"elevation": 89.0, "background": "transparent", "size": SIZE}
    rough = render_preview(ball, supersample=1, **from_above)[..., 3]
    smooth = render_preview(ball, supersample=3, **from_above)[..., 3]
    lit = render_preview(ball, supersample=3, **from_above)[..., :3].sum(axis=2) > 60
    assert len(np.unique(smooth[lit])) > 5
    assert abs(int((rough == 255).sum()) - int((smooth == 255).sum())) < 300


def test_inside_of_an_open_surface_is_darker_than_its_outside() -> None:
    ball = gallery.sphere().mesh(40)
    lower = (ball.vertices[ball.faces][:, :, 2] < 0.0).all(axis=1)
    bowl = Mesh(ball.vertices, ball.faces[lower], ball.normals)
    assert ball.normals is not None
    outside_in = Mesh(ball.vertices, bowl.faces[:, ::-1], -ball.normals)
    right, wrong = (
        render_preview(mesh, size=SIZE, elevation=80.0)[60, 80, :3].sum()
        for mesh in (bowl, outside_in)
    )
    assert right < 0.8 * wrong


def test_values_color_the_mesh_and_draw_a_legend(ball: Mesh) -> None:
    values = ball.vertices[:, 2]
    plain = render_preview(ball, size=(320, 240))
    colored = render_preview(ball, size=(320, 240), values=values, label="height")
    legend = np.s_[60:180, 8:30]
    assert np.abs(colored[legend].astype(int) - plain[legend]).max() > 60
    assert np.abs(colored[60:180, 120:200].astype(int) - plain[60:180, 120:200]).max() > 60


def test_color_map_is_even_in_lightness_and_gray_for_nan() -> None:
    colors = colors_of(np.linspace(0.0, 1.0, 9), 0.0, 1.0, "heat")
    lightness = np.cbrt(colors.astype(float) ** 2.2 @ [0.2126, 0.7152, 0.0722])
    steps = np.diff(lightness)
    assert (steps < 0.0).all()
    assert steps.min() > 2.5 * steps.max()
    assert np.array_equal(colors_of(np.array([-1.0, 2.0]), 0.0, 1.0), colors[[0, -1]])
    assert np.allclose(colors_of(np.array([np.nan]), 0.0, 1.0), 0.6)


def test_picture_is_the_same_for_any_number_of_threads(ball: Mesh) -> None:
    one, three = (render_preview(ball, size=SIZE, threads=threads) for threads in (1, 3))
    assert np.array_equal(one, three)


def test_scan_far_from_the_origin_looks_the_same() -> None:
    ball = gallery.sphere().mesh(40)
    near = render_preview(ball, size=SIZE).astype(int)
    far = render_preview(Mesh(ball.vertices + 1e7, ball.faces, ball.normals), size=SIZE)
    assert np.abs(near - far).mean() < 0.5


def test_points_show_as_a_closed_surface_in_their_own_colors() -> None:
    shape = gallery.sphere()
    cloud = gallery.uniform_scan(shape, 3000)
    green = np.tile(np.array([[20, 200, 20]], dtype=np.uint8), (len(cloud), 1))
    picture = render_points(
        PointCloud(cloud.points, cloud.normals, green), size=SIZE, background="transparent"
    )
    disc = picture[45:75, 65:95].astype(int)
    assert (disc[..., 3] > 200).mean() > 0.95
    assert (disc[..., 1] > 2 * disc[..., 0]).mean() > 0.95


def test_a_few_far_outliers_change_neither_the_frame_nor_the_light() -> None:
    cloud = gallery.uniform_scan(gallery.sphere(), 5000)
    far = np.array([[5e6, 0.0, 0.0], [0.0, 0.0, -800.0], [0.0, 3e4, 0.0]])
    up = np.tile(np.array([[0.0, 0.0, 1.0]], dtype=np.float32), (3, 1))
    assert cloud.normals is not None
    stray = PointCloud(np.concatenate([cloud.points, far]), np.concatenate([cloud.normals, up]))
    with_them, without = (render_points(scan, size=SIZE).astype(int) for scan in (stray, cloud))
    assert np.abs(with_them - without).mean() < 2.0


@pytest.mark.parametrize("count", [1, 2, 10])
def test_a_handful_of_points_still_gives_a_picture(count: int) -> None:
    points = np.random.default_rng(0).normal(size=(count, 3))
    assert render_points(PointCloud(points), size=SIZE).shape == (120, 160, 4)


def test_png_is_written_whole_and_leaves_nothing_beside_it(ball: Mesh, tmp_path: Path) -> None:
    picture = render_preview(ball, tmp_path / "preview.png", size=SIZE)
    with Image.open(tmp_path / "preview.png") as image:
        assert np.array_equal(np.asarray(image), picture)
    assert [path.name for path in tmp_path.iterdir()] == ["preview.png"]


def test_a_folder_that_is_missing_fails_without_a_trace(ball: Mesh, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        render_preview(ball, tmp_path / "missing" / "preview.png", size=SIZE)


def test_nothing_to_draw_is_refused_in_a_sentence() -> None:
    empty = Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32))
    with pytest.raises(InputError, match="no faces"):
        render_preview(empty)
    with pytest.raises(InputError, match="no points"):
        render_points(PointCloud(np.zeros((0, 3))))
