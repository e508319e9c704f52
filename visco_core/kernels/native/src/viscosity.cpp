// The viscosity loss: its rows, their transpose and the diagonal; and the whole operator.
//
// Within a run of free nodes the neighbours on every side are runs too, so the inner loops are plain
// strides that the compiler vectorises.
#include "common.h"
#include "points.h"

using namespace visco;

namespace {

constexpr int64_t RUNS = 256;  // in a block of a sum
constexpr int64_t CHUNKS = 64;

// As kernels.free_runs makes them.
struct Run {
    int64_t start, stop, x0, x1, y0, y1;
};

const Run *runs_of(const int64_t *runs) { return reinterpret_cast<const Run *>(runs); }

struct Slopes {
    const float *x, *y, *z;
    Slopes(const float *slopes, int64_t stride) : x(slopes), y(slopes + stride), z(slopes + 2 * stride) {}
};

// rows = W J v over the runs; returns v · JᵀW J v.
double rows_of(const Run *run, const Run *end, const float *__restrict v, Slopes s,
               const float *__restrict stiffness, float laplace, float *__restrict rows) {
    double total = 0;
    for (; run < end; run++) {
        const float *x0 = v + run->x0, *x1 = v + run->x1, *y0 = v + run->y0, *y1 = v + run->y1;
        float square = 0;
        for (int64_t t = run->start; t < run->stop; t++) {
            float along = s.x[t] * (x1[t] - x0[t]) + s.y[t] * (y1[t] - y0[t]) + s.z[t] * (v[t + 1] - v[t - 1]);
            float around = x0[t] + x1[t] + y0[t] + y1[t] + v[t - 1] + v[t + 1] - 6 * v[t];
            float row = along - laplace * around;
            rows[t] = stiffness[t] * row;
            square += row * rows[t];
        }
        total += square;
    }
    return total;
}

// out = scale · Jᵀ rows over the runs.
void columns_of(const Run *run, const Run *end, const float *__restrict rows, Slopes s, float laplace,
                float scale, float *__restrict out) {
    for (; run < end; run++) {
        const float *x0 = rows + run->x0, *x1 = rows + run->x1, *y0 = rows + run->y0, *y1 = rows + run->y1;
        const float *sx0 = s.x + run->x0, *sx1 = s.x + run->x1, *sy0 = s.y + run->y0, *sy1 = s.y + run->y1;
        for (int64_t t = run->start; t < run->stop; t++) {
            float along = sx0[t] * x0[t] - sx1[t] * x1[t] + sy0[t] * y0[t] - sy1[t] * y1[t] +
                          s.z[t - 1] * rows[t - 1] - s.z[t + 1] * rows[t + 1];
            float around = x0[t] + x1[t] + y0[t] + y1[t] + rows[t - 1] + rows[t + 1] - 6 * rows[t];
            out[t] = scale * (along - laplace * around);
        }
    }
}

}  // namespace

double visco_linearise(const float *__restrict values, const float *__restrict target,
                       const float *__restrict stiffness, const int64_t *runs, int64_t run_count,
                       float half_inverse, float laplace, float *__restrict slopes, int64_t stride,
                       float *__restrict rows) {
    float *sx = slopes, *sy = slopes + stride, *sz = slopes + 2 * stride;
    return sum_of_blocks(run_count, RUNS, [=](int64_t first, int64_t last) {
        double total = 0;
        for (const Run *run = runs_of(runs) + first; run < runs_of(runs) + last; run++) {
            const float *x0 = values + run->x0, *x1 = values + run->x1;
            const float *y0 = values + run->y0, *y1 = values + run->y1;
            float square = 0;
            for (int64_t t = run->start; t < run->stop; t++) {
                float v = values[t];
                float gx = (x1[t] - x0[t]) * half_inverse, gy = (y1[t] - y0[t]) * half_inverse;
                float gz = (values[t + 1] - values[t - 1]) * half_inverse;
                float norm = std::sqrt(gx * gx + gy * gy + gz * gz);
                float sign = v > 0 ? 1.0f : v < 0 ? -1.0f : 0.0f;
                float k = sign * half_inverse / std::max(norm, 1e-6f);
                sx[t] = k * gx, sy[t] = k * gy, sz[t] = k * gz;
                float around = x0[t] + x1[t] + y0[t] + y1[t] + values[t - 1] + values[t + 1] - 6 * v;
                float row = (norm - 1) * sign - laplace * around - target[t];
                rows[t] = stiffness[t] * row;
                square += row * rows[t];
            }
            total += square;
        }
        return total;
    });
}

