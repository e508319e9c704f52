"""How the surface bends, from what two halves of a scan tell of it."""

import math

import numpy as np
import pytest

from visco_core.bending import Scale, bending, scales
from visco_core.progress import never


def test_halves_of_a_noisy_plane_differ_by_what_noise_makes_of_them_and_tell_it() -> None:
    random = np.random.default_rng(1)
    points = np.append(random.uniform(size=(100_000, 2)), np.zeros((100_000, 1)), 1)
    points[:, 2] = 0.001 * random.standard_normal(len(points))
    seen = list(scales(points, np.tile([0.0, 0.0, 1.0], (len(points), 1)), random, 2, never))
    assert len(seen) > 4
    for scale in seen[1:-1]:
        assert scale.missed == pytest.approx(scale.variance * 0.001**2, rel=0.1)
        assert scale.noise == pytest.approx(0.001, rel=0.15)
        assert scale.other_wall == 0


def _scale(radius: float, missed: float, variance: float = 0.0) -> Scale:
    return Scale(radius, 0.0, 0.0, missed, variance)


@pytest.mark.parametrize(("power", "taken"), [(1.0, 1.75), (3.0, 3.0), (6.0, 4.0)])
def test_bending_goes_on_below_what_was_seen_as_a_power_within_bounds(
    power: float, taken: float
) -> None:
    seen = [_scale(radius, radius ** (2 * power)) for radius in (0.1, 0.2)]
    assert bending(0.05, seen, 0.0) == pytest.approx(0.1**power * 0.5**taken)
    assert bending(0.15, seen, 0.0) == pytest.approx(0.15**power)


def test_radii_at_which_the_noise_hides_the_bending_are_left_out() -> None:
    seen = [_scale(0.06, 0.44e-4, 0.4), _scale(0.12, 1.4e-4, 0.4), _scale(0.24, 64e-4)]
    assert bending(0.06, seen, 0.01) == pytest.approx(0.01 * 0.5**3)


def test_without_two_radii_to_compare_the_bending_is_unknown() -> None:
    assert bending(0.05, [_scale(0.1, math.nan, math.nan)], 0.0) is None
