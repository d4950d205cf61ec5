// Runs a kernel's thread blocks on this thread.
#pragma once
#include "cuda_cpu.h"

namespace emulated {

// Calls `call` for every thread of every block; `shared` bytes of dynamic shared memory. What is wrong about its barriers,
// or nothing.
const char *run(dim3 grid, dim3 block, size_t shared, const Call &call);

}  // namespace emulated
