"""Run one worker, for many machines."""

from __future__ import annotations

import argparse
from importlib import import_module
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--queue", action="append", default=[], help="take jobs of this queue only (repeatable)"
    )
    parser.add_argument("--device", choices=("auto", "cpu", "cuda"), default="auto")
    parser.add_argument("--data-dir", type=Path, help="folder of database, scans and results")


def run(args: argparse.Namespace) -> int:
    import os

    from service.settings import load_settings

    settings = load_settings(data_dir=args.data_dir)
    # Spawned children read their settings from the environment.
    os.environ.update(settings.environment())
    # By name: the service knows nothing of the worker, and the API never loads it.
    device_class = import_module("worker.identity").choose_device(args.device)
    return import_module("worker.app").run_worker(settings, device_class, args.queue)
