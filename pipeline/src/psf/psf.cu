// PSF stage on a GPU: the sums of psf.rs, launched by psf/cuda. The CPU implementations are psf/portable.rs and psf/simd.
//
//     film = sum over nodes of (w_node . remapped) * P_node,    w_node = the node's weight (psf/grid.rs)
//
// psf_pack    a block of remapped pixels with their polar coordinates (psf/polar.rs), computed once a block instead of once a node
// psf_spectra spectra of kernels, which are base kernels transposed and rotated by quarter turns
// psf_scatter for each node: weight, FFT along y, FFT along x, multiply by the spectrum, accumulate in registers; then one inverse
// psf_unfold  last radix-4 step of the 256 transforms, each shared by four thread blocks
// psf_add     overlap-add of a tile's blocks in fixed order: no atomics, the same bits in every run
// psf_copy    the contribution for a window of 1 pixel
//
// A transform of SIDE x SIDE real values has SIDE / 2 spectral rows (right-angle transform along y, psf/simd/block.rs):
//     Z_k = sum_y x_y exp(-2 pi i y (2k - 1/2) / SIDE),   k < SIDE / 2
// A thread block holds the ROWS rows k = SLICES q + slice of them: all 64 of SIDE 128, every fourth of SIDE 256. That is always
// 8192 complex values = 64 KB of shared memory. A multiprocessor runs one thread block at a time: 512 threads of 128 registers
// (psf_spectra: 72) leave too few of its 65536 for a second.
// With y = j + 8i and q = k + FIRST l the sum separates into
//     i:  FIRST values k of  sum_i x_y fold_i exp(-2 pi i (i mod FIRST) k / FIRST),   fold_i = exp(-2 pi i 8i (2 slice - 1/2) / SIDE)
//     j:  times along_y = exp(-2 pi i j (2 (SLICES k + slice) - 1/2) / SIDE), then radix 8
// Along x, x = j + LAST m: radix 16 over m, times along_x = exp(-2 pi i j p / SIDE), radix LAST over j. Outputs stay in digit-reversed
// order: the inverse applies the stages in reverse, and spectra are stored in the order in which the threads hold them.
//
// Accuracy: (r, theta) are computed as on the CPU (near the axis in f64), and weights from the CPU's coefficients by correctly rounded
// f32 operations: no approximate division or root is used.

// From cuda/partition.rs: THREADS, ROW_GROUP

#ifndef DYNAMIC_SHARED
#define DYNAMIC_SHARED(type, name) extern __shared__ type name[]
#endif

#include "transform.cuh"

// Computes the image of one job (blockIdx.x / SLICES).
template <int SIDE> DEVICE void scatter(
    const Job *jobs, const Weight *weights, const float4 *packed, const float4 *spectra, const float2 *tables, float *images) {
    typedef Layout<SIDE> C;
    typedef LastStage<SIDE> Last;
    DYNAMIC_SHARED(float4, memory);
    Shared<SIDE> &s = *(Shared<SIDE> *)memory;
    const int job = blockIdx.x / C::SLICES, slice = blockIdx.x % C::SLICES;
    int n = jobs[job].first;
    load_tables<SIDE>(s, tables, slice);
    if (threadIdx.x == 0) s.job = jobs[job];
    if (threadIdx.x == 32) s.weights[n & 1] = weights[n];
    Complex sum[Last::TASKS][C::LAST];
#pragma unroll
    for (int i = 0; i < Last::TASKS; ++i)
#pragma unroll
        for (int j = 0; j < C::LAST; ++j) sum[i][j] = complex(0.f, 0.f);
#pragma unroll 1
    do { // a job has at least one node
        barrier<1>(); // job, weight and tables are written; the values of the previous node have been read
        if (thread() == 0 && n + 1 < reload(s.job.end)) s.weights[(n + 1) & 1] = weights[n + 1];
        const WeightedBlock<SIDE> source = {s, s.weights[n & 1], packed};
        float4 kernel[Last::TASKS][C::LAST / 2]; // the thread's part of the spectrum: read while the stage along x is computed
        forward<SIDE>(s, source, [&] {
            const size_t number = reload(s.weights[n & 1].spectrum) + reload(s.job.part);
            const float4 *spectrum = spectra + number * C::SPECTRUM + slice * (POINTS / 2) + Last::spectrum(thread(), 0, 0);
#pragma unroll
            for (int i = 0; i < Last::TASKS; ++i)
#pragma unroll
                for (int c = 0; c < C::LAST / 2; ++c) kernel[i][c] = __ldcg(spectrum + Last::spectrum(0, i, c));
        });
        const int t0 = thread();
#pragma unroll
        for (int i = 0; i < Last::TASKS; ++i) {
            Complex a[C::LAST];
            Last::transform(s, t0, i, a);
#pragma unroll
            for (int c = 0; c < C::LAST / 2; ++c) {
                const float4 k = kernel[i][c];
                Complex &p = sum[i][2 * c], &q = sum[i][2 * c + 1];
                const Complex e = a[2 * c], f = a[2 * c + 1];
                p.re = fmaf(e.re, k.x, fmaf(-e.im, k.y, p.re));
                p.im = fmaf(e.re, k.y, fmaf(e.im, k.x, p.im));
                q.re = fmaf(f.re, k.z, fmaf(-f.im, k.w, q.re));
                q.im = fmaf(f.re, k.w, fmaf(f.im, k.z, q.im));
            }
        }
    } while (++n < reload(s.job.end));
    inverse<SIDE>(s, sum, slice, images + (size_t)job * (SIDE * SIDE));
}

