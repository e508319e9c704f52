"""Meshes to and from files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from visco_core.errors import InputError
from visco_core.io import obj, ply, stl
from visco_core.io.faces import check_faces
from visco_core.io.glb import UpAxis, read_extras, srgb_bytes, up_rotation, write_glb
from visco_core.io.output import replacing
from visco_core.io.ply_output import float32_suffices, write_ply
from visco_core.io.source import Source, decoding
from visco_core.result import Mesh

MESH_FORMATS = (".glb", ".ply", ".obj", ".stl")
"""Endings that ``write_mesh`` takes."""

_READABLE = (*MESH_FORMATS, ".off")


def write_mesh(
    mesh: Mesh,
    path: str | Path,
    *,
    up_axis: UpAxis = "z",
    metadata: Mapping[str, Any] | None = None,
) -> None:
    """The mesh in the format that the ending of ``path`` names, whole or not at all.

    GLB and PLY lose nothing and carry normals, colours, attributes and ``metadata``; where a GLB
    keeps the offset and what ``up_axis`` does to it is said at ``write_glb``. OBJ has coordinates
    and normals, STL coordinates only, as float32.

    Raises InputError: ``unsupported_output`` for another ending, ``empty_mesh``,
    ``unwritable_output``.
    """
    suffix = check_output(path)
    if not len(mesh.faces):
        raise InputError("empty_mesh", "The mesh has no faces; there is nothing to write.")
    with replacing(path) as file:
        if suffix == ".glb":
            write_glb(mesh, file, up_axis=up_axis, metadata=metadata)
        elif suffix == ".ply":
            write_ply(mesh, file, metadata=metadata)
        else:
            _write_plain(mesh, file, suffix)


def check_output(path: str | Path) -> str:
    """The ending of ``path`` in small letters; raises InputError (``unsupported_output``)."""
    suffix = Path(path).suffix.lower()
    if suffix not in MESH_FORMATS:
        raise InputError(
            "unsupported_output",
            f"{Path(path).name} has no ending that can be written; "
            f"use one of {', '.join(MESH_FORMATS)}.",
        )
    return suffix


def _write_plain(mesh: Mesh, file: BinaryIO, suffix: str) -> None:
    if suffix == ".stl" and not float32_suffices(mesh):
        raise InputError(
            "unsupported_output",
            "STL has too few digits for coordinates this far from the origin; use .glb or .ply.",
        )
    import trimesh
    from trimesh.exchange.obj import export_obj
    from trimesh.exchange.stl import export_stl

    plain = trimesh.Trimesh(
        mesh.vertices, mesh.faces, vertex_normals=mesh.normals, process=False, validate=False
    )
    if suffix == ".stl":
        file.write(export_stl(plain))
    else:
        # 17 digits hold every float64.
        text = export_obj(plain, include_color=False, digits=17)
        file.write(str(text).encode())


def read_mesh(path: str | Path) -> Mesh:
    """The mesh in a PLY, OBJ, OFF, STL or GLB file, its vertices as they stand there.

    All parts of a GLB are joined with their nodes' transforms applied; if ``write_mesh`` made it,
    it comes back in the scan's frame. Raises InputError (``unreadable_file``, ``not_a_mesh`` and,
    for PLY, those of ``read_points``).
    """
    source = Source.of_file(path)
    if source.suffix not in _READABLE:
        raise InputError(
            "not_a_mesh", f"{source.name} is no mesh; give one of {', '.join(_READABLE)}."
        )
    mesh = _READERS.get(source.suffix, _read_scene)(source)
    if not len(mesh.faces):
        raise InputError("not_a_mesh", f"{source.name} has no faces; give a mesh, not a scan.")
    check_faces(mesh.faces, len(mesh.vertices))
    return mesh


def _read_ply(source: Source) -> Mesh:
    cloud, faces = ply.read_with_faces(source)
    return Mesh(
        cloud.points, faces.astype(np.int32), cloud.normals, cloud.colors, dict(cloud.scalars)
    )


def _read_obj(source: Source) -> Mesh:
    cloud, faces = obj.read_with_faces(source)
    return Mesh(cloud.points, faces.astype(np.int32), cloud.normals, cloud.colors)


def _read_stl(source: Source) -> Mesh:
    corners = stl.read_corners(source)
    return Mesh(corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3))


_READERS = {".ply": _read_ply, ".obj": _read_obj, ".stl": _read_stl}


def _read_scene(source: Source) -> Mesh:
    import trimesh

    with decoding(source.suffix[1:].upper()), source.file.open("rb") as file:
        scene = trimesh.load_scene(file, file_type=source.suffix[1:], process=False)
        parts = [_placed(scene, node) for node in scene.graph.nodes_geometry]
        extras = read_extras(source.read_all()) if source.suffix == ".glb" else {}
    if not parts:
        return Mesh(np.empty((0, 3)), np.empty((0, 3), np.int32))
    mesh = _joined(parts)
    if extras.get("up_axis") not in ("x", "y", "z"):
        return mesh
    turn = up_rotation(extras["up_axis"])
    normals = None if mesh.normals is None else mesh.normals @ turn.astype(np.float32)
    return Mesh(mesh.vertices @ turn, mesh.faces, normals, mesh.colors, mesh.attributes)


def _placed(scene: Any, node: str) -> Mesh:
    transform, name = scene.graph[node]
    part = scene.geometry[name]
    if not hasattr(part, "faces"):
        return Mesh(np.empty((0, 3)), np.empty((0, 3), np.int32))
    linear = transform[:3, :3]
    vertices = np.asarray(part.vertices) @ linear.T + transform[:3, 3]
    turned = np.asarray(part.vertex_normals) @ np.linalg.inv(linear)
    lengths = np.linalg.norm(turned, axis=1, keepdims=True)
    normals = (turned / np.where(lengths > 0, lengths, 1.0)).astype(np.float32)
    attributes = {
        key.removeprefix("_").lower(): np.asarray(values, np.float32).ravel()
        for key, values in part.vertex_attributes.items()
        if np.size(values) == len(vertices)
    }
    return Mesh(vertices, np.asarray(part.faces, np.int32), normals, _colors(part), attributes)


def _colors(part: Any) -> np.ndarray | None:
    """glTF's linear vertex colours, which trimesh hands on as they stand in the file."""
    values = getattr(part.visual, "vertex_attributes", {}).get("color")
    if values is None:
        return None
    top = 1.0 if values.dtype.kind == "f" else np.iinfo(values.dtype).max
    return srgb_bytes(values[:, :3] / top)


def _joined(parts: list[Mesh]) -> Mesh:
    if len(parts) == 1:
        return parts[0]
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    normals = [part.normals for part in parts if part.normals is not None]
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([p.faces + s for p, s in zip(parts, starts, strict=True)]).astype(np.int32),
        np.concatenate(normals) if len(normals) == len(parts) else None,
    )
