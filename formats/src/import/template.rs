//! A folder of tables to begin with: the worked example `formats/data/tables-example`, which [`super::open`] reads.

/// Its files: name and content.
pub const TEMPLATE: [(&str, &[u8]); 6] = [
    ("README.md", include_bytes!("../../data/tables-example/README.md")),
    ("lens.csv", include_bytes!("../../data/tables-example/lens.csv")),
    ("heights.csv", include_bytes!("../../data/tables-example/heights.csv")),
    ("psf.csv", include_bytes!("../../data/tables-example/psf.csv")),
    ("psf_500.npy", include_bytes!("../../data/tables-example/psf_500.npy")),
    ("psf_550.npy", include_bytes!("../../data/tables-example/psf_550.npy")),
];
