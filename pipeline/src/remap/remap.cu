// Remap stage on a GPU: relative illumination, distortion and resampling in one pass, as in anchors.rs, lanes.rs and map.rs.
//
//     remapped(y, x) = R(r) · chart at offset + (dy, dx)·(h(r)/r)/scale,   (dy, dx) = (y, x) − axis,  r = hypot(dy, dx),  all in px
//
// A thread block computes AREA_ROWS x AREA_COLS pixels of a tile, in blocks of ANCHOR_SPACING_PX columns that start at multiples of
// it on the film, so a pixel's coordinates do not depend on the tiles. First each thread computes the anchor of one block in f64
// (on graphics GPUs the rate of f64 is 1/64 of that of f32), then each pixel is expanded from its anchor in f32, to within 2e-6 px
// of the exact map (derived in anchors.rs). Blocks that are near the axis, reach beyond the table, cross more than one knot on
// either side, or have a large slope change are mapped pixel by pixel in f64. Where scale < 1 every pixel is mapped in f64, and the chart is
// averaged in f64. The chart rectangle of a tile, computed by the host (reach.rs), contains every tap, including the surround.
//
// From map.rs: ANCHOR_SPACING_PX
// From cuda.rs: AREA_ROWS, AREA_COLS, TILES, THREADS
// WITHOUT: tests omit a part to verify that they detect it.
#ifndef WITHOUT
#define WITHOUT 0
#endif

// A step of the field's table. Between the real heights from and until: h = h_at + h_slope·r, R = gain_at + gain_slope·r. clear_*:
// radii between which a block crosses no knot but these two. slope_change: sum of |slope change of h| at both. Then slope of R, and the slope changes
// (changes of slope) of h and R at the outer and the inner knot.
struct Step {
    double from, until, h_at, h_slope, gain_at, gain_slope, clear_from, clear_until, slope_change;
    float r_slope, outer_h, outer_r, inner_h, inner_r, unused;
};
static_assert(sizeof(Step) == 96, "as in cuda.rs");

// The map of film to chart. whole_columns: chart columns per film column, rounded.
struct Map {
    double axis_y, axis_x, offset_y, offset_x, per_scale_y, per_scale_x, whole_columns;
    double buckets_per_px, last_px, magnification_on_axis, gain_on_axis, box_y, box_x;
    int buckets, unused;
};
static_assert(sizeof(Map) == 112, "as in cuda.rs");

// A film rectangle, its chart rectangle, and the index of the first pixel of each in its buffer.
struct Tile {
    int y, x, height, width;
    int chart_y, chart_x, chart_width, unused;
    long long chart_offset, remapped_offset;
};
static_assert(sizeof(Tile) == 48, "as in cuda.rs");

// The tiles of a launch, indexed by blockIdx.z.
struct Tiles {
    Tile tile[TILES];
};

struct Coordinate {
    int cell;
    float fraction;
};

// An integer and a fraction in [0, 1]; a fraction below 2^-30 is set to 0, so that an identity map is exact.
__device__ __forceinline__ Coordinate split(double at) {
    const double farthest = 1073741824.0;
    at = fmin(fmax(at, -farthest), farthest);
    const double cell = floor(at), rest = at - cell;
    Coordinate c;
    c.cell = (int)cell;
    c.fraction = rest < 1.0 / 1073741824.0 ? 0.0f : (float)rest;
    return c;
}

// Index of the step that contains r.
__device__ __forceinline__ int step_of(const Map &map, const Step *steps, const unsigned *buckets, double r) {
    int i = (int)buckets[min((int)fmin(r * map.buckets_per_px, 1e9), map.buckets - 1)];
    while (steps[i].until <= r) ++i;
    return i;
}

struct Place {
    double row, col, gain;
};

// Chart coordinates of the pixel (y, x), and its R, in f64.
__device__ __forceinline__ Place place(const Map &map, const Step *steps, const unsigned *buckets, int y, int x) {
    const double dy = y - map.axis_y, dx = x - map.axis_x;
    const double r = fmin(sqrt(dy * dy + dx * dx), map.last_px);
    double magnification = map.magnification_on_axis;
    Place p;
    p.gain = map.gain_on_axis;
    if (r > 0.0) {
        const Step &s = steps[step_of(map, steps, buckets, r)];
        magnification = s.h_slope + s.h_at / r;
        p.gain = s.gain_at + s.gain_slope * r;
    }
    p.row = map.offset_y + dy * magnification * map.per_scale_y;
    p.col = map.offset_x + dx * magnification * map.per_scale_x;
    return p;
}

// Expansion about the middle pixel of a block (anchors.rs). step: EXACT if its pixels are mapped one by one.
struct Anchor {
    float row_fraction, col_fraction, extra, dx;
    float c1, c2, c3, c4;
    float per_r, slope, gain, outer;
    float inner;
    int row, col, step;
};
#define EXACT (-1)

