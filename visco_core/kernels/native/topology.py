"""Which nodes exist and who is beside whom."""

from __future__ import annotations

import numpy as np

from visco_core.kernels.native import library


def find_nodes(query, ijk, columns, side):
    out = np.empty(len(query), np.int32)
    library.find_nodes(query, len(query), ijk, len(ijk), columns, side, out)
    return out


def neighbour_table(ijk, columns, side):
    neighbours, flags = np.empty((len(ijk), 6), np.int32), np.zeros(len(ijk) + 1, np.uint8)
    library.neighbour_table(ijk, len(ijk), columns, side, neighbours, flags)
    return neighbours, flags


def free_runs(neighbours, flags, slabs):
    runs = np.empty((library.count_free_runs(flags, len(neighbours)), 6), np.int64)
    library.free_runs(neighbours, flags, len(neighbours), runs)
    return runs, np.searchsorted(runs[:, 0], slabs)


def refine(ijk, columns, neighbours, values, carried, side, limit):
    crossed = np.zeros(len(ijk), np.uint8)
    library.crossed(values, neighbours, len(ijk), crossed)
    fine = 2 * side - 1
    fine_columns = np.zeros(fine * fine + 1, np.int64)
    coarse = ijk, columns, values, crossed, side, limit
    library.refine_counts(*coarse, fine_columns)
    fine_ijk = np.empty((fine_columns[-1], 3), np.int16)
    fine_values = np.zeros(fine_columns[-1] + 1, np.float32)
    fine_carried = np.zeros((2, len(fine_values)), np.float32)
    out = fine_columns, fine_ijk, fine_values, fine_carried
    library.refine(*coarse, carried, carried.shape[1], *out)
    return fine_ijk, fine_columns, fine_values, fine_carried


def voxel_corners(neighbours, base):
    out = np.empty((len(base), 8), np.int32)
    library.voxel_corners(neighbours, len(neighbours), base, len(base), out)
    return out
