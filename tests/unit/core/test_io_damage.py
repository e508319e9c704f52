"""Damaged files of every format give points or one sentence, and uploads are judged cheaply."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from io_files import write_samples

from visco_core.errors import InputError
from visco_core.io import read_points, sniff_points

ROUNDS = 60

FORMATS = {
    "text.ply": "ply",
    "little.ply": "ply",
    "big.ply": "ply",
    "points.xyz": "xyz",
    "points.csv": "xyz",
    "points.pts": "xyz",
    "points.npz": "npz",
    "points.npy": "npy",
    "ascii.pcd": "pcd",
    "binary.pcd": "pcd",
    "binary_compressed.pcd": "pcd",
    "points.las": "las",
    "points.laz": "las",
    "old.laz": "las",
    "points.e57": "e57",
    "ball.stl": "stl",
    "ball_text.stl": "stl",
    "ball.obj": "obj",
}


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return {path.name: path for path in write_samples(tmp_path_factory.mktemp("samples"))}


def damaged(data: bytes, rng: np.random.Generator, kind: int) -> bytes:
    """Cut off somewhere, or with a few bytes changed anywhere or within the header."""
    if kind == 0:
        return data[: rng.integers(0, len(data))]
    broken = bytearray(data)
    reach = len(data) if kind == 1 else min(len(data), 600)
    for position in rng.integers(0, reach, rng.integers(1, 5)):
        broken[position] = rng.integers(0, 256)
    return bytes(broken)


@pytest.mark.parametrize("name", FORMATS)
def test_damage_gives_points_or_one_sentence(
    samples: dict[str, Path], tmp_path: Path, name: str
) -> None:
    data = samples[name].read_bytes()
    rng = np.random.default_rng(2022)
    path = tmp_path / name
    sentences = []
    for turn in range(ROUNDS):
        broken = damaged(data, rng, turn % 3)
        path.write_bytes(broken)
        for attempt in (
            lambda: sniff_points(broken[:2000], len(broken), name=name),  # noqa: B023
            lambda: sniff_points(path),
            lambda: read_points(path),
        ):
            try:
                attempt()
            except InputError as error:
                sentences.append(str(error))
    assert len(sentences) > ROUNDS // 4
    assert all(s.endswith(".") and "\n" not in s for s in sentences)


@pytest.mark.parametrize(("name", "kind"), FORMATS.items())
def test_the_content_decides_and_not_the_name(
    samples: dict[str, Path], tmp_path: Path, name: str, kind: str
) -> None:
    data = samples[name].read_bytes()
    misnamed = tmp_path / "scan.ply"
    misnamed.write_bytes(data)

    assert sniff_points(misnamed).format == kind
    assert sniff_points(data, name="holiday.jpg").format == kind
    assert np.array_equal(read_points(misnamed).points, read_points(samples[name]).points)


@pytest.mark.parametrize(
    "data",
    [b"\x89PNG\r\n\x1a\n" + bytes(100), b"%PDF-1.7\n", b"<!doctype html>", b"glTF" + bytes(99)],
)
def test_other_kinds_of_file_are_no_point_cloud(data: bytes) -> None:
    with pytest.raises(InputError, match="PLY, XYZ") as caught:
        sniff_points(data, len(data), name="scan.dat")
    assert caught.value.code == "not_a_point_cloud"


def test_too_many_declared_points_are_refused_by_the_head_alone(
    samples: dict[str, Path],
) -> None:
    data = samples["little.ply"].read_bytes()

    with pytest.raises(InputError) as caught:
        sniff_points(data[:500], len(data), max_points=199)
    assert caught.value.code == "too_many_points"
    assert sniff_points(data[:500], len(data), max_points=200).points == 200


def test_a_missing_file_is_an_input_error(tmp_path: Path) -> None:
    for function in (read_points, sniff_points):
        with pytest.raises(InputError, match="check the path") as caught:
            function(tmp_path / "missing.ply")
        assert caught.value.code == "unreadable_file"


def test_sniffing_loads_no_heavy_library(samples: dict[str, Path]) -> None:
    program = (
        "import sys\n"
        "from visco_core.io import sniff_points\n"
        "for path in sys.argv[1:]: sniff_points(path)\n"
        "heavy = {'torch', 'scipy', 'trimesh', 'laspy', 'lazrs', 'pye57', 'pypcd4'}\n"
        "print(sorted(heavy & set(sys.modules)))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, *samples.values()],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "[]"
