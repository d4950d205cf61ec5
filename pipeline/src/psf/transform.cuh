// Transform of a block or of a kernel part by one thread block in shared memory, and its inverse. The equations are at the head of psf.cu.

#pragma once

#include "descriptors.cuh"
#include "fft.cuh"

#ifndef WITHOUT
#define WITHOUT 0
#endif

// A numbered barrier: tests omit one to verify that they detect it.
template <int NUMBER> DEVICE void barrier() {
    if (NUMBER != WITHOUT) __syncthreads();
}

// The thread's index, read again at each use: no address of a stage then occupies registers across the loop over nodes.
DEVICE int thread() {
#ifdef EMULATED_CUDA
    return threadIdx.x;
#else
    int t;
    asm volatile("mov.u32 %0, %tid.x;" : "=r"(t));
    return t;
#endif
}

// A value of shared memory, read again at each use for the same reason.
template <class T> DEVICE T reload(const T &value) { return *(const volatile T *)&value; }

// Layout of a transform.
#define POINTS 8192 // complex values of a slice
#define ROW 18      // values from one j to the next in along_x: 16-byte reads of 8 neighbours use different banks
template <int SIDE> struct Layout {
    enum {
        SLICES = SIDE == 128 ? 1 : 4,
        ROWS = POINTS / SIDE,
        FIRST = ROWS / 8,
        LAST = SIDE / 16,
        FOLDS = SIDE / 8,
        ALONG_Y = 8 * FIRST,
        TABLE = ALONG_Y + FOLDS, // of one slice, in global memory; along_x (LAST x 16) follows the last slice's
        STRIDE = SIDE + SIDE / 16, // of a row in shared memory
        SPECTRUM = SLICES * POINTS / 2, // float4 of a spectrum, all slices
    };
};

template <int SIDE> struct Shared {
    typedef Layout<SIDE> C;
    Complex d[C::ROWS * C::STRIDE];
    Complex along_x[C::LAST * ROW];
    Complex along_y[C::ALONG_Y]; // [j][k]
    Complex fold[C::FOLDS];
    Weight weights[2];
    Job job;
};
static_assert(sizeof(Shared<128>) == 71520 && sizeof(Shared<256>) == 72544, "as in partition.rs");

// Index of value (row, x): there is a gap after every 16 values. The 8-byte accesses of half a warp then use 16 different pairs of
// banks in all access patterns (16 columns of a row, LAST neighbours of 16 / LAST rows, every LAST-th column), and every address of
// a task is its first one plus a constant.
template <int SIDE> DEVICE int position(int row, int x) { return row * Layout<SIDE>::STRIDE + x + (x >> 4); }

DEVICE void load_pair(const Complex *from, Complex &a, Complex &b) {
    const float4 v = *(const float4 *)from;
    a = complex(v.x, v.y);
    b = complex(v.z, v.w);
}

template <int SIDE> DEVICE void load_tables(Shared<SIDE> &s, const float2 *tables, int slice) {
    typedef Layout<SIDE> C;
    const float2 *y = tables + slice * C::TABLE, *x = tables + C::SLICES * C::TABLE;
    for (int i = threadIdx.x; i < C::TABLE; i += THREADS) {
        Complex *to = i < C::ALONG_Y ? s.along_y + i : s.fold + (i - C::ALONG_Y);
        *to = complex(y[i].x, y[i].y);
    }
    for (int i = threadIdx.x; i < C::LAST * 16; i += THREADS) s.along_x[(i >> 4) * ROW + (i & 15)] = complex(x[i].x, x[i].y);
}

// Sources of a transform: `column(x, first_row)` is a function from a row, relative to the first, to its value.

template <int SIDE> struct WeightedBlock { // a packed block, each pixel times the node's weight
    const Shared<SIDE> &s;
    const Weight &weight;
    const float4 *packed;
    struct Column {
        const float4 *pixels;
        float rise, rise_at, fall, fall_at, azimuth, per_rad;
        DEVICE float operator()(int y) const {
            const float4 p = __ldg(pixels + y * SIDE); // value, r, theta
            const float radial = fminf(__saturatef(fmaf(p.y, rise, rise_at)), __saturatef(fmaf(p.y, fall, fall_at)));
            return p.x * (radial * __saturatef(fmaf(-fabsf(p.z - azimuth), per_rad, 1.f)));
        }
    };
    DEVICE int width() const { return reload(s.job.width); }
    DEVICE int height() const { return reload(s.job.height); }
    DEVICE Column column(int x, int first_row) const {
        Column c;
        c.pixels = packed + (size_t)reload(s.job.packed) * SIDE + first_row * SIDE + x;
        c.rise = reload(weight.rise);
        c.rise_at = reload(weight.rise_at);
        c.fall = reload(weight.fall);
        c.fall_at = reload(weight.fall_at);
        c.azimuth = reload(weight.azimuth);
        c.per_rad = reload(weight.per_rad);
        return c;
    }
};

