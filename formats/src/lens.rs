//! Lens packs: a Zarr v3 group `*.lens.zarr`, a .zip of it, or a pack built into the program.
//!
//! # Arrays
//!
//! B bands, M field points, K PSF heights, n samples a window side (its own per band).
//!
//! | array | shape | unit | contents |
//! |---|---|---|---|
//! | `wavelength` | (B) | nm | ascending |
//! | `ideal_height` | (B, M) | mm | f·tan(field angle) with the *distortion* focal length f, ascending from 0 |
//! | `image_height` | (B, M) | mm | real chief-ray height, ascending from 0 |
//! | `relative_illumination` | (B, M) | 1 | 1 on axis |
//! | `psf_height` | (B, K) | mm | real image height of each PSF, ascending from 0 |
//! | `azimuth_count` | (B, K) | 1 | azimuths at that height: 1 on axis, else a multiple of 4 |
//! | `psf/<band index>` | (K, n, n) | 1 | share of the energy per sample, sum 1; n odd |
//! | `psf_pitch` | (B) | µm | sample pitch of the PSFs |
//! | `kernel_pitch` | (B) | µm | optional: sample pitch to which the PSFs are low-passed before kernels are made from them, or 0 for the default ([`pipeline::psf::coarse`]) |
//! | `psf_energy` | (B, K) | 1 | share of the total energy inside the window before normalisation |
//! | `solid_angle` | (B) | sr | irradiance of the film on the axis over radiance of the object, π·NA² in focus; default π/(4N²), N the F-number |
//! | `transmission` | (B) | 1 | transmission of the lens; default 1 |
//!
//! In a PSF window the chief ray is at the central sample ((n−1)/2, (n−1)/2), the field point is on +x, and rows run down.
//!
//! # Depth nodes
//!
//! A pack of schema [`DEPTH_SCHEMA`] has the PSFs of several object distances on one film plane: D nodes, their tables and windows in place of
//! those above; `relative_illumination` and `solid_angle` are those of the vergence in focus, `ideal_height` those of an object at infinity
//! ([`pipeline::lens::depth`]).
//!
//! | array | shape | unit | contents |
//! |---|---|---|---|
//! | `vergence` | (B, D) | 1/m | 1/distance from the centre of the entrance pupil, ascending from 0 or more |
//! | `psf_height`, `azimuth_count`, `psf_energy` | (B, D, K) | | as above, per node |
//! | `psf/<band index>/<node index>` | (K, n, n) | 1 | as above; n of each node |
//! | `psf_pitch` | (B, D) | µm | sample pitch of the node's PSFs |
//! | `pupil_shift` | (B, M) | mm | from the centre of the entrance pupil to where the chief ray crosses the axis, towards the film; default 0 |
//! | `etendue_ratio` | (B, D, M) | 1 | light of a bundle at the node over that in focus, at equal real height; default 1 |
//!
//! Attributes: `focus_distance_m` (`Infinity` allowed), `blur_per_dioptre_um`, `entrance_pupil_mm` (behind the first vertex),
//! `entrance_pupil_diameter_mm`, `depth_tolerance` (maximum L1 error of a kernel half-way between nodes).
//!
//! # Pupil functions
//!
//! A pack of schema [`PUPIL_SCHEMA`] has the pupil functions of its PSFs, a hundredth of their bytes, in place of `psf/<band index>`; the PSFs are
//! computed from them when they are read ([`pipeline::design::pupil_stack`]). S segments, P points of the largest one:
//!
//! | array | shape | unit | contents |
//! |---|---|---|---|
//! | `psf_size` | (B) | 1 | n, samples a window side |
//! | `pupil_segment/<band index>` | (S, 8) | | of each segment: index of its height, rings, spokes, first and last angle in rad, index of the surface that limits it or −1, its centre on the meridian, 1 or −1 if an obscuration hides it |
//! | `pupil/<band index>` | (S, 5, P) | | at rings × spokes Chebyshev points (then NaN): W in µm, L, M, √(Φ J / N) · B², Φ / N · B² |
//!
//! # Lenses without rotational symmetry
//!
//! A pack of schema [`PLANAR_SCHEMA`] is of a built lens, of a design without symmetry, or of a measured one ([`pipeline::lens::planar`]): maps over
//! the film in place of the tables over image height, and PSFs that depend on the azimuth, or are on a grid. All coordinates are of the film: X right,
//! Y DOWN, mm from the lens's axis, real unless named ideal. Mx, My nodes of the map of the band with most:
//!
//! | array | shape | unit | contents |
//! |---|---|---|---|
//! | `map_x`, `map_y` | (B, Mx), (B, My) | mm | nodes of the map, uniform, ascending; 4 to 1025 |
//! | `map_ideal_x`, `map_ideal_y` | (B, My, Mx) | mm | ideal point of the field point whose image is there |
//! | `map_relative_illumination` | (B, My, Mx) | 1 | 1 at the film's centre |
//! | `psf/<band index>` | (R, n, n) | 1 | R PSFs, up to 65,536, at the places below; in place of (K, n, n) |
//! | `psf_energy` | (B, R) | 1 | as above, per PSF |
//! | `wavelength`, `psf_pitch`, `solid_angle`, `transmission` | (B) | | as above; `solid_angle` at the film's centre |
//!
//! `psf_field` = `polar`: PSFs at the azimuths 2π a/A_k about the film's centre of each height, each in the frame turned by its azimuth (φ from +x
//! towards +y), so that the field point is on +x as above; rows (k, a), a fastest, R = Σ A_k:
//!
//! | array | shape | unit | contents |
//! |---|---|---|---|
//! | `psf_height`, `azimuth_count` | (B, K) | mm, 1 | as above |
//! | `psf_azimuths` | (B, K) | 1 | A_k, 1 to 2880: 1 on the axis |
//!
//! `psf_field` = `grid`: PSFs at columns and rows of the film, not turned; rows (j, i), i fastest, R = Ny·Nx:
//!
//! | array | shape | unit | contents |
//! |---|---|---|---|
//! | `psf_x`, `psf_y` | (B, Nx), (B, Ny) | mm | places of the PSFs, uniform, ascending; 1 to 4096 |
//!
//! Of a band with fewer nodes than the widest, the rows of `map_x`, `map_y`, `psf_height`, `psf_x` and `psf_y` end with NaN, and the numbers of the other
//! tables beyond its nodes have any value (this program writes NaN, and 0 for counts). The size of a table of maps, all bands, is up to 33,620,000
//! numbers. With `psf_size` the pack has pupil functions in place of PSFs: those above, of the whole pupil, with 9 numbers a segment (angles from −π to π;
//! the centre along and across the meridian); a PSF has one, in the frame of that PSF. Such a pack has neither depth nodes nor tails; a lens with
//! rotational symmetry is never written as one.
//!
//! # Tails
//!
//! A pack whose attribute `extras` lists `tail` has the light of its PSFs beyond their windows ([`pipeline::lens::tail`]); the windows then keep
//! their share of the light in films (`psf_energy`). H heights:
//!
//! | array | shape | unit | contents |
//! |---|---|---|---|
//! | `tail/inner_radius` | (B) | mm | R, half a side of the PSF window or more; NaN: this band has no tail |
//! | `tail/height` | (B, H) | mm | real image heights, ascending from 0 |
//! | `tail/coefficient` | (B, H, 10) | mm, mm³ | c_mj of harmonic m and term j at 2 m + j |
//!
//! With `middle` in `extras`, too, bands whose rays land beyond the window have a middle part ([`pipeline::lens::middle`]); R is then the radius beyond which none land:
//!
//! | array | shape | unit | contents |
//! |---|---|---|---|
//! | `tail/middle_pitch` | (B) | mm | pitch of the samples, 2 R/n; NaN: this band has no middle part |
//! | `tail/middle/<band>` | (H of the band, n, n) | share of the light | one image a height, the field point on +x, row down, the chief ray in the centre; n odd |
//!
//! # Ghosts
//!
//! A pack whose attribute `extras` lists `ghost` has the light of two reflections, of rings of a scene on rings of the film
//! ([`pipeline::design::ghost::rings`]): N rings, N_s = ⌈1.25 N⌉ of the scene, M = ⌊1.5 N⌋ azimuthal orders, the same of all bands. Neither with depth nodes
//! nor of lenses without rotational symmetry:
//!
//! | array | shape | unit | contents |
//! |---|---|---|---|
//! | `ghost/ring` | (B) | mm | width of a ring: N rings reach the film's corner |
//! | `ghost/operator/<band index>` | (M + 1, N, N_s) | 1 | G_m(j, i), 16 ≤ N ≤ 256; none exceeds that of order 0 |
//! | `ghost/paths/<band index>` | (P, 8) | | optional, for reports: of each path the surfaces that reflect (counted from 1; 0: the film), shares of the light from axis and half field over that of the image on the axis, diameter of the light from the axis in mm, height on the film per pupil height and per tangent (mm), 1 if the operator has it |
//! | `ghost/sensor_reflectance` | (B) | 1 | share that the film reflects, which the operators contain |
//!
//! # Values
//!
//! Tables are float32, float64 or of an integer type, PSFs float32 or float64. A band with fewer field points or heights than the widest ends its rows
//! with NaN (`azimuth_count` and `psf_energy`: any value): its K is the number of entries of `psf_height` before the first NaN, and
//! `psf/<band index>` has K windows. A window whose sum differs from 1 by more than 1e-3 is an error, by less than 1e-6 is used as it is,
//! otherwise is divided by its sum.
//!
//! # Attributes of the group
//!
//! | attribute | value |
//! |---|---|
//! | `schema` | [`SCHEMA`], [`DEPTH_SCHEMA`], [`PUPIL_SCHEMA`] or [`PLANAR_SCHEMA`] |
//! | `distortion_focal_length_mm`, `effective_focal_length_mm` | > 0 |
//! | `f_number`, `primary_wavelength_nm` | > 0 |
//! | `psf_sample` | `point`: point samples; `integrated`: each sample integrated over the pitch |
//! | `psf_field` | `polar` or `grid`, of a lens without rotational symmetry |
//! | `extras` | names of optional groups that change films: `tail`, `middle`, `cones`, `ghost`; others are an error |
//! | `name` | default: the file's name |
//! | `object_distance_mm` | null, missing or `Infinity`: at infinity |
//! | `magnification` | default 0 |
//! | `image_plane`, `defocus_mm`, `frame`, `psf_tolerance`, `source` | optional; printed, not used in any calculation |
//! | `reference_point` | optional, of a lens without rotational symmetry: `chief ray`, `centroid` or `as given`, the point that map and PSF windows are of |
//! | `errors`, `compensators` | optional, of a built lens: the errors drawn (`file`, `digest`, `seed`, `sample`, `values`), and what compensates them; any JSON |
//!
//! # Storage
//!
//! Zarr v3 with a regular chunk grid and the codecs `transpose`, `bytes`, one of `blosc`, `zstd`, `gzip`, and `crc32c`; neither shards nor
//! storage transformers nor Zarr v2. A missing chunk is an error, except a PSF chunk of an array with fill value 0 whose windows sum to 1
//! without it. Tables are read when the pack is opened, PSFs band by band on demand (a traced band takes 60 MB). Any malformed pack is a
//! [`LensPackError`].

mod array;
mod attributes;
mod digest;
mod error;
mod number;
mod pack;
mod read;
mod sink;
mod store;
mod stored;
mod summary;
mod write;

pub use array::MAX_SAMPLES as MAX_ARRAY_SAMPLES;
pub use attributes::{DEPTH_SCHEMA, PLANAR_SCHEMA, PUPIL_SCHEMA, PackAttributes, ReferencePoint, SCHEMA};
pub use digest::{DepthBandValues, band_digest};
pub use error::LensPackError;
pub use pack::{LensPack, builtin, builtin_names};
pub(crate) use read::MAP_NUMBERS;
pub use read::PackGhosts;
pub use summary::{BandSummary, LensSummary, PlanarBandSummary, PlanarSummary, PsfFieldSummary, summary};
pub use write::{LensPackWriter, write};
