"""How `visco serve` divides a machine."""

from __future__ import annotations

from pathlib import Path

import pytest

from service.settings import Settings
from service.supervisor import Supervisor


def test_workers_of_one_machine_share_its_gpus_and_cores(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "2,5")
    monkeypatch.setattr("os.cpu_count", lambda: 8)
    settings = Settings(data_dir=tmp_path)
    workers = Supervisor(settings, None, "auto").workers
    assert [w.environment["CUDA_VISIBLE_DEVICES"] for w in workers] == ["2", "5"]
    assert {w.environment["VISCO_WORKER_THREADS"] for w in workers} == {"4"}
    (alone,) = Supervisor(settings, None, "cpu").workers
    assert "VISCO_WORKER_THREADS" not in alone.environment
