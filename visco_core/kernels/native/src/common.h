// What several kernels share.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>

#include "kernels.h"
#include "parallel.h"

namespace visco {

constexpr uint8_t ROW = 1, FREE = 2, ENCLOSED = 4;  // as in visco_core.kernels
constexpr int64_t BLOCK = 4096;

// Memory for a kernel's own use.
template <class T>
class Buffer {
  public:
    explicit Buffer(int64_t n) : start(static_cast<T *>(calloc(std::max<int64_t>(n, 1), sizeof(T)))) {
        if (!start) abort();
    }
    ~Buffer() { free(start); }
    Buffer(const Buffer &) = delete;
    Buffer &operator=(const Buffer &) = delete;
    operator T *() { return start; }

  private:
    T *start;
};

// The sum of work(first, last) over blocks of n items, added up in their order, so that the result
// does not depend on the number of threads.
template <class Work>
double sum_of_blocks(int64_t n, int64_t size, const Work &work) {
    Buffer<double> parts(blocks_of(n, size));
    parallel_blocks(n, size, [&](int64_t first, int64_t last) { parts[first / size] = work(first, last); });
    double total = 0;
    for (int64_t k = 0; k < blocks_of(n, size); k++) total += parts[k];
    return total;
}

// Work on i-slabs that writes to a slab and the next one: even slabs first, then the odd ones.
template <class Work>
void parallel_slabs(int64_t count, const Work &work) {
    for (int64_t parity = 0; parity < 2; parity++)
        parallel((count + 1 - parity) / 2, [&](int64_t half) { work(2 * half + parity); });
}

// Weights (8) and gradients (8, 3), in voxels, of the corners 4x + 2y + z at (u, v, w) in [0, 1].
inline void trilinear(float u, float v, float w, float *weights, float (*gradients)[3]) {
    for (int c = 0; c < 8; c++) {
        float x = c & 4 ? u : 1 - u, y = c & 2 ? v : 1 - v, z = c & 1 ? w : 1 - w;
        weights[c] = x * y * z;
        gradients[c][0] = c & 4 ? y * z : -y * z;
        gradients[c][1] = c & 2 ? x * z : -x * z;
        gradients[c][2] = c & 1 ? x * y : -x * y;
    }
}

// The voxel's eight nodes above node i of n; false where one is missing.
inline bool corners_above(int32_t i, const int32_t *neighbours, int64_t n, int32_t *corners) {
    corners[0] = i;
    for (int c = 1; c < 8; c++) {
        int lower = c & 1 ? c - 1 : c & 2 ? c - 2 : c - 4;
        int side = c & 1 ? 5 : c & 2 ? 3 : 1;
        corners[c] = neighbours[6 * int64_t(corners[lower]) + side];
        if (corners[c] == n) return false;
    }
    return true;
}

}  // namespace visco