// Transforms one kernel part (blockIdx.x / SLICES), scaled by 2 / SIDE^2.
template <int SIDE> DEVICE void spectra(const KernelPart *parts, const float *base_kernels, int window, const float2 *tables, float4 *spectra) {
    typedef Layout<SIDE> C;
    typedef LastStage<SIDE> Last;
    DYNAMIC_SHARED(float4, memory);
    Shared<SIDE> &s = *(Shared<SIDE> *)memory;
    const int slice = blockIdx.x % C::SLICES;
    const KernelSource<SIDE> source = {base_kernels, window, parts[blockIdx.x / C::SLICES]};
    load_tables<SIDE>(s, tables, slice);
    barrier<1>();
    forward<SIDE>(s, source, [] {});
    float4 *to = spectra + (size_t)source.part.spectrum * C::SPECTRUM + slice * (POINTS / 2);
#pragma unroll 1
    for (int i = 0; i < Last::TASKS; ++i) {
        Complex a[C::LAST];
        Last::transform(s, threadIdx.x, i, a);
#pragma unroll
        for (int c = 0; c < C::LAST / 2; ++c)
            to[Last::spectrum(threadIdx.x, i, c)] = make_float4(a[2 * c].re, a[2 * c].im, a[2 * c + 1].re, a[2 * c + 1].im);
    }
}

#define SCATTER const Job *jobs, const Weight *weights, const float4 *packed, const float4 *spectra, const float2 *tables, float *images
#define SPECTRA const KernelPart *parts, const float *base_kernels, int window, const float2 *tables, float4 *to
#define ENTRIES(SIDE) \
    extern "C" __global__ void __launch_bounds__(THREADS, 1) psf_scatter_##SIDE(SCATTER) { \
        scatter<SIDE>(jobs, weights, packed, spectra, tables, images); \
    } \
    extern "C" __global__ void __launch_bounds__(THREADS, 1) psf_spectra_##SIDE(SPECTRA) { \
        spectra<SIDE>(parts, base_kernels, window, tables, to); \
    }
ENTRIES(128)
ENTRIES(256)

// Combines the four slices of an image, in place: a thread has the rows n + 32 i of a column. Row n + 32 s holds the real part of
// slice s, the row 128 further down its imaginary part:
//     x(n + 32m) + i x(n + 32m + 128) = exp(-i pi m / 8) sum_s g_s exp(2 pi i m s / 4)
extern "C" __global__ void __launch_bounds__(256) psf_unfold(float *images) {
    const float C[4] = {1.f, 0.923879532511286756f, 0.707106781186547524f, 0.382683432365089772f};
    float *values = images + (size_t)(blockIdx.x / 32) * (256 * 256) + (blockIdx.x % 32) * 256 + threadIdx.x;
    Complex a[4];
#pragma unroll
    for (int i = 0; i < 4; ++i) a[i] = complex(values[i * (32 * 256)], values[(i + 4) * (32 * 256)]);
    Fft<4, true>::run(a);
#pragma unroll
    for (int i = 0; i < 4; ++i) {
        const Complex v = times_conjugate(a[i], complex(C[i], i ? C[4 - i] : 0.f));
        values[i * (32 * 256)] = v.re;
        values[(i + 4) * (32 * 256)] = v.im;
    }
}

