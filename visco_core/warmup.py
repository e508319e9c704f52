"""Compiling the CPU kernels ahead of the first reconstruction; numba keeps them on disk."""

from __future__ import annotations

import numpy as np

from visco_core.kernels import Backend
from visco_core.kernels.cache import all_compiled


def is_warm(backend: Backend) -> bool:
    """Whether every kernel has been compiled since their sources last changed; True off numba."""
    return backend.name != "numba" or all_compiled(backend.kernels)


def warm_up(backend: Backend) -> None:
    """Runs every kernel once on a small sphere; the first time takes about a minute."""
    from visco_core.config import ReconstructionConfig
    from visco_core.pointcloud import PointCloud
    from visco_core.reconstruction import reconstruct

    normals = np.random.default_rng(0).standard_normal((2000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    sphere = PointCloud(normals, normals.astype(np.float32))
    short = {"resolution": 128, "outer_steps": [1], "inner_steps": [2], "lambda_c": 1e-6}
    paper = {"resolution": 64, "profile": "paper", "iterations": 1, "epochs": [1]}
    for options in (short, paper):
        fixed = {"backend": backend.name, "device": backend.device}
        reconstruct(sphere, ReconstructionConfig.from_options(options, **fixed))
