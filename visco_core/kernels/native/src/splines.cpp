// Cubic B-splines between a grid and coarser ones.
//
// A plane of the result is made at a time, axis after axis, in buffers that stay in the cache. Their
// borders are zero, so that no line needs a case for its ends.
#include "points.h"

using namespace visco;

namespace {

void add(float *__restrict out, float weight, const float *__restrict line, int64_t n) {
    for (int64_t t = 0; t < n; t++) out[t] += weight * line[t];
}

// The three coefficients that make fine entry j begin with ``first``.
struct Taps {
    int64_t first;
    float weights[3];
    explicit Taps(int64_t j) : first(j % 2 ? j / 2 : j / 2 - 1), weights{0.125f, 0.75f, 0.125f} {
        if (j % 2) weights[0] = weights[1] = 0.5f, weights[2] = 0;
    }
};

// Calls take(i, j, line) for every line (side) of the fine grid, i by i on any thread.
template <class Take>
void prolong(const float *coarse, int64_t n, int64_t side, const Take &take) {
    parallel(side, [&](int64_t i) {
        int64_t width = n + 3;
        Buffer<float> plane(width * width), line(width), fine(2 * n);
        Taps across(i);
        for (int tap = 0; tap < 3; tap++) {
            int64_t h = across.first + tap;
            if (h < 0 || h >= n || across.weights[tap] == 0) continue;
            for (int64_t b = 0; b < n; b++)
                add(plane + (b + 1) * width + 1, across.weights[tap], coarse + (h * n + b) * n, n);
        }
        for (int64_t j = 0; j < side; j++) {
            Taps along(j);
            std::fill_n(&line[0], width, 0.0f);
            for (int tap = 0; tap < 3; tap++)
                add(line, along.weights[tap], plane + (along.first + 1 + tap) * width, width);
            for (int64_t h = 0; h < n; h++) {
                float low = line[h], middle = line[h + 1], high = line[h + 2];
                fine[2 * h] = 0.75f * middle + 0.125f * (low + high);
                fine[2 * h + 1] = 0.5f * (middle + high);
            }
            take(i, j, &fine[0]);
        }
    });
}

}  // namespace

void visco_spline_prolong(const float *coarse, int64_t n, float *fine, int64_t side) {
    prolong(coarse, n, side, [=](int64_t i, int64_t j, const float *line) {
        std::copy_n(line, side, fine + (i * side + j) * side);
    });
}

double visco_spline_correct(const float *coarse, int64_t n, int64_t side, const float *r, float *z) {
    Buffer<double> sums(side * side);
    prolong(coarse, n, side, [&](int64_t i, int64_t j, const float *line) {
        int64_t start = (i * side + j) * side;
        const float *__restrict rl = r + start;
        float *__restrict zl = z + start;
        if (i % (side - 1) && j % (side - 1))
            for (int64_t k = 1; k < side - 1; k++) zl[k] += line[k];
        float sum = 0;
        for (int64_t k = 0; k < side; k++) sum += rl[k] * zl[k];
        sums[i * side + j] = sum;
    });
    double total = 0;
    for (int64_t l = 0; l < side * side; l++) total += sums[l];
    return total;
}

void visco_spline_restrict(const float *fine, int64_t side, float *coarse) {
    int64_t n = side / 2 + 1, width = side + 5;
    const float weights[] = {0.125f, 0.5f, 0.75f, 0.5f, 0.125f};
    parallel(n, [=](int64_t h) {
        Buffer<float> plane(width * width), line(width);
        for (int tap = 0; tap < 5; tap++) {
            int64_t i = 2 * h + tap - 2;
            if (i < 0 || i >= side) continue;
            for (int64_t j = 0; j < side; j++)
                add(plane + (j + 2) * width + 2, weights[tap], fine + (i * side + j) * side, side);
        }
        for (int64_t b = 0; b < n; b++) {
            std::fill_n(&line[0], width, 0.0f);
            for (int tap = 0; tap < 5; tap++) add(line, weights[tap], plane + (2 * b + tap) * width, width);
            float *out = coarse + (h * n + b) * n;
            for (int64_t d = 0; d < n; d++) {
                const float *l = line + 2 * d;
                out[d] = 0.125f * (l[0] + l[4]) + 0.5f * (l[1] + l[3]) + 0.75f * l[2];
            }
        }
    });
}

void visco_spline_energies(const int32_t *corners, const float *matrices, const int64_t *slabs,
                           int64_t slab_count, const int16_t *ijk, const float *basis, int64_t reach,
                           int64_t spacing, int64_t side, float *out) {
    int64_t last = slab_count - 1;
    parallel(side, [=](int64_t a) {
        int64_t begin = slabs[std::clamp<int64_t>(a * spacing - reach - 1, 0, last + 1)];
        int64_t end = slabs[std::min(a * spacing + reach, last) + 1];
        for (int64_t m = begin; m < end; m++) {
            const int16_t *node = ijk + 3 * int64_t(corners[8 * m]);
            int64_t low[3], high[3];
            for (int axis = 1; axis < 3; axis++) {
                low[axis] = std::max((node[axis] - reach + spacing - 1) / spacing, int64_t(0));
                high[axis] = std::min((node[axis] + 1 + reach) / spacing, side - 1);
            }
            for (int64_t b = low[1]; b <= high[1]; b++)
                for (int64_t d = low[2]; d <= high[2]; d++) {
                    Eight w;
                    for (int c = 0; c < 8; c++) {
                        int64_t x = node[0] + (c >> 2) - a * spacing + reach;
                        int64_t y = node[1] + (c >> 1 & 1) - b * spacing + reach;
                        int64_t z = node[2] + (c & 1) - d * spacing + reach;
                        bool inside = std::min({x, y, z}) >= 0 && std::max({x, y, z}) <= 2 * reach;
                        w[c] = inside ? basis[x] * basis[y] * basis[z] : 0;
                    }
                    out[(a * side + b) * side + d] += product(w, times(matrices + 40 * m, w));
                }
        }
    });
}
