// PSF stage on a GPU: the sums of psf/mod.rs, launched by psf/cuda. The CPU implementations are psf/portable.rs and psf/simd.
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
// 8192 complex values = 64 KB, the maximum with two thread blocks a multiprocessor on sm_80 and sm_90, one on sm_86 and sm_89.
// With y = j + 8i and q = k + FIRST l the sum separates into
//     i:  FIRST values k of  sum_i x_y fold_i exp(-2 pi i (i mod FIRST) k / FIRST),   fold_i = exp(-2 pi i 8i (2 slice - 1/2) / SIDE)
//     j:  times along_y = exp(-2 pi i j (2 (SLICES k + slice) - 1/2) / SIDE), then radix 8
// Along x, x = j + LAST m: radix 16 over m, times along_x = exp(-2 pi i j p / SIDE), radix LAST over j. Outputs stay in digit-reversed
// order: the inverse applies the stages in reverse, and spectra are stored in the order in which the threads hold them.
//
// Accuracy: (r, theta) are computed as on the CPU (near the axis in f64), and weights from the CPU's coefficients by correctly rounded
// f32 operations: no approximate division or root is used in this file.

// From cuda/partition.rs: THREADS, ROW_GROUP

#ifndef DYNAMIC_SHARED
#define DYNAMIC_SHARED(type, name) extern __shared__ type name[]
#endif
#ifndef WITHOUT
#define WITHOUT 0
#endif

#define DEVICE __device__ __forceinline__

// Descriptors, as in psf/cuda/descriptors.rs.

struct Block {            // a block of remapped pixels and its place about the optical axis
    double dy, dx;        // first pixel minus the axis, px
    double r, azimuth;    // of the centre
    float cosine, sine;   // of that azimuth
    float half_y, half_x; // centre minus first pixel
    unsigned long long remapped; // index of the first pixel
    int stride;           // pixels from row to row
    int rows, cols;
    int height, width;    // zero-padded: input of the transform
    int near_axis;        // azimuths are computed in f64
    int packed;           // first row of the packed block, in rows of SIDE pixels
    int unused;
};
static_assert(sizeof(Block) == 88, "as in descriptors.rs");

struct Weight {           // coefficients of psf/grid.rs, and the node's spectrum
    float rise, rise_at, fall, fall_at, azimuth, per_rad;
    int spectrum;         // index of the spectrum of the node's first kernel part
    int unused;
};
static_assert(sizeof(Weight) == 32, "as in descriptors.rs");

struct Job {              // work of one thread block (for each slice): a node group of a block, one part of their kernels
    int packed;           // first row of the packed block, in rows of SIDE pixels
    int height, width;    // of the zero-padded block
    int first, end;       // range in the list of weights
    int part;             // index of the kernel part
    int unused[2];
};
static_assert(sizeof(Job) == 32, "as in descriptors.rs");

struct KernelPart {       // a part of a kernel to be transformed
    unsigned base;        // index of the first value of the base kernel
    int transposed, quarter_turns; // from base kernel to kernel: transposed first
    int y, x, rows, cols; // rectangle of the part in the kernel
    int spectrum;         // index of its spectrum
};
static_assert(sizeof(KernelPart) == 32, "as in descriptors.rs");

struct Tile {             // a tile's contribution: its remapped rectangle grown by half the window
    unsigned long long remapped, contribution; // index of the first value
    int stride, rows, cols;
    int block_y, block_x; // side of its blocks
    int down, across;     // number of blocks
    int last_rows, last_cols; // of the last block in either direction
    int first;            // its first block in the list of block images
};
static_assert(sizeof(Tile) == 56, "as in descriptors.rs");

struct BlockImages {      // images of a block: for each node group, those of all kernel parts
    int first, groups;
};
static_assert(sizeof(BlockImages) == 8, "as in descriptors.rs");

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

// Complex arithmetic. INVERSE conjugates the roots of unity.

