"""Solids whose surface is known exactly, and a virtual scanner to look at them."""

from visco_core.gallery.damage import add_outliers, flip_normals, subsample, vary_density
from visco_core.gallery.ply import encode_scan, write_scan
from visco_core.gallery.sample import make_sample_scan, sample_scan_path
from visco_core.gallery.scanner import Scanner, even_directions, scan
from visco_core.gallery.shape import Shape
from visco_core.gallery.shapes import (
    SHAPES,
    box,
    bracket,
    bumpy_torus,
    octopus,
    sphere,
    thin_plate,
    torus,
    two_bodies,
)
from visco_core.gallery.uniform import uniform_scan

__all__ = [
    "SHAPES",
    "Scanner",
    "Shape",
    "add_outliers",
    "box",
    "bracket",
    "bumpy_torus",
    "encode_scan",
    "even_directions",
    "flip_normals",
    "make_sample_scan",
    "octopus",
    "sample_scan_path",
    "scan",
    "sphere",
    "subsample",
    "thin_plate",
    "torus",
    "two_bodies",
    "uniform_scan",
    "vary_density",
    "write_scan",
]
