// What previews are drawn with: a z-buffer, and light. All colors are linear, all vectors in the
// camera's frame (right, up, forward).
//
// The z-buffer is drawn in bands of rows; for each all primitives are walked.
#include "common.h"

using namespace visco;

namespace {

constexpr int64_t FEW_BANDS = 4, BANDS = 64;

struct Vector {
    double x, y, z;
};

Vector at(const float *values, int64_t i) { return {values[3 * i], values[3 * i + 1], values[3 * i + 2]}; }

double dot(Vector a, Vector b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

// Twice the signed area of a triangle on the screen.
double area_of(Vector a, Vector b, Vector c) { return (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y); }

// draw(first, last) for bands of rows.
template <class Draw>
void in_bands(int64_t rows, int64_t bands, const Draw &draw) {
    parallel_blocks(rows, blocks_of(rows, bands), draw);
}

// What the pixels see; owner: face, or point where there are no faces.
struct Surface {
    const float *depth;
    const int32_t *owner;
    int64_t width, height;
    const float *screen;
    const int32_t *faces;
    int64_t face_count;
    const double *center;

    // A (V, 3) attribute where a pixel sees the surface, correct in perspective.
    Vector interpolate(const float *values, int64_t row, int64_t column) const {
        int64_t seen = owner[row * width + column];
        if (!face_count) return at(values, seen);
        const int32_t *f = faces + 3 * seen;
        Vector a = at(screen, f[0]), b = at(screen, f[1]), c = at(screen, f[2]);
        Vector p = {column + 0.5, row + 0.5, 0};
        double area = area_of(a, b, c);
        double u = area_of(b, c, p) / area * a.z, v = area_of(c, a, p) / area * b.z;
        double w = area_of(a, b, p) / area * c.z, total = u + v + w;
        Vector q = at(values, f[0]), r = at(values, f[1]), s = at(values, f[2]);
        u /= total, v /= total, w /= total;
        return {u * q.x + v * r.x + w * s.x, u * q.y + v * r.y + w * s.y, u * q.z + v * r.z + w * s.z};
    }

    Vector position(int64_t row, int64_t column) const {
        double z = 1 / double(depth[row * width + column]);
        return {(column + 0.5 - center[0]) * z / center[2], (center[1] - row - 0.5) * z / center[2], z};
    }

    // Whether a pixel sees the inside: by the face's winding, or the point's normal.
    bool is_back(int64_t row, int64_t column, Vector normal, Vector position) const {
        int64_t seen = owner[row * width + column];
        // Discs just past the silhouette stick out over it and would fray it with dark spots.
        if (!face_count) return dot(normal, position) > 0.4 * position.z;
        const int32_t *f = faces + 3 * seen;
        return area_of(at(screen, f[0]), at(screen, f[1]), at(screen, f[2])) > 0;
    }
};

// The unit normal on the side that is seen.
Vector toward_eye(Vector normal, bool back) {
    double sign = (back ? -1.0 : 1.0) / std::max(std::sqrt(dot(normal, normal)), 1e-12);
    return {normal.x * sign, normal.y * sign, normal.z * sign};
}

// Rolls off highlights instead of clipping them.
double soft(double value) { return value <= 0.7 ? value : 0.7 + 0.3 * (1 - std::exp(-(value - 0.7) / 0.3)); }

}  // namespace

void visco_draw_triangles(const float *screen, const int32_t *faces, int64_t face_count, float *depth,
                          int32_t *owner, int64_t width, int64_t height) {
    in_bands(height, FEW_BANDS, [=](int64_t first, int64_t last) {
        for (int64_t face = 0; face < face_count; face++) {
            const int32_t *f = faces + 3 * face;
            Vector a = at(screen, f[0]), b = at(screen, f[1]), c = at(screen, f[2]);
            int64_t top = std::max(int64_t(std::ceil(std::min({a.y, b.y, c.y}) - 0.5)), first);
            int64_t bottom = std::min(int64_t(std::floor(std::max({a.y, b.y, c.y}) - 0.5)), last - 1);
            int64_t left = std::max(int64_t(std::ceil(std::min({a.x, b.x, c.x}) - 0.5)), int64_t(0));
            int64_t right = std::min(int64_t(std::floor(std::max({a.x, b.x, c.x}) - 0.5)), width - 1);
            double area = area_of(a, b, c);
            if (top > bottom || left > right || area == 0) continue;
            for (int64_t row = top; row <= bottom; row++)
                for (int64_t column = left; column <= right; column++) {
                    Vector p = {column + 0.5, row + 0.5, 0};
                    double u = area_of(b, c, p) / area, v = area_of(c, a, p) / area, w = 1 - u - v;
                    if (u < 0 || v < 0 || w < 0) continue;
                    float inverse = float(u * a.z + v * b.z + w * c.z);
                    int64_t pixel = row * width + column;
                    if (inverse > depth[pixel]) depth[pixel] = inverse, owner[pixel] = int32_t(face);
                }
        }
    });
}

void visco_draw_discs(const float *screen, int64_t count, float radius, float *depth, int32_t *owner,
                      int64_t width, int64_t height) {
    in_bands(height, FEW_BANDS, [=](int64_t first, int64_t last) {
        for (int64_t point = 0; point < count; point++) {
            Vector p = at(screen, point);
            double reach = std::max(radius * p.z, 0.75), square = reach * reach;
            int64_t top = std::max(int64_t(std::ceil(p.y - reach - 0.5)), first);
            int64_t bottom = std::min(int64_t(std::floor(p.y + reach - 0.5)), last - 1);
            int64_t left = std::max(int64_t(std::ceil(p.x - reach - 0.5)), int64_t(0));
            int64_t right = std::min(int64_t(std::floor(p.x + reach - 0.5)), width - 1);
            for (int64_t row = top; row <= bottom; row++)
                for (int64_t column = left; column <= right; column++) {
                    double x = column + 0.5 - p.x, y = row + 0.5 - p.y, apart = x * x + y * y;
                    // The rim lies a little deeper, so that neighboring discs meet halfway.
                    float sunk = float(p.z * (1 - 2e-3 * apart / square));
                    int64_t pixel = row * width + column;
                    if (apart <= square && sunk > depth[pixel])
                        depth[pixel] = sunk, owner[pixel] = int32_t(point);
                }
        }
    });
}

// Screen-space ambient occlusion: the share of the hemisphere that near surfaces hide.
void visco_occlude(const float *depth, const int32_t *owner, int64_t width, int64_t height,
                   const float *screen, const int32_t *faces, int64_t face_count, const float *normals,
                   int64_t step, const double *center, double reach, const float *spiral,
                   int64_t samples, float *openness) {
    Surface surface{depth, owner, width, height, screen, faces, face_count, center};
    int64_t columns = width / step;
    auto open = [=](int64_t i, int64_t j) {
        int64_t row = i * step, column = j * step;
        Vector p = surface.position(row, column), normal = surface.interpolate(normals, row, column);
        Vector n = toward_eye(normal, surface.is_back(row, column, normal, p));
        double turn = 0.61803 * double((i % 4) * 4 + (j % 4)) * 2 * M_PI;
        double cosine = std::cos(turn), sine = std::sin(turn), pixels = reach * center[2] / p.z, hidden = 0;
        for (int64_t k = 0; k < samples; k++) {
            double a = spiral[2 * k], b = spiral[2 * k + 1];
            auto x = int64_t(column + pixels * (cosine * a - sine * b));
            auto y = int64_t(row + pixels * (sine * a + cosine * b));
            if (x < 0 || y < 0 || x >= width || y >= height || owner[y * width + x] < 0) continue;
            Vector q = surface.position(y, x), d = {q.x - p.x, q.y - p.y, q.z - p.z};
            double apart = std::sqrt(dot(d, d)) + 1e-12, above = dot(d, n) / apart - 0.06;
            if (above > 0 && apart < 2 * reach) hidden += above * (1 - 0.5 * apart / reach);
        }
        return std::max(0.0, 1 - 2.6 * hidden / double(samples));
    };
    in_bands(height / step, BANDS, [=](int64_t first, int64_t last) {
        for (int64_t i = first; i < last; i++)
            for (int64_t j = 0; j < columns; j++)
                if (owner[i * step * width + j * step] >= 0) openness[i * columns + j] = float(open(i, j));
    });
}

// Average over the dither pattern's period, not across edges in depth.
void visco_blur(const float *openness, const float *depth, int64_t width, int64_t height, int64_t step,
                float *smooth) {
    constexpr int64_t REACH = 2;
    int64_t rows = height / step, columns = width / step;
    in_bands(rows, BANDS, [=](int64_t first, int64_t last) {
        for (int64_t i = first; i < last; i++)
            for (int64_t j = 0; j < columns; j++) {
                float here = depth[i * step * width + j * step], total = 0, weight = 0;
                if (here == 0) continue;
                for (int64_t y = std::max(i - REACH, int64_t(0)); y < std::min(i + REACH, rows); y++)
                    for (int64_t x = std::max(j - REACH, int64_t(0)); x < std::min(j + REACH, columns); x++) {
                        if (std::abs(depth[y * step * width + x * step] - here) >= 0.01f * here) continue;
                        total += openness[y * columns + x];
                        weight += 1;
                    }
                if (weight > 0) smooth[i * columns + j] = total / weight;
            }
    });
}

// A warm key light, a cool fill, a rim from behind, and the sky.
void visco_shade(const float *depth, const int32_t *owner, int64_t width, int64_t height,
                 const float *screen, const int32_t *faces, int64_t face_count, const float *normals,
                 const float *albedo, int64_t step, const double *center, const float *up,
                 const float *openness, float *picture) {
    Surface surface{depth, owner, width, height, screen, faces, face_count, center};
    int64_t columns = width / step;
    auto shade = [=](int64_t row, int64_t column, double open_sky, double *color) {
        Vector position = surface.position(row, column), normal = surface.interpolate(normals, row, column);
        bool back = surface.is_back(row, column, normal, position);
        Vector n = toward_eye(normal, back), tint = surface.interpolate(albedo, row, column);
        if (back) tint = {0.35 * tint.x, 0.3 * tint.y, 0.28 * tint.z};
        auto facing = [n](Vector light) { return std::max(dot(n, light), 0.0); };
        double key = facing({-0.51, 0.62, -0.6}) * (0.4 + 0.6 * open_sky);
        double fill = facing({0.86, 0.17, -0.47}) * open_sky;
        double rim = facing({0.35, 0.61, 0.71});
        double sky = (0.35 + 0.65 * (0.5 + 0.5 * dot(n, at(up, 0)))) * open_sky;
        // Half way between the key light and the eye, for a soft gloss.
        double gloss = std::pow(facing({-0.285, 0.347, -0.894}), 36) * 0.10 * open_sky;
        rim *= rim;
        color[0] += soft(tint.x * (1.02 * key + 0.15 * fill + 0.30 * rim + 0.29 * sky) + gloss);
        color[1] += soft(tint.y * (0.97 * key + 0.17 * fill + 0.31 * rim + 0.31 * sky) + gloss);
        color[2] += soft(tint.z * (0.90 * key + 0.20 * fill + 0.33 * rim + 0.35 * sky) + gloss);
        color[3] += 1;
    };
    in_bands(height / step, BANDS, [=](int64_t first, int64_t last) {
        for (int64_t i = first; i < last; i++)
            for (int64_t j = 0; j < columns; j++) {
                double color[4] = {};
                for (int64_t row = i * step; row < (i + 1) * step; row++)
                    for (int64_t column = j * step; column < (j + 1) * step; column++)
                        if (owner[row * width + column] >= 0)
                            shade(row, column, openness[i * columns + j], color);
                for (int channel = 0; channel < 4; channel++)
                    picture[4 * (i * columns + j) + channel] = float(color[channel] / double(step * step));
            }
    });
}
