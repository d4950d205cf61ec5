// CUDA C for g++: the .cu files of this project are compiled with it for the CPU, so that tests run the same source.
//
// A thread block runs on one CPU thread, its CUDA threads as fibers (block.cpp): each runs to its next barrier, then the next one.
// EMULATED_CUDA_ORDER sets their order: a result that depends on it lacks a barrier. Dynamic shared memory has the requested size and
// is filled with NaN when a block starts, so AddressSanitizer detects accesses beyond it, and tests detect reads before writes (a
// static array keeps the values of the previous block).
//
// Supported: threadIdx ..., __syncthreads, __syncwarp, __shfl_*_sync, atomicAdd, vectors of 2 and 4, the arithmetic below. Write
// `DYNAMIC_SHARED(float4, name);` for `extern __shared__ float4 name[];` (the .cu files define the macro for nvcc).
#pragma once
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

#define EMULATED_CUDA 1
#define __global__
#define __device__
#define __host__
#define __constant__ static
#define __shared__ static thread_local
#define __forceinline__ inline
#define __restrict__ __restrict
#define __grid_constant__
#define __align__(n) alignas(n)
#define __launch_bounds__(...)
#define DYNAMIC_SHARED(type, name) type *name = static_cast<type *>(emulated::dynamic_shared())

struct dim3 { unsigned x = 1, y = 1, z = 1; };
struct uint3 { unsigned x, y, z; };
struct alignas(8) float2 { float x, y; };
struct alignas(16) float4 { float x, y, z, w; };
struct alignas(8) int2 { int x, y; };
struct alignas(16) int4 { int x, y, z, w; };
struct alignas(16) double2 { double x, y; };
inline float2 make_float2(float x, float y) { return {x, y}; }
inline float4 make_float4(float x, float y, float z, float w) { return {x, y, z, w}; }
inline int2 make_int2(int x, int y) { return {x, y}; }
inline int4 make_int4(int x, int y, int z, int w) { return {x, y, z, w}; }
inline double2 make_double2(double x, double y) { return {x, y}; }

extern thread_local uint3 threadIdx, blockIdx;
extern thread_local dim3 blockDim, gridDim;
constexpr int warpSize = 32;

namespace emulated {

void *dynamic_shared();
// Barrier: waits until all threads of the block (of the warp) that have not returned wait at the same line.
void block_barrier(int line);
void warp_barrier(int line);
// Warp shuffle: the value `mine` of the thread `lane` of this warp.
uint64_t exchange(uint64_t mine, unsigned lane, int line);

template <class T> T shuffle(T mine, int lane, int line) {
    static_assert(sizeof(T) <= 8, "one register or two");
    uint64_t bits = 0;
    std::memcpy(&bits, &mine, sizeof(T));
    bits = exchange(bits, lane & (warpSize - 1), line);
    std::memcpy(&mine, &bits, sizeof(T));
    return mine;
}
inline int lane() { return int(threadIdx.x + blockDim.x * (threadIdx.y + blockDim.y * threadIdx.z)) & (warpSize - 1); }

// A kernel with its arguments, called by every thread.
using Call = std::function<void()>;

struct Kernel {
    std::vector<size_t> sizes;           // of its arguments
    std::function<Call(void **)> bind;   // copies the arguments
};

void add(const char *name, Kernel kernel);

template <class... A, size_t... I> Call with_arguments(void (*kernel)(A...), void **arguments, std::index_sequence<I...>) {
    std::tuple<std::decay_t<A>...> copied(*static_cast<std::decay_t<A> *>(arguments[I])...);
    return [=] { std::apply(kernel, copied); };
}

template <class... A> bool add(const char *name, void (*kernel)(A...)) {
    auto bound = [=](void **arguments) { return with_arguments(kernel, arguments, std::index_sequence_for<A...>()); };
    add(name, Kernel{{sizeof(A)...}, bound});
    return true;
}

}  // namespace emulated

// Registers a kernel with the emulated driver.
#define EMULATE(name) static const bool emulated_##name = emulated::add(#name, &name);

#define __syncthreads() emulated::block_barrier(__LINE__)
#define __syncwarp(...) emulated::warp_barrier(__LINE__)
#define __shfl_sync(mask, value, lane) emulated::shuffle(value, lane, __LINE__)
#define __shfl_xor_sync(mask, value, bits) emulated::shuffle(value, emulated::lane() ^ (bits), __LINE__)

// Arithmetic as on a device, to the last bit or two.
using std::max;
using std::min;
inline float __fdividef(float a, float b) { return a / b; }
inline float __frcp_rn(float a) { return 1.0f / a; }
inline float rsqrtf(float a) { return 1.0f / std::sqrt(a); }
inline double rsqrt(double a) { return 1.0 / std::sqrt(a); }
inline float __saturatef(float a) { return std::fmin(std::fmax(a, 0.0f), 1.0f); }
inline int __float2int_rd(float a) { return int(std::floor(a)); }
inline int __double2int_rd(double a) { return int(std::floor(a)); }
inline float __double2float_rn(double a) { return float(a); }
inline int __float_as_int(float a) { int i; std::memcpy(&i, &a, 4); return i; }
inline float __int_as_float(int i) { float a; std::memcpy(&a, &i, 4); return a; }
inline void sincospif(float a, float *s, float *c) { *s = float(std::sin(M_PI * a)); *c = float(std::cos(M_PI * a)); }
template <class T> T __ldg(const T *from) { return *from; }
template <class T> T __ldcg(const T *from) { return *from; }
template <class T> T __ldcs(const T *from) { return *from; }
template <class T> void __stcs(T *to, T value) { *to = value; }
// Not atomic: blocks and threads run one after another.
template <class T> T atomicAdd(T *to, T value) { T before = *to; *to = before + value; return before; }
