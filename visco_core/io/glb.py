"""Binary glTF 2.0.

Written by hand rather than through trimesh: importing that takes as long as a tenth of a whole
reconstruction, it stores colours as sRGB bytes where glTF wants linear ones, and it leaves no place
for the offset in ``asset.extras``. What is written here is checked by the Khronos validator.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Mapping
from typing import Any, BinaryIO, Literal

import numpy as np

from visco_core.io.faces import vertex_normals
from visco_core.pointcloud import PointCloud
from visco_core.result import Mesh

UpAxis = Literal["x", "y", "z"]

# Unit quaternions (x, y, z, w) that turn the scan's up axis to +Y.
_TO_Y_UP = {
    "x": (0.0, 0.0, 0.5**0.5, 0.5**0.5),
    "y": (0.0, 0.0, 0.0, 1.0),
    "z": (-(0.5**0.5), 0.0, 0.0, 0.5**0.5),
}
_FLOAT, _USHORT, _UINT = 5126, 5123, 5125
_VERTICES, _FACES = 34962, 34963
_POINTS = 0
_GREY = (0.6, 0.62, 0.65, 1.0)
# Extents beyond these lose float32 precision or overflow when a viewer squares them.
_SMALLEST, _LARGEST = 1e-12, 1e12


def write_glb(
    mesh: Mesh, file: BinaryIO, *, up_axis: UpAxis = "z", metadata: Mapping[str, Any] | None = None
) -> None:
    """The mesh as float32 about its own centre, under nodes that put it back into place.

    The upper node turns ``up_axis`` to +Y, the lower one has the translation and, for extents
    beyond 1e-12 to 1e12 only, a scale. ``asset.extras["visco"]`` holds the same in float64,
    ``offset``, ``scale`` and ``up_axis``, beside ``metadata`` (values that JSON can hold):
    scan coordinates = offset + scale * POSITION. Colours become linear, as glTF wants them;
    attributes are ``_NAME``, with zeros for values that are not finite and more underscores where a
    name is taken.
    """
    offset, scale, positions = _recentered(mesh.vertices)
    buffers = _Buffers()
    attributes = {"POSITION": buffers.add(positions, _FLOAT, _VERTICES, bounds=True)}
    attributes["NORMAL"] = buffers.add(_unit_normals(mesh), _FLOAT, _VERTICES)
    if mesh.colors is not None:
        attributes["COLOR_0"] = buffers.add(
            _linear_colors(mesh.colors), _USHORT, _VERTICES, normalized=True
        )
    for name, values in mesh.attributes.items():
        finite = np.nan_to_num(np.asarray(values, np.float32), posinf=0.0, neginf=0.0)
        unused = _attribute_name(name)
        while unused in attributes:
            unused += "_"
        attributes[unused] = buffers.add(finite, _FLOAT, _VERTICES)
    indices = buffers.add(mesh.faces.astype("<u4").ravel(), _UINT, _FACES)
    primitive = {"attributes": attributes, "indices": indices}
    _write_scene(file, buffers, primitive, offset, scale, up_axis, metadata or {})


def write_points_glb(cloud: PointCloud, file: BinaryIO, *, up_axis: UpAxis = "z") -> None:
    """The points and their colours as a glTF point cloud, placed as ``write_glb`` places meshes."""
    offset, scale, positions = _recentered(cloud.points)
    buffers = _Buffers()
    attributes = {"POSITION": buffers.add(positions, _FLOAT, _VERTICES, bounds=True)}
    if cloud.colors is not None:
        colors = _linear_colors(cloud.colors)
        attributes["COLOR_0"] = buffers.add(colors, _USHORT, _VERTICES, normalized=True)
    primitive = {"attributes": attributes, "mode": _POINTS}
    _write_scene(file, buffers, primitive, offset, scale, up_axis, {})


def _write_scene(
    file: BinaryIO,
    buffers: _Buffers,
    primitive: dict[str, Any],
    offset: np.ndarray,
    scale: float,
    up_axis: UpAxis,
    metadata: Mapping[str, Any],
) -> None:
    colored = "COLOR_0" in primitive["attributes"]
    extras = {"offset": offset.tolist(), "scale": scale, "up_axis": up_axis}
    place: dict[str, Any] = {"mesh": 0, "name": "scan frame", "translation": offset.tolist()}
    if scale != 1.0:
        place["scale"] = [scale] * 3
    document = {
        "asset": {"version": "2.0", "generator": "visco", "extras": {"visco": extras}},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1], "name": "up axis", "rotation": _TO_Y_UP[up_axis]}, place],
        "meshes": [{"primitives": [{**primitive, "material": 0}]}],
        "materials": [_material(colored)],
        "accessors": buffers.accessors,
        "bufferViews": buffers.views,
        "buffers": [{"byteLength": buffers.length}],
    }
    extras.update({key: value for key, value in metadata.items() if key not in extras})
    _write_chunks(file, document, buffers)


class _Buffers:
    """The binary chunk as it grows, with a view and an accessor for every array."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.views: list[dict[str, int]] = []
        self.accessors: list[dict[str, Any]] = []
        self.length = 0

    def add(
        self,
        values: np.ndarray,
        component: int,
        target: int,
        *,
        bounds: bool = False,
        normalized: bool = False,
    ) -> int:
        """The accessor's number for values (N,) or (N, 3 or 4), whose rows fill whole words."""
        accessor: dict[str, Any] = {
            "bufferView": len(self.views),
            "componentType": component,
            "count": len(values),
            "type": "SCALAR" if values.ndim == 1 else f"VEC{values.shape[1]}",
        }
        if bounds:
            accessor["min"] = values.min(axis=0).tolist()
            accessor["max"] = values.max(axis=0).tolist()
        if normalized:
            accessor["normalized"] = True
        data = values.tobytes()
        self.views.append(
            {"buffer": 0, "byteOffset": self.length, "byteLength": len(data), "target": target}
        )
        self.accessors.append(accessor)
        self.parts.append(data)
        self.length += len(data)
        return len(self.accessors) - 1


