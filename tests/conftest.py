"""Fixtures that every test may use."""

from __future__ import annotations

from pathlib import Path

import pytest

_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def realdata() -> Path:
    """The folder of real scans beside the project; only tests marked ``realdata`` read it."""
    if not _DATA.is_dir():
        pytest.fail(
            f"This test reads real scans from {_DATA}, which is missing. "
            "Put the data there, or leave these tests out with: -m 'not realdata'."
        )
    return _DATA
