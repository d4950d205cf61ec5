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
