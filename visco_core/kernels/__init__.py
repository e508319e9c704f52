"""Which compiled or plain kernels a run uses, and where its arrays live.

``reference`` and ``native`` have the same functions with the same signatures, in files of the
same names; the first is the specification of the second. Nothing is imported before
``choose_backend`` is called.
"""

from __future__ import annotations

import ctypes
import importlib
import os
from dataclasses import dataclass
from types import ModuleType
from typing import Any, Literal

import numpy as np

from visco_core.errors import InputError

Array = Any
"""A numpy array under ``native``, a torch tensor under ``reference``."""

ROW, FREE, ENCLOSED = 1, 2, 4
"""Flags of a node: the viscosity loss has a row there; its value is unknown; all 26 nodes around it
are there."""


@dataclass(frozen=True)
class Backend:
    """A package of kernels, the device that its arrays live on, and the CPU threads it may use."""

    name: Literal["native", "reference"]
    device: str
    kernels: ModuleType
    threads: int

    def array(self, values: np.ndarray) -> Array:
        """``values`` on the backend's device, copied only where it must be."""
        if self.name == "native":
            return np.ascontiguousarray(values)
        import torch

        return torch.from_numpy(np.ascontiguousarray(values)).to(self.device)

    def numpy(self, array: Array) -> np.ndarray:
        return array if isinstance(array, np.ndarray) else array.cpu().numpy()

    def zeros(self, *shape: int) -> Array:
        """float32 zeros."""
        if self.name == "native":
            return np.zeros(shape, np.float32)
        import torch

        return torch.zeros(shape, device=self.device)

    def starts(self, counts: Array) -> Array:
        """(N + 1,) int64: where each of N consecutive runs of ``counts`` entries starts."""
        if self.name == "native":
            return np.append(0, np.cumsum(counts, dtype=np.int64))
        import torch

        total = counts.long().cumsum(0)
        return torch.cat([total.new_zeros(1), total])


def choose_backend(name: str = "auto", device: str = "auto", threads: int | None = None) -> Backend:
    """The backend that was asked for; only ``auto`` may choose.

    ``auto`` takes CUDA with the torch kernels where a device answers, else the CPU's compiled ones.
    Raises InputError (``device_unavailable``, ``invalid_option``) when the request cannot be met.
    """
    if device == "cuda" and name == "native":
        raise InputError("invalid_option", "The native backend runs on the CPU; use device cpu.")
    if device in ("auto", "cuda") and name != "native" and _has_cuda(required=device == "cuda"):
        return _reference("cuda", threads)
    if name == "reference":
        return _reference("cpu", threads)
    kernels = importlib.import_module("visco_core.kernels.native")
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    used = min(threads or available or 1, available or 1)
    kernels.set_threads(used)
    return Backend("native", "cpu", kernels, used)


def _reference(device: str, threads: int | None) -> Backend:
    import torch

    if threads is not None:
        torch.set_num_threads(threads)
    kernels = importlib.import_module("visco_core.kernels.reference")
    return Backend("reference", device, kernels, torch.get_num_threads())


def _has_cuda(required: bool) -> bool:
    """Whether torch can use a CUDA device; asks the driver first, since torch is slow to import."""
    if not required and not _driver_present():
        return False
    import torch

    if torch.cuda.is_available():
        return True
    if required:
        raise InputError(
            "device_unavailable", "No CUDA device answers; use --device cpu or install the driver."
        )
    return False


def _driver_present() -> bool:
    try:
        ctypes.CDLL("nvcuda.dll" if os.name == "nt" else "libcuda.so.1")
    except OSError:
        return False
    return True
