"""Run one worker, for many machines."""

from __future__ import annotations

import argparse
from importlib import import_module

from service.cli.common import add_data_argument, add_device_argument
from visco_core.errors import InputError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--queue",
        action="append",
        default=[],
        help="take jobs of this queue only, such as visco.cpu.high (repeatable)",
    )
    add_device_argument(parser)
    add_data_argument(parser)


def run(args: argparse.Namespace) -> int:
    import os

    from service.jobs.queues import queue_names
    from service.settings import load_settings

    settings = load_settings(data_dir=args.data_dir)
    # Spawned children read their settings from the environment.
    os.environ.update(settings.environment())
    # By name: the service knows nothing of the worker, and the API never loads it.
    device_class = import_module("worker.identity").choose_device(args.device)
    known = queue_names(device_class)
    for name in args.queue:
        if name not in known:
            raise InputError(
                "unknown_queue",
                f"{name} is no queue of {device_class} workers; choose from {', '.join(known)}.",
            )
    return import_module("worker.app").run_worker(settings, device_class, args.queue)
