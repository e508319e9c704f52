// Vectors over the nodes: conjugate gradients, Adam, sampling.
#include "common.h"

using namespace visco;

namespace {

constexpr int64_t PIECE = 4 * BLOCK;

// A block is short enough for float32 sums of eight lanes.
float dot_of(int64_t first, int64_t last, const float *a, const float *b) {
    float total = 0;
    for (int64_t i = first; i < last; i++) total += a[i] * b[i];
    return total;
}

}  // namespace

double visco_dot(const float *a, const float *b, int64_t n) {
    return sum_of_blocks(n, BLOCK, [=](int64_t first, int64_t last) { return dot_of(first, last, a, b); });
}

double visco_cg_advance(float *__restrict x, float *__restrict r, const float *__restrict p,
                        const float *__restrict q, float alpha, const float *__restrict inverse,
                        float *__restrict z, int64_t n) {
    return sum_of_blocks(n, BLOCK, [=](int64_t first, int64_t last) {
        float total = 0;
        for (int64_t i = first; i < last; i++) {
            x[i] += alpha * p[i];
            float residual = r[i] - alpha * q[i], scaled = inverse[i] * residual;
            r[i] = residual;
            z[i] = scaled;
            total += residual * scaled;
        }
        return double(total);
    });
}

void visco_cg_direction(float *__restrict p, const float *__restrict z, float beta, int64_t n) {
    parallel_blocks(n, PIECE, [=](int64_t first, int64_t last) {
        for (int64_t i = first; i < last; i++) p[i] = z[i] + beta * p[i];
    });
}

void visco_adam_advance(float *__restrict values, const float *__restrict gradient, float *__restrict mean,
                        float *__restrict square, int64_t n, float rate, float correction, float beta1,
                        float beta2, float tiny) {
    parallel_blocks(n, PIECE, [=](int64_t first, int64_t last) {
        for (int64_t i = first; i < last; i++) {
            float g = gradient[i];
            mean[i] = beta1 * mean[i] + (1 - beta1) * g;
            square[i] = beta2 * square[i] + (1 - beta2) * g * g;
            values[i] -= rate * mean[i] / (std::sqrt(square[i] / correction) + tiny);
        }
    });
}

void visco_sample(int64_t count, int64_t limit, int64_t seed, uint8_t *out) {
    uint32_t start = uint32_t(seed) * 0x9E3779B1u;
    parallel_blocks(count, PIECE, [=](int64_t first, int64_t last) {
        for (int64_t i = first; i < last; i++) {
            uint64_t h = uint64_t(i) ^ start;
            h = (h ^ h >> 16) * 0x85EBCA6Bu & 0xFFFFFFFFu;
            h = (h ^ h >> 13) * 0xC2B2AE35u & 0xFFFFFFFFu;
            out[i] = int64_t(h ^ h >> 16) < limit;
        }
    });
}
