// A pool whose threads help where they can and are waited for only while they are at work: beside
// other busy processes a thread that does not get a core delays nobody.
#include "parallel.h"

#include <atomic>
#include <new>
#include <pthread.h>
#include <sched.h>

#include "kernels.h"

namespace visco {
namespace {

constexpr int MOST_THREADS = 256;
constexpr int SPINS = 4000;  // some 20 µs: the next kernel mostly comes before a thread has slept

struct Pool {
    pthread_mutex_t in_use = PTHREAD_MUTEX_INITIALIZER;  // by one caller at a time
    pthread_mutex_t sleep = PTHREAD_MUTEX_INITIALIZER;
    pthread_cond_t wake = PTHREAD_COND_INITIALIZER;
    int helpers = 0;
    std::atomic<int> sleeping{0};
    std::atomic<uint64_t> round{0};

    // The work of a round. A helper counts itself in before it looks whether the round is open, and
    // the caller closes it before looking for helpers, so that either sees the other.
    std::atomic<bool> open{false};
    std::atomic<int> working{0};
    std::atomic<int> places{0};
    std::atomic<int64_t> next{0};
    int64_t tasks = 0;
    Body body = nullptr;
    const void *context = nullptr;
};

Pool *new_pool() { return new (__builtin_malloc(sizeof(Pool))) Pool; }

Pool *pool = new_pool();
thread_local int threads_of_caller = 1;

void relax() {
#if defined(__x86_64__)
    __builtin_ia32_pause();
#elif defined(__aarch64__)
    asm volatile("yield");
#endif
}

void take_tasks(Pool &p) {
    for (int64_t task; (task = p.next.fetch_add(1)) < p.tasks;) p.body(p.context, task);
}

void *help(void *argument) {
    Pool &p = *static_cast<Pool *>(argument);
    uint64_t seen = 0;
    for (;;) {
        for (int spin = 0; spin < SPINS && p.round.load() == seen; spin++) relax();
        if (p.round.load() == seen) {
            pthread_mutex_lock(&p.sleep);
            p.sleeping.fetch_add(1);
            while (p.round.load() == seen) pthread_cond_wait(&p.wake, &p.sleep);
            p.sleeping.fetch_sub(1);
            pthread_mutex_unlock(&p.sleep);
        }
        seen = p.round.load();
        p.working.fetch_add(1);
        if (p.open.load() && p.places.fetch_sub(1) > 0) take_tasks(p);
        p.working.fetch_sub(1);
    }
}

// A forked child has none of the threads; its first parallel work makes new ones.
void forget_threads() { pool = new_pool(); }

void add_helpers(Pool &p, int wanted) {
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, [] { pthread_atfork(nullptr, nullptr, forget_threads); });
    while (p.helpers < wanted) {
        pthread_t thread;
        if (pthread_create(&thread, nullptr, help, &p)) return;
        pthread_detach(thread);
        p.helpers++;
    }
}

}  // namespace

void run_tasks(int64_t tasks, Body body, const void *context) {
    Pool &p = *pool;
    int helpers = threads_of_caller - 1;
    if (tasks - 1 < helpers) helpers = tasks - 1;
    if (helpers < 1 || pthread_mutex_trylock(&p.in_use)) {
        for (int64_t task = 0; task < tasks; task++) body(context, task);
        return;
    }
    add_helpers(p, helpers);
    p.tasks = tasks, p.body = body, p.context = context;
    p.next.store(0);
    p.places.store(helpers);
    p.open.store(true);
    p.round.fetch_add(1);
    if (p.sleeping.load()) {
        pthread_mutex_lock(&p.sleep);
        pthread_cond_broadcast(&p.wake);
        pthread_mutex_unlock(&p.sleep);
    }
    take_tasks(p);
    p.open.store(false);
    for (int spin = 0; p.working.load(); spin++) spin < SPINS ? relax() : (void)sched_yield();
    pthread_mutex_unlock(&p.in_use);
}

}  // namespace visco

int64_t visco_set_threads(int64_t threads) {
    int64_t before = visco::threads_of_caller;
    threads = threads < 1 ? 1 : threads;
    visco::threads_of_caller = threads < visco::MOST_THREADS ? threads : visco::MOST_THREADS;
    return before;
}
