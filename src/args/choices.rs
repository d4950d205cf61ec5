//! Flags with named values: a parser, and the values of the library, which knows no command line.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use formats::chart::NanPolicy;
use formats::export::exr::ExrCompression;
use formats::film::{Codec, SampleType};
use formats::import::Format;
use formats::import::window::{EvenWindow, Outward, RowOrder};
use formats::picture::style::Style;
use pipeline::design::system::RayAiming;
use pipeline::design::tolerance::Boresight;
use pipeline::develop::Demosaic;
use pipeline::field::Outside;
use pipeline::lens::PsfSample;
use pipeline::resample::{Interp, Surround};
use pipeline::sensor::pixels::Resample;
use pipeline::stage::Stage;
use pipeline::stages::{self, DESCRIPTIONS, Description, described};
use std::sync::LazyLock;

/// Name, help (may be empty), value.
pub(super) type Choices<T> = &'static [(&'static str, &'static str, T)];

pub(super) const AIMING: Choices<RayAiming> = &[
    ("real", "Through the real stop", RayAiming::Real),
    ("paraxial", "Through the paraxial entrance pupil", RayAiming::Paraxial),
];
pub(super) const BORESIGHT: Choices<Boresight> = &[
    ("keep", "From the film's centre", Boresight::Keep),
    ("remove", "From the image of the axis of the scene", Boresight::Remove),
];
pub(super) const CODEC: Choices<Codec> =
    &[("none", "", Codec::None), ("lz4", "", Codec::Lz4), ("zstd", "", Codec::Zstd)];
pub(super) const COMPRESSION: Choices<ExrCompression> =
    &[("zip", "", ExrCompression::Zip), ("piz", "", ExrCompression::Piz), ("none", "", ExrCompression::None)];
pub(super) const DEMOSAIC: Choices<Demosaic> = &[
    ("malvar", "Gradient-corrected, for Bayer patterns", Demosaic::Malvar),
    ("bilinear", "Linear over one period, any pattern", Demosaic::Bilinear),
    ("superpixel", "One pixel per period", Demosaic::Superpixel),
];
pub(super) const DTYPE: Choices<SampleType> = &[("f32", "", SampleType::F32), ("f16", "", SampleType::F16)];
pub(super) const EVEN_WINDOW: Choices<EvenWindow> = &[
    ("pad", "On sample N/2 (from 0); a zero row and column are added", EvenWindow::Pad),
    ("crop", "On sample N/2 (from 0); the first row and column are removed", EvenWindow::Crop),
    ("shift", "Between the four central samples; the window is shifted by half a sample", EvenWindow::Shift),
];
pub(super) const FROM: Choices<Format> = &[
    ("iset", "Folder written by the ISET macros for Zemax or Code V", Format::Iset),
    ("listings", "Folder of OpticStudio text listings", Format::Listings),
    ("tables", "Folder of CSV tables and NPY windows", Format::Tables),
    ("npz", "NumPy archive", Format::Npz),
];
pub(super) const INTERP: Choices<Interp> =
    &[("bicubic", "", Interp::Bicubic), ("bilinear", "", Interp::Bilinear)];
pub(super) const NAN: Choices<NanPolicy> = &[("error", "", NanPolicy::Error), ("zero", "", NanPolicy::Zero)];
pub(super) const OUTSIDE: Choices<Outside> = &[("error", "", Outside::Error), ("clamp", "", Outside::Clamp)];
pub(super) const PSF_OUTWARD: Choices<Outward> = &[
    ("right", "", Outward::Right),
    ("down", "", Outward::Down),
    ("left", "", Outward::Left),
    ("up", "", Outward::Up),
];
pub(super) const PSF_ROWS: Choices<RowOrder> =
    &[("top", "", RowOrder::Top), ("bottom", "", RowOrder::Bottom)];
pub(super) const PSF_SAMPLE: Choices<PsfSample> =
    &[("point", "", PsfSample::Point), ("integrated", "", PsfSample::Integrated)];
pub(super) const RESAMPLE: Choices<Resample> = &[
    ("cubic", "Cubic Hermite", Resample::Cubic),
    ("area", "Linear: the film constant over a pixel", Resample::Area),
];
pub(super) const STYLE: Choices<Style> =
    &[("light", "Black on white", Style::Light), ("dark", "Light on dark grey", Style::Dark)];
pub(super) const SWITCH: Choices<bool> = &[("on", "", true), ("off", "", false)];
pub(super) const SURROUND: Choices<Surround> =
    &[("edge", "", Surround::Edge), ("black", "", Surround::Black), ("mirror", "", Surround::Mirror)];

/// Parser of the names of `choices`.
pub(super) fn one_of<T: Copy + Send + Sync>(choices: Choices<T>) -> impl TypedValueParser<Value = T> {
    let possible = |&(name, help, _): &(&'static str, &'static str, T)| match help {
        "" => PossibleValue::new(name),
        help => PossibleValue::new(name).help(help),
    };
    PossibleValuesParser::new(choices.iter().map(possible)).map(|name: String| {
        let chosen = choices.iter().find(|choice| choice.0 == name);
        chosen.expect("the parser accepts no other name").2
    })
}

/// Help of `--stages`: what the stages do.
pub(super) fn stages_help() -> String {
    let helps: Vec<String> = chosen().map(|d| d.help.to_lowercase().replace("psf", "PSF")).collect();
    format!("Stages to apply: {}", helps.join(", "))
}

/// The stages that `--stages` chooses.
fn chosen() -> impl Iterator<Item = &'static Description> {
    DESCRIPTIONS.iter().filter(|d| d.flags.is_empty())
}

/// Parses the name of a stage.
pub(super) fn stage() -> impl TypedValueParser<Value = Stage> {
    let names = chosen().map(|d| PossibleValue::new(d.name).help(d.help));
    PossibleValuesParser::new(names).map(|name| {
        let named = DESCRIPTIONS.iter().find(|d| d.name == name);
        named.expect("one of the possible values").stage
    })
}

/// The stages without `--stages`, as typed.
pub(super) fn default_stages() -> &'static str {
    static NAMES: LazyLock<String> =
        LazyLock::new(|| described(stages::default_stages()).map(|d| d.name).collect::<Vec<_>>().join(","));
    &NAMES
}
