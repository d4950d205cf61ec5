// Runs the thread blocks of a kernel on this CPU thread.
#pragma once
#include "cuda_cpu.h"

namespace emulated {

// Calls `call` for every thread of every block, with `shared` bytes of dynamic shared memory. Returns an error of its barriers, or null.
const char *run(dim3 grid, dim3 block, size_t shared, const Call &call);

}  // namespace emulated