__device__ __forceinline__ Anchor anchor(const Map &map, const Step *steps, const unsigned *buckets, int y, int x) {
    const double half = ANCHOR_SPACING_PX / 2, dy = y - map.axis_y, dx = x + half - map.axis_x;
    const double r = sqrt(dy * dy + dx * dx);
    Anchor a;
    a.step = EXACT;
    if (r + half > map.last_px) return a;
    const int i = step_of(map, steps, buckets, r);
    const Step &s = steps[i];
    const double per_r = 1.0 / r, excess = s.h_at * per_r, magnification = s.h_slope + excess;
    const double extra = magnification * map.per_scale_x - map.whole_columns;
    const bool far = r < s.clear_from || r > s.clear_until || half * (fabs(excess) + s.slope_change) > 1.0 || fabs(extra) > 1.0;
    if (far) return a;
    const Coordinate row = split(map.offset_y + dy * magnification * map.per_scale_y);
    const Coordinate col = split(map.offset_x + dx * magnification * map.per_scale_x);
    const double u = dx * per_r, across = 0.5 * (1.0 - u * u) * per_r;
    a.row_fraction = row.fraction;
    a.col_fraction = col.fraction;
    a.extra = (float)extra;
    a.dx = (float)(dx * map.per_scale_x);
    a.c1 = (float)u;
    a.c2 = (float)across;
    a.c3 = (float)(-across * u * per_r);
    a.c4 = (float)(across * (5.0 * u * u - 1.0) * 0.25 * per_r * per_r);
    a.per_r = (float)per_r;
    a.slope = (float)-excess;
    a.gain = (float)(s.gain_at + s.gain_slope * r);
    a.outer = (float)(s.until - r);
    a.inner = (float)(s.from - r);
    a.row = row.cell;
    a.col = col.cell;
    a.step = i;
    return a;
}

struct Point {
    Coordinate row, col;
    float gain;
};

// The pixel t columns from its block's anchor, -ANCHOR_SPACING_PX/2 <= t < ANCHOR_SPACING_PX/2.
__device__ __forceinline__ Point expand(const Map &map, const Step *steps, const Anchor &a, int y, float t) {
    const Step &s = steps[a.step];
    const float dy = (float)((y - map.axis_y) * map.per_scale_y);
    const float r = t * fmaf(t, fmaf(t, fmaf(t, a.c4, a.c3), a.c2), a.c1);
    const float past_outer = fmaxf(r - a.outer, 0.0f), before_inner = fmaxf(a.inner - r, 0.0f);
    const float h = fmaf(r, a.slope, fmaf(past_outer, s.outer_h, before_inner * s.inner_h));
    const float e = r * a.per_r;
    const float m = h * a.per_r * ((1.0f - e) * fmaf(e, e, 1.0f));
    const float row = fmaf(dy, m, a.row_fraction);
    const float col = fmaf(fmaf(t, (float)map.per_scale_x, a.dx), m, fmaf(t, a.extra, a.col_fraction));
    const float row_cell = floorf(row), col_cell = floorf(col);
    Point p;
    p.row.cell = a.row + (int)row_cell;
    p.row.fraction = row - row_cell;
    p.col.cell = a.col + (int)fmaf(t, (float)map.whole_columns, col_cell);
    p.col.fraction = col - col_cell;
    p.gain = fmaf(past_outer, s.outer_r, fmaf(r, s.r_slope, fmaf(before_inner, s.inner_r, a.gain)));
    return p;
}

__device__ __forceinline__ Point exact_point(const Map &map, const Step *steps, const unsigned *buckets, int y, int x) {
    const Place at = place(map, steps, buckets, y, x);
    Point p;
    p.row = split(at.row);
    p.col = split(at.col);
    p.gain = (float)at.gain;
    return p;
}

// Catmull-Rom weights of the pixels -1, 0, 1, 2 at fraction f; linear ones of 0, 1.
template <int TAPS> __device__ __forceinline__ void weights(float f, float *w) {
    if (TAPS == 4) {
        const float g = 0.5f * f;
        w[0] = ((2.0f - f) * f - 1.0f) * g;
        w[1] = ((3.0f * f - 5.0f) * f * f + 2.0f) * 0.5f;
        w[2] = ((4.0f - 3.0f * f) * f + 1.0f) * g;
        w[3] = (f - 1.0f) * f * g;
    } else {
        w[0] = 1.0f - f;
        w[1] = f;
    }
}

template <int TAPS>
__device__ __forceinline__ float sample(const Tile &tile, const float *chart, const Point &p) {
    const int before = TAPS == 4 && WITHOUT != 2 ? 1 : 0;
    const long long row = p.row.cell - before - tile.chart_y, col = p.col.cell - before - tile.chart_x;
    const float *from = chart + tile.chart_offset + row * tile.chart_width + col;
    float wy[TAPS], wx[TAPS], sum = 0.0f;
    weights<TAPS>(p.row.fraction, wy);
    weights<TAPS>(p.col.fraction, wx);
#pragma unroll
    for (int j = 0; j < TAPS; ++j) {
        float line = __ldg(from) * wx[0];
#pragma unroll
        for (int k = 1; k < TAPS; ++k) line = fmaf(__ldg(from + k), wx[k], line);
        sum = fmaf(line, wy[j], sum);
        from += tile.chart_width;
    }
    return sum;
}

