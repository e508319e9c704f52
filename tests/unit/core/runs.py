"""Runs on a small ball, and a clock, as the tests of solves and whole runs share them."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from visco_core.config import LevelSchedule, ReconstructionConfig
from visco_core.mesh_health import mesh_health
from visco_core.pointcloud import PointCloud
from visco_core.progress import Progress
from visco_core.reconstruction import reconstruct
from visco_core.result import Mesh, Reconstruction

QUICK = LevelSchedule(outer_steps=(2,), inner_steps=(12,))


def config(resolution: int = 128, **fields: Any) -> ReconstructionConfig:
    """By default two levels, 64 and 128, and few steps; on the CPU."""
    fields = {"schedule": QUICK, "device": "cpu", "threads": 2, **fields}
    return ReconstructionConfig(resolution=resolution, **fields)


def voxel(result: Reconstruction) -> float:
    """The finest level's grid spacing in scan units."""
    return result.report["frame"]["scale"] / result.outcome.resolution


def assert_one_closed_body(mesh: Mesh, bodies: int = 1, genus: int = 0) -> None:
    health = mesh_health(mesh)
    assert health["watertight"]
    assert health["outward"]
    assert (health["components"], health["genus"]) == (bodies, genus)


def off_sphere(result: Reconstruction) -> float:
    """Largest distance of a vertex from the unit sphere, in voxels."""
    radius = np.linalg.norm(result.mesh.vertices, axis=1)
    return float(np.abs(radius - 1).max()) / voxel(result)


@dataclasses.dataclass
class Record:
    """A run with all that it told."""

    result: Reconstruction
    progress: list[Progress]
    levels: list[tuple[Mesh, int]]

    @classmethod
    def of(cls, cloud: PointCloud) -> Record:
        progress: list[Progress] = []
        levels: list[tuple[Mesh, int]] = []
        result = reconstruct(
            cloud,
            config(),
            on_progress=progress.append,
            on_level=lambda mesh, resolution: levels.append((mesh, resolution)),
        )
        return cls(result, progress, levels)


@dataclasses.dataclass
class Pace:
    """Counts what it is asked; late from its ``patience``-th question on."""

    patience: float = float("inf")
    checks: int = 0
    questions: int = 0

    def check(self) -> None:
        self.checks += 1

    def late(self) -> bool:
        self.questions += 1
        return self.questions > self.patience
