// Which nodes exist and who is beside whom.
#include "common.h"

using namespace visco;

namespace {

// Children in fine column (i, j) whose parents all exist, and that lie within the limit or whose
// parents are all crossed: calls keep(k, value, two carried values) for each.
template <class Keep>
void refine_column(const int16_t *ijk, const int64_t *columns, const float *values, const float *one,
                   const float *other, const uint8_t *crossed, int64_t side, int64_t i, int64_t j,
                   float limit, const Keep &keep) {
    int64_t parents[4], ends[4];
    int count = 0;
    for (int64_t a = i / 2; a <= (i + 1) / 2; a++)
        for (int64_t b = j / 2; b <= (j + 1) / 2; b++) {
            parents[count] = columns[a * side + b];
            ends[count++] = columns[a * side + b + 1];
        }
    for (int64_t t = parents[0]; t < ends[0]; t++) {
        int16_t k = ijk[3 * t + 2];
        float total = values[t], ones = one[t], others = other[t];
        bool near = crossed[t];
        auto take = [&](int64_t node) {
            total += values[node], ones += one[node], others += other[node], near &= crossed[node];
        };
        auto emit = [&](int16_t at, float parents) {
            float mean = total / parents;
            if (std::abs(mean) < limit || near) keep(at, mean, ones / parents, others / parents);
        };
        bool whole = true;
        for (int c = 1; c < count && whole; c++) {
            while (parents[c] < ends[c] && ijk[3 * parents[c] + 2] < k) parents[c]++;
            whole = parents[c] < ends[c] && ijk[3 * parents[c] + 2] == k;
            if (whole) take(parents[c]);
        }
        if (!whole) continue;
        emit(2 * k, float(count));
        if (t + 1 == ends[0] || ijk[3 * (t + 1) + 2] != k + 1) continue;
        take(t + 1);
        for (int c = 1; c < count && whole; c++) {
            int64_t above = parents[c] + 1;
            whole = above < ends[c] && ijk[3 * above + 2] == k + 1;
            if (whole) take(above);
        }
        if (whole) emit(2 * k + 1, float(2 * count));
    }
}

uint8_t flags_of(const int32_t *neighbours, int64_t t, int64_t n) {
    auto has = [=](int64_t node, int first, int last) {
        const int32_t *beside = neighbours + 6 * node;
        return *std::max_element(beside + first, beside + last) < n;
    };
    if (!has(t, 0, 6)) return 0;
    const int32_t *beside = neighbours + 6 * t;
    if (!has(beside[2], 4, 6) || !has(beside[3], 4, 6)) return ROW | FREE;
    for (int x = 0; x < 2; x++) {
        if (!has(beside[x], 2, 6)) return ROW | FREE;
        const int32_t *along = neighbours + 6 * int64_t(beside[x]);
        if (!has(along[2], 4, 6) || !has(along[3], 4, 6)) return ROW | FREE;
    }
    return ROW | FREE | ENCLOSED;
}

}  // namespace

void visco_find_nodes(const int32_t *query, int64_t count, const int16_t *ijk, int64_t n,
                      const int64_t *columns, int64_t side, int32_t *out) {
    parallel_blocks(count, BLOCK, [=](int64_t first, int64_t last) {
        for (int64_t q = first; q < last; q++) {
            const int32_t *at = query + 3 * q;
            int64_t column = at[0] * side + at[1], low = columns[column], end = columns[column + 1];
            for (int64_t high = end; low < high;) {
                int64_t middle = (low + high) / 2;
                if (ijk[3 * middle + 2] < at[2])
                    low = middle + 1;
                else
                    high = middle;
            }
            out[q] = low < end && ijk[3 * low + 2] == at[2] ? int32_t(low) : int32_t(n);
        }
    });
}

