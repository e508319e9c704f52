"""Which worker this is, and what it computes on."""

from __future__ import annotations

import os
import platform
import socket
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Literal

from service.settings import DeviceClass

VARIABLE = "VISCO_WORKER_ID"
DEVICE_VARIABLE = "VISCO_WORKER_DEVICE"


@dataclass(frozen=True)
class WorkerIdentity:
    """``name`` is unique for each start of a worker's parent process."""

    name: str
    device_class: DeviceClass

    @classmethod
    def of_parent(cls, device_class: DeviceClass) -> WorkerIdentity:
        return cls(f"{socket.gethostname()}:{os.getpid()}:{os.urandom(3).hex()}", device_class)

    @classmethod
    def of_child(cls) -> WorkerIdentity:
        """The identity that the parent left in the environment."""
        device_class: DeviceClass = "cuda" if os.environ[DEVICE_VARIABLE] == "cuda" else "cpu"
        return cls(os.environ[VARIABLE], device_class)

    def to_environment(self) -> None:
        """Leave the identity to the spawned children."""
        os.environ[VARIABLE] = self.name
        os.environ[DEVICE_VARIABLE] = self.device_class


def choose_device(asked: Literal["auto", "cpu", "cuda"]) -> DeviceClass:
    """The device class for this machine, told without importing torch.

    The parent process never touches CUDA; whether the device really works shows in the child.
    """
    if asked != "auto":
        return asked
    has_driver = any(Path("/dev").glob("nvidia[0-9]*"))
    return "cuda" if has_driver and "+cpu" not in version("torch") else "cpu"


def device_name(device_class: DeviceClass) -> str:
    """A name for people; on CUDA only to be asked in the child that computes."""
    if device_class == "cuda":
        import torch

        return torch.cuda.get_device_name()[:64]
    return f"{platform.machine()}, {os.cpu_count()} cores"[:64]
