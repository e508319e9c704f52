// The points' part of the operator, which viscosity.cpp applies slab by slab.
#pragma once

#include "common.h"

namespace visco {

using Eight = float __attribute__((vector_size(32)));

inline Eight eight_at(const float *place) {
    Eight found;
    __builtin_memcpy(&found, place, sizeof found);
    return found;
}

// x turned by k places: entry r is x[(r + k) mod 8].
template <int k>
Eight turned(Eight x) {
    return __builtin_shufflevector(x, x, k % 8, (k + 1) % 8, (k + 2) % 8, (k + 3) % 8, (k + 4) % 8,
                                   (k + 5) % 8, (k + 6) % 8, (k + 7) % 8);
}

inline float product(Eight x, Eight y) {
    float total = 0;
    for (int c = 0; c < 8; c++) total += x[c] * y[c];
    return total;
}

// A x, where A is symmetric and given by its cyclic diagonals: entry (k, r) is A[r][(r + k) mod 8].
inline Eight times(const float *diagonals, Eight x) {
    Eight d1 = eight_at(diagonals + 8), d2 = eight_at(diagonals + 16), d3 = eight_at(diagonals + 24);
    return eight_at(diagonals) * x + d1 * turned<1>(x) + d2 * turned<2>(x) + d3 * turned<3>(x) +
           eight_at(diagonals + 32) * turned<4>(x) + turned<7>(d1 * x) + turned<6>(d2 * x) +
           turned<5>(d3 * x);
}

// out += A v at the free corners of voxels first .. last - 1; returns the sum of vᵀ A v.
inline double points_of(int64_t first, int64_t last, const float *__restrict v,
                        const int32_t *__restrict corners, const float *__restrict matrices,
                        const uint8_t *__restrict flags, float *__restrict out) {
    double total = 0;
    for (int64_t m = first; m < last; m++) {
        const int32_t *corner = corners + 8 * m;
        Eight x;
        for (int c = 0; c < 8; c++) x[c] = v[corner[c]];
        Eight y = times(matrices + 40 * m, x);
        total += product(x, y);
        for (int c = 0; c < 8; c++)
            if (flags[corner[c]] & FREE) out[corner[c]] += y[c];
    }
    return total;
}

}  // namespace visco
