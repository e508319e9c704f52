"""Points and meshes as text: what stands in each column, and broken rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from io_files import sphere

from visco_core.errors import InputError
from visco_core.io import read_points
from visco_core.pointcloud import PointCloud


def read(tmp_path: Path, text: str, name: str = "scan.xyz", **options) -> PointCloud:
    path = tmp_path / name
    path.write_bytes(text.encode())
    return read_points(path, **options)


def refusal(tmp_path: Path, text: str, name: str = "scan.xyz") -> InputError:
    with pytest.raises(InputError) as caught:
        read(tmp_path, text, name)
    return caught.value


def table(*columns: np.ndarray, separator: str = " ") -> str:
    rows = np.column_stack(columns)
    return "".join(separator.join(f"{v:.9g}" for v in row) + "\n" for row in rows)


@pytest.mark.parametrize("separator", [" ", "\t", ",", ", ", ";", " ; "])
@pytest.mark.parametrize("name", ["scan.xyz", "scan.txt", "scan.csv", "scan"])
def test_any_separator_is_read_whatever_the_name(tmp_path: Path, separator: str, name: str) -> None:
    points, normals, _ = sphere(50)

    cloud = read(tmp_path, table(points, normals, separator=separator), name)

    assert np.allclose(cloud.points, points, rtol=1e-8)
    assert np.allclose(cloud.normals, normals, atol=1e-6)  # type: ignore[arg-type]


@pytest.mark.parametrize("separator", [";", " ", "\t"])
def test_a_decimal_comma_is_read_where_another_separator_stands(
    tmp_path: Path, separator: str
) -> None:
    text = "1,5 2,25 -3,125\n4,5 5,25 6,125\n".replace(" ", separator)

    assert read(tmp_path, text).points.tolist() == [[1.5, 2.25, -3.125], [4.5, 5.25, 6.125]]


def test_utm_coordinates_keep_every_digit(tmp_path: Path) -> None:
    cloud = read(tmp_path, "665187.522077 5648349.895035 241.767693\n" * 2)

    assert cloud.points[0].tolist() == [665187.522077, 5648349.895035, 241.767693]


@pytest.mark.parametrize(
    ("extra", "normals", "colors", "scalars"),
    [
        ("", False, False, []),
        ("i", False, False, ["intensity"]),
        ("n", True, False, []),
        ("c", False, True, []),
        ("f", False, True, []),
        ("cn", True, True, []),
        ("nc", True, True, []),
        ("ci", False, True, ["intensity"]),
        ("ni", True, False, ["intensity"]),
        ("icn", True, True, ["intensity"]),
    ],
)
def test_unnamed_columns_are_told_by_what_they_hold(
    tmp_path: Path, extra: str, normals: bool, colors: bool, scalars: list[str]
) -> None:
    points, directions, bytes_ = sphere(50)
    intensity = np.linspace(-2000, 2000, 50)
    kinds = {"n": directions, "c": bytes_, "f": bytes_ / 255, "i": intensity}

    cloud = read(tmp_path, table(points, *(kinds[kind] for kind in extra)))

    assert (cloud.normals is not None, cloud.colors is not None) == (normals, colors)
    assert list(cloud.scalars) == scalars
    if colors:
        assert np.array_equal(cloud.colors, bytes_)  # type: ignore[arg-type]
    if normals:
        assert np.allclose(cloud.normals, directions, atol=1e-6)  # type: ignore[arg-type]


def test_three_lone_columns_that_are_no_colors_are_normals_of_any_length(tmp_path: Path) -> None:
    points, normals, _ = sphere(50)

    cloud = read(tmp_path, table(points, normals * 17))

    assert np.allclose(cloud.normals, normals * 17, rtol=1e-5)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "titles",
    [
        "X Y Z R G B Nx Ny Nz",
        "//X Y Z R G B Nx Ny Nz",
        "# x y z red green blue normal_x normal_y normal_z",
        '"x" "y" "z" "Red" "Green" "Blue" "nx" "ny" "nz"',
    ],
)
@pytest.mark.parametrize("separator", [" ", ",", ";"])
def test_titles_name_the_columns(tmp_path: Path, titles: str, separator: str) -> None:
    text = f"{titles}\n1 2 3 10 20 30 0 0 1\n4 5 6 40 50 60 0 1 0\n".replace(" ", separator)

    cloud = read(tmp_path, text)

    assert cloud.points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert cloud.colors.tolist() == [[10, 20, 30], [40, 50, 60]]  # type: ignore[union-attr]
    assert cloud.normals.tolist() == [[0, 0, 1], [0, 1, 0]]  # type: ignore[union-attr]


def test_titles_may_put_the_coordinates_anywhere(tmp_path: Path) -> None:
    cloud = read(tmp_path, "id,z,y,x,gps_time\n7,3,2,1,0.5\n8,6,5,4,0.5\n")

    assert cloud.points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert cloud.scalars["id"].tolist() == [7, 8]


def test_comments_and_blank_lines_are_passed_over(tmp_path: Path) -> None:
    text = "# made by a scanner\n\n  % on Monday\n1 2 3\n\n// pause\n4 5 6\n# end\n"

    assert read(tmp_path, text).points.tolist() == [[1, 2, 3], [4, 5, 6]]


def test_pts_has_a_count_and_the_intensity_before_the_colors(tmp_path: Path) -> None:
    cloud = read(tmp_path, "2\n1 2 3 200 10 20 30\n4 5 6 90 40 50 60\n", "scan.pts")

    assert cloud.colors.tolist() == [[10, 20, 30], [40, 50, 60]]  # type: ignore[union-attr]
    assert cloud.scalars["intensity"].tolist() == [200, 90]


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("3\n1 2 3\n4 5 6\n", "truncated_file"),
        ("1\n1 2 3\n4 5 6\n", "excess_data"),
        ("9999999999\n1 2 3\n4 5 6\n", "truncated_file"),
        ("1 2 3\n4 5\n7 8 9\n", "unreadable_file"),
        ("1 2 3\n4 5 6\n7 8\n", "truncated_file"),
        ("1 2 3\n4 five 6\n7 8 9\n", "unreadable_file"),
        ("1,2,3,4\n1,2,,4\n1,2,3,4\n", "unreadable_file"),
        ("OFF\n8 6 0\n1 2 3\n", "not_a_point_cloud"),
        ("Dear Sir,\n\nthank you for the 3 scans.\n", "not_a_point_cloud"),
        ("1 2\n3 4\n", "not_a_point_cloud"),
        ("\n\n\n", "not_a_point_cloud"),
        ("", "no_points"),
    ],
)
def test_text_that_is_no_table_of_points_is_refused(tmp_path: Path, text: str, code: str) -> None:
    assert refusal(tmp_path, text).code == code


def test_too_many_rows_are_refused_before_they_are_parsed(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path, "1 2 3\n" + "not a number\n" * 10, max_points=10)
    assert caught.value.code == "too_many_points"


def test_an_obj_point_cloud_keeps_its_normals_and_colors(tmp_path: Path) -> None:
    text = "# scan\nvn 0 0 1\nv 1 2 3 1 0.5 0\nvn 0 1 0\nv 4 5 6 0 0 0\n"

    cloud = read(tmp_path, text, "scan.obj")

    assert cloud.points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert cloud.normals.tolist() == [[0, 0, 1], [0, 1, 0]]  # type: ignore[union-attr]
    assert cloud.colors.tolist() == [[255, 128, 0], [0, 0, 0]]  # type: ignore[union-attr]


SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


@pytest.mark.parametrize(
    "faces",
    [
        "f 1 2 3 4\n",
        "f 1/1/1 2/2/1 3/3/1 4/4/1\n",
        "f 1//1 2//1 3//1 4//1\n",
        "f 1 2 3\nf 1 3 4\n",
        "f 1 2 3 4\nf 1 2 3\n",
        "f -4 -3 -2 -1\nv 5 5 5\n",
        "f 1 2 \\\n3 4\n",
    ],
)
def test_obj_faces_of_any_kind_give_normals(tmp_path: Path, faces: str) -> None:
    cloud = read(tmp_path, f"mtllib missing.mtl\n{SQUARE}{faces}", "part.obj")

    assert cloud.normals[:4].tolist() == [[0, 0, 1]] * 4  # type: ignore[index]


@pytest.mark.parametrize(
    ("text", "code"),
    [
        (SQUARE + "f 1 2 9\n", "unreadable_file"),
        (SQUARE + "f 0 1 2\n", "unreadable_file"),
        (SQUARE + "f 1 2 x\n", "unreadable_file"),
        ("v 1 2\nv 3 4\n", "unreadable_file"),
        ("v 1 2 3\nv 3\nv 1 2 3\n", "unreadable_file"),
        ("v 1 2 3\nv 4 5 6\nv 7 8\n", "truncated_file"),
        ("o part\ng part\n", "no_points"),
    ],
)
def test_broken_obj_files_are_refused(tmp_path: Path, text: str, code: str) -> None:
    assert refusal(tmp_path, text, "part.obj").code == code


@pytest.mark.parametrize("text", [True, False])
def test_stl_corners_are_merged_and_get_normals(tmp_path: Path, text: bool) -> None:
    ball = trimesh.creation.icosphere(2)
    exported = (
        trimesh.exchange.stl.export_stl_ascii(ball).encode()
        if text
        else trimesh.exchange.stl.export_stl(ball)
    )
    (tmp_path / "part.stl").write_bytes(exported)

    cloud = read_points(tmp_path / "part.stl")

    assert len(cloud) == len(ball.vertices)
    assert (np.einsum("pi,pi->p", cloud.points, cloud.normals) > 0.99).all()  # type: ignore[arg-type]


def test_a_cut_stl_is_refused(tmp_path: Path) -> None:
    text = trimesh.exchange.stl.export_stl_ascii(trimesh.creation.icosphere(1))
    binary = trimesh.exchange.stl.export_stl(trimesh.creation.icosphere(1))

    assert refusal(tmp_path, text[: len(text) // 2], "part.stl").code == "truncated_file"
    (tmp_path / "part.stl").write_bytes(binary[:-1])
    with pytest.raises(InputError) as caught:
        read_points(tmp_path / "part.stl")
    assert caught.value.code == "truncated_file"


@pytest.mark.realdata
def test_agisoft_and_cloudcompare_exports_agree(realdata: Path) -> None:
    agisoft, compare = (
        read_points(realdata / "ply_odd" / f"trimesh__models_points_{name}.xyz")
        for name in ("agisoft", "cloudcompare")
    )

    assert np.allclose(agisoft.points, compare.points[:100], atol=1e-6)
    assert np.array_equal(agisoft.colors, compare.colors[:100])  # type: ignore[arg-type, index]
