"""PCD, LAS, LAZ, E57, NPZ: what other libraries write is read back, and lies are found out."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
from io_files import COUNT, sphere, write_samples

from visco_core.errors import InputError
from visco_core.io import read_points, sniff_points


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return {path.name: path for path in write_samples(tmp_path_factory.mktemp("samples"))}


def refusal(path: Path, data: bytes) -> InputError:
    path.write_bytes(data)
    with pytest.raises(InputError) as caught:
        read_points(path)
    return caught.value


@pytest.mark.parametrize(
    ("name", "normals", "colors"),
    [
        ("ascii.pcd", True, True),
        ("binary.pcd", True, True),
        ("binary_compressed.pcd", True, True),
        ("points.las", False, True),
        ("points.laz", False, True),
        ("old.laz", False, True),
        ("points.e57", False, True),
        ("points.npz", True, True),
        ("points.npy", True, False),
    ],
)
def test_every_format_gives_the_points_back(
    samples: dict[str, Path], name: str, normals: bool, colors: bool
) -> None:
    points, directions, bytes_ = sphere()
    # pye57 writes coordinates as float32.
    tolerance = 5e-5 if name.endswith("e57") else 1e-9

    header = sniff_points(samples[name])
    cloud = read_points(samples[name])

    assert header.points == len(cloud) == COUNT
    assert np.abs(cloud.points - points).max() < tolerance
    assert (cloud.normals is not None, cloud.colors is not None) == (normals, colors)
    assert header.has_normals == normals
    assert header.has_colors == colors
    if cloud.normals is not None:
        assert np.allclose(cloud.normals, directions, atol=1e-6)
    if cloud.colors is not None:
        assert np.array_equal(cloud.colors, bytes_)


def test_invalid_points_of_an_e57_scan_are_left_out(tmp_path: Path) -> None:
    import pye57

    points, _, _ = sphere()
    invalid = (np.arange(COUNT) % 4 == 0).astype(np.int8)
    file = pye57.E57(str(tmp_path / "scan.e57"), mode="w")
    names = ("cartesianX", "cartesianY", "cartesianZ")
    data = dict(zip(names, points.T.copy(), strict=True))
    file.write_scan_raw({**data, "cartesianInvalidState": invalid})
    file.close()

    cloud = read_points(tmp_path / "scan.e57")

    assert np.abs(cloud.points - points[invalid == 0]).max() < 5e-5


def test_a_las_without_any_color_has_none(tmp_path: Path) -> None:
    import laspy

    las = laspy.LasData(laspy.LasHeader(point_format=2, version="1.2"))
    las.x = las.y = las.z = np.arange(10.0)
    las.write(tmp_path / "scan.las")

    assert read_points(tmp_path / "scan.las").colors is None


def test_las_normals_in_extra_dimensions_are_found(tmp_path: Path) -> None:
    import laspy

    points, normals, _ = sphere()
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.add_extra_dims([laspy.ExtraBytesParams(f"Normal{axis}", np.float32) for axis in "XYZ"])
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    for axis, values in zip("XYZ", normals.T, strict=True):
        las[f"Normal{axis}"] = values
    las.write(tmp_path / "scan.las")

    assert np.array_equal(read_points(tmp_path / "scan.las").normals, normals)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "name",
    [
        *("ascii.pcd", "binary.pcd", "binary_compressed.pcd", "points.las", "points.laz"),
        *("points.e57", "points.npy", "points.npz"),
    ],
)
def test_a_file_cut_in_half_is_refused(samples: dict[str, Path], tmp_path: Path, name: str) -> None:
    data = samples[name].read_bytes()

    error = refusal(tmp_path / name, data[: len(data) // 2])

    # The directory of an archive and the chunk table of LAZ stand at the end.
    late = name in ("points.npz", "points.laz")
    assert error.code == ("unreadable_file" if late else "truncated_file")


@pytest.mark.parametrize("name", ["ascii.pcd", "binary.pcd"])
def test_a_pcd_with_more_rows_than_promised_is_refused(
    samples: dict[str, Path], tmp_path: Path, name: str
) -> None:
    data = samples[name].read_bytes().replace(b"POINTS 200", b"POINTS 198")

    assert refusal(tmp_path / name, data).code == "excess_data"


@pytest.mark.parametrize("name", ["ascii.pcd", "binary.pcd", "binary_compressed.pcd"])
def test_a_pcd_that_promises_a_billion_points_is_refused_by_its_head_alone(
    samples: dict[str, Path], name: str
) -> None:
    data = samples[name].read_bytes().replace(b"POINTS 200", b"POINTS 2000000000")

    with pytest.raises(InputError) as caught:
        sniff_points(data[:1000], len(data))
    assert caught.value.code in ("truncated_file", "unreadable_file")


@pytest.mark.parametrize("name", ["points.las", "points.laz"])
def test_a_las_that_promises_a_billion_points_is_refused_by_its_head_alone(
    samples: dict[str, Path], name: str
) -> None:
    data = bytearray(samples[name].read_bytes())
    struct.pack_into("<Q", data, 247, 10**9)

    with pytest.raises(InputError) as caught:
        sniff_points(bytes(data[:1000]), len(data))
    assert caught.value.code == "truncated_file"


def test_laz_chunks_that_would_make_the_decoder_abort_are_refused(
    samples: dict[str, Path], tmp_path: Path
) -> None:
    data = samples["points.laz"].read_bytes()
    record = data.index(b"laszip encoded") + 52
    huge_chunk = bytearray(data)
    struct.pack_into("<I", huge_chunk, record + 12, 2_400_000_000)
    begin = struct.unpack_from("<I", data, 96)[0]
    huge_layer = bytearray(data)
    struct.pack_into("<I", huge_layer, begin + 8 + 36 + 4, 2_400_000_000)

    assert refusal(tmp_path / "chunk.laz", bytes(huge_chunk)).code == "unreadable_file"
    assert refusal(tmp_path / "layer.laz", bytes(huge_layer)).code == "unreadable_file"


def test_an_e57_is_sniffed_by_its_head_where_there_is_no_more(samples: dict[str, Path]) -> None:
    data = samples["points.e57"].read_bytes()

    assert sniff_points(data[:200], len(data)).points is None
    with pytest.raises(InputError):
        sniff_points(data[:200], len(data) - 1)


def save_npz(path: Path, **arrays: np.ndarray) -> Path:
    np.savez_compressed(path, **arrays)  # type: ignore[arg-type]
    return path


@pytest.mark.parametrize("key", ["points", "xyz", "vertices", "arr_0"])
def test_npz_keys_have_synonyms(tmp_path: Path, key: str) -> None:
    points, _, _ = sphere()

    cloud = read_points(save_npz(tmp_path / "scan.npz", **{key: points.astype(np.float32)}))

    assert np.allclose(cloud.points, points, rtol=1e-6)
    assert cloud.normals is None


@pytest.mark.parametrize(
    ("arrays", "code"),
    [
        ({"faces": np.zeros((4, 3))}, "not_a_point_cloud"),
        ({"points": np.zeros((4, 2))}, "unsupported_property"),
        ({"points": np.zeros(12)}, "unsupported_property"),
        ({"points": np.zeros((4, 3), complex)}, "unsupported_property"),
        ({"points": np.array([[1, 2, {}]], object)}, "unsupported_property"),
        ({"points": np.zeros((4, 3)), "normals": np.zeros((5, 3))}, "unsupported_property"),
        ({"points": np.zeros((0, 3))}, "no_points"),
    ],
)
def test_npz_arrays_that_are_no_scan_are_refused(
    tmp_path: Path, arrays: dict[str, np.ndarray], code: str
) -> None:
    with pytest.raises(InputError) as caught:
        read_points(save_npz(tmp_path / "scan.npz", **arrays))
    assert caught.value.code == code


def test_a_zip_bomb_is_refused_unopened(tmp_path: Path) -> None:
    path = save_npz(tmp_path / "bomb.npz", points=np.zeros((4_000_000, 3)))
    assert path.stat().st_size < 200_000

    with pytest.raises(InputError) as caught:
        sniff_points(path)
    assert caught.value.code == "suspicious_compression"


def test_an_array_that_promises_more_than_its_archive_holds_is_refused(tmp_path: Path) -> None:
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000, 3), }\n"
    array = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + bytes(240)
    with zipfile.ZipFile(tmp_path / "scan.npz", "w") as archive:
        archive.writestr("points.npy", array)

    for path, data in (("scan.npz", None), ("scan.npy", array)):
        if data is not None:
            (tmp_path / path).write_bytes(data)
        with pytest.raises(InputError) as caught:
            read_points(tmp_path / path)
        assert caught.value.code == "truncated_file"


def test_a_zip_without_arrays_is_no_point_cloud(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "report.docx", "w") as archive:
        archive.writestr("word/document.xml", "<w/>")

    with pytest.raises(InputError) as caught:
        read_points(tmp_path / "report.docx")
    assert caught.value.code == "not_a_point_cloud"


@pytest.mark.realdata
def test_occupancy_archives_are_read_by_their_points(realdata: Path) -> None:
    assert len(read_points(realdata / "srb/gt/anchor_occ_points.npz")) == 100_000
