"""Compiled kernels of which nodes exist and who is beside whom."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from visco_core.kernels.numba_cpu.common import FREE, ROW, corners_above


@njit(parallel=True, cache=True)
def find_nodes(query, ijk, columns, side):
    missing = ijk.shape[0]
    out = np.empty(query.shape[0], np.int32)
    for q in prange(query.shape[0]):
        c = query[q, 0] * side + query[q, 1]
        low = columns[c]
        high = columns[c + 1]
        end = high
        k = query[q, 2]
        while low < high:
            middle = (low + high) // 2
            if ijk[middle, 2] < k:
                low = middle + 1
            else:
                high = middle
        out[q] = low if low < end and ijk[low, 2] == k else missing
    return out


@njit(parallel=True, cache=True)
def neighbour_table(ijk, columns, side):
    missing = ijk.shape[0]
    out = np.empty((missing, 6), np.int32)
    flags = np.zeros(missing + 1, np.uint8)
    for i in prange(side):
        for j in range(side):
            start = columns[i * side + j]
            stop = columns[i * side + j + 1]
            if start == stop:
                continue
            for t in range(start, stop):
                k = ijk[t, 2]
                out[t, 4] = t - 1 if t > start and ijk[t - 1, 2] == k - 1 else missing
                out[t, 5] = t + 1 if t + 1 < stop and ijk[t + 1, 2] == k + 1 else missing
            for side_index in range(4):
                di = (-1, 1, 0, 0)[side_index]
                dj = (0, 0, -1, 1)[side_index]
                if not (0 <= i + di < side and 0 <= j + dj < side):
                    for t in range(start, stop):
                        out[t, side_index] = missing
                    continue
                other = columns[(i + di) * side + j + dj]
                end = columns[(i + di) * side + j + dj + 1]
                for t in range(start, stop):
                    k = ijk[t, 2]
                    while other < end and ijk[other, 2] < k:
                        other += 1
                    out[t, side_index] = other if other < end and ijk[other, 2] == k else missing
            for t in range(start, stop):
                inner = True
                for a in range(6):
                    inner = inner and out[t, a] < missing
                flags[t] = ROW | FREE if inner else 0
    return out, flags


def free_runs(neighbours, flags):
    free = (flags & FREE > 0).astype(np.int8)
    edges = np.diff(free, prepend=0)
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return np.column_stack([starts, stops, neighbours[starts, :4] - starts[:, None]])


@njit(inline="always")
def _refine_column(ijk, columns, values, side, i, j, limit, write, out_ijk, out_values, cursor):
    """Children in fine column (i, j) whose parents all exist and that lie within ``limit``."""
    parents = np.empty(4, np.int64)
    ends = np.empty(4, np.int64)
    count = 0
    for a in range(i // 2, (i + 1) // 2 + 1):
        for b in range(j // 2, (j + 1) // 2 + 1):
            parents[count] = columns[a * side + b]
            ends[count] = columns[a * side + b + 1]
            count += 1
    found = 0
    first = parents[0]
    for t in range(first, ends[0]):
        k = ijk[t, 2]
        complete = True
        low = values[t]
        minimum = low
        maximum = low
        total = low
        for c in range(1, count):
            while parents[c] < ends[c] and ijk[parents[c], 2] < k:
                parents[c] += 1
            if parents[c] == ends[c] or ijk[parents[c], 2] != k:
                complete = False
                break
            v = values[parents[c]]
            total += v
            minimum = min(minimum, v)
            maximum = max(maximum, v)
        if not complete:
            continue
        mean = total / np.float32(count)
        if abs(mean) < limit or (minimum < 0) != (maximum < 0):
            if write:
                out_ijk[cursor + found, 0] = i
                out_ijk[cursor + found, 1] = j
                out_ijk[cursor + found, 2] = 2 * k
                out_values[cursor + found] = mean
            found += 1
        if t + 1 == ends[0] or ijk[t + 1, 2] != k + 1:
            continue
        v = values[t + 1]
        total += v
        minimum = min(minimum, v)
        maximum = max(maximum, v)
        for c in range(1, count):
            u = parents[c] + 1
            if u >= ends[c] or ijk[u, 2] != k + 1:
                complete = False
                break
            v = values[u]
            total += v
            minimum = min(minimum, v)
            maximum = max(maximum, v)
        if not complete:
            continue
        mean = total / np.float32(2 * count)
        if abs(mean) < limit or (minimum < 0) != (maximum < 0):
            if write:
                out_ijk[cursor + found, 0] = i
                out_ijk[cursor + found, 1] = j
                out_ijk[cursor + found, 2] = 2 * k + 1
                out_values[cursor + found] = mean
            found += 1
    return found


@njit(parallel=True, cache=True)
def _refine(ijk, columns, values, side, limit, fine_columns, write, out_ijk, out_values):
    fine = 2 * side - 1
    for i in prange(fine):
        for j in range(fine):
            c = i * fine + j
            cursor = fine_columns[c] if write else 0
            found = _refine_column(
                ijk, columns, values, side, i, j, limit, write, out_ijk, out_values, cursor
            )
            if not write:
                fine_columns[c + 1] = found


def refine(ijk, columns, values, side, limit):
    fine = 2 * side - 1
    fine_columns = np.zeros(fine * fine + 1, np.int64)
    empty_ijk, empty_values = np.empty((0, 3), np.int16), np.empty(0, np.float32)
    limit = np.float32(limit)
    _refine(ijk, columns, values, side, limit, fine_columns, False, empty_ijk, empty_values)
    np.cumsum(fine_columns, out=fine_columns)
    n = fine_columns[-1]
    out_ijk, out_values = np.empty((n, 3), np.int16), np.zeros(n + 1, np.float32)
    _refine(ijk, columns, values, side, limit, fine_columns, True, out_ijk, out_values)
    return out_ijk, fine_columns, out_values


@njit(parallel=True, cache=True)
def voxel_corners(neighbours, base):
    missing = neighbours.shape[0]
    out = np.empty((base.shape[0], 8), np.int32)
    for m in prange(base.shape[0]):
        if base[m] == missing or not corners_above(base[m], neighbours, out[m]):
            out[m] = missing
    return out
