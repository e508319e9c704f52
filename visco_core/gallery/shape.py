"""An analytic solid: where its surface is, exactly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from visco_core.result import Mesh

_NEWTON_STEPS = 60
_ON_SURFACE = 1e-12


@dataclass(frozen=True)
class Shape:
    """A closed solid given by a function that is negative inside and zero on the surface.

    sdf: points (P, 3) -> (P,), Lipschitz constant at most 1, so that it never overstates the
    distance; ``exact`` says that it is the Euclidean distance everywhere. bounds (2, 3): low and
    high corner of a box around the solid. genus sums over the ``bodies``, its connected parts.
    color: points (P, 3) -> (P, 3) uint8.
    """

    name: str
    sdf: Callable[[np.ndarray], np.ndarray]
    bounds: np.ndarray
    exact: bool = False
    genus: int = 0
    bodies: int = 1
    color: Callable[[np.ndarray], np.ndarray] | None = None

    @property
    def diagonal(self) -> float:
        """Length of the bounds' diagonal, the unit in which noise is given."""
        return float(np.linalg.norm(self.bounds[1] - self.bounds[0]))

    @property
    def center(self) -> np.ndarray:
        """Middle of the bounds, (3,)."""
        return self.bounds.mean(axis=0)

    def normal(self, points: np.ndarray) -> np.ndarray:
        """Unit outward normals (P, 3) float64: the gradient's direction; on a crease, a mean."""
        gradient = self.gradient(points)
        return gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-300)

    def gradient(self, points: np.ndarray) -> np.ndarray:
        """Central differences of ``sdf``, (P, 3), accurate to about 1e-10."""
        step = 1e-6 * self.diagonal
        columns = []
        for axis in range(3):
            offset = np.zeros(3)
            offset[axis] = step
            columns.append((self.sdf(points + offset) - self.sdf(points - offset)) / (2.0 * step))
        return np.stack(columns, axis=1)

    def project(self, points: np.ndarray) -> np.ndarray:
        """Points (P, 3) moved onto the surface by Newton's method, to 1e-12 of the diagonal.

        The start should lie near the surface. Raises ArithmeticError where the method does not
        arrive, as it may from the solid's inner ridges.
        """
        moved = np.array(points, dtype=np.float64)
        active = np.arange(len(moved))
        for _ in range(_NEWTON_STEPS):
            value = self.sdf(moved[active])
            away = np.abs(value) > _ON_SURFACE * self.diagonal
            active, value = active[away], value[away]
            if not len(active):
                return moved
            gradient = self.gradient(moved[active])
            slope = np.maximum((gradient**2).sum(axis=1), 1e-2)
            moved[active] -= (value / slope)[:, None] * gradient
        raise ArithmeticError(f"{len(active)} points did not reach the surface of {self.name}.")

    def sample(self, count: int, seed: int = 0) -> np.ndarray:
        """``count`` points on the surface, (count, 3), uniform by area up to a voxel's detail."""
        from visco_core.metrics import sample_surface

        return self.project(sample_surface(self.mesh(), count, seed)[0])

    def mesh(self, resolution: int = 128) -> Mesh:
        """A triangle mesh with every vertex on the surface; ``resolution`` voxels a side.

        Creases are cut off by less than a voxel.
        """
        from skimage.measure import marching_cubes

        low, spacing, values = _grid_values(self, resolution)
        vertices, faces, _, _ = marching_cubes(values, 0.0, gradient_direction="descent")
        vertices = self.project(low + spacing * vertices.astype(np.float64))
        return Mesh(vertices, faces.astype(np.int32), self.normal(vertices).astype(np.float32))


def _grid_values(shape: Shape, resolution: int) -> tuple[np.ndarray, float, np.ndarray]:
    """(low corner (3,), spacing, values) of a grid that is evaluated only near the surface.

    A block of nodes whose center lies farther from the surface than any voxel that touches the
    block reaches holds no surface, and keeps the center's value.
    """
    block = 8
    spacing = float((shape.bounds[1] - shape.bounds[0]).max()) / resolution
    # The odd offset keeps nodes off flat faces, where a value of exactly 0 degenerates triangles.
    low = shape.bounds[0] - 2.37 * spacing
    blocks = np.ceil((shape.bounds[1] + 3.0 * spacing - low) / (block * spacing)).astype(int)
    corners = np.stack(np.meshgrid(*map(np.arange, blocks), indexing="ij"), axis=-1) * block
    centers = low + spacing * (corners.reshape(-1, 3) + 0.5 * (block - 1))
    coarse = shape.sdf(centers)
    near = np.abs(coarse) <= 0.5 * np.sqrt(3.0) * (block + 1) * spacing
    values = np.repeat(coarse[:, None], block**3, axis=1)
    local = np.stack(np.meshgrid(*[np.arange(block)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    nodes = corners.reshape(-1, 3)[near][:, None, :] + local
    values[near] = shape.sdf((low + spacing * nodes).reshape(-1, 3)).reshape(-1, block**3)
    grid = values.reshape(*blocks, block, block, block).transpose(0, 3, 1, 4, 2, 5)
    return low, spacing, grid.reshape(blocks * block)
