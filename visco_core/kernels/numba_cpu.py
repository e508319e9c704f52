"""Compiled CPU kernels: the twins of ``reference``, one for one, on numpy arrays.

Shapes and meanings are given there. Every sum over nodes is taken in blocks of fixed size and added
up in order, so that results do not depend on the number of threads; sums into nodes that several
voxels share go by i-slab, even slabs first, so that no two threads write to one node.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

BLOCK = 4096
ROW, FREE = 1, 2


@njit(cache=True)
def _in_order(parts):
    """Their sum; ``parts.sum()`` would be split among the threads."""
    total = 0.0
    for part in parts:
        total += part
    return total


@njit(parallel=True, fastmath=True, cache=True)
def linearise(values, neighbours, flags, half_inverse, laplace, slopes, flux):
    n = neighbours.shape[0]
    blocks = (n + BLOCK - 1) // BLOCK
    partial = np.zeros(blocks)
    for b in prange(blocks):
        total = 0.0
        for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
            if flags[i] & ROW == 0:
                slopes[i] = 0.0
                flux[i] = 0.0
                continue
            a0 = values[neighbours[i, 0]]
            a1 = values[neighbours[i, 1]]
            b0 = values[neighbours[i, 2]]
            b1 = values[neighbours[i, 3]]
            c0 = values[neighbours[i, 4]]
            c1 = values[neighbours[i, 5]]
            v = values[i]
            gx = (a1 - a0) * half_inverse
            gy = (b1 - b0) * half_inverse
            gz = (c1 - c0) * half_inverse
            norm = np.sqrt(gx * gx + gy * gy + gz * gz)
            s = np.float32(1.0) if v > 0 else (np.float32(-1.0) if v < 0 else np.float32(0.0))
            k = s * half_inverse / max(norm, np.float32(1e-6))
            slopes[i, 0] = k * gx
            slopes[i, 1] = k * gy
            slopes[i, 2] = k * gz
            r = (norm - np.float32(1.0)) * s - laplace * (
                a0 + a1 + b0 + b1 + c0 + c1 - np.float32(6.0) * v
            )
            for axis in range(3):
                flux[i, axis] = slopes[i, axis] * r
            flux[i, 3] = r
            total += r * r
        partial[b] = total
    return _in_order(partial)


@njit(parallel=True, fastmath=True, cache=True)
def viscosity_rows(v, slopes, neighbours, flags, laplace, flux):
    n = neighbours.shape[0]
    for i in prange(n):
        if flags[i] & ROW == 0:
            flux[i] = 0.0
            continue
        a0 = v[neighbours[i, 0]]
        a1 = v[neighbours[i, 1]]
        b0 = v[neighbours[i, 2]]
        b1 = v[neighbours[i, 3]]
        c0 = v[neighbours[i, 4]]
        c1 = v[neighbours[i, 5]]
        r = (
            slopes[i, 0] * (a1 - a0)
            + slopes[i, 1] * (b1 - b0)
            + slopes[i, 2] * (c1 - c0)
            - laplace * (a0 + a1 + b0 + b1 + c0 + c1 - np.float32(6.0) * v[i])
        )
        flux[i, 0] = slopes[i, 0] * r
        flux[i, 1] = slopes[i, 1] * r
        flux[i, 2] = slopes[i, 2] * r
        flux[i, 3] = r


@njit(parallel=True, fastmath=True, cache=True)
def viscosity_columns(flux, neighbours, flags, laplace, scale, out):
    n = neighbours.shape[0]
    for i in prange(n):
        if flags[i] & FREE == 0:
            out[i] = 0.0
            continue
        a0 = neighbours[i, 0]
        a1 = neighbours[i, 1]
        b0 = neighbours[i, 2]
        b1 = neighbours[i, 3]
        c0 = neighbours[i, 4]
        c1 = neighbours[i, 5]
        out[i] = scale * (
            flux[a0, 0]
            - flux[a1, 0]
            + flux[b0, 1]
            - flux[b1, 1]
            + flux[c0, 2]
            - flux[c1, 2]
            - laplace
            * (
                flux[a0, 3]
                + flux[a1, 3]
                + flux[b0, 3]
                + flux[b1, 3]
                + flux[c0, 3]
                + flux[c1, 3]
                - np.float32(6.0) * flux[i, 3]
            )
        )


@njit(parallel=True, fastmath=True, cache=True)
def viscosity_diagonal(slopes, neighbours, flags, laplace, scale, out):
    n = neighbours.shape[0]
    for i in prange(n):
        if flags[i] & FREE == 0:
            out[i] = 0.0
            continue
        total = np.float32(36.0) * laplace * laplace if flags[i] & ROW else np.float32(0.0)
        for axis in range(3):
            low = neighbours[i, 2 * axis]
            high = neighbours[i, 2 * axis + 1]
            if flags[low] & ROW:
                total += (slopes[low, axis] - laplace) ** 2
            if flags[high] & ROW:
                total += (slopes[high, axis] + laplace) ** 2
        out[i] = scale * total


@njit(parallel=True, fastmath=True, cache=True)
def point_matvec(v, corners, matrices, slabs, flags, out):
    count = slabs.shape[0] - 1
    for parity in range(2):
        for half in prange((count + 1 - parity) // 2):
            slab = 2 * half + parity
            x = np.empty(8, np.float32)
            for m in range(slabs[slab], slabs[slab + 1]):
                for c in range(8):
                    x[c] = v[corners[m, c]]
                for r in range(8):
                    node = corners[m, r]
                    if flags[node] & FREE:
                        total = np.float32(0.0)
                        for c in range(8):
                            total += matrices[m, r, c] * x[c]
                        out[node] += total


@njit(inline="always")
def _corners(i, neighbours, corners):
    """The voxel's eight nodes above node i; False where one is missing."""
    missing = neighbours.shape[0]
    corners[0] = i
    for c in range(1, 8):
        if c & 1:
            low, axis = c - 1, 5
        elif c & 2:
            low, axis = c - 2, 3
        else:
            low, axis = c - 4, 1
        corners[c] = neighbours[corners[low], axis]
        if corners[c] == missing:
            return False
    return True


