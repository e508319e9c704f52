// How densely a scan's points lie around a place.
#include "common.h"

using namespace visco;

void visco_support(const float *places, const float *directions, int64_t count, const int64_t *sides,
                   int64_t levels, const int32_t *columns, const int32_t *depths, const float *clusters,
                   float enough, float *out) {
    auto support = [=](int64_t p) {
        const float *at = places + 3 * p, *n = directions + 3 * p;
        float radius = 1 / float(sides[0]);
        int64_t first = 0;
        float weight, spacing, cosine, weight_before = 0, spacing_before = 0, cosine_before = 0;
        int64_t level = 0;
        for (;; level++) {
            int64_t side = sides[level], cell[3];
            for (int a = 0; a < 3; a++)
                cell[a] = std::clamp<int64_t>(int64_t(at[a] / radius), 0, side - 1);
            float falling = 1 / (radius * radius);
            weight = spacing = cosine = 0;
            int64_t low = std::max<int64_t>(cell[1] - 1, 0), high = std::min(cell[1] + 2, side);
            for (int64_t i = std::max<int64_t>(cell[0] - 1, 0); i < std::min(cell[0] + 2, side); i++) {
                for (int64_t j = low; j < high; j++) {
                    const int32_t *column = columns + first + i * side + j;
                    const int32_t *end = depths + column[1];
                    const int32_t *depth = std::lower_bound(depths + column[0], end, cell[2] - 1);
                    for (; depth < end && *depth <= cell[2] + 1; depth++) {
                        const float *cluster = clusters + 8 * (depth - depths);
                        float dx = cluster[1] - at[0], dy = cluster[2] - at[1], dz = cluster[3] - at[2];
                        float w = 1 - (dx * dx + dy * dy + dz * dz) * falling;
                        float facing = cluster[4] * n[0] + cluster[5] * n[1] + cluster[6] * n[2];
                        if (w <= 0 || facing <= 0) continue;
                        weight += w * cluster[0];
                        cosine += w * facing;
                        spacing += w * cluster[7];
                    }
                }
            }
            if (weight >= enough || level == levels - 1) break;
            weight_before = weight, cosine_before = cosine, spacing_before = spacing;
            first += side * side + 1;
            radius *= 2;
        }
        if (level > 0) {
            float share = weight > enough ? (enough - weight_before) / (weight - weight_before) : 1;
            radius *= (1 + share) / 2;
            weight = weight_before + share * (weight - weight_before);
            cosine = cosine_before + share * (cosine - cosine_before);
            spacing = spacing_before + share * (spacing - spacing_before);
        }
        out[3 * p] = radius * radius;
        if (weight > 0) out[3 * p + 1] = spacing / weight, out[3 * p + 2] = cosine / weight;
    };
    parallel_blocks(count, BLOCK / 4, [=](int64_t begin, int64_t end) {
        for (int64_t p = begin; p < end; p++) support(p);
    });
}
