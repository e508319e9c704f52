// Every function of the library; ``library.py`` reads the types of its arguments from here.
//
// Arrays are contiguous and described in visco_core/kernels/reference, whose functions these are
// the twins of.
#pragma once

#include <stdint.h>

#pragma GCC visibility push(default)
extern "C" {

int64_t visco_set_threads(int64_t threads);

double visco_linearise(const float *values, const float *target, const float *stiffness, const int64_t *runs,
                       int64_t run_count, float half_inverse, float laplace, float *slopes, int64_t stride,
                       float *rows);
void visco_viscosity_columns(const float *rows, const float *slopes, int64_t stride, const int64_t *runs,
                             int64_t run_count, float laplace, float scale, float *out);
void visco_viscosity_diagonal(const float *slopes, int64_t stride, const float *stiffness, const int64_t *runs,
                              int64_t run_count, const uint8_t *flags, float laplace, float scale,
                              float *out);
double visco_operate(const float *v, const float *slopes, int64_t stride, const float *stiffness,
                     const int64_t *runs, const int64_t *run_slabs, int64_t side, float laplace, float scale,
                     const int32_t *corners, const float *matrices, const int64_t *slabs,
                     const uint8_t *flags, float *rows, float *out);

void visco_point_system(const float *local, const float *normals, const int64_t *starts, int64_t voxels,
                        float resolution, float point_weight, float normal_weight, float *matrices,
                        float *vectors);
void visco_point_sums(const float *values, const int32_t *corners, const float *local, const float *normals,
                      const int64_t *starts, int64_t voxels, float resolution, double *sums);
void visco_point_matvec(const float *v, const int32_t *corners, const float *matrices, const int64_t *slabs,
                        int64_t slab_count, const uint8_t *flags, float *out);
void visco_scatter(const float *per_corner, const int32_t *corners, const int64_t *slabs,
                   int64_t slab_count, const uint8_t *flags, float *out);

double visco_coarea(const float *values, const int32_t *neighbours, int64_t n, const int64_t *slabs,
                    int64_t slab_count, const uint8_t *flags, float resolution, float beta, float scale,
                    float *out);

double visco_dot(const float *a, const float *b, int64_t n);
double visco_cg_advance(float *x, float *r, const float *p, const float *q, float alpha,
                        const float *inverse, float *z, int64_t n);
void visco_cg_direction(float *p, const float *z, float beta, int64_t n);
void visco_adam_advance(float *values, const float *gradient, float *mean, float *square, int64_t n,
                        float rate, float correction, float beta1, float beta2, float tiny);
void visco_sample(int64_t count, int64_t limit, int64_t seed, uint8_t *out);

void visco_spline_prolong(const float *coarse, int64_t n, float *fine, int64_t side);
void visco_spline_restrict(const float *fine, int64_t side, float *coarse);
double visco_spline_correct(const float *coarse, int64_t n, int64_t side, const float *r, float *z);
void visco_spline_energies(const int32_t *corners, const float *matrices, const int64_t *slabs,
                           int64_t slab_count, const int16_t *ijk, const float *basis, int64_t reach,
                           int64_t spacing, int64_t side, float *out);

void visco_splat_divergence(const float *points, const float *vectors, int64_t count, int64_t cells,
                            float *out);
void visco_squared_distance(const uint8_t *region, int64_t n, float *out);

void visco_support(const float *places, const float *directions, int64_t count, const int64_t *sides,
                   int64_t levels, const int32_t *columns, const int32_t *depths, const float *clusters,
                   float enough, float *out);

void visco_find_nodes(const int32_t *query, int64_t count, const int16_t *ijk, int64_t n,
                      const int64_t *columns, int64_t side, int32_t *out);
void visco_neighbour_table(const int16_t *ijk, int64_t n, const int64_t *columns, int64_t side,
                           int32_t *neighbours, uint8_t *flags);
int64_t visco_count_free_runs(const uint8_t *flags, int64_t n);
void visco_free_runs(const int32_t *neighbours, const uint8_t *flags, int64_t n, int64_t *runs);
void visco_crossed(const float *values, const int32_t *neighbours, int64_t n, uint8_t *crossed);
void visco_refine_counts(const int16_t *ijk, const int64_t *columns, const float *values,
                         const uint8_t *crossed, int64_t side, float limit, int64_t *fine_columns);
void visco_refine(const int16_t *ijk, const int64_t *columns, const float *values, const uint8_t *crossed,
                  int64_t side, float limit, const float *carried, int64_t stride,
                  const int64_t *fine_columns, int16_t *fine_ijk, float *fine_values, float *fine_carried);
void visco_voxel_corners(const int32_t *neighbours, int64_t n, const int32_t *base, int64_t count,
                         int32_t *out);

void visco_surface_counts(const float *values, const int32_t *neighbours, int64_t n,
                          const uint8_t *counts_of_case, uint8_t *edges, uint8_t *triangles);
void visco_surface_vertices(const float *values, const int16_t *ijk, const int32_t *neighbours, int64_t n,
                            const int64_t *first_vertex, float *vertices, float *normals);
void visco_surface_faces(const float *values, const int32_t *neighbours, int64_t n,
                         const int64_t *first_vertex, const int64_t *first_triangle,
                         const uint8_t *edges_of_case, int64_t most_triangles, const uint8_t *edge_owner,
                         const uint8_t *edge_axis, int32_t *faces);

void visco_tree_build(const double *points, int64_t n, int64_t depth, int64_t *order, double *sorted,
                      double *splits, uint8_t *axes);
void visco_tree_nearest(const double *sorted, const int64_t *order, int64_t n, int64_t depth,
                        const double *splits, const uint8_t *axes, const double *places,
                        int64_t place_count, int64_t count, double within, double *distances,
                        int64_t *indices);

int64_t visco_label_pieces(const int32_t *faces, int64_t face_count, int64_t vertex_count, int32_t *labels);

void visco_draw_triangles(const float *screen, const int32_t *faces, int64_t face_count, float *depth,
                          int32_t *owner, int64_t width, int64_t height);
void visco_draw_discs(const float *screen, int64_t count, float radius, float *depth, int32_t *owner,
                      int64_t width, int64_t height);
void visco_occlude(const float *depth, const int32_t *owner, int64_t width, int64_t height,
                   const float *screen, const int32_t *faces, int64_t face_count, const float *normals,
                   int64_t step, const double *center, double reach, const float *spiral,
                   int64_t samples, float *openness);
void visco_blur(const float *openness, const float *depth, int64_t width, int64_t height, int64_t step,
                float *smooth);
void visco_shade(const float *depth, const int32_t *owner, int64_t width, int64_t height,
                 const float *screen, const int32_t *faces, int64_t face_count, const float *normals,
                 const float *albedo, int64_t step, const double *center, const float *up,
                 const float *openness, float *picture);
}
#pragma GCC visibility pop
