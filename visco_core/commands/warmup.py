"""Compile the CPU kernels, once for this machine: a first reconstruction then starts at once."""

from __future__ import annotations

import argparse
import time


def add_arguments(parser: argparse.ArgumentParser) -> None:
    del parser


def run(args: argparse.Namespace) -> int:
    del args
    from visco_core.kernels import choose_backend
    from visco_core.warmup import is_warm, warm_up

    backend = choose_backend("numba", "cpu")
    _draw_once()
    if is_warm(backend):
        print("The CPU kernels are compiled already.")
        return 0
    begun = time.monotonic()
    warm_up(backend)
    print(f"Compiled the CPU kernels in {time.monotonic() - begun:.0f} s.")
    return 0


def _draw_once() -> None:
    """Compiles what draws previews."""
    import numpy as np

    from visco_core.preview import render_preview
    from visco_core.result import Mesh

    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)
    render_preview(Mesh(corners, faces), size=(64, 48))
