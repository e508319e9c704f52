"""What the commands share: arguments, wrong input, and talking to a service."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from visco_core.errors import InputError

if TYPE_CHECKING:
    from service.client import Client

_ARTIFACTS = {
    ".glb": "mesh.glb",
    ".ply": "mesh.ply",
    ".png": "preview.png",
    ".json": "report.json",
    ".txt": "log.txt",
}


def add_service_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--url", help="address of the service (VISCO_URL or http://127.0.0.1:8000)")
    parser.add_argument("--key", help="API key (VISCO_KEY)")


def add_listening_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--host", help="address to listen on (127.0.0.1)")
    parser.add_argument("--port", type=int, help="port to listen on (8000)")


def add_data_argument(parser: argparse.ArgumentParser, **options: Any) -> None:
    parser.add_argument(
        "--data-dir", type=Path, help="folder of database, scans and results", **options
    )


def add_device_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--device",
        choices=("auto", "cpu", "cuda"),
        default="auto",
        help="what to solve on (auto: a GPU where there is one)",
    )


def add_set_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a parameter, such as resolution=512 (repeatable; --set help lists them)",
    )


def parse_settings(pairs: list[str]) -> dict[str, Any]:
    """``resolution=128`` and the like, by the parameters' types; commas separate a list's items.

    Raises InputError (``invalid_option``).
    """
    if not pairs:
        return {}
    from service.jobs.params import all_options

    types = {option.name: option.type for option in all_options()}
    params = {}
    for pair in pairs:
        name, separator, value = pair.partition("=")
        if not separator or not name:
            raise InputError(
                "invalid_option", f"--set {pair}: write NAME=VALUE, such as --set resolution=128."
            )
        params[name] = _value(value, types.get(name, "number"))
    return params


def _value(text: str, type: str) -> Any:
    if type == "string":
        return text
    try:
        value = json.loads(text)
    except ValueError:
        value = text
    if type in ("integers", "numbers", "strings") and not isinstance(value, list):
        item = type.removesuffix("s")
        return [_value(part.strip(), item) for part in text.split(",")]
    return value


def print_parameters() -> None:
    """What ``--set`` takes."""
    from service.jobs.params import all_options
    from visco_core.commands.values import option_table

    print(option_table(all_options()))


def artifact_for(output: Path) -> str:
    """The artifact that a file of this ending holds. Raises InputError."""
    try:
        return _ARTIFACTS[output.suffix.lower()]
    except KeyError:
        endings = ", ".join(_ARTIFACTS)
        raise InputError(
            "unsupported_output", f"{output}: the name must end with one of {endings}."
        ) from None


def check_writable(output: Path) -> None:
    """Raises InputError where the file could not be written later."""
    if not os.access(output.parent, os.W_OK):
        raise InputError(
            "unsupported_output", f"{output.parent} is no folder that can be written to; make it."
        )


def with_client(args: argparse.Namespace, action: Callable[[Client], int]) -> int:
    """Run an action; 2 for what the service refuses as wrong input, 1 for other trouble."""
    from service.client import ApiError, Client, ClientError

    try:
        with Client(args.url, args.key) as client:
            return action(client)
    except (ClientError, OSError) as error:
        print(f"visco: {error}", file=sys.stderr)
        wrong_input = isinstance(error, ApiError) and 400 <= error.status < 500
        return 2 if wrong_input else 1
