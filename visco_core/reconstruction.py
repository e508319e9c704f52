"""Point cloud → levels → mesh, on one page."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from visco_core.clean import clean_points
from visco_core.clock import Clock, peak_memory_bytes
from visco_core.confidence import confidence
from visco_core.config import ReconstructionConfig
from visco_core.extract import extract_isosurface, supported_pieces
from visco_core.frame import Normalisation
from visco_core.grid.samples import spatial_order
from visco_core.held_out import hold_out, searched_level
from visco_core.kernels import choose_backend
from visco_core.level_plan import plan_resolutions
from visco_core.multires import Problem, SolvedLevel, solve_levels
from visco_core.noise import estimate_noise
from visco_core.pointcloud import PointCloud
from visco_core.postprocess import finish_mesh, with_confidence
from visco_core.presets import SMOOTHED, Settings, decide, viscosity_search, weights_for_noise
from visco_core.progress import Check, ProgressCallback, ShouldStop
from visco_core.remarks import remarks
from visco_core.result import Mesh, Outcome, Reconstruction
from visco_core.rims import are_planes, straighten_rims

LevelCallback = Callable[[Mesh, int], None]


def reconstruct(
    cloud: PointCloud,
    config: ReconstructionConfig | None = None,
    *,
    on_progress: ProgressCallback | None = None,
    on_level: LevelCallback | None = None,
    should_stop: ShouldStop | None = None,
    started_at: float | None = None,
) -> Reconstruction:
    """The surface of ``cloud`` as a closed triangle mesh in the scan's own frame.

    ``on_level(mesh, resolution)`` receives an intermediate mesh after each level but the last.
    ``should_stop`` is asked often; Stopped is raised within half a second of its first True.
    ``started_at``, a time.monotonic() value, is when the budget began to run; default: now.

    Raises InputError for a scan or setting that cannot be used, ResourceError where memory or time
    do not suffice for the coarsest level, Stopped, and SolveError.
    """
    config = config or ReconstructionConfig()
    clock = Clock(
        time.monotonic() if started_at is None else started_at,
        config.budget.seconds,
        should_stop,
        on_progress,
    )
    backend = choose_backend(config.backend, config.device, config.threads)
    with clock.phase("prepare", points=len(cloud)) as entry:
        cloud = cloud if config.crop is None else cloud.crop(config.crop)
        cloud, cleaning = clean_points(
            cloud, normals=config.normals, threads=backend.threads, check=clock.check
        )
        entry["notes"] = cleaning.sentences
        frame = Normalisation.of(cloud.points)
    points = frame.to_cube(cloud.points)
    order = spatial_order(points)
    clock.check()
    points = points[order]
    clock.check()
    normals = None if cloud.normals is None else cloud.normals[order]
    planes = normals is not None and are_planes(points, normals, backend.threads, clock.check)
    derived = normals is None or planes
    if normals is None or planes:
        with clock.phase("normals"):
            normals = _best_normals(points, normals, backend.threads, clock.check)
    fitted = None if config.normals == "ignore" else normals
    settings, held = decide(config), None
    if config.profile == "fast":
        with clock.phase("noise") as entry:
            noise = estimate_noise(
                points, normals, SMOOTHED, config.seed, backend.threads, clock.check
            )
            entry.update(
                position=noise.position * frame.scale,
                bending=noise.bending * frame.scale,
                normal_radians=noise.normal,
            )
        resolutions = plan_resolutions(config.resolution)
        weights = weights_for_noise(noise, resolutions, derived=derived, shared=planes)
        search = viscosity_search(noise, resolutions, shared=planes)
        settings = decide(config, weights, search=search)
        if settings.search == "held_out":
            dropped = cleaning.off_surface
            dropped = PointCloud(frame.to_cube(dropped.points), dropped.normals)
            searched = searched_level(noise, resolutions)
            given = points, normals, fitted, dropped, noise.position, searched, config.seed
            held = hold_out(*given)
    problem = Problem(points, normals, fitted, settings, held)

    def surface(level: SolvedLevel) -> Mesh:
        found = extract_isosurface(level.grid, level.values)
        clock.check()
        found = supported_pieces(found, level.samples, backend)
        return Mesh(frame.to_scan(found.vertices), found.faces, found.normals)

    def level_done(level: SolvedLevel) -> None:
        if on_level is not None:
            on_level(surface(level), level.grid.resolution)

    level, outcome = solve_levels(backend, problem, clock, level_done if on_level else None)
    with clock.phase("extract") as entry:
        mesh = finish_mesh(surface(level), cloud, config, backend.threads, clock.check)
        placed = replace(mesh, vertices=frame.to_cube(mesh.vertices))
        scan = points, normals, level.grid.resolution
        sure = confidence(placed, *scan, backend, clock.check)
        if config.trim is None:
            entry["notes"] = remarks(mesh, sure, cloud, backend.threads, clock.check)
        mesh = with_confidence(mesh, sure)
        entry.update(vertices=len(mesh.vertices), triangles=len(mesh.faces))
    backend_name = f"{backend.name} on {backend.device}"
    return Reconstruction(
        mesh, outcome, _report(level.settings, clock, outcome, frame, backend_name)
    )


def _best_normals(
    points: np.ndarray, planes: np.ndarray | None, threads: int, check: Check
) -> np.ndarray:
    """Unit normals (P, 3) of points (P, 3) from nothing else, or from the ``planes`` of a scan."""
    if planes is None:
        from visco_core.normals import estimate_normals

        planes = estimate_normals(points, threads, check)
    return straighten_rims(points, planes, threads, check)


def _report(
    settings: Settings,
    clock: Clock,
    outcome: Outcome,
    frame: Normalisation,
    backend_name: str,
) -> dict[str, Any]:
    """Settings, phases with seconds and peak memory, loss terms per step, outcome, backend."""
    return {
        "settings": {
            **asdict(settings.config),
            "weights": [asdict(weights) for weights in settings.weights],
            "viscosity_search": settings.search,
            "schedule": asdict(settings.schedule),
        },
        "backend": backend_name,
        "outcome": asdict(outcome),
        "frame": {"center": np.asarray(frame.center).tolist(), "scale": frame.scale},
        "phases": clock.phases,
        "steps": clock.steps,
        "seconds": round(clock.elapsed_seconds, 4),
        "peak_memory_bytes": peak_memory_bytes(),
    }
