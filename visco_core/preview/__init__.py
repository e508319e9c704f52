"""Pictures of meshes and scans, without a display or a graphics card."""

from visco_core.preview.picture import render_points, render_preview

__all__ = ["render_points", "render_preview"]
