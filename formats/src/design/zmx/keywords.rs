//! Keywords of .zmx files that do not change the optics, by the reason why they do not.

/// Keywords of the system.
const HEADER: &[(&str, &[&str])] = &[
    (
        "bookkeeping, comments, display",
        &[
            "VERS", "AUTH", "IWDP", "PFIL", "LANG", "NOTE", "LUID", "BLNK", "FCOM", "DBDT", "EERA", "STUD",
            "SYNC", "PICB", "HYPR", "SDMA", "OMMA", "NSCD",
        ],
    ),
    ("weights of fields and wavelengths in the merit function", &["FWGT", "FWGN", "WWGT", "WWGN", "FSVY"]),
    (
        "coating file (`--coatings design`), polarisation of the source, gradients",
        &["POLS", "COFN", "GLRS", "GSTD"],
    ),
    (
        "solves, optimisation and tolerancing: the saved values hold",
        &["PUPD", "EFFL", "PUSH", "ROPD", "TOLS"],
    ),
    ("angles of vignetting factors", &["VANN", "ZVAN"]),
];

/// Keywords of a surface.
const SURFACE: &[(&str, &[&str])] = &[
    (
        "comments and drawing",
        &[
            "SSID", "COMM", "FIMP", "HIDE", "MIRR", "SLAB", "POPS", "SCOL", "SDRW", "SPID", "TPRI", "CSHP",
            "VCON", "VPAR", "EDGE", "TZPL",
        ],
    ),
    ("mechanical outline and chip zone", &["MEMA", "OEMA", "MAZH", "CHZH", "VDSZ", "TOLE"]),
    ("thermal expansion: the design is traced at its own temperature", &["TCED"]),
    ("solves and pickups: the saved values hold", &["PZUP", "PKUP", "PPAR"]),
];

fn contains(table: &[(&str, &[&str])], keyword: &str) -> bool {
    table.iter().any(|(_, keywords)| keywords.contains(&keyword))
}

pub(super) fn is_harmless_in_header(keyword: &str) -> bool {
    contains(HEADER, keyword)
}

pub(super) fn is_harmless_in_surface(keyword: &str) -> bool {
    contains(SURFACE, keyword)
}

/// Merit function, tolerance and configuration operands, which follow the surfaces: two to four capital letters or digits.
pub(super) fn is_operand(keyword: &str) -> bool {
    (2..=4).contains(&keyword.len()) && keyword.bytes().all(|b| b.is_ascii_uppercase() || b.is_ascii_digit())
}
