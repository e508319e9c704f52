// The point and normal losses, gathered per voxel.
#include "points.h"

using namespace visco;

void visco_point_system(const float *local, const float *normals, const int64_t *starts, int64_t voxels,
                        float resolution, float point_weight, float normal_weight, float *matrices,
                        float *vectors) {
    parallel_blocks(voxels, BLOCK, [=](int64_t first, int64_t last) {
        for (int64_t m = first; m < last; m++) {
            float *matrix = matrices + 40 * m, *vector = vectors + 8 * m;
            for (int64_t k = starts[m]; k < starts[m + 1]; k++) {
                const float *at = local + 3 * k, *n = normals + 3 * k;
                float w[8], g[8][3];
                trilinear(at[0], at[1], at[2], w, g);
                float gx[8], gy[8], gz[8];
                for (int r = 0; r < 8; r++) {
                    gx[r] = resolution * g[r][0], gy[r] = resolution * g[r][1], gz[r] = resolution * g[r][2];
                    vector[r] += normal_weight * (gx[r] * n[0] + gy[r] * n[1] + gz[r] * n[2]);
                }
                for (int k = 0; k < 5; k++)
                    for (int r = 0; r < 8; r++) {
                        int c = (r + k) % 8;
                        matrix[8 * k + r] += point_weight * w[r] * w[c] +
                                             normal_weight * (gx[r] * gx[c] + gy[r] * gy[c] + gz[r] * gz[c]);
                    }
            }
        }
    });
}

void visco_point_sums(const float *values, const int32_t *corners, const float *local, const float *normals,
                      const int64_t *starts, int64_t voxels, float resolution, double *sums) {
    Buffer<double> mismatches(blocks_of(voxels, BLOCK));
    sums[0] = sum_of_blocks(voxels, BLOCK, [&](int64_t first, int64_t last) {
        double square = 0, mismatch = 0;
        for (int64_t m = first; m < last; m++) {
            float f[8];
            for (int c = 0; c < 8; c++) f[c] = values[corners[8 * m + c]];
            for (int64_t k = starts[m]; k < starts[m + 1]; k++) {
                const float *at = local + 3 * k, *n = normals + 3 * k;
                float w[8], g[8][3];
                trilinear(at[0], at[1], at[2], w, g);
                float value = 0, slope[3] = {};
                for (int c = 0; c < 8; c++) {
                    value += w[c] * f[c];
                    for (int a = 0; a < 3; a++) slope[a] += g[c][a] * f[c];
                }
                square += value * value;
                for (int a = 0; a < 3; a++) {
                    float apart = slope[a] * resolution - n[a];
                    mismatch += apart * apart;
                }
            }
        }
        mismatches[first / BLOCK] = mismatch;
        return square;
    });
    sums[1] = 0;
    for (int64_t b = 0; b < blocks_of(voxels, BLOCK); b++) sums[1] += mismatches[b];
}

void visco_point_matvec(const float *v, const int32_t *corners, const float *matrices, const int64_t *slabs,
                        int64_t slab_count, const uint8_t *flags, float *out) {
    parallel_slabs(slab_count, [=](int64_t slab) {
        points_of(slabs[slab], slabs[slab + 1], v, corners, matrices, flags, out);
    });
}

void visco_scatter(const float *per_corner, const int32_t *corners, const int64_t *slabs, int64_t slab_count,
                   const uint8_t *flags, float *out) {
    parallel_slabs(slab_count, [=](int64_t slab) {
        for (int64_t k = 8 * slabs[slab]; k < 8 * slabs[slab + 1]; k++)
            if (flags[corners[k]] & FREE) out[corners[k]] += per_corner[k];
    });
}
