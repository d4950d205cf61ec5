//! The guide: pages of Markdown that `lenscube help TOPIC` prints, `lenscube man` writes as manual pages, and this module holds as documentation.

pub mod roff;

/// A page of the guide.
#[derive(Clone, Copy, Debug)]
pub struct Page {
    /// Name, as in `lenscube help NAME`.
    pub name: &'static str,
    /// What it is about.
    pub about: &'static str,
    /// Markdown.
    pub text: &'static str,
}

macro_rules! pages {
    ($($name:ident: $about:literal,)*) => {
        $(
            #[doc = include_str!(concat!("manual/guide/", stringify!($name), ".md"))]
            #[allow(rustdoc::invalid_rust_codeblocks, reason = "indented blocks are commands of a shell")]
            mod $name {}
        )*
        /// All pages, in the order of the guide.
        pub const PAGES: &[Page] = &[$(Page {
            name: stringify!($name),
            about: $about,
            text: include_str!(concat!("manual/guide/", stringify!($name), ".md")),
        }),*];
    };
}

pages! {
    charts: "formats and axes, wavelengths, units, pictures, drawn charts, missing data",
    lenses: "designs, tables and listings, lens packs, tracing and its cache",
    tolerances: "manufacturing errors, lenses as built and their films",
    light: "what a film holds: tails of PSFs, transmission, ghosts, scatter, veiling glare",
    scenes: "meshes with materials, camera and light; solids, hidden surfaces",
    depth: "distances per pixel, hidden surfaces, focus",
    films: "stores, resume, export, pyramids, the viewer, exit codes, reproducibility",
    camera: "sensors, raws, development, comparison of lenses under the same noise",
    reports: "a camera measured from pictures of charts: resolution, noise, distortion, shading, glare, colour",
    restoration: "films back to charts: methods, noise, figures, limits",
    python: "the package, arrays in memory, gradients",
    datasets: "many samples by a recipe: pictures, lenses, sensors, labels",
    clusters: "plans and units, Dask, Slurm, Kubernetes, S3",
    gpus: "devices, what is required, what was measured",
    model: "equations and conventions",
    accuracy: "what was compared with what, and speed",
    limits: "what is left out",
}

/// The page `name`.
pub fn page(name: &str) -> Option<&'static Page> {
    PAGES.iter().find(|page| page.name == name)
}
