// A k-d tree over points: a perfect binary tree of ranges, halved at the median across the widest
// side, until a leaf holds few. Node i has the children 2i + 1 and 2i + 2.
#include "common.h"

using namespace visco;

namespace {

struct Found {
    double square;
    int64_t index;
    bool operator<(const Found &other) const {
        return square < other.square || (square == other.square && index < other.index);
    }
};

struct Tree {
    const double *points;  // (n, 3) in the order of the leaves
    const int64_t *order;  // of each, its place among the caller's points
    int64_t n, depth;
    const double *splits;
    const uint8_t *axes;
};

class Search {
  public:
    Search(const Tree &tree, const double *place, Found *heap, int64_t count, double within)
        : tree(tree), place(place), heap(heap), count(count), worst(within) {
        double offsets[3] = {};
        visit(0, 0, 0, tree.n, offsets);
        std::sort_heap(heap, heap + found);
    }

    int64_t found = 0;

  private:
    // offsets: from the place to the node's box, along each axis.
    void visit(int64_t node, int64_t depth, int64_t low, int64_t high, double *offsets) {
        if (depth == tree.depth) return take(low, high);
        int axis = tree.axes[node];
        double across = place[axis] - tree.splits[node], before = offsets[axis];
        int64_t middle = low + (high - low) / 2;
        auto descend = [&](bool upper) {
            visit(2 * node + 1 + upper, depth + 1, upper ? middle : low, upper ? high : middle, offsets);
        };
        descend(across >= 0);
        offsets[axis] = across;
        if (offsets[0] * offsets[0] + offsets[1] * offsets[1] + offsets[2] * offsets[2] < worst)
            descend(across < 0);
        offsets[axis] = before;
    }

    void take(int64_t low, int64_t high) {
        for (int64_t p = low; p < high; p++) {
            const double *q = tree.points + 3 * p;
            double x = q[0] - place[0], y = q[1] - place[1], z = q[2] - place[2];
            Found candidate = {x * x + y * y + z * z, tree.order[p]};
            if (!(candidate.square < worst)) continue;
            if (found == count) std::pop_heap(heap, heap + found--);
            heap[found++] = candidate;
            std::push_heap(heap, heap + found);
            if (found == count) worst = heap[0].square;
        }
    }

    const Tree &tree;
    const double *place;
    Found *heap;
    int64_t count;
    double worst;
};

void build(const double *points, int64_t *order, int64_t node, int64_t low, int64_t high, int64_t levels,
           double *splits, uint8_t *axes) {
    if (!levels) return;
    double least[3], most[3];
    for (int a = 0; a < 3; a++) least[a] = INFINITY, most[a] = -INFINITY;
    for (int64_t p = low; p < high; p++)
        for (int a = 0; a < 3; a++) {
            double x = points[3 * order[p] + a];
            least[a] = std::min(least[a], x), most[a] = std::max(most[a], x);
        }
    int axis = 0;
    for (int a = 1; a < 3; a++)
        if (most[a] - least[a] > most[axis] - least[axis]) axis = a;
    int64_t middle = low + (high - low) / 2;
    auto before = [=](int64_t a, int64_t b) { return points[3 * a + axis] < points[3 * b + axis]; };
    if (middle < high) std::nth_element(order + low, order + middle, order + high, before);
    splits[node] = middle < high ? points[3 * order[middle] + axis] : INFINITY;
    axes[node] = uint8_t(axis);
    build(points, order, 2 * node + 1, low, middle, levels - 1, splits, axes);
    build(points, order, 2 * node + 2, middle, high, levels - 1, splits, axes);
}

}  // namespace

void visco_tree_build(const double *points, int64_t n, int64_t depth, int64_t *order, double *sorted,
                      double *splits, uint8_t *axes) {
    for (int64_t p = 0; p < n; p++) order[p] = p;
    // The upper levels node by node, each level's nodes at once; below them every node's own tree.
    constexpr int64_t UPPER = 5;
    int64_t upper = std::min(UPPER, depth);
    auto range = [=](int64_t level, int64_t place) {
        int64_t low = 0, high = n;
        for (int64_t bit = level - 1; bit >= 0; bit--) {
            int64_t middle = low + (high - low) / 2;
            (place >> bit & 1 ? low : high) = middle;
        }
        return std::pair(low, high);
    };
    for (int64_t level = 0; level <= upper; level++)
        parallel(int64_t(1) << level, [=](int64_t place) {
            auto [low, high] = range(level, place);
            int64_t node = (int64_t(1) << level) - 1 + place;
            if (level < upper) {
                build(points, order, node, low, high, 1, splits, axes);
            } else {
                build(points, order, node, low, high, depth - upper, splits, axes);
                for (int64_t p = low; p < high; p++) std::copy_n(points + 3 * order[p], 3, sorted + 3 * p);
            }
        });
}

void visco_tree_nearest(const double *sorted, const int64_t *order, int64_t n, int64_t depth,
                        const double *splits, const uint8_t *axes, const double *places, int64_t place_count,
                        int64_t count, double within, double *distances, int64_t *indices) {
    Tree tree{sorted, order, n, depth, splits, axes};
    parallel_blocks(place_count, 64, [=](int64_t first, int64_t last) {
        Buffer<Found> heap(count);
        for (int64_t p = first; p < last; p++) {
            Search search(tree, places + 3 * p, heap, count, within * within);
            for (int64_t k = 0; k < count; k++) {
                bool is = k < search.found;
                distances[p * count + k] = is ? std::sqrt(heap[k].square) : INFINITY;
                indices[p * count + k] = is ? heap[k].index : n;
            }
        }
    });
}
