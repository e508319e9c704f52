// Work in tasks, for the threads of one pool.
#pragma once

#include <cstdint>
#include <type_traits>

namespace visco {

using Body = void (*)(const void *context, int64_t task);

// Runs body(context, 0 .. tasks - 1), each once, in any order, and returns when all are done.
void run_tasks(int64_t tasks, Body body, const void *context);

template <class Work>
void parallel(int64_t tasks, const Work &work) {
    run_tasks(
        tasks,
        [](const void *context, int64_t task) { (*static_cast<const Work *>(context))(task); },
        &work);
}

// How many blocks of size n items make, the last one shorter.
inline int64_t blocks_of(int64_t n, int64_t size) { return (n + size - 1) / size; }

// work(first, last) for blocks of size of n items.
template <class Work>
void parallel_blocks(int64_t n, int64_t size, const Work &work) {
    parallel(blocks_of(n, size), [&](int64_t block) {
        int64_t first = block * size, last = first + size;
        work(first, last < n ? last : n);
    });
}

}  // namespace visco
