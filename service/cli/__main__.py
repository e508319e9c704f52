"""``python -m service.cli COMMAND …``: how the supervisor starts its children."""

from __future__ import annotations

import argparse
import sys
from importlib import import_module


def main() -> int:
    name = sys.argv[1]
    command = import_module(f"service.cli.{name}")
    parser = argparse.ArgumentParser(prog=f"visco {name}", description=command.__doc__)
    command.add_arguments(parser)
    return command.run(parser.parse_args(sys.argv[2:]))


if __name__ == "__main__":
    sys.exit(main())
