"""What runs on a graphics card keeps its arrays there, and ends as it does on the CPU."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import torch
from disguised import disguised_device
from kernel_inputs import INPUTS, TOPOLOGIES
from test_kernels import call

from visco_core import ReconstructionConfig, level_plan, reconstruct, reconstruction
from visco_core.gallery import sphere, uniform_scan
from visco_core.kernels import Backend, reference


@pytest.fixture
def elsewhere() -> Iterator[Backend]:
    with disguised_device() as device:
        yield Backend("reference", device, reference, 1)


def test_the_disguised_device_refuses_to_mix_with_the_cpu(elsewhere: Backend) -> None:
    there = elsewhere.array(np.ones(3, np.float32))
    assert elsewhere.numpy(there + there).tolist() == [2, 2, 2]
    with pytest.raises(RuntimeError, match="mixes"):
        there + torch.ones(3)
    with pytest.raises(RuntimeError, match="mixes"):
        torch.ones(3)[there.long()]
    with pytest.raises(RuntimeError):
        there.numpy()


@pytest.mark.parametrize("name", INPUTS)
def test_a_kernel_keeps_to_the_device_of_its_arrays(
    name: str, elsewhere: Backend, reference_backend: Backend
) -> None:
    arguments = INPUTS[name](TOPOLOGIES["band"]())
    found = call(elsewhere, name, *arguments)
    for ours, expected in zip(found, call(reference_backend, name, *arguments), strict=True):
        np.testing.assert_array_equal(ours, expected)


@pytest.mark.parametrize(
    ("options", "noise", "search"),
    [
        ({"lambda_c": 1e-6}, 0.0, "leave_one_out"),
        ({"profile": "paper"}, 0.0, "none"),
        ({}, 0.01, "held_out"),
        ({}, 0.03, "held_out"),
    ],
    ids=str,
)
def test_a_whole_reconstruction_keeps_to_its_device(
    options: dict[str, object],
    noise: float,
    search: str,
    elsewhere: Backend,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Points are held out of the second level, or of the coarsest where noise is wide."""
    monkeypatch.setattr(level_plan, "COARSEST", 16)
    monkeypatch.setattr(level_plan, "COARSEST_AT_MOST", 24)
    short = {"resolution": 64, "outer_steps": [1], "inner_steps": [4], "iterations": 2}
    config = ReconstructionConfig.from_options(
        {**short, "epochs": [1], **options}, backend="reference", device="cpu", threads=1
    )
    cloud = uniform_scan(sphere(), 2000, noise=noise)
    expected = reconstruct(cloud, config)
    assert expected.report["settings"]["viscosity_search"] == search
    monkeypatch.setattr(reconstruction, "choose_backend", lambda *_: elsewhere)
    found = reconstruct(cloud, config)
    assert found.report["backend"] == f"reference on {elsewhere.device}"
    np.testing.assert_array_equal(found.mesh.vertices, expected.mesh.vertices)
    np.testing.assert_array_equal(found.mesh.faces, expected.mesh.faces)
