"""Compiles ``src`` when the package is installed, with the C++ compiler of the ziglang wheel.

``VISCO_CPU`` names the processor to compile for, such as ``x86_64_v3``, where that is not the one
that compiles.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from setuptools.command.build_ext import build_ext

# Sums may be reordered into vector lanes; infinities and NaN keep their meaning.
FLAGS = (
    *("-std=c++20", "-O3", "-fPIC", "-fvisibility=hidden", "-fno-exceptions", "-fno-rtti", "-g0"),
    *("-fno-math-errno", "-fno-trapping-math", "-fno-signed-zeros", "-fassociative-math"),
    *("-ffp-contract=fast", "-fno-sanitize=undefined", "-Wall", "-Wextra", "-Werror"),
)


class BuildKernels(build_ext):
    """Makes ``kernels.so``: no Python extension, so one serves every interpreter."""

    def get_ext_filename(self, fullname: str) -> str:
        return str(Path(*fullname.split(".")).with_suffix(".so"))

    def build_extension(self, ext) -> None:
        target = Path(self.get_ext_fullpath(ext.name)).absolute()
        target.parent.mkdir(parents=True, exist_ok=True)
        compile_sources([Path(source) for source in ext.sources], target)


def compile_sources(sources: list[Path], target: Path) -> None:
    """One library (``target``) of C++ ``sources``; raises CalledProcessError."""
    zig = sys.executable, "-m", "ziglang"
    cpu = f"-mcpu={os.environ.get('VISCO_CPU') or 'native'}"
    with tempfile.TemporaryDirectory() as folder:
        objects = [str(Path(folder, source.stem).with_suffix(".o")) for source in sources]
        running = [
            subprocess.Popen([*zig, "c++", *FLAGS, cpu, "-c", str(source), "-o", out])
            for source, out in zip(sources, objects, strict=True)
        ]
        for process in running:
            if process.wait():
                raise subprocess.CalledProcessError(process.returncode, process.args)
        # As C: nothing of the C++ library is needed but its headers.
        partial = target.with_suffix(".partial")
        link = "-shared", "-s", cpu, "-lpthread", "-o", str(partial)
        subprocess.run([*zig, "cc", *objects, *link], check=True)
        partial.replace(target)