void visco_viscosity_columns(const float *rows, const float *slopes, int64_t stride, const int64_t *runs,
                             int64_t run_count, float laplace, float scale, float *out) {
    parallel_blocks(run_count, RUNS, [=](int64_t first, int64_t last) {
        columns_of(runs_of(runs) + first, runs_of(runs) + last, rows, Slopes(slopes, stride), laplace, scale,
                   out);
    });
}

void visco_viscosity_diagonal(const float *slopes, int64_t stride, const float *stiffness, const int64_t *runs,
                              int64_t run_count, const uint8_t *flags, float laplace, float scale,
                              float *out) {
    parallel_blocks(run_count, RUNS, [=](int64_t first, int64_t last) {
        for (const Run *run = runs_of(runs) + first; run < runs_of(runs) + last; run++) {
            const int64_t low[] = {run->x0, run->y0, -1}, high[] = {run->x1, run->y1, 1};
            for (int64_t t = run->start; t < run->stop; t++) {
                float total = stiffness[t] * (36 * laplace * laplace);
                for (int axis = 0; axis < 3; axis++) {
                    const float *s = slopes + axis * stride;
                    float below = s[t + low[axis]] - laplace, above = s[t + high[axis]] + laplace;
                    if (flags[t + low[axis]] & ROW) total += stiffness[t + low[axis]] * (below * below);
                    if (flags[t + high[axis]] & ROW) total += stiffness[t + high[axis]] * (above * above);
                }
                out[t] = scale * total;
            }
        }
    });
}

// Rows, columns and points slab after slab, so that what one leaves is in the cache for the next.
// A chunk of slabs belongs to one thread. The rows at its two ends come before, since its neighbours
// need them, and the points between it and the next chunk after.
double visco_operate(const float *v, const float *slopes, int64_t stride, const float *stiffness,
                     const int64_t *runs, const int64_t *run_slabs, int64_t side, float laplace,
                     float scale, const int32_t *corners, const float *matrices, const int64_t *slabs,
                     const uint8_t *flags, float *rows, float *out) {
    Slopes s(slopes, stride);
    const Run *run = runs_of(runs);
    // Two slabs at least, so that no two chunks add points to the same slab.
    int64_t chunks = std::max<int64_t>(1, std::min(CHUNKS, side / 2));
    Buffer<int64_t> ends(chunks + 1);
    int64_t all = run_slabs[side];
    for (int64_t c = 1; c <= chunks; c++) {
        int64_t a = ends[c - 1] + 2, most = side - 2 * (chunks - c);
        while (a < most && run_slabs[a] < all * c / chunks) a++;
        ends[c] = c < chunks ? a : side;
    }
    Buffer<double> squares(chunks), pulls(chunks);
    auto make_rows = [&](int64_t slab) {
        return rows_of(run + run_slabs[slab], run + run_slabs[slab + 1], v, s, stiffness, laplace, rows);
    };
    auto add_points = [&](int64_t slab) {
        return points_of(slabs[slab], slabs[slab + 1], v, corners, matrices, flags, out);
    };
    parallel(chunks, [&](int64_t c) { squares[c] = make_rows(ends[c]) + make_rows(ends[c + 1] - 1); });
    parallel(chunks, [&](int64_t c) {
        int64_t a = ends[c], b = ends[c + 1];
        double square = 0, pull = 0;
        for (int64_t slab = a; slab < b; slab++) {
            if (slab + 1 < b - 1) square += make_rows(slab + 1);
            columns_of(run + run_slabs[slab], run + run_slabs[slab + 1], rows, s, laplace, scale, out);
            if (slab > a) pull += add_points(slab - 1);
        }
        squares[c] += square, pulls[c] = pull;
    });
    parallel(chunks, [&](int64_t c) { pulls[c] += add_points(ends[c + 1] - 1); });
    double square = 0, pull = 0;
    for (int64_t c = 0; c < chunks; c++) square += squares[c], pull += pulls[c];
    return scale * square + pull;
}
