"""Numba's compiled kernels on disk: whether they belong to today's sources, and are all there.

Numba compiles a kernel anew when the file of that kernel has changed, but it does not follow the
helpers and constants which the kernel takes from other files. So all that is kept goes when any
source of the package has changed: a kernel never runs with yesterday's helper.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from types import ModuleType
from typing import Any

SOURCES = "sources.sha256"
"""Beside the compiled kernels: what they were compiled from."""


def compiled_kernels(kernels: ModuleType) -> dict[str, Any]:
    """Module and name → every function of the package ``kernels`` that numba keeps on disk."""
    from numba.core.dispatcher import Dispatcher

    inside = f"{kernels.__name__}."
    parts = [part for part in vars(kernels).values() if isinstance(part, ModuleType)]
    return {
        f"{found.__module__}.{found.__name__}": found
        for part in parts
        if part.__name__.startswith(inside)
        for found in vars(part).values()
        if isinstance(found, Dispatcher) and found.stats.cache_path is not None
    }


def discard_stale(kernels: ModuleType) -> None:
    """Deletes what was compiled from other sources of the package, or by another numba."""
    mark, digest = _folder(kernels) / SOURCES, _digest(kernels)
    if mark.exists() and mark.read_text(encoding="ascii") == digest:
        return
    for stale in _folder(kernels).glob("*.nb[ic]"):
        stale.unlink(missing_ok=True)
    mark.write_text(digest, encoding="ascii")


def all_compiled(kernels: ModuleType) -> bool:
    """Whether every kernel has been compiled since ``discard_stale`` last deleted any."""
    kept = [index.name for index in _folder(kernels).glob("*.nbi")]
    names = [".".join(name.split(".")[-2:]) + "-" for name in compiled_kernels(kernels)]
    return all(any(index.startswith(name) for index in kept) for name in names)


def _folder(kernels: ModuleType) -> Path:
    """Where numba keeps them: beside the sources, or in the user's cache if that is read-only."""
    return Path(next(iter(compiled_kernels(kernels).values())).stats.cache_path)


def _digest(kernels: ModuleType) -> str:
    import numba

    found = hashlib.sha256(numba.__version__.encode())
    for source in sorted(Path(str(kernels.__file__)).parent.glob("*.py")):
        found.update(source.name.encode() + source.read_bytes())
    return found.hexdigest()