void visco_neighbour_table(const int16_t *ijk, int64_t n, const int64_t *columns, int64_t side,
                           int32_t *neighbours, uint8_t *flags) {
    const int di[] = {-1, 1, 0, 0}, dj[] = {0, 0, -1, 1};
    parallel(side, [=](int64_t i) {
        for (int64_t j = 0; j < side; j++) {
            int64_t start = columns[i * side + j], stop = columns[i * side + j + 1];
            for (int64_t t = start; t < stop; t++) {
                int16_t k = ijk[3 * t + 2];
                neighbours[6 * t + 4] = t > start && ijk[3 * (t - 1) + 2] == k - 1 ? t - 1 : n;
                neighbours[6 * t + 5] = t + 1 < stop && ijk[3 * (t + 1) + 2] == k + 1 ? t + 1 : n;
            }
            for (int way = 0; way < 4; way++) {
                int64_t a = i + di[way], b = j + dj[way];
                bool outside = a < 0 || a >= side || b < 0 || b >= side;
                int64_t other = outside ? 0 : columns[a * side + b];
                int64_t end = outside ? 0 : columns[a * side + b + 1];
                for (int64_t t = start; t < stop; t++) {
                    int16_t k = ijk[3 * t + 2];
                    while (other < end && ijk[3 * other + 2] < k) other++;
                    neighbours[6 * t + way] = other < end && ijk[3 * other + 2] == k ? other : n;
                }
            }
        }
    });
    parallel_blocks(n, BLOCK, [=](int64_t first, int64_t last) {
        for (int64_t t = first; t < last; t++) flags[t] = flags_of(neighbours, t, n);
    });
}

int64_t visco_count_free_runs(const uint8_t *flags, int64_t n) {
    int64_t count = 0;
    for (int64_t t = 0; t < n; t++) count += flags[t] & FREE && !(t && flags[t - 1] & FREE);
    return count;
}

void visco_free_runs(const int32_t *neighbours, const uint8_t *flags, int64_t n, int64_t *runs) {
    for (int64_t t = 0; t < n; t++) {
        if (!(flags[t] & FREE)) continue;
        int64_t start = t;
        while (t < n && flags[t] & FREE) t++;
        *runs++ = start, *runs++ = t;
        for (int way = 0; way < 4; way++) *runs++ = neighbours[6 * start + way] - start;
    }
}

void visco_crossed(const float *values, const int32_t *neighbours, int64_t n, uint8_t *crossed) {
    // Blocks may mark the same node, so they store whole bytes, and all of them the same one.
    parallel_blocks(n, BLOCK, [=](int64_t first, int64_t last) {
        for (int64_t i = first; i < last; i++) {
            int32_t corners[8];
            if (!corners_above(i, neighbours, n, corners)) continue;
            int negative = 0;
            for (int32_t corner : corners) negative += values[corner] < 0;
            if (negative % 8)
                for (int32_t corner : corners) __atomic_store_n(crossed + corner, 1, __ATOMIC_RELAXED);
        }
    });
}

void visco_refine_counts(const int16_t *ijk, const int64_t *columns, const float *values,
                         const uint8_t *crossed, int64_t side, float limit, int64_t *fine_columns) {
    int64_t fine = 2 * side - 1;
    parallel(fine, [=](int64_t i) {
        for (int64_t j = 0; j < fine; j++) {
            int64_t found = 0;
            refine_column(ijk, columns, values, values, values, crossed, side, i, j, limit,
                          [&](int16_t, float, float, float) { found++; });
            fine_columns[i * fine + j + 1] = found;
        }
    });
    for (int64_t column = 0; column < fine * fine; column++) fine_columns[column + 1] += fine_columns[column];
}

void visco_refine(const int16_t *ijk, const int64_t *columns, const float *values, const uint8_t *crossed,
                  int64_t side, float limit, const float *carried, int64_t stride,
                  const int64_t *fine_columns, int16_t *fine_ijk, float *fine_values, float *fine_carried) {
    int64_t fine = 2 * side - 1, fine_stride = fine_columns[fine * fine] + 1;
    parallel(fine, [=](int64_t i) {
        for (int64_t j = 0; j < fine; j++) {
            int64_t node = fine_columns[i * fine + j];
            auto keep = [&](int16_t k, float value, float one, float other) {
                fine_ijk[3 * node] = i, fine_ijk[3 * node + 1] = j, fine_ijk[3 * node + 2] = k;
                fine_carried[node] = one, fine_carried[fine_stride + node] = other;
                fine_values[node++] = value;
            };
            refine_column(ijk, columns, values, carried, carried + stride, crossed, side, i, j, limit, keep);
        }
    });
}

void visco_voxel_corners(const int32_t *neighbours, int64_t n, const int32_t *base, int64_t count,
                         int32_t *out) {
    parallel_blocks(count, BLOCK, [=](int64_t first, int64_t last) {
        for (int64_t m = first; m < last; m++)
            if (base[m] == n || !corners_above(base[m], neighbours, n, out + 8 * m))
                std::fill_n(out + 8 * m, 8, int32_t(n));
    });
}