// Packs block blockIdx.x as [remapped value, r, theta, 0] in rows of `side`, zero-padded. r and theta are relative to the block's
// centre. `polynomials`: ATAN (8) and SECANT (6) of psf/polar.rs.
extern "C" __global__ void __launch_bounds__(256) psf_pack(const Block *blocks, int side, const float *remapped, const float *polynomials, float4 *packed) {
    const Block b = blocks[blockIdx.x];
    float4 *to = packed + (size_t)b.packed * side;
    for (int i = threadIdx.x; i < b.height * b.width; i += 256) {
        const int y = i / b.width, x = i - y * b.width;
        float4 v = make_float4(0.f, 0.f, 0.f, 0.f);
        if (y < b.rows && x < b.cols) {
            v.x = __ldg(remapped + b.remapped + (size_t)y * b.stride + x);
            if (b.near_axis) {
                const double dy = b.dy + y, dx = b.dx + x, tau = 6.283185307179586, angle = atan2(dy, dx) - b.azimuth;
                v.y = (float)(hypot(dy, dx) - b.r);
                v.z = (float)(angle - tau * round(angle / tau));
            } else {
                const float dy = (float)y - b.half_y, dx = (float)x - b.half_x;
                const float along = dx * b.cosine + dy * b.sine, across = dy * b.cosine - dx * b.sine;
                const float t = across / ((float)b.r + along), z = t * t;
                float atan = __ldg(polynomials + 7), secant = __ldg(polynomials + 13);
#pragma unroll
                for (int k = 6; k >= 0; --k) atan = fmaf(atan, z, __ldg(polynomials + k));
#pragma unroll
                for (int k = 12; k >= 8; --k) secant = fmaf(secant, z, __ldg(polynomials + k));
                v.y = fmaf(across * t, secant, along);
                v.z = t * atan;
            }
        }
        to[y * side + x] = v;
    }
}

// Overlap-add of tile blockIdx.z. Order of the sum of a pixel: blocks row by row, within each its kernel parts row by row, within
// each its node groups. Kernels are divided into `parts` x `parts` of `part` pixels, the last ones smaller.
extern "C" __global__ void __launch_bounds__(256, 4) psf_add(
    const Tile *tiles, const BlockImages *block_images, const float *images, int side, int window, int parts, int part, float *contribution) {
    const Tile tile = tiles[blockIdx.z];
    const int x = blockIdx.x * 32 + (threadIdx.x & 31), y = blockIdx.y * 8 + (threadIdx.x >> 5);
    if (x >= tile.cols || y >= tile.rows) return;
    // Block i contributes to the rows from i * block_y to i * block_y + (rows of the block) + window - 2.
    const int up = min(y / tile.block_y, tile.down - 1), left = min(x / tile.block_x, tile.across - 1);
    float sum = 0.f;
    for (int i = max(0, y - window + 1) / tile.block_y; i <= up; ++i)
        for (int j = max(0, x - window + 1) / tile.block_x; j <= left; ++j) {
            const BlockImages block = block_images[tile.first + i * tile.across + j];
            const int rows = i == tile.down - 1 ? tile.last_rows : tile.block_y, cols = j == tile.across - 1 ? tile.last_cols : tile.block_x;
            for (int a = 0; a < parts; ++a) {
                const int yy = y - i * tile.block_y - a * part;
                if (yy < 0 || yy >= rows + min(part, window - a * part) - 1) continue;
                for (int b = 0; b < parts; ++b) {
                    const int xx = x - j * tile.block_x - b * part;
                    if (xx < 0 || xx >= cols + min(part, window - b * part) - 1) continue;
                    const float *image = images + (size_t)(block.first + a * parts + b) * (side * side) + yy * side + xx;
                    for (int k = 0; k < block.groups; ++k) sum += __ldg(image + (size_t)k * (parts * parts) * (side * side));
                }
            }
        }
    contribution[tile.contribution + (size_t)y * tile.stride + x] = sum;
}

// Copies tile blockIdx.z.
extern "C" __global__ void __launch_bounds__(256) psf_copy(const Tile *tiles, const float *remapped, float *contribution) {
    const Tile tile = tiles[blockIdx.z];
    const int x = blockIdx.x * 32 + (threadIdx.x & 31), y = blockIdx.y * 8 + (threadIdx.x >> 5);
    if (x >= tile.cols || y >= tile.rows) return;
    contribution[tile.contribution + (size_t)y * tile.stride + x] = __ldg(remapped + tile.remapped + (size_t)y * tile.cols + x);
}
