//! Orders of samples in files without an index.

/// Order of bands, rows and columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interleave {
    /// (band, row, column).
    Bsq,
    /// (row, band, column).
    Bil,
    /// (row, column, band).
    Bip,
    /// (band, column, row).
    BandColumnRow,
    /// (column, band, row).
    ColumnBandRow,
    /// (column, row, band).
    ColumnRowBand,
}

impl Interleave {
    /// Name of the order. Part of a chart's identity, which films store: do not change.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Bsq => "bsq",
            Self::Bil => "bil",
            Self::Bip => "bip",
            Self::BandColumnRow => "band, column, row",
            Self::ColumnBandRow => "column, band, row",
            Self::ColumnRowBand => "column, row, band",
        }
    }
}
