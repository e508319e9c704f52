"""A device that is not the CPU, for machines that have none.

Its tensors hold CPU tensors and say that they are elsewhere (torch's ``meta`` device, whose real
tensors hold nothing). An operation that mixes them with the CPU's raises, as CUDA does; moving is
what ``to``, ``cpu`` and ``copy_`` are for. So what runs here with the CPU's result keeps its arrays
together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves, tree_map

DEVICE = "meta"


class Elsewhere(Tensor):
    inner: Tensor

    @staticmethod
    def __new__(cls, inner: Tensor) -> Elsewhere:
        form = {"strides": inner.stride(), "storage_offset": inner.storage_offset()}
        found = Tensor._make_wrapper_subclass(
            cls, inner.size(), dtype=inner.dtype, device=DEVICE, **form
        )
        found.inner = inner
        return found

    @classmethod
    def __torch_dispatch__(cls, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        return _run(func, args, kwargs or {})


@contextmanager
def disguised_device() -> Iterator[str]:
    """The device's name; torch's operations on it work inside."""
    with _Moves(), _Operations():
        yield DEVICE


def _is_there(value: Any) -> bool:
    return isinstance(value, Elsewhere)


def _run(func: Any, args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
    tensors = [leaf for leaf in tree_leaves((args, kwargs)) if isinstance(leaf, Tensor)]
    there = any(map(_is_there, tensors))
    here = any(not _is_there(tensor) and tensor.dim() for tensor in tensors)
    name = func._schema.name
    if there and here and name != "aten::copy_":
        raise RuntimeError(f"{name} mixes tensors of the CPU with those of another device")
    device = kwargs.get("device")
    goes = there if device is None else torch.device(device).type == DEVICE
    args_here, kwargs_here = tree_map(lambda v: v.inner if _is_there(v) else v, (args, kwargs))
    if device is not None:
        kwargs_here["device"] = "cpu"
    found = func(*args_here, **kwargs_here)
    if not goes:
        return found
    for given, described in zip(args, func._schema.arguments, strict=False):
        if described.alias_info is not None and described.alias_info.is_write:
            return given
    return tree_map(lambda v: Elsewhere(v) if isinstance(v, Tensor) else v, found)


class _Operations(TorchDispatchMode):
    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        return _run(func, args, kwargs or {})


class _Moves(TorchFunctionMode):
    """What torch decides before it comes to an operation."""

    def __torch_function__(
        self, func: Callable[..., Any], types: Any, args: Any = (), kwargs: Any = None
    ) -> Any:
        first = args[0] if args else None
        if func is Tensor.to and not _is_there(first) and args[1:] == (DEVICE,):
            return Elsewhere(first.clone())
        if _is_there(first):
            if func is Tensor.cpu:
                return first.inner.clone()
            if func is Tensor.tolist:
                return first.inner.tolist()
            if func is Tensor.new_tensor:
                return Elsewhere(torch.tensor(args[1], dtype=first.dtype))
        return func(*args, **(kwargs or {}))
