//! Physics and scheduling of lenscube: from a chart on the ideal image plane of a lens to the image that the lens forms of it on the
//! sensor plane (the film), band by band. No file formats: charts and films are the traits of [`flow`].
//!
//! Coordinates: film row y down, column x right, pixel centres at integers, X = (x − cx)·pitch and Y = (y − cy)·pitch in mm from the
//! optical axis, r = hypot(X, Y) the REAL image height in mm, θ = atan2(Y, X) the azimuth in radians.
//!
//! | stage | equation (one band of wavelength λ) | module |
//! |---|---|---|
//! | read | chart rectangle under a part of a tile, inside the remap stage | [`flow`] |
//! | remap | remapped(X, Y) = gain · R(r, λ) · chart((X, Y) · h(r, λ)/r) | [`remap`], [`field`], [`resample`] |
//! | SVPSF | contribution = Σ_nodes (weight_node · remapped) ∗ kernel_node | [`psf`] |
//! | depth | in place of remap and SVPSF, for surfaces at several distances | [`depth`] |
//! | overlap-add | shard += contribution, in tile order for each shard | [`executor`] |
//! | layers | finished shard += smooth light that was computed before the tiles | [`layer`], [`reduced_chart`], [`extended_chart`] |
//! | encode, commit | shards that no later tile reaches | [`executor`], [`flow`] |
//!
//! gain converts the chart's radiance to the film's unit (1 for a relative film; transmission and solid angle of the lens for an irradiance).
//! h is the ideal height of the field point whose chief ray lands at real height r, R its relative illumination; both come from the tables
//! of a [`lens`]. Remapping is a gather (each film pixel reads the chart), the PSF a scatter (each pixel of the remapped image spreads
//! over its window), so the remapped image is computed on the film grown by half the PSF window.
//!
//! Surfaces at several distances hide each other, which is not linear: [`depth`] computes each tile of the film from the chart under it and the margin of its PSFs.
//!
//! A tile on the CPU: a worker of [`executor`] claims the next tile of a band, in the order of the shards; [`stages`] remaps it and applies the PSF into a buffer of the tile
//! and its tail, and the buffer is added to each open shard that it reaches after the tiles before it, row by row, so the sums have the same bits for any number of
//! threads. A shard that no later tile reaches is encoded by a worker and committed by a writer. On a GPU: a queue per device
//! claims rows of shards of a band and divides their tiles into batches; workers read the chart rectangles into page-locked memory; the device
//! remaps, applies the PSF and adds the contributions to film rows, in the same order; finished rows are downloaded once, and
//! workers copy them to the shards.
//!
//! Before the film: [`scene`] makes chart, distances and coverages of a triangle mesh.
//!
//! After the film: [`sensor`] exposes a camera's sensor to it, [`develop`] makes a picture of the raw.
//!
//! From a film to a chart: [`adjoint`], the exact transpose of the film of one flat chart; [`restore`] solves for the chart with both.
//!
//! Other modules: [`design`] makes the tables and PSFs of a lens from its prescription by ray tracing, in layers (prescription, rays, pupil,
//! figures, PSF, tables); lens files are read by the package `formats`. [`chart`] draws test charts
//! ([`colour`], [`reflectance`], [`wavelengths`]); [`measure`] measures edges, points and profiles; [`figures`] summarises a lens;
//! [`camera_model`] fits the camera models of other programs to its distortion;
//! [`layer`], [`tails`] and [`veil`] are the light beyond PSF windows and stray light, [`reduced_chart`] and [`extended_chart`] what they are computed from;
//! [`tiling`] divides film and bands into tiles and shards, [`buffer`] holds the light of a tile, [`geometry`] has rectangles and the film frame, [`projection`] the planes of charts, [`options`] what a job asks of
//! the physics. [`bounds`] has the bounds of all input numbers; [`clock`] counts the time of each stage; [`simd`] selects an instruction set; [`real`] has
//! functions whose bits do not depend on the host; [`cuda`] opens GPUs and holds their memory; [`mod@bench`] holds the baselines of benchmarks.
//!
//! # Adding a stage
//!
//! Light that changes from pixel to pixel is computed tile by tile, between remap and overlap-add, where the tails of neighbouring tiles overlap. Light that is smooth over the film, or is added once
//! to each pixel, is a [`layer`]: computed before the tiles, stored with the film, added to finished shards.
//!
//! Both:
//!
//! - the module with the equation at its head, its line here;
//! - a variant of [`stage::Stage`];
//! - its row in `stages/description.rs`: name and help of the switch, identity, engines, reach, memory, cost; `--stages`, `status`, the memory plan and forecasts are made from the row
//!   (those of surfaces at several distances have a computation of their own, [`depth`], which applies the stage itself if it is to have it);
//! - a flag of its own, in place of `--stages`: a field of `src/args/run.rs` and of its `new`, or of one of the groups of arguments there, which `shoot` and the film of arrays have as well; the latter
//!   knows it by `src/job/arrays/flags.rs`;
//! - bounds of its numbers in [`bounds`]; what lenses without symmetry cannot have is refused in `src/job/inputs.rs`.
//!
//! A stage of tiles:
//!
//! - [`band`]: `BandStages`, what [`stages`] computes of a tile, and `clock::Phase` if its time is counted by itself. What a worker keeps in memory follows from the row; the margin of tiles is half the
//!   PSF window ([`tiling`]), which a stage that reads further must enlarge;
//! - `src/job/arguments.rs` switches the stage on, `src/job/identity.rs` has its values; where one is named otherwise than its flag, `src/job/keys.rs` says so;
//! - if GPUs have it: a `.cu` file (`scripts/ptx` compiles it to `pipeline/ptx`), its name in `cuda/ptx.rs`, a launcher beside its module, `stages/cuda/band.rs`, its bytes in
//!   `cuda/memory.rs`, and its kernel among those of the verdict (`src/machine/device/verdict.rs`);
//! - tests: `tests/oracle/` of this package, the model in `tests/golden/reference.py` with `make_golden.py`.
//!
//! A layer (the tails of PSFs in [`tails`], stray light in [`veil`]), which runs on any device:
//!
//! - a `JobLayer` of `src/job/layers.rs` in a module of `src/job` (`veil.rs` is one): its coefficients, memory, seconds, and values in the identity;
//! - its row in `src/job/own_layers.rs`, by which jobs switch it on, make and identify it;
//! - the name of its array, that of the stage, in `formats/src/group/kind.rs`. Storing, adding, verification, `status`, removal and refusals follow;
//! - tests: closed forms (`veil/plan/tests.rs`, `tests/cli/veil`), `formats/src/film/tests/layers.rs`.
//!
//! Then the snapshots of help, and `model.md` and `limits.md` of the guide.
//!
//! Chart formats and codecs: head of the package `formats`.
//!
//! # Glossary
//!
//! The words of the sensor and of depth stand at the heads of [`sensor`] and [`depth`].
//!
//! - **chart**: the input, a multispectral image on the ideal image plane. **film**: the output, the image on the sensor plane.
//! - **remapped image**: the chart after relative illumination and distortion, before the PSF. **contribution**: the PSF stage's output for one
//!   tile: the tile and its tail.
//! - **ideal height**: f·tan(field angle). **real height**: where the chief ray lands. Both in mm from the axis.
//! - **design**: the prescription of a lens. **lens pack**: its tables and PSFs, traced. **surround**: what the chart is taken to be beyond its edges. **taps**: the samples that an interpolation reads.
//! - **layer**: smooth light of a film, stored on **bins** of pixels. **reduced chart**: means over blocks of the chart's pixels, from which layers are computed.
//! - **node**: a grid point of the PSF field (height, azimuth). **kernel**: its PSF integrated over film pixels. **spectrum**: the kernel's Fourier
//!   transform. **weight**: a node's bilinear share at a pixel. **PSF window**: the support of a kernel in film pixels. **margin**: half of it, around a tile or the film.
//!   **stack**: the PSFs of a band at all heights. **gain** of a band: the factor of its chart values (film units); of a sensor: that of its converter.
//! - **tile**: unit of computing (about 512 px). **block**: unit of a Fourier transform. **shard**: a stored file of the film. **chunk**: a compressed part
//!   of a store. **strip**: consecutive rows that are in memory together. **walk**: the order in which workers compute the tiles of a band.
//! - **film region**: a rectangle of the film (`--roi`). **job**: all that determines the pixels of a film. **unit**: a part of a planned job that
//!   one process computes. **run**: one execution of a command on a film. **plan** (`lenscube plan`): the division of a job into units. **band plan**
//!   ([`band::BandPlan`]): tables, tiles and blocks of a band before a pixel is computed. **forecast**: bytes and seconds of a run, told before it. **position**: the place of a
//!   band in a job, from 0.
//! - **item**, **batch**: what one claim computes, a tile or on GPUs a row of shards; consecutive items that are claimed together, for a GPU the tiles sent to it together.
//!   **queue**, **worker**: the order of work of one device; a thread. **portion**: rows of shards of a band that one
//!   GPU computes. **claim**, **requeue**, **commit**: take a tile or a portion to compute it; return it after a failure; make a shard visible.
//! - **engine**: an implementation of the arithmetic: avx512, avx2, portable, cuda-sm_NN. **fault**: an error injected by a test.

#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod adjoint;
pub mod band;
pub mod bench;
pub mod bounds;
pub mod buffer;
pub mod camera_model;
pub mod chart;
pub mod clock;
pub mod colour;
pub mod cuda;
pub mod depth;
pub mod design;
pub mod develop;
pub mod executor;
pub mod extended_chart;
pub mod field;
pub mod figures;
pub mod flow;
pub mod geometry;
pub mod layer;
mod least_squares;
pub mod lens;
pub mod lru;
pub mod measure;
pub mod options;
mod parts;
pub mod projection;
pub mod psf;
pub mod real;
pub mod reduced_chart;
pub mod reflectance;
pub mod remap;
pub mod resample;
pub mod restore;
pub mod scene;
pub mod scratch;
pub mod sensor;
pub mod simd;
mod spline;
pub mod stage;
pub mod stages;
pub mod tails;
pub mod tiling;
pub mod veil;
pub mod wavelengths;
pub mod words;
