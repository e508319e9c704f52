"""The compiled library, and what it wants of its callers.

``src/kernels.h`` declares every function; the arguments of a call are checked against it, so that a
wrong type is an error here and not a crash there.
"""

from __future__ import annotations

import ctypes
import functools
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

FOLDER = Path(__file__).parent
PATH = FOLDER / "kernels.so"
HEADER = FOLDER / "src" / "kernels.h"
PREFIX = "visco_"

_DECLARATION = re.compile(rf"^(\w+) {PREFIX}(\w+)\(([^)]*)\);", re.MULTILINE)
_ITEMS = {
    "float": np.dtype(np.float32),
    "double": np.dtype(np.float64),
    **{f"{name}_t": np.dtype(name) for name in ("uint8", "int16", "int32", "int64")},
}
_NUMBERS = {
    "void": None,
    "float": ctypes.c_float,
    "double": ctypes.c_double,
    "int64_t": ctypes.c_int64,
}


@functools.cache
def functions() -> dict[str, Callable[..., Any]]:
    """Name, without its prefix → function; loads the library the first time."""
    try:
        library = ctypes.CDLL(str(PATH))
    except OSError as error:
        raise ImportError(f"{PATH.name} is not built; install the package again.") from error
    found = {}
    for returned, name, parameters in _DECLARATION.findall(HEADER.read_text(encoding="utf-8")):
        function = library[PREFIX + name]
        function.restype = _NUMBERS[returned]
        function.argtypes = [_argument(text) for text in parameters.split(",")]
        found[name] = function
    return found


def __getattr__(name: str) -> Callable[..., Any]:
    if name not in functions():
        raise AttributeError(name)
    return functions()[name]


def _argument(declared: str) -> Any:
    """What ctypes turns an argument with: ``const float *values`` is an array of float32."""
    constant = declared.strip().startswith("const ")
    kind = declared.replace("const ", "").split()[0]
    return _array(_ITEMS[kind], constant) if "*" in declared else _NUMBERS[kind]


@functools.cache
def _array(dtype: np.dtype, constant: bool) -> type:
    """Passes the place of an array of ``dtype``.

    One that is only read may have any strides, and is copied where it is not contiguous.
    """

    class Argument:
        @classmethod
        def from_param(cls, array: Any) -> ctypes.c_void_p:
            if array.dtype != dtype:
                raise TypeError(f"needs {dtype}, not {array.dtype}")
            if not array.flags.c_contiguous and constant:
                array = np.ascontiguousarray(array)
            elif not (array.flags.c_contiguous and (constant or array.flags.writeable)):
                raise TypeError("needs a contiguous array that can be written to")
            place = ctypes.c_void_p(array.ctypes.data)
            place.array = array  # type: ignore[attr-defined] # for as long as the call lasts
            return place

    return Argument