template <int SIDE> struct KernelSource { // a part of a kernel, read from its base kernel
    const float *base;
    int window;
    KernelPart part;
    struct Column {
        const float *base;
        int window, rows, y0, y1, x, transposed, turns;
        DEVICE float operator()(int y) const {
            if (y + y0 >= rows) return 0.f;
            y += y0 + y1;
            const int last = window - 1;
            const int sy = turns == 0 ? y : turns == 1 ? last - x : turns == 2 ? last - y : x;
            const int sx = turns == 0 ? x : turns == 1 ? y : turns == 2 ? last - x : last - y;
            return __ldg(base + (transposed ? sx * window + sy : sy * window + sx)) * (2.f / (SIDE * SIDE));
        }
    };
    DEVICE int width() const { return (part.cols + 15) & -16; }
    DEVICE int height() const { return part.rows; }
    DEVICE Column column(int x, int first_row) const {
        Column c = {base + part.base, window, x < part.cols ? part.rows : 0, first_row, part.y, part.x + x, part.transposed, part.quarter_turns};
        return c;
    }
};

// All stages but the last. Reads values written before barrier 1, ends with barrier 4. `prefetch()` is called before the stage along x.
template <int SIDE, class Source, class Prefetch> DEVICE void forward(Shared<SIDE> &s, const Source &source, const Prefetch &prefetch) {
    typedef Layout<SIDE> C;
    const int width = source.width(), height = source.height();
    const int inverse = (1 << 20) / width + 1; // t / width = t * inverse >> 20 for t <= 2048
#pragma unroll 1
    for (int t = thread(); t < 8 * width; t += THREADS) { // source values, fold, radix FIRST over the rows j + 8i
        const int j = t * inverse >> 20, x = t - j * width;
        const auto value = source.column(x, j);
        Complex a[C::FIRST];
#pragma unroll
        for (int k = 0; k < C::FIRST; ++k) a[k] = complex(0.f, 0.f);
#pragma unroll
        for (int i = 0; i < C::FOLDS; ++i) {
            if (i % ROW_GROUP == 0 && 8 * i >= height) break;
            const float v = value(8 * i);
            const Complex w = s.fold[i];
            Complex &to = a[i % C::FIRST];
            to = complex(fmaf(v, w.re, to.re), fmaf(v, w.im, to.im));
        }
        Fft<C::FIRST, false>::run(a);
        Complex *values = s.d + position<SIDE>(j, x);
#pragma unroll
        for (int k = 0; k < C::FIRST; k += 2) {
            Complex v, w;
            load_pair(s.along_y + j * C::FIRST + k, v, w);
            values[position<SIDE>(8 * k, 0)] = times(a[k], v);
            values[position<SIDE>(8 * k + 8, 0)] = times(a[k + 1], w);
        }
    }
    barrier<2>();
#pragma unroll 1
    for (int t = thread(); t < C::FIRST * width; t += THREADS) { // radix 8 over j
        const int k = t * inverse >> 20, x = t - k * width;
        Complex *values = s.d + position<SIDE>(8 * k, x), a[8];
#pragma unroll
        for (int j = 0; j < 8; ++j) a[j] = values[position<SIDE>(j, 0)];
        Fft<8, false>::run(a);
#pragma unroll
        for (int j = 0; j < 8; ++j) values[position<SIDE>(j, 0)] = a[j];
    }
    barrier<3>();
    prefetch();
#pragma unroll 1
    for (int t = thread(); t < POINTS / 16; t += THREADS) { // radix 16 over the columns j + LAST m; zeros beyond width
        const int row = t / C::LAST, j = t % C::LAST;
        Complex *values = s.d + position<SIDE>(row, j), a[16];
#pragma unroll
        for (int m = 0; m < 16; ++m) a[m] = C::LAST * m < width ? values[position<SIDE>(0, C::LAST * m)] : complex(0.f, 0.f);
        Fft<16, false>::run(a);
#pragma unroll
        for (int p = 0; p < 16; p += 2) {
            Complex v, w;
            load_pair(s.along_x + j * ROW + p, v, w);
            values[position<SIDE>(0, C::LAST * p)] = times(a[p], v);
            values[position<SIDE>(0, C::LAST * (p + 1))] = times(a[p + 1], w);
        }
    }
    barrier<4>();
}

