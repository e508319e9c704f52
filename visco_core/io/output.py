"""Files that are there whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from visco_core.errors import InputError


@contextmanager
def replacing(path: str | Path) -> Iterator[BinaryIO]:
    """A file to write that takes the name ``path`` only when the block ends without an error.

    It lies beside ``path`` under a hidden name until then. Raises InputError
    (``unwritable_output``) where the folder cannot be written to.
    """
    path = Path(path)
    draft = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with draft.open("wb") as file:
            yield file
        draft.replace(path)
    except OSError as error:
        reason = error.strerror or "unknown reason"
        raise InputError(
            "unwritable_output",
            f"{path} cannot be written ({reason}); choose another place or make room.",
        ) from error
    finally:
        draft.unlink(missing_ok=True)