@njit(parallel=True, cache=True)
def voxel_corners(neighbours, base):
    missing = neighbours.shape[0]
    out = np.empty((base.shape[0], 8), np.int32)
    for m in prange(base.shape[0]):
        if base[m] == missing or not _corners(base[m], neighbours, out[m]):
            out[m] = missing
    return out


@njit(parallel=True, fastmath=True, cache=True)
def scatter(per_corner, corners, slabs, flags, out):
    count = slabs.shape[0] - 1
    for parity in range(2):
        for half in prange((count + 1 - parity) // 2):
            slab = 2 * half + parity
            for m in range(slabs[slab], slabs[slab + 1]):
                for c in range(8):
                    if flags[corners[m, c]] & FREE:
                        out[corners[m, c]] += per_corner[m, c]


@njit(inline="always")
def _trilinear(u, v, w, weights, gradients):
    """Weights and gradients, in voxels, of the eight corners at (u, v, w) in [0, 1]."""
    one = np.float32(1.0)
    for c in range(8):
        x = u if c & 4 else one - u
        y = v if c & 2 else one - v
        z = w if c & 1 else one - w
        weights[c] = x * y * z
        gradients[c, 0] = y * z if c & 4 else -y * z
        gradients[c, 1] = x * z if c & 2 else -x * z
        gradients[c, 2] = x * y if c & 1 else -x * y


@njit(parallel=True, fastmath=True, cache=True)
def _point_system(
    local, normals, starts, resolution, point_weight, normal_weight, matrices, vectors
):
    for m in prange(starts.shape[0] - 1):
        w = np.empty(8, np.float32)
        g = np.empty((8, 3), np.float32)
        for k in range(starts[m], starts[m + 1]):
            _trilinear(local[k, 0], local[k, 1], local[k, 2], w, g)
            for r in range(8):
                total = np.float32(0.0)
                for a in range(3):
                    g[r, a] *= resolution
                    total += g[r, a] * normals[k, a]
                vectors[m, r] += normal_weight * total
            for r in range(8):
                for c in range(8):
                    alike = g[r, 0] * g[c, 0] + g[r, 1] * g[c, 1] + g[r, 2] * g[c, 2]
                    matrices[m, r, c] += point_weight * w[r] * w[c] + normal_weight * alike


def point_system(local, normals, starts, resolution, point_weight, normal_weight):
    voxels = len(starts) - 1
    matrices, vectors = np.zeros((voxels, 8, 8), np.float32), np.zeros((voxels, 8), np.float32)
    _point_system(
        local,
        normals,
        starts,
        np.float32(resolution),
        np.float32(point_weight),
        np.float32(normal_weight),
        matrices,
        vectors,
    )
    return matrices, vectors


@njit(parallel=True, fastmath=True, cache=True)
def point_sums(values, corners, local, normals, starts, resolution):
    voxels = starts.shape[0] - 1
    blocks = (voxels + BLOCK - 1) // BLOCK
    partial = np.zeros((blocks, 2))
    for b in prange(blocks):
        w = np.empty(8, np.float32)
        g = np.empty((8, 3), np.float32)
        square = 0.0
        mismatch = 0.0
        for m in range(b * BLOCK, min(voxels, (b + 1) * BLOCK)):
            for k in range(starts[m], starts[m + 1]):
                _trilinear(local[k, 0], local[k, 1], local[k, 2], w, g)
                value = np.float32(0.0)
                for c in range(8):
                    value += w[c] * values[corners[m, c]]
                square += value * value
                for a in range(3):
                    slope = np.float32(0.0)
                    for c in range(8):
                        slope += g[c, a] * values[corners[m, c]]
                    mismatch += (slope * resolution - normals[k, a]) ** 2
        partial[b, 0] = square
        partial[b, 1] = mismatch
    return _in_order(partial[:, 0]), _in_order(partial[:, 1])


@njit(parallel=True, fastmath=True, cache=True)
def coarea(values, neighbours, slabs, flags, resolution, beta, scale, out):
    count = slabs.shape[0] - 1
    partial = np.zeros(count)
    for parity in range(2):
        for half in prange((count + 1 - parity) // 2):
            slab = 2 * half + parity
            corners = np.empty(8, np.int32)
            w = np.empty(8, np.float32)
            g = np.empty((8, 3), np.float32)
            _trilinear(np.float32(0.5), np.float32(0.5), np.float32(0.5), w, g)
            total = 0.0
            for i in range(slabs[slab], slabs[slab + 1]):
                if flags[i] & ROW == 0 or not _corners(i, neighbours, corners):
                    continue
                mean = np.float32(0.0)
                gx = np.float32(0.0)
                gy = np.float32(0.0)
                gz = np.float32(0.0)
                for c in range(8):
                    f = values[corners[c]]
                    mean += w[c] * f
                    gx += g[c, 0] * f * resolution
                    gy += g[c, 1] * f * resolution
                    gz += g[c, 2] * f * resolution
                norm = np.sqrt(gx * gx + gy * gy + gz * gz)
                density = np.exp(-abs(mean) / beta) / (2 * beta)
                total += density * norm
                along = resolution / max(norm, np.float32(1e-6))
                slope = -np.sign(mean) / beta * norm / 8
                for c in range(8):
                    if flags[corners[c]] & FREE:
                        directed = gx * g[c, 0] + gy * g[c, 1] + gz * g[c, 2]
                        out[corners[c]] += scale * density * (along * directed + slope)
            partial[slab] = total
    return _in_order(partial)


@njit(fastmath=True, cache=True)
def splat(points, vectors, cells):
    width = vectors.shape[1]
    out = np.zeros((width + 1, cells, cells, cells), np.float32)
    w = np.empty(8, np.float32)
    g = np.empty((8, 3), np.float32)
    for p in range(points.shape[0]):
        x = points[p, 0] * cells - np.float32(0.5)
        y = points[p, 1] * cells - np.float32(0.5)
        z = points[p, 2] * cells - np.float32(0.5)
        i = int(np.floor(x))
        j = int(np.floor(y))
        k = int(np.floor(z))
        _trilinear(np.float32(x - i), np.float32(y - j), np.float32(z - k), w, g)
        for c in range(8):
            a = (i + (c >> 2)) % cells
            b = (j + (c >> 1 & 1)) % cells
            d = (k + (c & 1)) % cells
            for v in range(width):
                out[v, a, b, d] += w[c] * vectors[p, v]
            out[width, a, b, d] += w[c]
    return out


@njit(parallel=True, cache=True)
def _sample(count, limit, seed):
    out = np.empty(count, np.uint8)
    low = np.int64(0xFFFFFFFF)
    start = seed * np.int64(0x9E3779B1) & low
    for i in prange(count):
        h = np.int64(i) ^ start
        h = (h ^ h >> 16) * np.int64(0x85EBCA6B) & low
        h = (h ^ h >> 13) * np.int64(0xC2B2AE35) & low
        out[i] = (h ^ h >> 16) < limit
    return out


def sample(count, fraction, seed):
    return _sample(count, int(fraction * 2**32), seed)


@njit(parallel=True, fastmath=True, cache=True)
def adam_advance(values, gradient, mean, square, rate, correction, beta1, beta2, tiny):
    for i in prange(values.shape[0]):
        g = gradient[i]
        mean[i] = beta1 * mean[i] + (1 - beta1) * g
        square[i] = beta2 * square[i] + (1 - beta2) * g * g
        values[i] -= rate * mean[i] / (np.sqrt(square[i] / correction) + tiny)


@njit(inline="always")
def _lower_envelope(line, apex, border, out):
    """out[i] = min over j of line[j] + (i − j)²; ``line`` is 1e20 where there is no parabola."""
    n = line.shape[0]
    k = -1
    for j in range(n):
        if line[j] >= 1e20:
            continue
        start = -np.inf
        while k >= 0:
            v = apex[k]
            start = ((line[j] + j * j) - (line[v] + v * v)) / (2 * (j - v))
            if start > border[k]:
                break
            k -= 1
        if k < 0:
            start = -np.inf
        k += 1
        apex[k] = j
        border[k] = start
    if k < 0:
        out[:] = 1e20
        return
    last = k
    k = 0
    for i in range(n):
        while k < last and border[k + 1] < i:
            k += 1
        out[i] = line[apex[k]] + (i - apex[k]) ** 2


@njit(parallel=True, cache=True)
def _distance_along(values, out):
    """Along the middle axis of (A, n, B)."""
    n = values.shape[1]
    for a in prange(values.shape[0]):
        line, found, border = np.empty(n), np.empty(n), np.empty(n)
        apex = np.empty(n, np.int64)
        for b in range(values.shape[2]):
            line[:] = values[a, :, b]
            _lower_envelope(line, apex, border, found)
            out[a, :, b] = found


def squared_distance(region):
    start = np.where(region, np.float32(1e20), np.float32(0))
    return _along_axes(_distance_along, start, len(region))


@njit(parallel=True, fastmath=True, cache=True)
def _spline_up(coarse, fine):
    """Along the middle axis: (A, n', B) to (A, n, B)."""
    last = coarse.shape[1] - 1
    for a in prange(coarse.shape[0]):
        for j in range(fine.shape[1]):
            h = j // 2
            for t in range(coarse.shape[2]):
                high = coarse[a, h + 1, t] if h < last else np.float32(0)
                if j % 2:
                    fine[a, j, t] = np.float32(0.5) * (coarse[a, h, t] + high)
                else:
                    low = coarse[a, h - 1, t] if h > 0 else np.float32(0)
                    fine[a, j, t] = np.float32(0.75) * coarse[a, h, t] + np.float32(0.125) * (
                        low + high
                    )


@njit(parallel=True, fastmath=True, cache=True)
def _spline_down(fine, coarse):
    """Along the middle axis: (A, n, B) to (A, n', B), the transpose of ``_spline_up``."""
    side = fine.shape[1]
    for a in prange(fine.shape[0]):
        for h in range(coarse.shape[1]):
            for t in range(fine.shape[2]):
                total = np.float32(0)
                for offset in range(-2, 3):
                    j = 2 * h + offset
                    if 0 <= j < side:
                        w = (0.75, 0.5, 0.125)[abs(offset)]
                        total += np.float32(w) * fine[a, j, t]
                coarse[a, h, t] = total


def _along_axes(kernel, values, side):
    """Applies a middle-axis kernel to each axis of a cube, growing or shrinking it to ``side``.

    The last axis, which is the slowest since its rows are single numbers, goes where it is short.
    """
    for axis in (2, 1, 0) if side > len(values) else (0, 1, 2):
        shape = (*values.shape[:axis], side, *values.shape[axis + 1 :])
        out = np.empty(shape, np.float32)
        before, after = math.prod(shape[:axis]), math.prod(shape[axis + 1 :])
        kernel(values.reshape(before, -1, after), out.reshape(before, side, after))
        values = out
    return values


def spline_prolong(coarse, side):
    return _along_axes(_spline_up, coarse, side)


def spline_restrict(fine):
    return _along_axes(_spline_down, fine, len(fine) // 2 + 1)


@njit(fastmath=True, cache=True)
def spline_energies(corners, matrices, ijk, basis, spacing, side):
    reach = (basis.shape[0] - 1) // 2
    out = np.zeros((side, side, side), np.float32)
    low = np.empty(3, np.int64)
    high = np.empty(3, np.int64)
    w = np.empty(8, np.float32)
    for m in range(corners.shape[0]):
        node = ijk[corners[m, 0]]
        for axis in range(3):
            low[axis] = max((node[axis] - reach + spacing - 1) // spacing, 0)
            high[axis] = min((node[axis] + 1 + reach) // spacing, side - 1)
        for a in range(low[0], high[0] + 1):
            for b in range(low[1], high[1] + 1):
                for d in range(low[2], high[2] + 1):
                    for c in range(8):
                        x = node[0] + (c >> 2) - a * spacing + reach
                        y = node[1] + (c >> 1 & 1) - b * spacing + reach
                        z = node[2] + (c & 1) - d * spacing + reach
                        inside = min(x, y, z) >= 0 and max(x, y, z) <= 2 * reach
                        w[c] = basis[x] * basis[y] * basis[z] if inside else np.float32(0)
                    for r in range(8):
                        for c in range(8):
                            out[a, b, d] += w[r] * matrices[m, r, c] * w[c]
    return out


@njit(parallel=True, fastmath=True, cache=True)
def dot(a, b):
    n = a.shape[0]
    blocks = (n + BLOCK - 1) // BLOCK
    partial = np.zeros(blocks)
    for k in prange(blocks):
        # A block is short enough for float32; slices, whose indices cannot be negative, let the
        # loop be vectorised.
        x = a[k * BLOCK : (k + 1) * BLOCK]
        y = b[k * BLOCK : (k + 1) * BLOCK]
        total = np.float32(0)
        for i in range(x.shape[0]):
            total += x[i] * y[i]
        partial[k] = total
    return _in_order(partial)


@njit(parallel=True, fastmath=True, cache=True)
def cg_advance(x, r, p, q, alpha):
    for i in prange(x.shape[0]):
        x[i] += alpha * p[i]
        r[i] -= alpha * q[i]


@njit(parallel=True, fastmath=True, cache=True)
def cg_direction(p, z, beta):
    for i in prange(p.shape[0]):
        p[i] = z[i] + beta * p[i]


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
def surface_counts(values, neighbours, counts_of_case):
    n = neighbours.shape[0]
    edge_counts = np.empty(n, np.uint8)
    triangle_counts = np.empty(n, np.uint8)
    for b in prange((n + BLOCK - 1) // BLOCK):
        corners = np.empty(8, np.int32)
        for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
            inside = values[i] < 0
            edges = 0
            for axis in range(3):
                other = neighbours[i, 2 * axis + 1]
                if other < n and (values[other] < 0) != inside:
                    edges += 1
            edge_counts[i] = edges
            triangle_counts[i] = 0
            if _corners(i, neighbours, corners):
                case = 0
                for c in range(8):
                    if values[corners[c]] < 0:
                        case |= 1 << c
                triangle_counts[i] = counts_of_case[case]
    return edge_counts, triangle_counts


@njit(parallel=True, cache=True)
def surface_vertices(values, ijk, neighbours, first_vertex):
    n = neighbours.shape[0]
    vertices = np.empty((first_vertex[-1], 3), np.float32)
    normals = np.empty((first_vertex[-1], 3), np.float32)
    for b in prange((n + BLOCK - 1) // BLOCK):
        gradient = np.empty((2, 3), np.float32)
        for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
            vertex = first_vertex[i]
            if vertex == first_vertex[i + 1]:
                continue
            for axis in range(3):
                other = neighbours[i, 2 * axis + 1]
                if other == n or (values[other] < 0) == (values[i] < 0):
                    continue
                t = values[i] / (values[i] - values[other])
                t = min(max(t, np.float32(1e-4)), np.float32(1 - 1e-4))
                for end in range(2):
                    node = i if end == 0 else other
                    for a in range(3):
                        low = neighbours[node, 2 * a]
                        high = neighbours[node, 2 * a + 1]
                        low = node if low == n else low
                        high = node if high == n else high
                        span = (high != node) + (low != node)
                        gradient[end, a] = (values[high] - values[low]) / max(span, 1)
                norm = np.float32(0)
                for a in range(3):
                    vertices[vertex, a] = ijk[i, a]
                    g = (1 - t) * gradient[0, a] + t * gradient[1, a]
                    normals[vertex, a] = g
                    norm += g * g
                vertices[vertex, axis] += t
                norm = max(np.sqrt(norm), np.float32(1e-20))
                for a in range(3):
                    normals[vertex, a] /= norm
                vertex += 1
    return vertices, normals


@njit(parallel=True, cache=True)
def surface_faces(
    values, neighbours, first_vertex, first_triangle, edges_of_case, edge_owner, edge_axis
):
    n = neighbours.shape[0]
    faces = np.empty((first_triangle[-1], 3), np.int32)
    for b in prange((n + BLOCK - 1) // BLOCK):
        corners = np.empty(8, np.int32)
        for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
            face = first_triangle[i]
            if face == first_triangle[i + 1]:
                continue
            _corners(i, neighbours, corners)
            case = 0
            for c in range(8):
                if values[corners[c]] < 0:
                    case |= 1 << c
            for t in range(first_triangle[i + 1] - face):
                for k in range(3):
                    edge = edges_of_case[case, t, k]
                    node = corners[edge_owner[edge]]
                    vertex = first_vertex[node]
                    for axis in range(edge_axis[edge]):
                        other = neighbours[node, 2 * axis + 1]
                        if other < n and (values[other] < 0) != (values[node] < 0):
                            vertex += 1
                    faces[face + t, k] = vertex
    return faces
