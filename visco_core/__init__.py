"""Surfaces from point clouds: the solver of VisCo Grids, made fast.

    from visco_core import read_points, reconstruct, write_mesh

    result = reconstruct(read_points("scan.ply"))
    write_mesh(result.mesh, "mesh.glb")

Names are imported when they are first used, so that reading the settings stays cheap.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from visco_core.config import Budget, LevelSchedule, LossWeights, ReconstructionConfig
    from visco_core.errors import InputError, ResourceError, SolveError, Stopped, VisCoError
    from visco_core.io import read_mesh, read_points, sniff_points, write_mesh
    from visco_core.metrics import evaluate
    from visco_core.pointcloud import PointCloud
    from visco_core.preview import render_preview
    from visco_core.progress import Progress
    from visco_core.reconstruction import reconstruct
    from visco_core.result import Mesh, Outcome, Reconstruction

_HOMES = {
    "Budget": "config",
    "InputError": "errors",
    "LevelSchedule": "config",
    "LossWeights": "config",
    "Mesh": "result",
    "Outcome": "result",
    "PointCloud": "pointcloud",
    "Progress": "progress",
    "Reconstruction": "result",
    "ReconstructionConfig": "config",
    "ResourceError": "errors",
    "SolveError": "errors",
    "Stopped": "errors",
    "VisCoError": "errors",
    "evaluate": "metrics",
    "read_mesh": "io",
    "read_points": "io",
    "reconstruct": "reconstruction",
    "render_preview": "preview",
    "sniff_points": "io",
    "write_mesh": "io",
}

__all__ = [
    "Budget",
    "InputError",
    "LevelSchedule",
    "LossWeights",
    "Mesh",
    "Outcome",
    "PointCloud",
    "Progress",
    "Reconstruction",
    "ReconstructionConfig",
    "ResourceError",
    "SolveError",
    "Stopped",
    "VisCoError",
    "evaluate",
    "read_mesh",
    "read_points",
    "reconstruct",
    "render_preview",
    "sniff_points",
    "write_mesh",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return __all__
