"""How much memory a solve may take."""

from __future__ import annotations

from pathlib import Path

from service.settings import DeviceClass

_SHARE = 0.85
_CGROUP = Path("/sys/fs/cgroup")


def solve_memory_bytes(device_class: DeviceClass, configured: int, asked: int | None) -> int:
    """The limit for one solve: the smallest of what was configured, asked for and is free."""
    limits = [limit for limit in (configured, asked) if limit]
    free = free_memory_bytes()
    if device_class == "cuda":
        free = min(free, _device_free())
    return min([*limits, int(free * _SHARE)])


def free_memory_bytes() -> int:
    """Memory that this process can still get, from the machine or its control group."""
    import psutil

    free = psutil.virtual_memory().available
    group = _cgroup_free(_CGROUP)
    return free if group is None else min(free, group)


def _device_free() -> int:
    """What the current CUDA device has left, with what torch has kept from earlier solves."""
    import torch

    free, _ = torch.cuda.mem_get_info()
    return free + torch.cuda.memory_reserved() - torch.cuda.memory_allocated()


def _cgroup_free(folder: Path) -> int | None:
    """What a version 2 control group leaves, or None without a limit."""
    try:
        limit = (folder / "memory.max").read_text().strip()
        used = int((folder / "memory.current").read_text())
    except (OSError, ValueError):
        return None
    return None if limit == "max" else max(0, int(limit) - used)