def _recentered(vertices: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """Centre (3,), scale, and (V, 3) float32 with vertices = centre + scale * result."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    center = low + (high - low) / 2
    size = float((high - low).max())
    scale = 1.0 if size == 0 or _SMALLEST <= size <= _LARGEST else size
    return center, scale, ((vertices - center) / scale).astype("<f4")


def _unit_normals(mesh: Mesh) -> np.ndarray:
    """The validator wants unit length everywhere; a vertex without a direction gets +Z."""
    normals = (
        mesh.normals if mesh.normals is not None else vertex_normals(mesh.vertices, mesh.faces)
    )
    lengths = np.sqrt(np.einsum("vi,vi->v", normals, normals, dtype=np.float64))
    known = np.isfinite(lengths) & (lengths > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        unit = (normals / lengths[:, None]).astype("<f4")
    unit[~known] = (0.0, 0.0, 1.0)
    return unit


def _linear_colors(colors: np.ndarray) -> np.ndarray:
    """(V, 4) uint16 linear RGBA of sRGB bytes (V, 3); 8 bits would lose the dark tones."""
    shares = np.arange(256) / 255.0
    linear = np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
    table = np.rint(linear * 65535).astype("<u2")
    rgba = np.full((len(colors), 4), 65535, "<u2")
    rgba[:, :3] = table[colors]
    return rgba


def srgb_bytes(linear: np.ndarray) -> np.ndarray:
    """uint8 sRGB of linear shares: the inverse of what ``write_glb`` does to colours."""
    shares = np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.rint(np.clip(shares, 0, 1) * 255).astype(np.uint8)


def _material(colored: bool) -> dict[str, Any]:
    """Matt, and lit from both sides because trimmed meshes are open."""
    return {
        "name": "scan colours" if colored else "grey",
        "doubleSided": True,
        "pbrMetallicRoughness": {
            "baseColorFactor": (1.0, 1.0, 1.0, 1.0) if colored else _GREY,
            "metallicFactor": 0.0,
            "roughnessFactor": 0.8,
        },
    }


def _attribute_name(name: str) -> str:
    return "_" + re.sub(r"[^A-Z0-9_]", "_", name.upper())


def _write_chunks(file: BinaryIO, document: dict[str, Any], buffers: _Buffers) -> None:
    """Source: Khronos, glTF 2.0 specification, section 4 (GLB)."""
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    total = 12 + 8 + len(text) + 8 + buffers.length
    file.write(struct.pack("<4sII", b"glTF", 2, total))
    file.write(struct.pack("<I4s", len(text), b"JSON") + text)
    file.write(struct.pack("<I4s", buffers.length, b"BIN\0"))
    file.writelines(buffers.parts)


def read_extras(data: bytes) -> dict[str, Any]:
    """What ``write_glb`` left in ``asset.extras``; empty for files from elsewhere."""
    length = struct.unpack_from("<I", data, 12)[0]
    document = json.loads(data[20 : 20 + length])
    found = document.get("asset", {}).get("extras", {})
    return found.get("visco", {}) if isinstance(found, dict) else {}


def up_rotation(up_axis: str) -> np.ndarray:
    """(3, 3): what the upper node of ``write_glb`` does to a vector."""
    return {
        "x": np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
        "y": np.eye(3),
        "z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
    }[up_axis]
