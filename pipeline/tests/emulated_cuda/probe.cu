// Kernels for tests of the emulated driver.
#ifndef DYNAMIC_SHARED
#define DYNAMIC_SHARED(type, name) extern __shared__ type name[]
#endif

// out[i] = a·in[i] + b
extern "C" __global__ void probe_scale(const float *in, float *out, unsigned n, float a, float b) {
    const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < n) out[i] = a * in[i] + b;
}

// Each block reverses its values through shared memory; WITHOUT=1 omits the barrier in between.
extern "C" __global__ void __launch_bounds__(256) probe_reverse(const float *in, float *out) {
    DYNAMIC_SHARED(float, row);
    const unsigned n = blockDim.x, first = blockIdx.x * n, i = threadIdx.x;
    row[i] = in[first + i];
#if WITHOUT != 1
    __syncthreads();
#endif
    out[first + i] = row[n - 1 - i];
}

// Each half of the threads waits at another barrier: hangs on a device.
extern "C" __global__ void probe_apart(float *out) {
    if (threadIdx.x % 2) {
        __syncthreads();
        out[threadIdx.x] = 1.0f;
    } else {
        __syncthreads();
        out[threadIdx.x] = 2.0f;
    }
}

// Sums each warp's values by shuffles.
extern "C" __global__ void probe_warp_sum(const float *in, float *out) {
    float sum = in[blockIdx.x * blockDim.x + threadIdx.x];
    for (int bits = 16; bits; bits /= 2) sum += __shfl_xor_sync(0xffffffff, sum, bits);
    out[blockIdx.x * blockDim.x + threadIdx.x] = sum;
}
