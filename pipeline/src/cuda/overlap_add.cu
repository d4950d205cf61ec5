// Overlap-add on a GPU: adds the contributions of a rectangle of tiles to film rows on the device. Launched by film_rows.rs; the CPU
// implementation is executor/overlap_add.rs.
//
//     film[y, x] = ((film[y, x] + contribution of the first tile that reaches it) + that of the second) + ...
//
// tiles row by row. Rectangles of tiles are added in that order as well, each by one launch after the other, so every sum has the order
// of the tiles of the band, for any division into rectangles. One thread a pixel, no atomics.

struct Add {
    int y, x, height, width;      // film rectangle to add to: what the tiles reach
    int row, column;              // place of (y, x) in `film`, whose rows follow one another cyclically
    int rows, stride;             // of `film`
    int first_row, end_row, first_column, end_column; // the tiles
    int tile, tail, grown_width;  // side of a tile; px that a contribution is larger; width of all tiles of a row
    int slot;                     // values from one contribution to the next
};
static_assert(sizeof(Add) == 64, "as in film_rows.rs");

extern "C" __global__ void __launch_bounds__(256) add_tiles(const Add a, const float *contributions, float *film) {
    const int x = blockIdx.x * 32 + (threadIdx.x & 31), y = blockIdx.y * 8 + (threadIdx.x >> 5);
    if (x >= a.width || y >= a.height) return;
    // Tile i reaches the film rows from i * tile - tail to (i + 1) * tile - 1.
    const int film_y = a.y + y, film_x = a.x + x;
    const int up = max(a.first_row, film_y / a.tile), down = min(a.end_row - 1, (film_y + a.tail) / a.tile);
    const int left = max(a.first_column, film_x / a.tile), right = min(a.end_column - 1, (film_x + a.tail) / a.tile);
    const int row = a.row + y;
    float *to = film + (size_t)(row < a.rows ? row : row - a.rows) * a.stride + a.column + x;
    float sum = *to;
    for (int i = up; i <= down; ++i) {
        const float *first = contributions + (size_t)(i - a.first_row) * (a.end_column - a.first_column) * a.slot;
        for (int j = left; j <= right; ++j) {
            const int width = min(a.tile, a.grown_width - j * a.tile) + a.tail;
            const int at = (film_y - i * a.tile + a.tail) * width + (film_x - j * a.tile + a.tail);
            sum += __ldg(first + (size_t)(j - a.first_column) * a.slot + at);
        }
    }
    *to = sum;
}
