// Marching cubes over the band.
#include "common.h"

using namespace visco;

namespace {

int case_of(const float *values, const int32_t *corners) {
    int found = 0;
    for (int c = 0; c < 8; c++) found |= (values[corners[c]] < 0) << c;
    return found;
}

// Whether the edge from node i up to node ``other`` crosses zero.
bool is_cut(const float *values, int64_t i, int64_t other, int64_t n) {
    return other < n && (values[other] < 0) != (values[i] < 0);
}

}  // namespace

void visco_surface_counts(const float *values, const int32_t *neighbours, int64_t n,
                          const uint8_t *counts_of_case, uint8_t *edges, uint8_t *triangles) {
    parallel_blocks(n, BLOCK, [=](int64_t first, int64_t last) {
        for (int64_t i = first; i < last; i++) {
            int32_t corners[8];
            edges[i] = 0;
            for (int axis = 0; axis < 3; axis++)
                edges[i] += is_cut(values, i, neighbours[6 * i + 2 * axis + 1], n);
            bool whole = corners_above(i, neighbours, n, corners);
            triangles[i] = whole ? counts_of_case[case_of(values, corners)] : 0;
        }
    });
}

void visco_surface_vertices(const float *values, const int16_t *ijk, const int32_t *neighbours, int64_t n,
                            const int64_t *first_vertex, float *vertices, float *normals) {
    auto gradient = [=](int64_t node, float *out) {
        for (int a = 0; a < 3; a++) {
            int64_t low = neighbours[6 * node + 2 * a], high = neighbours[6 * node + 2 * a + 1];
            low = low == n ? node : low, high = high == n ? node : high;
            out[a] = (values[high] - values[low]) / float(std::max((high != node) + (low != node), 1));
        }
    };
    parallel_blocks(n, BLOCK, [=](int64_t first, int64_t last) {
        for (int64_t i = first; i < last; i++) {
            int64_t vertex = first_vertex[i];
            for (int axis = 0; axis < 3 && vertex < first_vertex[i + 1]; axis++) {
                int64_t other = neighbours[6 * i + 2 * axis + 1];
                if (!is_cut(values, i, other, n)) continue;
                float t = std::clamp(values[i] / (values[i] - values[other]), 1e-4f, 1 - 1e-4f);
                float here[3], there[3], square = 0;
                gradient(i, here), gradient(other, there);
                float *place = vertices + 3 * vertex, *normal = normals + 3 * vertex;
                for (int a = 0; a < 3; a++) {
                    place[a] = ijk[3 * i + a];
                    normal[a] = (1 - t) * here[a] + t * there[a];
                    square += normal[a] * normal[a];
                }
                place[axis] += t;
                float norm = std::max(std::sqrt(square), 1e-20f);
                for (int a = 0; a < 3; a++) normal[a] /= norm;
                vertex++;
            }
        }
    });
}

void visco_surface_faces(const float *values, const int32_t *neighbours, int64_t n,
                         const int64_t *first_vertex, const int64_t *first_triangle,
                         const uint8_t *edges_of_case, int64_t most_triangles, const uint8_t *edge_owner,
                         const uint8_t *edge_axis, int32_t *faces) {
    parallel_blocks(n, BLOCK, [=](int64_t first, int64_t last) {
        for (int64_t i = first; i < last; i++) {
            int32_t corners[8];
            int64_t entries = 3 * (first_triangle[i + 1] - first_triangle[i]);
            if (!entries || !corners_above(i, neighbours, n, corners)) continue;
            const uint8_t *edges = edges_of_case + 3 * most_triangles * case_of(values, corners);
            for (int64_t e = 0; e < entries; e++) {
                int64_t node = corners[edge_owner[edges[e]]], vertex = first_vertex[node];
                for (int axis = 0; axis < edge_axis[edges[e]]; axis++)
                    vertex += is_cut(values, node, neighbours[6 * node + 2 * axis + 1], n);
                faces[3 * first_triangle[i] + e] = int32_t(vertex);
            }
        }
    });
}

// Joins the vertices that share a face (union by the smaller root, paths halved), then numbers the
// pieces by their first vertices; returns how many there are.
int64_t visco_label_pieces(const int32_t *faces, int64_t face_count, int64_t vertex_count, int32_t *labels) {
    for (int32_t v = 0; v < vertex_count; v++) labels[v] = v;
    auto root = [=](int32_t v) {
        while (labels[v] != v) v = labels[v] = labels[labels[v]];
        return v;
    };
    for (int64_t f = 0; f < face_count; f++)
        for (int corner = 1; corner < 3; corner++) {
            int32_t a = root(faces[3 * f]), b = root(faces[3 * f + corner]);
            labels[std::max(a, b)] = std::min(a, b);
        }
    // A root comes before all that it is the root of, and has its number when they ask.
    int32_t pieces = 0;
    for (int32_t v = 0; v < vertex_count; v++) labels[v] = labels[v] == v ? pieces++ : labels[labels[v]];
    return pieces;
}
