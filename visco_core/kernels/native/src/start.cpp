// What the starting field is made of.
#include "common.h"

using namespace visco;

namespace {

constexpr float NOTHING = 1e20f;
constexpr int64_t TILE = 16;  // lines along a slow axis that are turned at a time

// out[i] = min over j of line[j] + (i − j)²; ``line`` is NOTHING where there is no parabola.
// Felzenszwalb, Huttenlocher, "Distance transforms of sampled functions", 2012.
void lower_envelope(const double *line, int64_t n, int64_t *apex, double *border, double *out) {
    int64_t k = -1;
    for (int64_t j = 0; j < n; j++) {
        if (line[j] >= NOTHING) continue;
        double height = line[j] + double(j * j), start = -INFINITY;
        while (k >= 0) {
            int64_t v = apex[k];
            start = (height - (line[v] + double(v * v))) / double(2 * (j - v));
            if (start > border[k]) break;
            k--;
        }
        k++;
        apex[k] = j;
        border[k] = k ? start : -INFINITY;
    }
    if (k < 0) {
        std::fill_n(out, n, double(NOTHING));
        return;
    }
    int64_t last = k;
    k = 0;
    for (int64_t i = 0; i < n; i++) {
        while (k < last && border[k + 1] < double(i)) k++;
        int64_t apart = i - apex[k];
        out[i] = line[apex[k]] + double(apart * apart);
    }
}

// In place along the middle axis of values (before, n, after).
void distance_along(float *values, int64_t before, int64_t n, int64_t after) {
    int64_t tiles = blocks_of(after, TILE);
    parallel(before * tiles, [=](int64_t task) {
        float *first = values + task / tiles * n * after + task % tiles * TILE;
        int64_t width = std::min(TILE, after - task % tiles * TILE);
        Buffer<double> lines(TILE * n), found(TILE * n), border(n);
        Buffer<int64_t> apex(n);
        for (int64_t j = 0; j < n; j++)
            for (int64_t b = 0; b < width; b++) lines[b * n + j] = first[j * after + b];
        for (int64_t b = 0; b < width; b++) lower_envelope(lines + b * n, n, apex, border, found + b * n);
        for (int64_t j = 0; j < n; j++)
            for (int64_t b = 0; b < width; b++) first[j * after + b] = float(found[b * n + j]);
    });
}

}  // namespace

void visco_splat_divergence(const float *points, const float *vectors, int64_t count, int64_t cells,
                            float *out) {
    // Points in any order write to the same cells: one thread, in the order of the points.
    for (int64_t p = 0; p < count; p++) {
        const float *vector = vectors + 3 * p;
        float local[3];
        int64_t cell[3][2];
        for (int a = 0; a < 3; a++) {
            float at = points[3 * p + a] * float(cells) - 0.5f, base = std::floor(at);
            local[a] = at - base;
            for (int upper = 0; upper < 2; upper++) {
                int64_t wrapped = (int64_t(base) + upper) % cells;
                cell[a][upper] = wrapped < 0 ? wrapped + cells : wrapped;
            }
        }
        float w[8], g[8][3];
        trilinear(local[0], local[1], local[2], w, g);
        for (int c = 0; c < 8; c++) {
            int64_t place = (cell[0][c >> 2] * cells + cell[1][c >> 1 & 1]) * cells + cell[2][c & 1];
            out[place] -= vector[0] * g[c][0] + vector[1] * g[c][1] + vector[2] * g[c][2];
        }
    }
}

void visco_squared_distance(const uint8_t *region, int64_t n, float *out) {
    for (int64_t i = 0; i < n * n * n; i++) out[i] = region[i] ? NOTHING : 0;
    distance_along(out, n * n, n, 1);
    distance_along(out, n, n, n);
    distance_along(out, 1, n, n * n);
}
