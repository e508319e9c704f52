"""Exactly known surfaces by name: the gallery's shapes and the meshes in a folder."""

from __future__ import annotations

from pathlib import Path

from visco_core import gallery
from visco_core.io import read_mesh
from visco_core.result import Mesh

_ENDINGS = (".ply", ".obj", ".off", ".stl")
_GALLERY_RESOLUTION = 300


def load_surface(name: str, folder: Path | None) -> Mesh:
    """The mesh file in ``folder`` whose name ends with ``name``, or the gallery's shape."""
    files = sorted(folder.iterdir()) if folder is not None else []
    for path in files:
        if path.suffix.lower() in _ENDINGS and path.stem.lower().endswith(name.lower()):
            return read_mesh(path)
    if name not in gallery.SHAPES:
        raise SystemExit(f"there is no surface {name!r} in {folder} or in the gallery")
    return gallery.SHAPES[name]().mesh(_GALLERY_RESOLUTION)
