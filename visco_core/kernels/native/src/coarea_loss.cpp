// The coarea loss.
#include "common.h"

using namespace visco;

double visco_coarea(const float *values, const int32_t *neighbours, int64_t n, const int64_t *slabs,
                    int64_t slab_count, const uint8_t *flags, float resolution, float beta, float scale,
                    float *out) {
    Buffer<double> totals(slab_count);
    float w[8], g[8][3];
    trilinear(0.5f, 0.5f, 0.5f, w, g);
    parallel_slabs(slab_count, [&](int64_t slab) {
        double total = 0;
        for (int64_t i = slabs[slab]; i < slabs[slab + 1]; i++) {
            int32_t corners[8];
            if (!(flags[i] & ROW) || !corners_above(i, neighbours, n, corners)) continue;
            float mean = 0, gx = 0, gy = 0, gz = 0;
            for (int c = 0; c < 8; c++) {
                float f = values[corners[c]];
                mean += w[c] * f;
                gx += g[c][0] * f * resolution, gy += g[c][1] * f * resolution, gz += g[c][2] * f * resolution;
            }
            float norm = std::sqrt(gx * gx + gy * gy + gz * gz);
            float density = std::exp(-std::abs(mean) / beta) / (2 * beta);
            total += density * norm;
            float along = resolution / std::max(norm, 1e-6f);
            float sign = mean > 0 ? 1.0f : mean < 0 ? -1.0f : 0.0f;
            float slope = -sign / beta * norm / 8;
            for (int c = 0; c < 8; c++) {
                if (!(flags[corners[c]] & FREE)) continue;
                float directed = gx * g[c][0] + gy * g[c][1] + gz * g[c][2];
                out[corners[c]] += scale * density * (along * directed + slope);
            }
        }
        totals[slab] = total;
    });
    double total = 0;
    for (int64_t slab = 0; slab < slab_count; slab++) total += totals[slab];
    return total;
}
