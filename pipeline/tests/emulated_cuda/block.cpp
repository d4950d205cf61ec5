// Runs a thread block on one CPU thread: CUDA threads are fibers, which yield at barriers.
//
// A fiber runs CUDA threads one after another until one of them waits at a barrier; it is then suspended with that thread, and
// another fiber runs the next ones. So a kernel without barriers needs one fiber. When all threads have started, the waiting ones
// resume if all threads that have not returned wait at the same line: any other state hangs a GPU.
#include "block.h"
#include <cstdlib>
#include <memory>
#include <random>
#include <ucontext.h>
#ifdef __SANITIZE_ADDRESS__
#include <sanitizer/common_interface_defs.h>
#endif

thread_local uint3 threadIdx, blockIdx;
thread_local dim3 blockDim, gridDim;

namespace emulated {
namespace {

#ifdef __SANITIZE_ADDRESS__
constexpr size_t STACK = 1 << 18;
#else
constexpr size_t STACK = 1 << 16;
#endif

enum class Wait : unsigned char { none, running, block, warp, returned };

struct Fiber {
    ucontext_t context;
    std::unique_ptr<char[]> stack{new char[STACK]};
    int thread = 0;
};

struct Thread {
    Wait wait;
    int line;
    Fiber *fiber;
    uint64_t shuffled; // value for a warp shuffle
};

// The block that runs on this CPU thread.
struct Block {
    std::vector<std::unique_ptr<Fiber>> fibers;
    std::vector<Fiber *> idle;
    std::vector<Thread> threads;
    std::vector<int> order;
    void *shared = nullptr;
    size_t next = 0;
    Fiber *running = nullptr;
    ucontext_t scheduler;
    const Call *call = nullptr;
#ifdef __SANITIZE_ADDRESS__
    const void *bottom = nullptr;
    size_t size = 0;
#endif

