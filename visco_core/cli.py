"""The ``visco`` command. Other packages' commands join by the entry points ``visco.commands``.

An entry point names a module with ``add_arguments(parser)`` and ``run(args) -> exit code``, so that
the core never imports the service. Only the module of the command that runs is imported.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

OWN_COMMANDS = {
    "reconstruct": "visco_core.commands.reconstruct",
    "evaluate": "visco_core.commands.evaluate",
}

HELP = {
    "reconstruct": "turn one scan into a mesh, in this process",
    "evaluate": "measure a mesh against the truth",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command; returns 0, 2 for bad input, 1 for any other failure."""
    from visco_core.errors import InputError, VisCoError

    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        return _run(words)
    except VisCoError as error:
        print(f"visco: {error}", file=sys.stderr)
        return 2 if isinstance(error, InputError) else 1
    except BrokenPipeError:
        return 1
    except KeyboardInterrupt:
        print("visco: stopped", file=sys.stderr)
        return 130


def _run(words: list[str]) -> int:
    name = next((word for word in words if not word.startswith("-")), None)
    others = {} if name in OWN_COMMANDS else _others()
    parser = argparse.ArgumentParser("visco", description="Clean surfaces from scanned points.")
    parser.add_argument("--version", action=_ShowVersion, nargs=0, help="show the version")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for command in [*OWN_COMMANDS, *others]:
        summary = HELP.get(command) or (_summary(others[command]) if name is None else "")
        sub = commands.add_parser(command, help=summary)
        if command == name:
            module = _module(command, others)
            sub.description = (module.__doc__ or "").strip()
            module.add_arguments(sub)
            sub.set_defaults(run=module.run)
    args = parser.parse_args(words)
    return args.run(args)


def _others() -> dict[str, EntryPoint]:
    from importlib.metadata import entry_points

    return {found.name: found for found in entry_points(group="visco.commands")}


def _module(command: str, others: dict[str, EntryPoint]):
    if command in OWN_COMMANDS:
        return importlib.import_module(OWN_COMMANDS[command])
    return others[command].load()


def _summary(found: EntryPoint) -> str:
    first = (found.load().__doc__ or "").strip().splitlines()
    return first[0].rstrip(".") if first else ""


class _ShowVersion(argparse.Action):
    """Looks the version up only when it is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from importlib.metadata import version

        print(f"visco {version('visco')}")
        parser.exit()


if __name__ == "__main__":
    raise SystemExit(main())
