"""PLY in all its forms, and PLY that lies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from io_files import ply_bytes, sphere

from visco_core.errors import InputError
from visco_core.io import read_points, sniff_points

TRIANGLE = "0 0 0\n1 0 0\n0 1 0\n"
XYZ = "property float x\nproperty float y\nproperty float z\n"


def text_ply(elements: str, rows: str, *, before: str = "") -> bytes:
    return f"ply\nformat ascii 1.0\n{before}{elements}end_header\n{rows}".encode()


def read(tmp_path: Path, data: bytes, **options):
    path = tmp_path / "scan.ply"
    path.write_bytes(data)
    return read_points(path, **options)


def refusal(tmp_path: Path, data: bytes) -> InputError:
    with pytest.raises(InputError) as caught:
        read(tmp_path, data)
    sentence = str(caught.value)
    assert sentence.endswith(".")
    assert "\n" not in sentence
    return caught.value


@pytest.mark.parametrize(("order", "text"), [("<", False), (">", False), ("=", True)])
def test_both_endians_and_text_give_the_same_points(tmp_path: Path, order: str, text: bool) -> None:
    points, normals, colors = sphere()

    cloud = read(tmp_path, ply_bytes(points, normals, colors, order=order, text=text))

    assert np.array_equal(cloud.points, points)
    assert cloud.normals is not None
    assert np.allclose(cloud.normals, normals, atol=1e-6)
    assert cloud.normals.dtype == np.float32
    assert np.array_equal(cloud.colors, colors)  # type: ignore[arg-type]


def test_properties_may_stand_in_any_order_and_others_become_scalars(tmp_path: Path) -> None:
    rows = np.zeros(
        2,
        [
            *[("quality", "<f4"), ("blue", "u1"), ("z", "<f8"), ("nz", "<f4"), ("x", "<f4")],
            *[("red", "u1"), ("ny", "<f4"), ("y", "<i2"), ("green", "u1"), ("nx", "<f4")],
            ("alpha", "u1"),
        ],
    )
    rows["x"], rows["y"], rows["z"] = 1.5, -2, 1e7 + 0.125
    rows["ny"], rows["red"], rows["blue"], rows["quality"] = 1, 255, 7, [0.25, 0.5]
    types = {"f4": "float", "f8": "double", "u1": "uchar", "i2": "short"}
    names = rows.dtype.names or ()
    properties = "".join(f"property {types[rows.dtype[n].str[1:]]} {n}\n" for n in names)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex 2\n{properties}end_header\n"

    cloud = read(tmp_path, header.encode() + rows.tobytes())

    assert cloud.points.tolist() == [[1.5, -2, 1e7 + 0.125]] * 2
    assert cloud.normals.tolist() == [[0, 1, 0]] * 2  # type: ignore[union-attr]
    assert cloud.colors.tolist() == [[255, 0, 7]] * 2  # type: ignore[union-attr]
    assert {name: values.tolist() for name, values in cloud.scalars.items()} == {
        "quality": [0.25, 0.5]
    }


@pytest.mark.parametrize(
    ("kind", "values", "expected"),
    [
        ("uchar", "0 1 1", [0, 1, 1]),
        ("float", "0 0.5 1", [0, 128, 255]),
        ("float", "0 127.6 255", [0, 128, 255]),
        ("ushort", "0 32896 65535", [0, 128, 255]),
    ],
)
def test_colors_of_any_range_become_bytes(
    tmp_path: Path, kind: str, values: str, expected: list[int]
) -> None:
    colors = "".join(f"property {kind} diffuse_{c}\n" for c in ("red", "green", "blue"))

    cloud = read(tmp_path, text_ply(f"element vertex 1\n{XYZ}{colors}", f"1 2 3 {values}\n"))

    assert cloud.colors.tolist() == [expected]  # type: ignore[union-attr]


def test_long_names_for_normals_and_colors_are_known(tmp_path: Path) -> None:
    extra = "".join(f"property float normal_{a}\n" for a in "xyz")
    extra += "".join(f"property uchar {c}\n" for c in "rgb")

    cloud = read(tmp_path, text_ply(f"element vertex 1\n{XYZ}{extra}", "1 2 3 0 0 1 9 8 7\n"))

    assert cloud.normals.tolist() == [[0, 0, 1]]  # type: ignore[union-attr]
    assert cloud.colors.tolist() == [[9, 8, 7]]  # type: ignore[union-attr]
    assert not cloud.scalars


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_any_kind_of_line_end_is_read(tmp_path: Path, newline: str) -> None:
    data = text_ply(f"element vertex 3\n{XYZ}", TRIANGLE).replace(b"\n", newline.encode())

    assert read(tmp_path, data).points[1].tolist() == [1, 0, 0]


@pytest.mark.parametrize("newline", [b"\n", b"\r\n", b"\r"])
def test_binary_rows_that_begin_like_a_newline_keep_their_first_byte(
    tmp_path: Path, newline: bytes
) -> None:
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex 1\n{XYZ}end_header\n"
    row = b"\n\r\xbe\x40" + np.array([2.0, 3.0], "<f4").tobytes()

    cloud = read(tmp_path, header.encode().replace(b"\n", newline) + row)

    assert cloud.points[0, 0] == np.frombuffer(b"\n\r\xbe\x40", "<f4")[0]


def test_comments_and_obj_info_may_stand_anywhere(tmp_path: Path) -> None:
    elements = f"element vertex 3\ncomment a\n{XYZ}obj_info num_cols 512\n"

    cloud = read(tmp_path, text_ply(elements, TRIANGLE, before="comment element vertex 9\n"))

    assert len(cloud) == 3


def test_a_range_grid_is_passed_over(tmp_path: Path) -> None:
    grid = "element range_grid 4\nproperty list uchar int vertex_indices\n"

    cloud = read(
        tmp_path, text_ply(f"element vertex 3\n{XYZ}{grid}", TRIANGLE + "0\n1 0\n1 1\n0\n")
    )

    assert len(cloud) == 3
    assert cloud.normals is None


def test_faces_give_normals_weighted_by_area_where_the_file_has_none(tmp_path: Path) -> None:
    # Point 0 has a triangle of area 0.5 facing +z and one of area 2 facing -y.
    rows = "0 0 0\n1 0 0\n0 1 0\n0 0 4\n3 0 1 2\n3 0 1 3\n"
    faces = "element face 2\nproperty list uchar int vertex_index\n"

    cloud = read(tmp_path, text_ply(f"element vertex 4\n{XYZ}{faces}", rows))

    expected = np.array([[0, -4, 1], [0, -4, 1], [0, 0, 1], [0, -1, 0]], float)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    assert np.allclose(cloud.normals, expected, atol=1e-6)  # type: ignore[arg-type]


def list_ply(order: str, polygons: list[list[int]], *, faces_first: bool) -> bytes:
    """A square pyramid without normals, its faces beside a scalar, in either order."""
    points = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [1, 1, 1]], order + "f4")
    name = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    face = f"element face {len(polygons)}\nproperty ushort flags\n"
    face += "property list uchar uint vertex_indices\n"
    vertex = f"element vertex 5\n{XYZ}"
    rows = b"".join(
        np.array([3], order + "u2").tobytes()
        + bytes([len(p)])
        + np.array(p, order + "u4").tobytes()
        for p in polygons
    )
    parts = [(vertex, points.tobytes()), (face, rows)][:: -1 if faces_first else 1]
    header = f"ply\nformat {name} 1.0\n{parts[0][0]}{parts[1][0]}end_header\n"
    return header.encode() + parts[0][1] + parts[1][1]


SIDES = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("faces_first", [True, False])
@pytest.mark.parametrize("base", [[[3, 2, 1, 0]], [[2, 1, 0], [3, 2, 0]]])
def test_binary_lists_of_equal_and_differing_length_are_read(
    tmp_path: Path, order: str, faces_first: bool, base: list[list[int]]
) -> None:
    cloud = read(tmp_path, list_ply(order, SIDES + base, faces_first=faces_first))

    assert cloud.points[4].tolist() == [1, 1, 1]
    assert np.allclose(cloud.normals[4], [0, 0, 1])  # type: ignore[index]
    assert (cloud.normals[:4, 2] < 1e-6).all()  # type: ignore[index]
    assert cloud.normals[base[0][0], 2] < -0.5  # type: ignore[index]


def test_text_lists_of_differing_length_are_read(tmp_path: Path) -> None:
    face = "element face 2\nproperty list uchar int vertex_indices\nproperty float weight\n"
    rows = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3 0.5\n3 0 1 2 0.5\n"

    cloud = read(tmp_path, text_ply(f"element vertex 4\n{XYZ}{face}", rows))

    assert cloud.normals.tolist() == [[0, 0, 1]] * 4  # type: ignore[union-attr]


def test_a_list_within_the_vertices_is_passed_over(tmp_path: Path) -> None:
    vertex = "element vertex 2\nproperty list uchar int rings\n" + XYZ

    cloud = read(tmp_path, text_ply(vertex, "2 8 9 1 2 3\n0 4 5 6\n"))

    assert cloud.points.tolist() == [[1, 2, 3], [4, 5, 6]]


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian"])
@pytest.mark.parametrize("count", [10**9, 10**14])
def test_a_header_that_promises_more_than_the_file_holds_is_refused_before_it_costs_anything(
    tmp_path: Path, kind: str, count: int
) -> None:
    data = f"ply\nformat {kind} 1.0\nelement vertex {count}\n{XYZ}end_header\n".encode()
    data += TRIANGLE.encode() * 10

    assert refusal(tmp_path, data).code == "truncated_file"
    with pytest.raises(InputError):
        sniff_points(data, len(data))


@pytest.mark.parametrize(("count", "code"), [(4, "truncated_file"), (2, "excess_data")])
def test_text_with_fewer_or_more_rows_than_promised_is_refused(
    tmp_path: Path, count: int, code: str
) -> None:
    assert refusal(tmp_path, text_ply(f"element vertex {count}\n{XYZ}", TRIANGLE)).code == code


def test_binary_data_beyond_the_promise_are_refused(tmp_path: Path) -> None:
    data = ply_bytes(*sphere())

    assert refusal(tmp_path, data.replace(b"vertex 200", b"vertex 199")).code == "excess_data"


@pytest.mark.parametrize(
    ("rows", "code"),
    [
        ("0 0 0\n1.0 0\n0 1 0\n", "unreadable_file"),
        ("0 0 0\n1.0 0 0\n0 1\n", "truncated_file"),
        ("0 0 0\n1 zero 0\n0 1 0\n", "unreadable_file"),
        ("0 0 0 0\n1 0 0 0\n0 1 0 0\n", "unreadable_file"),
    ],
)
def test_broken_rows_are_refused(tmp_path: Path, rows: str, code: str) -> None:
    assert refusal(tmp_path, text_ply(f"element vertex 3\n{XYZ}", rows)).code == code


@pytest.mark.parametrize(
    ("elements", "rows", "code"),
    [
        ("element vertex 0\n" + XYZ, "", "no_points"),
        ("element face 0\nproperty list uchar int vertex_indices\n", "", "no_points"),
        ("element vertex 1\nproperty float x\nproperty float y\n", "1 2\n", "unsupported_property"),
        (f"element vertex 1\n{XYZ}property float x\n", "1 2 3 4\n", "unsupported_property"),
        (f"element vertex 1\n{XYZ}element vertex 1\n{XYZ}", "1 2 3\n1 2 3\n", "unreadable_file"),
        ("element vertex 1\nproperty quad x\n", "1\n", "unreadable_file"),
        ("element vertex minus\n" + XYZ, "1 2 3\n", "unreadable_file"),
        ("element vertex 3\n", TRIANGLE, "unreadable_file"),
        (
            f"element vertex 3\n{XYZ}element face 1\nproperty list uchar int vertex_indices\n",
            TRIANGLE + "3 0 1 3\n",
            "unreadable_file",
        ),
    ],
)
def test_headers_that_make_no_sense_are_refused(
    tmp_path: Path, elements: str, rows: str, code: str
) -> None:
    assert refusal(tmp_path, text_ply(elements, rows)).code == code


def test_binary_lists_that_run_past_the_end_are_refused(tmp_path: Path) -> None:
    data = list_ply("<", [*SIDES, [3, 2, 1, 0]], faces_first=True)
    # The last list claims 200 corners.
    broken = data.replace(b"\x04" + np.array([3, 2, 1, 0], "<u4").tobytes(), b"\xc8")

    assert refusal(tmp_path, broken).code == "truncated_file"


def test_more_points_than_allowed_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path, ply_bytes(*sphere()), max_points=199)
    assert caught.value.code == "too_many_points"
    assert len(read(tmp_path, ply_bytes(*sphere()), max_points=200)) == 200


ODD = {
    "assimp__test_models-nonbsd_PLY_ant-half.ply": "truncated_file",
    "assimp__test_models_PLY_cube.ply": 8,
    "assimp__test_models_PLY_cube_binary.ply": 8,
    "assimp__test_models_PLY_cube_binary_starts_with_nl.ply": 8,
    "assimp__test_models_PLY_cube_uv.ply": 24,
    "assimp__test_models_PLY_float-color.ply": 3,
    "assimp__test_models_PLY_points.ply": 4,
    "assimp__test_models_PLY_pond.0.ply": 70051,
    "assimp__test_models_invalid_crash-30d6d0f7c529b3b66b4131700b7a4580cd7082df.ply": (
        "truncated_file"
    ),
    "common3d__igea_tristrips.ply": 134345,
    "euclid__data_bunny_vn.ply": 8670,
    "euclid__data_cube_ascii.ply": 26,
    "happly__test_sampledata_platonic_shelf.ply": 50,
    "happly__test_sampledata_platonic_shelf_ascii.ply": 50,
    "happly__test_sampledata_platonic_shelf_big_endian.ply": 50,
    "pyntcloud__tests_data_diamond.ply": 6,
    "pyntcloud__tests_data_diamond_ascii.ply": 6,
    "pyntcloud__tests_data_diamond_ascii_vertex_index.ply": 6,
    "pyntcloud__tests_data_sphere.ply": 2929,
    "pyntcloud__tests_data_voxelgrid.ply": 6,
    "thegyro__dragonStandRight_0_badheader_bye.ply": "unreadable_file",
    "trimesh__models_cube_blender_uv.ply": 24,
    "trimesh__models_cube_blender_uv_meshlab.ply": 24,
    "trimesh__models_empty.ply": "no_points",
    "trimesh__models_emptyIO_ply_empty_bin.ply": "no_points",
    "trimesh__models_emptyIO_ply_empty_header.ply": "no_points",
    "trimesh__models_emptyIO_ply_points_ascii.ply": 8,
    "trimesh__models_fixed_top.ply": 2374,
    "trimesh__models_fuze.ply": 502,
    "trimesh__models_fuze_ascii.ply": 502,
    "trimesh__models_mirror.ply": 143,
    "trimesh__models_multi.ply": 4,
    "trimesh__models_octagonal_pocket.ply": 1658,
    "trimesh__models_plane_tri.ply": 4,
    "trimesh__models_points_agisoft.xyz": 100,
    "trimesh__models_points_ascii.ply": 5,
    "trimesh__models_points_bin.ply": 5,
    "trimesh__models_points_cloudcompare.xyz": 101,
    "trimesh__models_points_emptyascii.ply": "excess_data",
    "trimesh__models_reference.ply": 845,
    "trimesh__models_sphere.ply": 642,
    "trimesh__models_suzanne.ply": 1966,
}


@pytest.mark.realdata
@pytest.mark.parametrize(("name", "outcome"), ODD.items())
def test_every_odd_file_gives_its_points_or_one_sentence(
    realdata: Path, name: str, outcome: int | str
) -> None:
    path = realdata / "ply_odd" / name
    if isinstance(outcome, str):
        with pytest.raises(InputError) as caught:
            read_points(path)
        assert caught.value.code == outcome
    else:
        cloud = read_points(path)
        assert len(cloud) == outcome
        assert np.isfinite(cloud.points).all()


@pytest.mark.realdata
def test_the_list_of_odd_files_is_complete(realdata: Path) -> None:
    assert {path.name for path in (realdata / "ply_odd").iterdir()} == set(ODD)


@pytest.mark.realdata
@pytest.mark.parametrize(
    ("name", "points", "normals"),
    [
        ("srb/scans/anchor.ply", 85127, True),
        ("srb/scans/dc.ply", 71265, True),
        ("srb/scans/gargoyle.ply", 95435, True),
        ("stanford/bunny_150k.ply", 150000, True),
        ("stanford/dragon_stand_100k.ply", 100000, True),
        ("stanford/bun000.ply", 40256, False),
        ("stanford/bun_zipper.ply", 35947, True),
    ],
)
def test_real_scans_are_read_whole(realdata: Path, name: str, points: int, normals: bool) -> None:
    cloud = read_points(realdata / name)

    assert len(cloud) == points
    assert (cloud.normals is not None) == normals
    if cloud.normals is not None:
        lengths = np.linalg.norm(cloud.normals, axis=1)
        # The zippered mesh has points without a face.
        assert np.allclose(lengths[lengths > 0], 1, atol=1e-3)
        assert (lengths > 0).mean() > 0.95
