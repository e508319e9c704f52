"""The core as the runner uses it: read, reconstruct, write. Tests put a stand-in here."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from service.settings import DeviceClass
from visco_core.progress import ProgressCallback, ShouldStop

if TYPE_CHECKING:
    from visco_core.config import ReconstructionConfig
    from visco_core.io.glb import UpAxis
    from visco_core.pointcloud import PointCloud
    from visco_core.result import Mesh, Reconstruction

_WARM_POINTS = 2000
# Nobody waits for a larger picture: drawing takes as long as the square of its width.
_PREVIEW_SIZE = (800, 600)


@dataclass(frozen=True)
class Hooks:
    """How a reconstruction talks to its attempt. ``started_at`` is a ``time.monotonic()``."""

    on_progress: ProgressCallback
    on_scan: Callable[[PointCloud], None]
    on_level: Callable[[Mesh, int], None]
    should_stop: ShouldStop
    started_at: float


class Solver(Protocol):
    def warm_up(self) -> None:
        """Load and compile what the first job would otherwise wait for."""
        ...

    def reconstruct(
        self, scan: Path, max_points: int, config: ReconstructionConfig, hooks: Hooks
    ) -> Reconstruction:
        """Raises VisCoError; Stopped when the hooks say so."""
        ...

    def write(
        self, mesh: Mesh, path: Path, up_axis: UpAxis, metadata: Mapping[str, Any] | None
    ) -> None:
        """Write a mesh (.glb, .ply) or its picture (.png), by the path's ending."""
        ...

    def write_points(self, cloud: PointCloud, path: Path, up_axis: UpAxis) -> None:
        """Write a scan as GLB, for viewers."""
        ...


class CoreSolver:
    """The real one. The core is imported when it is first needed: it brings torch along."""

    def __init__(self, device: DeviceClass) -> None:
        self.device: DeviceClass = device

    def warm_up(self) -> None:
        from visco_core import ReconstructionConfig, reconstruct
        from visco_core.gallery import sphere, uniform_scan

        config = ReconstructionConfig(resolution=64, device=self.device)
        done = reconstruct(uniform_scan(sphere(), _WARM_POINTS), config)
        with tempfile.TemporaryDirectory() as folder:
            for name in ("mesh.glb", "mesh.ply", "preview.png"):
                self.write(done.mesh, Path(folder) / name, "z", None)

    def reconstruct(
        self, scan: Path, max_points: int, config: ReconstructionConfig, hooks: Hooks
    ) -> Reconstruction:
        from visco_core import reconstruct
        from visco_core.io import read_points

        cloud = read_points(scan, max_points=max_points)
        hooks.on_scan(cloud)
        return reconstruct(
            cloud,
            config,
            on_progress=hooks.on_progress,
            on_level=hooks.on_level,
            should_stop=hooks.should_stop,
            started_at=hooks.started_at,
        )

    def write(
        self, mesh: Mesh, path: Path, up_axis: UpAxis, metadata: Mapping[str, Any] | None
    ) -> None:
        if path.suffix == ".png":
            from visco_core.preview import render_preview

            render_preview(mesh, path, up_axis=up_axis, size=_PREVIEW_SIZE)
            return
        from visco_core.io import write_mesh

        write_mesh(mesh, path, up_axis=up_axis, metadata=metadata)

    def write_points(self, cloud: PointCloud, path: Path, up_axis: UpAxis) -> None:
        from visco_core.io.glb import write_points_glb

        with path.open("wb") as file:
            write_points_glb(cloud, file, up_axis=up_axis)