// First pixel of this thread block; false if it lies beyond the tile.
__device__ __forceinline__ bool area(const Tile &tile, int &y, int &x) {
    y = tile.y + (int)blockIdx.y * AREA_ROWS;
    x = (tile.x & -ANCHOR_SPACING_PX) + (int)blockIdx.x * AREA_COLS;
    return y < tile.y + tile.height && x < tile.x + tile.width;
}

template <int TAPS>
__device__ __forceinline__ void interpolate(
    const Map &map, const Tile &tile, const Step *steps, const unsigned *buckets, const float *chart, float *remapped) {
    __shared__ Anchor anchors[AREA_ROWS * (AREA_COLS / ANCHOR_SPACING_PX)];
    const int n = AREA_COLS / ANCHOR_SPACING_PX, thread = threadIdx.x;
    int y0, x0;
    if (!area(tile, y0, x0)) return;
    for (int i = thread; i < AREA_ROWS * n; i += THREADS)
        anchors[i] = anchor(map, steps, buckets, y0 + i / n, x0 + i % n * ANCHOR_SPACING_PX);
#if WITHOUT != 1
    __syncthreads();
#endif
    for (int i = thread; i < AREA_ROWS * AREA_COLS; i += THREADS) {
        const int y = y0 + i / AREA_COLS, x = x0 + i % AREA_COLS;
        if (y >= tile.y + tile.height || x < tile.x || x >= tile.x + tile.width) continue;
        const Anchor &a = anchors[i / ANCHOR_SPACING_PX];
        const Point p = a.step == EXACT ? exact_point(map, steps, buckets, y, x)
                                        : expand(map, steps, a, y, (float)(i % ANCHOR_SPACING_PX - ANCHOR_SPACING_PX / 2));
        remapped[tile.remapped_offset + (long long)(y - tile.y) * tile.width + (x - tile.x)] =
            sample<TAPS>(tile, chart, p) * p.gain;
    }
}

#define ARGUMENTS                                                                                                      \
    const __grid_constant__ Map map, const __grid_constant__ Tiles tiles, const Step *steps, const unsigned *buckets, \
        const float *chart, float *remapped

extern "C" __global__ void __launch_bounds__(THREADS) remap_bicubic(ARGUMENTS) {
    interpolate<4>(map, tiles.tile[blockIdx.z], steps, buckets, chart, remapped);
}

extern "C" __global__ void __launch_bounds__(THREADS) remap_bilinear(ARGUMENTS) {
    interpolate<2>(map, tiles.tile[blockIdx.z], steps, buckets, chart, remapped);
}

// Chart pixels that a box about `centre` overlaps: the first, and their number.
__device__ __forceinline__ int box_first(double centre, double width) { return (int)floor(centre - 0.5 * width + 0.5); }
__device__ __forceinline__ int box_count(double centre, double width, int first) {
    return max((int)ceil(centre + 0.5 * width + 0.5) - first, 1);
}

// Share of the box in chart pixel i.
__device__ __forceinline__ double box_share(double centre, double width, int i) {
    const double low = fmax(i - 0.5, centre - 0.5 * width), high = fmin(i + 0.5, centre + 0.5 * width);
    return (double)(float)(fmax(high - low, 0.0) / width);
}

// The mean of the chart over each film pixel, a box of 1/scale chart pixels.
extern "C" __global__ void __launch_bounds__(THREADS) remap_mean(ARGUMENTS) {
    const Tile &tile = tiles.tile[blockIdx.z];
    int y0, x0;
    if (!area(tile, y0, x0)) return;
    for (int i = threadIdx.x; i < AREA_ROWS * AREA_COLS; i += THREADS) {
        const int y = y0 + i / AREA_COLS, x = x0 + i % AREA_COLS;
        if (y >= tile.y + tile.height || x < tile.x || x >= tile.x + tile.width) continue;
        const Place p = place(map, steps, buckets, y, x);
        const int row = box_first(p.row, map.box_y), rows = box_count(p.row, map.box_y, row);
        const int col = box_first(p.col, map.box_x), cols = box_count(p.col, map.box_x, col);
        double sum = 0.0;
        for (int j = 0; j < rows; ++j) {
            const long long at = (long long)(row + j - tile.chart_y) * tile.chart_width + (col - tile.chart_x);
            const float *from = chart + tile.chart_offset + at;
            double line = 0.0;
            for (int k = 0; k < cols; ++k) line += box_share(p.col, map.box_x, col + k) * (double)__ldg(from + k);
            sum += box_share(p.row, map.box_y, row + j) * line;
        }
        remapped[tile.remapped_offset + (long long)(y - tile.y) * tile.width + (x - tile.x)] = (float)sum * (float)p.gain;
    }
}
