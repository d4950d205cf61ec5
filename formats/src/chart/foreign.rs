//! Files of formats that are not read: the format by its first bytes or extension, and how to convert it.

use std::io::Read;
use std::path::Path;

use super::error::ChartError;
use super::header::open_regular;
use crate::durable::DurableError;

/// First bytes that are looked at.
const FIRST_BYTES: u64 = 128;

/// Conversion in Python: `{in}` is the file, `{stem}` its name without extension.
struct Format {
    name: &'static str,
    extensions: &'static [&'static str],
    conversion: &'static str,
}

/// With neither of the signatures of level 5 and of v7.3, which are read.
const OTHER_MATLAB: Format = Format {
    name: "without the signature of MATLAB 5 or later: level 4, or is the copy complete?",
    extensions: &["mat"],
    conversion: "with Python: `import numpy, scipy.io` and `numpy.save(\"{stem}.npy\", scipy.io.loadmat(\"{in}\")[\"NAME\"])`, then run \
                 {stem}.npy with `--axes y,x,wavelength` and `--wavelengths`",
};
const WITHOUT_SIGNATURE: Format = Format {
    name: "no HDF5 signature in it: is the copy complete?",
    extensions: &["h5", "hdf5", "he5", "nc4"],
    conversion: "",
};
const NETCDF_3: Format = Format {
    name: "NetCDF-3",
    extensions: &["nc", "cdf"],
    conversion: "with Python: `import xarray` and `xarray.open_dataset(\"{in}\")[[\"NAME\"]].rename(NAME=\"chart\").to_zarr(\"{stem}.zarr\")`",
};
const NPZ: Format = Format {
    name: "a NumPy archive",
    extensions: &["npz"],
    conversion: "with Python: `import numpy` and `numpy.save(\"{stem}.npy\", numpy.load(\"{in}\")[\"NAME\"])`",
};
const COLOUR: Format = Format {
    name: "a picture",
    extensions: &["png", "jpg", "jpeg", "webp"],
    conversion: "by `lenscube chart image {in} {stem}.zarr` (colours become spectra); bands in several pictures are run as their folder \
                 or a pattern such as '*.png'",
};
const OTHER_PICTURE: Format = Format {
    name: "a picture",
    extensions: &["bmp", "gif", "ppm", "pgm", "heic", "jp2", "avif", "tga", "dng", "cr2", "nef"],
    conversion: "to TIFF or PNG with the program that wrote it",
};
const ZIP: Format = Format { name: "a zip archive", extensions: &["zip"], conversion: "by unpacking it" };

/// The format of a file by its first bytes, else by its extension.
fn format_of(extension: &str, first: &[u8]) -> Option<&'static Format> {
    let at = |offset: usize, magic: &[u8]| first.get(offset..).is_some_and(|f| f.starts_with(magic));
    match () {
        () if at(0, b"MATLAB 7.3 MAT-file") => return Some(&WITHOUT_SIGNATURE),
        () if at(0, b"CDF\x01") || at(0, b"CDF\x02") || at(0, b"CDF\x05") => return Some(&NETCDF_3),
        () if at(0, b"\x89PNG") || at(0, b"\xff\xd8\xff") || (at(0, b"RIFF") && at(8, b"WEBP")) => {
            return Some(&COLOUR);
        }
        () if at(0, b"PK\x03\x04") && extension != "npz" => return Some(&ZIP),
        () => {}
    }
    let all = [&OTHER_MATLAB, &WITHOUT_SIGNATURE, &NETCDF_3, &NPZ, &COLOUR, &OTHER_PICTURE, &ZIP];
    all.into_iter().find(|f| f.extensions.contains(&extension))
}

/// The error for a file that no reader supports; `formats`: those in files that are read.
pub(super) fn unsupported(path: &Path, formats: &str) -> ChartError {
    let file = match open_regular(path) {
        Ok(file) => file,
        Err(e) => return e,
    };
    let mut first = Vec::new();
    if let Err(e) = file.take(FIRST_BYTES).read_to_end(&mut first) {
        return DurableError::io("read", path, 0, e).into();
    }
    let extension = path.extension().map_or(String::new(), |e| e.to_string_lossy().to_lowercase());
    let stem = path.file_stem().map_or(String::new(), |s| s.to_string_lossy().into_owned());
    let format = format_of(&extension, &first);
    let name = format.map(|f| f.name);
    let found = match (extension.is_empty(), name) {
        (true, None) => "a file without an extension".to_owned(),
        (true, Some(name)) => name.to_owned(),
        (false, None) => format!(".{extension}"),
        (false, Some(name)) => format!(".{extension} ({name})"),
    };
    let convert = format.filter(|f| !f.conversion.is_empty()).map_or(String::new(), |f| {
        let conversion = f.conversion.replace("{in}", &path.display().to_string()).replace("{stem}", &stem);
        format!("; convert it {conversion}")
    });
    let supported = format!("Zarr v2 and v3, {formats}, raw samples (--chart-shape, --chart-dtype)");
    ChartError::Unsupported { path: path.into(), found, supported, convert }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_without_permission_is_an_error_of_the_file_system() {
        use std::os::unix::fs::PermissionsExt;
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.h5");
        std::fs::write(&path, [0; 9]).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o000)).unwrap();
        // Root may read every file.
        let expected =
            if std::fs::File::open(&path).is_ok() { "no HDF5 signature" } else { "ermission denied" };
        let error = unsupported(&path, "ENVI").to_string();
        assert!(error.contains(expected) && error.contains("a.h5"), "{error}");
    }

    #[test]
    fn format_is_found_by_first_bytes_or_extension() {
        let dir = tempfile::tempdir().unwrap();
        let cases: [(&str, &[u8], &[&str]); 9] = [
            ("a.mat", b"MATLAB 7.3 MAT-file, Platform: GLNXA64", &[".mat", "signature", "complete"]),
            ("a.mat", b"", &[".mat (without", "level 4", "scipy.io.loadmat(", "a.npy"]),
            ("cube.h5", b"", &[".h5", "signature"]),
            ("a.nc", b"CDF\x02rest", &["NetCDF-3", "to_zarr(\"a.zarr\")"]),
            ("a.npz", b"PK\x03\x04", &["NumPy archive", "numpy.load"]),
            ("a.jpg", b"\xff\xd8\xff\xe0", &["a picture", "lenscube chart image"]),
            ("a.zip", b"PK\x03\x04", &["unpacking"]),
            ("a.xyz", b"1 2 3", &["unsupported format .xyz; supported: Zarr"]),
            ("noname", b"", &["without an extension", "ENVI"]),
        ];
        for (name, bytes, words) in cases {
            let path = dir.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            let error = unsupported(&path, "ENVI").to_string();
            assert!(words.iter().all(|w| error.contains(w)) && error.contains(name), "{words:?} in {error}");
            assert!(!error.contains("directory"), "{error}");
        }
    }
}
