"""From named columns, as most formats have them, to a PointCloud."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from visco_core.errors import InputError
from visco_core.pointcloud import PointCloud

_NAMES = {
    "x": ("x", "px", "posx", "pos_x", "position_x", "cartesianx"),
    "y": ("y", "py", "posy", "pos_y", "position_y", "cartesiany"),
    "z": ("z", "pz", "posz", "pos_z", "position_z", "cartesianz"),
    "nx": ("nx", "normal_x", "normalx", "n_x", "normals_x", "nor:normalx"),
    "ny": ("ny", "normal_y", "normaly", "n_y", "normals_y", "nor:normaly"),
    "nz": ("nz", "normal_z", "normalz", "n_z", "normals_z", "nor:normalz"),
    "red": ("red", "r", "diffuse_red", "colorred", "color_red", "cr", "rf"),
    "green": ("green", "g", "diffuse_green", "colorgreen", "color_green", "cg", "gf"),
    "blue": ("blue", "b", "diffuse_blue", "colorblue", "color_blue", "cb", "bf"),
}
_OPACITY = ("alpha", "a", "diffuse_alpha", "coloralpha")
_ROLES = {name: role for role, names in _NAMES.items() for name in names}


def find_roles(names: Iterable[str]) -> dict[str, str]:
    """role -> name: which of ``names`` hold x y z, nx ny nz, red green blue; whole triples only.

    The first name wins where two would do.
    """
    found: dict[str, str] = {}
    for name in names:
        role = _ROLES.get(name.strip().lower())
        if role:
            found.setdefault(role, name)
    for triple in (("nx", "ny", "nz"), ("red", "green", "blue")):
        if not all(role in found for role in triple):
            for role in triple:
                found.pop(role, None)
    return found


def require_coordinates(roles: Mapping[str, str]) -> None:
    """Raises InputError (``unsupported_property``) where x, y or z is missing."""
    missing = [axis for axis in "xyz" if axis not in roles]
    if missing:
        raise InputError(
            "unsupported_property",
            f"The points have no {' and no '.join(missing)} coordinate; "
            "export them with x, y and z.",
        )


def assemble(columns: Mapping[str, np.ndarray]) -> PointCloud:
    """A PointCloud from columns of (P,) numbers; what has no role becomes a scalar.

    A colour's opacity is left out.
    Raises InputError (``unsupported_property``) where x, y or z is missing.
    """
    roles = find_roles(columns)
    require_coordinates(roles)
    taken = set(roles.values())
    points = _stack(columns, [roles[axis] for axis in "xyz"], np.float64)
    normals = colors = None
    if "nx" in roles:
        normals = _stack(columns, [roles[n] for n in ("nx", "ny", "nz")], np.float32)
    if "red" in roles:
        names = [roles[c] for c in ("red", "green", "blue")]
        taken.update(name for name in columns if name.lower() in _OPACITY)
        colors = to_bytes(_stack(columns, names, columns[names[0]].dtype.newbyteorder("=")))
    scalars = {n: to_float32(v) for n, v in columns.items() if n not in taken}
    return PointCloud(points, normals, colors, scalars)


def to_bytes(colors: np.ndarray) -> np.ndarray:
    """Colours (P, 3) of any type and range as uint8.

    Floats up to 1 are shares, integers above 255 have 16 bits. Not-a-number becomes black.
    """
    if colors.dtype == np.uint8:
        return colors
    top = np.nanmax(colors, initial=0)
    if colors.dtype.kind == "f":
        scale = 255.0 if top <= 1 else 1.0 if top <= 255 else 1 / 257
    else:
        scale = 1.0 if top <= 255 else 1 / 257
    scaled = np.nan_to_num(colors.astype(np.float64) * scale, posinf=255.0)
    return np.clip(np.rint(scaled), 0, 255).astype(np.uint8)


def to_float32(values: np.ndarray) -> np.ndarray:
    """float32 of any numbers; what is too large becomes infinite, without a warning."""
    with np.errstate(over="ignore", invalid="ignore"):
        return values.astype(np.float32)


def _stack(columns: Mapping[str, np.ndarray], names: list[str], dtype: np.typing.DTypeLike):
    stacked = np.empty((len(columns[names[0]]), len(names)), dtype)
    with np.errstate(over="ignore", invalid="ignore"):
        for i, name in enumerate(names):
            stacked[:, i] = columns[name]
    return stacked
