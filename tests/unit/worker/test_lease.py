"""A process that hangs is ended from within."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from conftest import Bench

_HANG = """
import sys, threading
from service.db import Database
from service.settings import load_settings
from worker.lease import Lease
settings = load_settings()
database = Database(settings.sqlalchemy_url)
hung = lambda: print("hung", flush=True)
with Lease(database, settings, "none", 1, 0.2, on_overdue=lambda: None, on_hung=hung):
    threading.Event().wait()
"""


def test_past_its_hard_limit_a_hung_solve_is_recorded_and_killed(bench: Bench) -> None:
    environment = {**os.environ, **bench.settings.environment()}
    done = subprocess.run(
        [sys.executable, "-c", _HANG], env=environment, capture_output=True, timeout=60
    )
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert done.stdout == b"hung\n"
