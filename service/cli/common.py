"""What the commands that call a service share."""

from __future__ import annotations

import argparse
import json
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


def add_set_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a parameter of /v1/options (repeatable)",
    )


def parse_settings(pairs: list[str]) -> dict[str, Any]:
    """``resolution=128`` and the like; commas make lists. Raises InputError."""
    params = {}
    for pair in pairs:
        name, separator, value = pair.partition("=")
        if not separator or not name:
            raise InputError(
                "invalid_option", f"--set {pair}: write NAME=VALUE, such as --set resolution=128."
            )
        params[name] = _value(value)
    return params


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return [_value(item) for item in text.split(",")] if "," in text else text


def artifact_for(output: Path) -> str:
    """The artifact that a file of this ending holds. Raises InputError."""
    try:
        return _ARTIFACTS[output.suffix.lower()]
    except KeyError:
        endings = ", ".join(_ARTIFACTS)
        raise InputError(
            "unsupported_output", f"{output}: the name must end with one of {endings}."
        ) from None


def with_client(args: argparse.Namespace, action: Callable[[Client], int]) -> int:
    """Run an action; 2 for what the service refuses as wrong input, 1 for other trouble."""
    from service.client import ApiError, Client, ClientError

    try:
        with Client(args.url, args.key) as client:
            return action(client)
    except ApiError as error:
        print(error, file=sys.stderr)
        return 2 if 400 <= error.status < 500 else 1
    except ClientError as error:
        print(error, file=sys.stderr)
        return 1
