"""What a reconstruction gives back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh in the scan's own frame and units.

    vertices (V, 3) float64; faces (F, 3) int32, counter-clockwise seen from outside;
    normals (V, 3) float32, unit, outward, or None; colors (V, 3) uint8 or None;
    attributes: name -> (V,) float32, one scalar a vertex.
    """

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray | None = None
    colors: np.ndarray | None = None
    attributes: Mapping[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True)
class Outcome:
    """How the reconstruction ended: a stable code and a sentence with advice.

    ``complete``: the asked resolution was reached. ``budget_exhausted``: the clock ran out and the
    finest finished level came back. ``memory_limited``: the same for the memory limit.
    """

    code: Literal["complete", "budget_exhausted", "memory_limited"]
    message: str
    resolution: int


@dataclass(frozen=True)
class Reconstruction:
    """A mesh, how the run ended, and the report: plain JSON-able values (see docs/method.md)."""

    mesh: Mesh
    outcome: Outcome
    report: Mapping[str, Any]

    @property
    def notes(self) -> list[str]:
        """Sentences for the scan's owner: what was cleaned away, and what is odd about the mesh."""
        return [note for phase in self.report["phases"] for note in phase.get("notes", ())]