struct Complex { float re, im; };
DEVICE Complex complex(float re, float im) { Complex c; c.re = re; c.im = im; return c; }
DEVICE Complex operator+(Complex a, Complex b) { return complex(a.re + b.re, a.im + b.im); }
DEVICE Complex operator-(Complex a, Complex b) { return complex(a.re - b.re, a.im - b.im); }
DEVICE Complex times(Complex a, Complex b) { return complex(fmaf(a.re, b.re, -(a.im * b.im)), fmaf(a.re, b.im, a.im * b.re)); }
DEVICE Complex times_conjugate(Complex a, Complex b) { return complex(fmaf(a.re, b.re, a.im * b.im), fmaf(a.im, b.re, -(a.re * b.im))); }
template <bool INVERSE> DEVICE Complex times_root(Complex a, float cos, float sin) {
    return INVERSE ? times(a, complex(cos, sin)) : times(a, complex(cos, -sin));
}
template <bool INVERSE> DEVICE Complex times_i(Complex a) { return INVERSE ? complex(-a.im, a.re) : complex(a.im, -a.re); }
template <bool INVERSE> DEVICE Complex times_eighth_root(Complex a) { // times exp(-+ i pi / 4)
    const float h = 0.707106781186547524f;
    return INVERSE ? complex(h * (a.re - a.im), h * (a.re + a.im)) : complex(h * (a.re + a.im), h * (a.im - a.re));
}

template <bool INVERSE> DEVICE void fft4(Complex &a, Complex &b, Complex &c, Complex &d) {
    const Complex s = a + c, t = a - c, u = b + d, v = times_i<INVERSE>(b - d);
    a = s + u;
    b = t + v;
    c = s - u;
    d = t - v;
}

// In place, outputs in order.
template <int N, bool INVERSE> struct Fft;
template <bool INVERSE> struct Fft<4, INVERSE> {
    static DEVICE void run(Complex a[4]) { fft4<INVERSE>(a[0], a[1], a[2], a[3]); }
};
template <bool INVERSE> struct Fft<8, INVERSE> {
    static DEVICE void run(Complex a[8]) {
        Complex b[8];
#pragma unroll
        for (int i = 0; i < 4; ++i) {
            b[i] = a[i] + a[i + 4];
            b[i + 4] = a[i] - a[i + 4];
        }
        b[5] = times_eighth_root<INVERSE>(b[5]);
        b[6] = times_i<INVERSE>(b[6]);
        b[7] = times_eighth_root<INVERSE>(times_i<INVERSE>(b[7]));
        fft4<INVERSE>(b[0], b[1], b[2], b[3]);
        fft4<INVERSE>(b[4], b[5], b[6], b[7]);
#pragma unroll
        for (int i = 0; i < 4; ++i) {
            a[2 * i] = b[i];
            a[2 * i + 1] = b[i + 4];
        }
    }
};
template <bool INVERSE> struct Fft<16, INVERSE> {
    static DEVICE void run(Complex a[16]) {
        const float C = 0.923879532511286756f, S = 0.382683432365089772f;
#pragma unroll
        for (int i = 0; i < 4; ++i) fft4<INVERSE>(a[i], a[i + 4], a[i + 8], a[i + 12]);
        a[5] = times_root<INVERSE>(a[5], C, S);
        a[6] = times_eighth_root<INVERSE>(a[6]);
        a[7] = times_root<INVERSE>(a[7], S, C);
        a[9] = times_eighth_root<INVERSE>(a[9]);
        a[10] = times_i<INVERSE>(a[10]);
        a[11] = times_eighth_root<INVERSE>(times_i<INVERSE>(a[11]));
        a[13] = times_root<INVERSE>(a[13], S, C);
        a[14] = times_eighth_root<INVERSE>(times_i<INVERSE>(a[14]));
        a[15] = times_root<INVERSE>(a[15], -C, -S);
#pragma unroll
        for (int k = 0; k < 4; ++k) fft4<INVERSE>(a[4 * k], a[4 * k + 1], a[4 * k + 2], a[4 * k + 3]);
#pragma unroll
        for (int k = 0; k < 4; ++k) // a[4k + q] holds output k + 4q
#pragma unroll
            for (int q = k + 1; q < 4; ++q) {
                const Complex c = a[4 * k + q];
                a[4 * k + q] = a[4 * q + k];
                a[4 * q + k] = c;
            }
    }
};

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
