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

void visco_splat(const float *points, const float *vectors, int64_t count, int64_t width, int64_t cells,
                 float *out) {
    int64_t channel = cells * cells * cells;
    // Points in any order write to the same cells: one thread, in the order of the points.
    for (int64_t p = 0; p < count; p++) {
        float at[3], base[3];
        for (int a = 0; a < 3; a++) {
            at[a] = points[3 * p + a] * float(cells) - 0.5f;
            base[a] = std::floor(at[a]);
        }
        float w[8], g[8][3];
        trilinear(at[0] - base[0], at[1] - base[1], at[2] - base[2], w, g);
        for (int c = 0; c < 8; c++) {
            const int corner[] = {c >> 2, c >> 1 & 1, c & 1};
            int64_t place = 0;
            for (int a = 0; a < 3; a++) {
                int64_t cell = (int64_t(base[a]) + corner[a]) % cells;
                place = place * cells + (cell < 0 ? cell + cells : cell);
            }
            for (int64_t v = 0; v < width; v++) out[v * channel + place] += w[c] * vectors[p * width + v];
            out[width * channel + place] += w[c];
        }
    }
}

void visco_squared_distance(const uint8_t *region, int64_t n, float *out) {
    for (int64_t i = 0; i < n * n * n; i++) out[i] = region[i] ? NOTHING : 0;
    distance_along(out, n * n, n, 1);
    distance_along(out, n, n, n);
    distance_along(out, 1, n, n * n);
}
