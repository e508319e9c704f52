"""Plain kernels of vectors over the nodes: conjugate gradients, Adam, sampling."""

from __future__ import annotations

import torch
from torch import Tensor


def dot(a: Tensor, b: Tensor) -> float:
    """Σ a b, in float64."""
    return float(a.double() @ b.double())


def cg_advance(
    x: Tensor, r: Tensor, p: Tensor, q: Tensor, alpha: float, inverse: Tensor, z: Tensor
) -> float:
    """x += αp, r −= αq, z = inverse · r; returns Σ r z."""
    x += alpha * p
    r -= alpha * q
    torch.mul(inverse, r, out=z)
    return dot(r, z)


def cg_direction(p: Tensor, z: Tensor, beta: float) -> None:
    """p = z + βp."""
    p *= beta
    p += z


def adam_advance(
    values: Tensor,
    gradient: Tensor,
    mean: Tensor,
    square: Tensor,
    rate: float,
    correction: float,
    beta1: float,
    beta2: float,
    tiny: float,
) -> None:
    """One Adam update in place: rate = lr / (1 − β₁ᵗ), correction = 1 − β₂ᵗ."""
    mean.mul_(beta1).add_(gradient, alpha=1 - beta1)
    square.mul_(beta2).addcmul_(gradient, gradient, value=1 - beta2)
    values -= rate * mean / ((square / correction).sqrt() + tiny)


def sample(count: int, fraction: float, seed: int) -> Tensor:
    """(count,) uint8: 1 with probability ``fraction``, by MurmurHash3 of index and seed."""
    low = 0xFFFFFFFF
    h = torch.arange(count) ^ (seed * 0x9E3779B1 & low)
    h = (h ^ h >> 16) * 0x85EBCA6B & low
    h = (h ^ h >> 13) * 0xC2B2AE35 & low
    return ((h ^ h >> 16) < int(fraction * 2**32)).to(torch.uint8)
