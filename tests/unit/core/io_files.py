"""Small valid files of every format that a scan may have, made by other libraries where one can."""

from __future__ import annotations

from pathlib import Path

import numpy as np

COUNT = 200


def sphere(count: int = COUNT) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (count, 3) on a sphere far from the origin, their unit normals, and colours."""
    rng = np.random.default_rng(7)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    colors = rng.integers(0, 256, (count, 3)).astype(np.uint8)
    points = np.round(normals * 5 + [500.0, -200.0, 30.0], 3)
    return points, normals.astype(np.float32), colors


def write_samples(folder: Path) -> list[Path]:
    """One file of each kind, all with the points of ``sphere()``, except for the mesh formats."""
    writers = (*_PLY_WRITERS, *_TEXT_WRITERS, *_ARRAY_WRITERS, *_SCANNER_WRITERS, *_MESH_WRITERS)
    return [write(folder) for write in writers]


def ply_bytes(
    points: np.ndarray,
    normals: np.ndarray,
    colors: np.ndarray,
    *,
    order: str = "<",
    text: bool = False,
) -> bytes:
    """A PLY of points, normals and colours, written by plyfile: an independent opinion."""
    import io

    import plyfile

    names = ["x", "y", "z", "nx", "ny", "nz", "red", "green", "blue"]
    kinds = ["f8"] * 3 + ["f4"] * 3 + ["u1"] * 3
    rows = np.empty(len(points), list(zip(names, kinds, strict=True)))
    for i, name in enumerate(names):
        rows[name] = (points, normals, colors)[i // 3][:, i % 3]
    element = plyfile.PlyElement.describe(rows, "vertex")
    stream = io.BytesIO()
    plyfile.PlyData([element], text=text, byte_order=order).write(stream)
    return stream.getvalue()


def _ply_ascii(folder: Path) -> Path:
    return _written(folder / "text.ply", ply_bytes(*sphere(), text=True, order="="))


def _ply_little(folder: Path) -> Path:
    return _written(folder / "little.ply", ply_bytes(*sphere()))


def _ply_big(folder: Path) -> Path:
    return _written(folder / "big.ply", ply_bytes(*sphere(), order=">"))


def _xyz(folder: Path) -> Path:
    points, normals, _ = sphere()
    return _table(folder / "points.xyz", np.hstack([points, normals]))


def _csv(folder: Path) -> Path:
    points, normals, colors = sphere()
    table = np.hstack([points, colors, normals])
    return _table(folder / "points.csv", table, ";", "X;Y;Z;R;G;B;Nx;Ny;Nz")


def _pts(folder: Path) -> Path:
    points, _, colors = sphere()
    table = np.hstack([points, np.full((COUNT, 1), -17), colors])
    return _table(folder / "points.pts", table, header=str(COUNT))


def _npz(folder: Path) -> Path:
    points, normals, colors = sphere()
    np.savez_compressed(folder / "points.npz", points=points, normals=normals, colors=colors)
    return folder / "points.npz"


def _npy(folder: Path) -> Path:
    points, normals, _ = sphere()
    np.save(folder / "points.npy", np.hstack([points, normals]))
    return folder / "points.npy"


def _pcd(encoding: str, folder: Path) -> Path:
    import pypcd4

    points, normals, colors = sphere()
    packed = (colors.astype(np.uint32) * [65536, 256, 1]).sum(axis=1).astype(np.uint32)
    names = ("x", "y", "z", "normal_x", "normal_y", "normal_z", "rgb")
    types = (np.float64,) * 3 + (np.float32,) * 3 + (np.uint32,)
    cloud = pypcd4.PointCloud.from_points([*points.T, *normals.T, packed], names, types)
    path = folder / f"{encoding}.pcd"
    cloud.save(path, encoding=pypcd4.Encoding(encoding))
    return path


def _las(name: str, folder: Path, kind: int = 7, version: str = "1.4") -> Path:
    import laspy

    points, _, colors = sphere()
    header = laspy.LasHeader(point_format=kind, version=version)
    header.scales, header.offsets = np.full(3, 1e-3), points.mean(axis=0).round()
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.red, las.green, las.blue = colors.T.astype(np.uint16) * 257
    path = folder / name
    las.write(path)
    return path


def _e57(folder: Path) -> Path:
    """Two scans of half the points each, the second turned and moved away by its pose."""
    import pye57

    points, _, colors = sphere()
    quarter_turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    shift = np.array([10.0, 20.0, 30.0])
    path = folder / "points.e57"
    file = pye57.E57(str(path), mode="w")
    half = COUNT // 2
    for part, rotation, translation in (
        (slice(half), np.array([1.0, 0, 0, 0]), np.zeros(3)),
        (slice(half, COUNT), np.array([0.5**0.5, 0, 0, 0.5**0.5]), shift),
    ):
        own = points[part] if part.start is None else (points[part] - shift) @ quarter_turn
        data = dict(zip(("cartesianX", "cartesianY", "cartesianZ"), own.T.copy(), strict=True))
        data |= dict(zip(("colorRed", "colorGreen", "colorBlue"), colors[part].T, strict=True))
        file.write_scan_raw(
            {name: np.ascontiguousarray(values) for name, values in data.items()},
            rotation=rotation,
            translation=translation,
        )
    file.close()
    return path


def _stl(folder: Path) -> Path:
    import trimesh

    ball = trimesh.creation.icosphere(1)
    return _written(folder / "ball.stl", trimesh.exchange.stl.export_stl(ball))


def _stl_text(folder: Path) -> Path:
    import trimesh

    ball = trimesh.creation.icosphere(1)
    text = trimesh.exchange.stl.export_stl_ascii(ball)
    return _written(folder / "ball_text.stl", text.encode())


def _obj(folder: Path) -> Path:
    import trimesh

    ball = trimesh.creation.icosphere(1)
    return _written(folder / "ball.obj", trimesh.exchange.obj.export_obj(ball).encode())


def _table(path: Path, table: np.ndarray, separator: str = " ", header: str = "") -> Path:
    np.savetxt(path, table, fmt="%.7g", delimiter=separator, header=header, comments="")
    return path


def _written(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


_PLY_WRITERS = (_ply_ascii, _ply_little, _ply_big)
_TEXT_WRITERS = (_xyz, _csv, _pts)
_ARRAY_WRITERS = (_npz, _npy)
_SCANNER_WRITERS = (
    lambda folder: _pcd("ascii", folder),
    lambda folder: _pcd("binary", folder),
    lambda folder: _pcd("binary_compressed", folder),
    lambda folder: _las("points.las", folder),
    lambda folder: _las("points.laz", folder),
    lambda folder: _las("old.laz", folder, kind=3, version="1.2"),
    _e57,
)
_MESH_WRITERS = (_stl, _stl_text, _obj)
