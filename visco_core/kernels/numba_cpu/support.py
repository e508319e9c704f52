"""Compiled kernel of how densely a scan's points lie around a place."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

BLOCK = 1024


@njit(parallel=True, cache=True)
def support(places, directions, sides, columns, depths, clusters, enough):
    count = places.shape[0]
    out = np.zeros((count, 3), np.float32)
    zero, one, two, enough = np.float32(0), np.float32(1), np.float32(2), np.float32(enough)
    for b in prange((count + BLOCK - 1) // BLOCK):
        for p in range(b * BLOCK, min(count, (b + 1) * BLOCK)):
            x, y, z = places[p, 0], places[p, 1], places[p, 2]
            nx, ny, nz = directions[p, 0], directions[p, 1], directions[p, 2]
            radius = one / np.float32(sides[0])
            first = 0
            weight = spacing = cosine = zero
            weight_before = spacing_before = cosine_before = zero
            level = 0
            while True:
                side = sides[level]
                i = min(max(int(x / radius), 0), side - 1)
                j = min(max(int(y / radius), 0), side - 1)
                k = min(max(int(z / radius), 0), side - 1)
                falling = one / (radius * radius)
                weight = spacing = cosine = zero
                low, high = max(j - 1, 0), min(j + 2, side)
                for a in range(max(i - 1, 0), min(i + 2, side)):
                    row = first + a * side
                    for c in range(columns[row + low], columns[row + high]):
                        if abs(depths[c] - k) > 1:
                            continue
                        dx, dy, dz = clusters[c, 1] - x, clusters[c, 2] - y, clusters[c, 3] - z
                        w = one - (dx * dx + dy * dy + dz * dz) * falling
                        facing = clusters[c, 4] * nx + clusters[c, 5] * ny + clusters[c, 6] * nz
                        if w > zero and facing > zero:
                            weight += w * clusters[c, 0]
                            cosine += w * facing
                            spacing += w * clusters[c, 7]
                if weight >= enough or level == len(sides) - 1:
                    break
                weight_before, cosine_before, spacing_before = weight, cosine, spacing
                first += side * side + 1
                radius *= two
                level += 1
            share = one
            if level > 0:
                if weight > enough:
                    share = (enough - weight_before) / (weight - weight_before)
                radius *= (one + share) / two
                weight = weight_before + share * (weight - weight_before)
                cosine = cosine_before + share * (cosine - cosine_before)
                spacing = spacing_before + share * (spacing - spacing_before)
            out[p, 0] = radius * radius
            if weight > zero:
                out[p, 1] = spacing / weight
                out[p, 2] = cosine / weight
    return out