// The last stage: task t is radix LAST of row t / 16, columns LAST (t % 16) + j. A thread has the tasks t0 + i THREADS.
template <int SIDE> struct LastStage {
    enum { LAST = Layout<SIDE>::LAST, TASKS = POINTS / LAST / THREADS };
    static DEVICE int task(int t0, int i) { return position<SIDE>((t0 >> 4) + i * (THREADS / 16), LAST * (t0 & 15)); }
    // Index in a spectrum of float4 `c` of a task (two neighbouring outputs), warp by warp.
    static DEVICE int spectrum(int t0, int i, int c) { return (t0 >> 5) * (16 * LAST) + (t0 & 31) + i * (THREADS / 2 * LAST) + c * 32; }
    static DEVICE void transform(const Shared<SIDE> &s, int t0, int i, Complex a[LAST]) {
#pragma unroll
        for (int j = 0; j < LAST; ++j) a[j] = s.d[task(t0, i) + j];
        Fft<LAST, false>::run(a);
    }
};

// Inverse of all stages: the slice's rows of SIDE values, real parts in the upper half of the image, imaginary parts in the lower.
template <int SIDE> DEVICE void inverse(Shared<SIDE> &s, Complex (*sum)[Layout<SIDE>::LAST], int slice, float *image) {
    typedef Layout<SIDE> C;
    typedef LastStage<SIDE> Last;
    const int t0 = thread();
#pragma unroll
    for (int i = 0; i < Last::TASKS; ++i) { // overwrites only values that this thread has read
        Fft<C::LAST, true>::run(sum[i]);
#pragma unroll
        for (int j = 0; j < C::LAST; ++j) s.d[Last::task(t0, i) + j] = sum[i][j];
    }
    barrier<5>();
#pragma unroll 1
    for (int t = thread(); t < POINTS / 16; t += THREADS) {
        const int row = t / C::LAST, j = t % C::LAST;
        Complex *values = s.d + position<SIDE>(row, j), a[16];
#pragma unroll
        for (int p = 0; p < 16; p += 2) {
            Complex v, w;
            load_pair(s.along_x + j * ROW + p, v, w);
            a[p] = times_conjugate(values[position<SIDE>(0, C::LAST * p)], v);
            a[p + 1] = times_conjugate(values[position<SIDE>(0, C::LAST * (p + 1))], w);
        }
        Fft<16, true>::run(a);
#pragma unroll
        for (int m = 0; m < 16; ++m) values[position<SIDE>(0, C::LAST * m)] = a[m];
    }
    barrier<6>();
#pragma unroll 1
    for (int t = thread(); t < POINTS / 8; t += THREADS) {
        const int k = t / SIDE, x = t % SIDE;
        Complex *values = s.d + position<SIDE>(8 * k, x), a[8];
#pragma unroll
        for (int j = 0; j < 8; ++j) a[j] = values[position<SIDE>(j, 0)];
        Fft<8, true>::run(a);
#pragma unroll
        for (int j = 0; j < 8; ++j) values[position<SIDE>(j, 0)] = a[j];
    }
    barrier<7>();
    image += slice * C::ROWS * SIDE;
#pragma unroll 1
    for (int t = thread(); t < 8 * SIDE; t += THREADS) {
        const int j = t / SIDE, x = t % SIDE;
        Complex *values = s.d + position<SIDE>(j, x), a[C::FIRST];
#pragma unroll
        for (int k = 0; k < C::FIRST; k += 2) {
            Complex v, w;
            load_pair(s.along_y + j * C::FIRST + k, v, w);
            a[k] = times_conjugate(values[position<SIDE>(8 * k, 0)], v);
            a[k + 1] = times_conjugate(values[position<SIDE>(8 * k + 8, 0)], w);
        }
        Fft<C::FIRST, true>::run(a);
#pragma unroll
        for (int m = 0; m < C::FIRST; ++m) {
            const Complex v = times_conjugate(a[m], s.fold[m]);
            image[(j + 8 * m) * SIDE + x] = v.re;
            image[(j + 8 * m + SIDE / 2) * SIDE + x] = v.im;
        }
    }
}
