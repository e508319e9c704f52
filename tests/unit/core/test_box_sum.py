"""Sums over blocks are those of brute force, also at the borders."""

from __future__ import annotations

import numpy as np
import pytest

from visco_core.box_sum import box_sum


@pytest.mark.parametrize("width", [1, 3, 5, 17])
def test_a_block_s_sum_is_that_of_its_cells(width: int) -> None:
    cells = np.random.default_rng(0).integers(0, 9, (6, 7, 8))
    reach = width // 2
    padded = np.pad(cells, reach)
    for place in np.ndindex(cells.shape):
        block = padded[tuple(slice(i, i + width) for i in place)]
        assert box_sum(cells, width)[place] == block.sum()
