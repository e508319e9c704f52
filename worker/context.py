"""What a worker's child process holds: built once when it starts."""

from __future__ import annotations

import logging
import time

from service.db import Database
from service.jobs.queues import Bell
from service.observability import configure_logging
from service.settings import load_settings
from service.storage import open_storage
from worker.identity import WorkerIdentity, device_name
from worker.runner import Runner
from worker.solver import CoreSolver, Solver

log = logging.getLogger(__name__)
_runner: Runner | None = None


def open_child(solver: Solver | None = None) -> Runner:
    """Build the runner of this process and warm the solver up."""
    global _runner
    settings = load_settings()
    configure_logging(settings)
    identity = WorkerIdentity.of_child()
    begun = time.monotonic()
    chosen = solver or CoreSolver(identity.device_class)
    try:
        chosen.warm_up()
    except Exception:
        # The first job shows what is wrong, with a message that its owner can see.
        log.exception("The solver could not be warmed up")
    _runner = Runner(
        Database(settings.sqlalchemy_url),
        open_storage(settings),
        Bell(settings),
        settings,
        identity,
        device_name(identity.device_class),
        chosen,
    )
    log.info("Ready to solve on %s after %.1f s", _runner.device_name, time.monotonic() - begun)
    return _runner


def child_runner() -> Runner:
    """The runner of this process."""
    return _runner or open_child()