    void set_thread_index(int i) {
        const unsigned x = blockDim.x, y = blockDim.y;
        threadIdx = {unsigned(i) % x, unsigned(i) / x % y, unsigned(i) / (x * y)};
    }
    void resume(Fiber *fiber);
    void yield();
    void shuffle(std::mt19937 &random);
    bool release();
    const char *run_one();
};

thread_local Block block;

void enter() {
#ifdef __SANITIZE_ADDRESS__
    __sanitizer_finish_switch_fiber(nullptr, &block.bottom, &block.size);
#endif
    for (;;) {
        Fiber *self = block.running;
        while (block.next < block.order.size()) {
            const int i = block.order[block.next++];
            self->thread = i;
            block.threads[i] = {Wait::running, 0, self, 0};
            block.set_thread_index(i);
            (*block.call)();
            block.threads[self->thread].wait = Wait::returned;
        }
        block.idle.push_back(self);
        block.yield();
    }
}

void Block::resume(Fiber *fiber) {
    running = fiber;
#ifdef __SANITIZE_ADDRESS__
    void *fake = nullptr;
    __sanitizer_start_switch_fiber(&fake, fiber->stack.get(), STACK);
    swapcontext(&scheduler, &fiber->context);
    __sanitizer_finish_switch_fiber(fake, nullptr, nullptr);
#else
    swapcontext(&scheduler, &fiber->context);
#endif
}

void Block::yield() {
    Fiber *self = running;
#ifdef __SANITIZE_ADDRESS__
    void *fake = nullptr;
    __sanitizer_start_switch_fiber(&fake, bottom, size);
    swapcontext(&self->context, &scheduler);
    __sanitizer_finish_switch_fiber(fake, &bottom, &size);
#else
    swapcontext(&self->context, &scheduler);
#endif
}

// Order in which the threads run until their next barrier.
void Block::shuffle(std::mt19937 &random) {
    static const char *setting = std::getenv("EMULATED_CUDA_ORDER");
    const size_t n = order.size();
    const bool reverse = setting && !std::strcmp(setting, "reverse");
    for (size_t i = 0; i < n; ++i) order[i] = int(reverse ? n - 1 - i : i);
    if (setting && !std::strcmp(setting, "random")) std::shuffle(order.begin(), order.end(), random);
}

// Marks the threads that may resume; false if there are none.
bool Block::release() {
    const size_t n = threads.size();
    bool some = false, all_block = true;
    int line = 0;
    for (const Thread &t : threads) {
        if (t.wait == Wait::returned) continue;
        line = line ? line : t.line;
        all_block &= t.wait == Wait::block && t.line == line;
    }
    for (size_t warp = 0; warp < n; warp += warpSize) {
        const size_t end = std::min(n, warp + warpSize);
        int at = 0;
        bool together = true, any = false;
        for (size_t i = warp; i < end; ++i) {
            if (threads[i].wait == Wait::returned) continue;
            at = at ? at : threads[i].line;
            any = true;
            together &= threads[i].wait == Wait::warp && threads[i].line == at;
        }
        if (!any || !(together || all_block)) continue;
        some = true;
        for (size_t i = warp; i < end; ++i)
            if (threads[i].wait != Wait::returned) threads[i].wait = Wait::none;
    }
    return some;
}

const char *Block::run_one() {
    // The same random order for every block.
    std::mt19937 random(7);
    shuffle(random);
    for (Thread &t : threads) t.wait = Wait::returned;
    next = 0;
    while (next < order.size()) {
        if (idle.empty()) {
            fibers.push_back(std::make_unique<Fiber>());
            Fiber *fiber = fibers.back().get();
            getcontext(&fiber->context);
            fiber->context.uc_stack.ss_sp = fiber->stack.get();
            fiber->context.uc_stack.ss_size = STACK;
            fiber->context.uc_link = nullptr;
            makecontext(&fiber->context, enter, 0);
            idle.push_back(fiber);
        }
        Fiber *fiber = idle.back();
        idle.pop_back();
        resume(fiber);
    }
    for (;;) {
        bool waiting = false;
        for (const Thread &t : threads) waiting |= t.wait != Wait::returned;
        if (!waiting) return nullptr;
        if (!release()) return "a barrier is reached by only a part of its threads";
        shuffle(random);
        for (int i : order) {
            if (threads[i].wait != Wait::none) continue;
            threads[i].wait = Wait::running;
            set_thread_index(i);
            resume(threads[i].fiber);
        }
    }
}

void wait(Wait kind, int line) {
    Fiber *self = block.running;
    Thread &t = block.threads[self->thread];
    t.wait = kind;
    t.line = line;
    block.yield();
}

}  // namespace

void block_barrier(int line) { wait(Wait::block, line); }
void warp_barrier(int line) { wait(Wait::warp, line); }
void *dynamic_shared() { return block.shared; }

uint64_t exchange(uint64_t mine, unsigned lane, int line) {
    const int self = block.running->thread;
    block.threads[self].shuffled = mine;
    wait(Wait::warp, line);
    const uint64_t theirs = block.threads[size_t(self) / warpSize * warpSize + lane].shuffled;
    wait(Wait::warp, -line);
    return theirs;
}

const char *run(dim3 grid, dim3 size, size_t shared, const Call &call) {
    const size_t n = size_t(size.x) * size.y * size.z;
    block.threads.assign(n, Thread{Wait::returned, 0, nullptr, 0});
    block.order.resize(n);
    block.call = &call;
    gridDim = grid;
    blockDim = size;
    for (unsigned z = 0; z < grid.z; ++z)
        for (unsigned y = 0; y < grid.y; ++y)
            for (unsigned x = 0; x < grid.x; ++x) {
                blockIdx = {x, y, z};
                // Of the requested size, and aligned as on a device.
                if (posix_memalign(&block.shared, 1024, std::max<size_t>(shared, 1))) return "no shared memory";
                std::memset(block.shared, 0xff, shared);
                const char *wrong = block.run_one();
                std::free(block.shared);
                if (wrong) {
                    // Suspended fibers never return.
                    block.idle.clear();
                    block.fibers.clear();
                    return wrong;
                }
            }
    return nullptr;
}

}  // namespace emulated
