"""Turns words of the command line into option values, and lists the options there are."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from typing import Any

from visco_core.config import OptionDescription
from visco_core.errors import InputError

_UNITS = {"": 1, "k": 2**10, "m": 2**20, "g": 2**30, "t": 2**40}


def option_values(settings: Iterable[str]) -> dict[str, Any]:
    """``["lambda_v=1e-5", "crop=0,0,0,1,1,1"]`` as a dict; lists are separated by commas.

    Raises InputError (``invalid_option``) for a word without ``=``.
    """
    options = {}
    for setting in settings:
        name, separator, text = setting.partition("=")
        if not separator:
            raise InputError("invalid_option", f"--set takes NAME=VALUE, not {setting!r}.")
        options[name.strip()] = _value(text.strip(), name.strip())
    return options


def _value(text: str, name: str) -> Any:
    if "," in text or name in _LISTS:
        return [_scalar(part) for part in text.split(",")]
    return _scalar(text)


_LISTS = {"outer_steps", "inner_steps", "epochs", "crop"}


def _scalar(text: str) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text


def option_table(options: Iterable[OptionDescription]) -> str:
    """Two lines an option: its name, default, range and unit, then its help."""
    lines = []
    for option in options:
        bounds = ""
        if option.minimum is not None or option.maximum is not None:
            low = "" if option.minimum is None else f"{option.minimum:g}"
            high = "" if option.maximum is None else f"{option.maximum:g}"
            bounds = f" [{low}..{high}]"
        default = "auto" if option.default is None else option.default
        lines.append(f"{option.name:18} {default!s:8}{bounds} {option.unit}\n    {option.help}")
    return "\n".join(lines)


def byte_count(text: str) -> int:
    """``4GiB``, ``512M`` or ``1000000`` as bytes; units are powers of 1024.

    Raises InputError (``invalid_option``) for anything else.
    """
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([kmgt]?)(?:i?b)?\s*", text.lower())
    if match is None:
        raise InputError(
            "invalid_option", f"A memory limit is a number such as 4GiB or 512MiB, not {text!r}."
        )
    return int(float(match[1]) * _UNITS[match[2]])
