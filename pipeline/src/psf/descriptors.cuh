// Descriptors of the PSF stage on a GPU (psf.cu), as in psf/cuda/descriptors.rs.

#pragma once

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
