//! No output takes the place of an input: exit code 2, a message that names both, and all files as before, also with `--overwrite`.

use super::*;
use std::collections::BTreeMap;
use std::os::unix::fs::{MetadataExt, symlink};

/// Inode and bytes of each file below a directory, and the targets of links.
fn state(root: &Path) -> BTreeMap<PathBuf, (u64, Vec<u8>)> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(root).unwrap() {
        let path = entry.unwrap().path();
        let meta = path.symlink_metadata().unwrap();
        let bytes = match () {
            () if meta.is_symlink() => fs::read_link(&path).unwrap().into_os_string().into_encoded_bytes(),
            () if meta.is_dir() => {
                found.extend(state(&path));
                Vec::new()
            }
            () => fs::read(&path).unwrap(),
        };
        found.insert(path, (meta.ino(), bytes));
    }
    found
}

/// A folder with one input of each kind; the first line of each file is enough for what the guard looks at.
fn inputs() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    Picture::noise(5, Size::new(8, 9), 3).write(&at("chart.zarr"));
    for directory in ["film.zarr/film", "raw.zarr/raw", "pack.lens.zarr", "tables", "pictures", "x.png.shot"]
    {
        fs::create_dir_all(at(directory)).unwrap();
    }
    for name in [
        "u.npy",
        "depth.npy",
        "cube.hdr",
        "cube.img",
        "t.tif",
        "scene.exr",
        "design.zmx",
        "glass.agf",
        "sensor.toml",
        "matrix.txt",
        "job.json",
        "photo.png",
        "pictures/450.png",
        "pictures/500.png",
        "tables/a.csv",
        "film.zarr/zarr.json",
        "film.zarr/film/zarr.json",
        "raw.zarr/zarr.json",
        "pack.lens.zarr/zarr.json",
        "figures.csv",
        "coatings.toml",
        "layout.svg",
    ] {
        let magic = match name {
            "t.tif" => "II*\0",
            "coatings.toml" => "coating.a.table = \"tables/a.csv\" #",
            _ => "",
        };
        fs::write(at(name), format!("{magic}{name}")).unwrap();
    }
    symlink("film.zarr", at("link.zarr")).unwrap();
    symlink("u.npy", at("link.npy")).unwrap();
    symlink("new.csv", at("dangling.csv")).unwrap();
    fs::hard_link(at("u.npy"), at("hard.npy")).unwrap();
    fs::hard_link(at("film.zarr/film/zarr.json"), at("hard.json")).unwrap();
    symlink("../layout.svg", at("tables/layout.svg")).unwrap();
    folder
}

/// Command lines, and two words of each message: output and input. `$` is `--overwrite`.
const REFUSED: &[(&str, &str, &str)] = &[
    // The same path, a link, a hard link; header and data of ENVI.
    ("export u.npy u.npy --crop 0,0,4,4 $", "OUT u.npy is", "film u.npy"),
    ("export u.npy ./pictures/../u.npy $", "OUT ./pictures/../u.npy", "film u.npy"),
    ("export u.npy link.npy $", "OUT link.npy (a link to", "film u.npy"),
    ("export link.npy u.npy $", "OUT u.npy is", "film link.npy"),
    ("export u.npy hard.npy $", "OUT hard.npy is a hard link", "film u.npy"),
    ("export cube.hdr cube.hdr $", "OUT cube.", "film cube.hdr"),
    ("export cube.hdr cube.img $", "OUT cube.img is cube.img, of", "film cube.hdr"),
    ("export cube.img cube.hdr --bands 0 $", "OUT cube.hdr", "film cube.img"),
    ("export t.tif t.tif $", "OUT t.tif", "film t.tif"),
    ("export pictures/*.png pictures/450.png $", "OUT pictures/450.png is", "film pictures/*.png"),
    ("export pictures pictures/x.tif", "OUT pictures/x.tif lies in", "film pictures"),
    ("export link.zarr//film film.zarr/x.npy", "OUT film.zarr/x.npy lies in", "film link.zarr//film"),
    // Files inside stores, and two outputs of one command.
    (
        "measure film.zarr --profile 0,0,5,5 --csv film.zarr/zarr.json $",
        "--csv film.zarr/zarr.json lies in",
        "film film.zarr",
    ),
    (
        "measure film.zarr/film --profile 0,0,5,5 --json film.zarr/zarr.json $",
        "--json film.zarr/zarr.json is",
        "of the film film.zarr/film",
    ),
    (
        "measure film.zarr --profile 0,0,5,5 --csv hard.json $",
        "--csv hard.json is a hard link to a file of",
        "film film.zarr",
    ),
    ("measure layout.svg --profile 0,0,5,5 --plot layout.svg $", "--plot layout.svg is", "film layout.svg"),
    ("measure u.npy --profile 0,0,5,5 --csv same --json same", "--json same is", "--csv same"),
    (
        "measure u.npy --profile 0,0,5,5 --csv new.csv --json dangling.csv",
        "--json dangling.csv (a link to",
        "--csv new.csv",
    ),
    // Films: equal to, inside and around each kind of input.
    ("run chart.zarr chart.zarr $", "FILM chart.zarr is", "chart chart.zarr"),
    ("run chart.zarr chart.zarr/film.zarr", "FILM chart.zarr/film.zarr lies in", "chart chart.zarr"),
    (
        "run chart.zarr film.zarr --lens pack.lens.zarr --depth film.zarr//depth",
        "FILM film.zarr is",
        "depth array film.zarr//depth",
    ),
    (
        "run chart.zarr new.zarr --lens new.zarr/pack.lens.zarr",
        "FILM new.zarr contains",
        "lens new.zarr/pack.lens.zarr",
    ),
    (
        "run chart.zarr pack.lens.zarr --lens pack.lens.zarr --dry-run",
        "FILM pack.lens.zarr is",
        "lens pack.lens.zarr",
    ),
    ("run chart.zarr design.zmx --lens design.zmx $", "FILM design.zmx is", "lens design.zmx"),
    (
        "run chart.zarr film.zarr --hidden film.zarr//hidden/1",
        "FILM film.zarr is",
        "hidden surface film.zarr//hidden/1",
    ),
    (
        "plan chart.zarr new.zarr --output chart.zarr/zarr.json",
        "--output chart.zarr/zarr.json lies in",
        "chart chart.zarr",
    ),
    (
        "plan chart.zarr new.zarr --output new.zarr/job.json",
        "--output new.zarr/job.json lies in",
        "FILM new.zarr",
    ),
    (
        "plan chart.zarr new.zarr --lens design.zmx --lens-pack design.zmx",
        "--lens-pack design.zmx is",
        "lens design.zmx",
    ),
    ("plan chart.zarr new.zarr --lens-pack new.zarr", "--lens-pack new.zarr is", "FILM new.zarr"),
    ("chart image photo.png photo.png $", "OUT.zarr photo.png is", "picture photo.png"),
    ("depth layout.svg --lens phone --plot layout.svg $", "--plot layout.svg is", "scene layout.svg"),
    (
        "depth u.npy --lens phone --depth layout.svg//Z --plot layout.svg $",
        "--plot layout.svg is",
        "depth array layout.svg//Z",
    ),
    // Lenses.
    ("lens trace design.zmx design.zmx", "OUT.lens.zarr design.zmx is", "lens design.zmx"),
    ("lens import tables tables/a.csv", "OUT.lens.zarr tables/a.csv is tables/a.csv, of", "source tables"),
    ("lens import tables tables", "OUT.lens.zarr tables contains tables/", "source tables"),
    ("lens convert design.zmx design.zmx $", "OUT design.zmx is", "lens design.zmx"),
    (
        "lens convert design.zmx glass.json --glass-catalog glass.agf $",
        "OUT glass.agf is",
        "glass catalogue glass.agf",
    ),
    ("lens show pack.lens.zarr --plot pack.lens.zarr", "--plot pack.lens.zarr/", "lens pack.lens.zarr"),
    (
        "lens psf design.zmx tables/a.csv --coatings coatings.toml $",
        "OUT tables/a.csv is",
        "table of the coatings tables/a.csv",
    ),
    ("lens show layout.svg --plot tables $", "--plot tables/layout.svg (a link to", "lens layout.svg"),
    // Cameras.
    ("sensor film.zarr film.zarr --sensor sensor.toml --exposure 1s $", "RAW film.zarr is", "film film.zarr"),
    (
        "sensor film.zarr film.zarr/raw.zarr --sensor sensor.toml --exposure 1s",
        "RAW film.zarr/raw.zarr lies in",
        "film film.zarr",
    ),
    (
        "sensor film.zarr//film sensor.toml --sensor sensor.toml --exposure 1s $",
        "RAW sensor.toml is",
        "sensor description sensor.toml",
    ),
    ("sensor show sensor.toml --plot sensor.toml", "--plot sensor.toml/", "sensor description sensor.toml"),
    ("sensor validate figures.csv --out . $", "--out ./figures.csv is", "sensor description figures.csv"),
    ("develop raw.zarr//raw raw.zarr/x.png", "OUT raw.zarr/x.png lies in", "raw raw.zarr"),
    ("develop raw.zarr photo.png --matrix photo.png $", "OUT photo.png is", "matrix photo.png"),
    (
        "develop raw.zarr pack.lens.zarr/x.png --shading pack.lens.zarr",
        "OUT pack.lens.zarr/x.png lies in",
        "shading pack.lens.zarr",
    ),
    ("compare raw.zarr film.zarr --out raw.zarr", "--out raw.zarr/report.html lies in", "raw raw.zarr"),
    ("shoot t.tif t.tif --lens phone --sensor example-2um $", "OUT t.tif is", "chart t.tif"),
    (
        "shoot x.png.shot x.png --lens phone --sensor example-2um",
        "the temporary directory x.png.shot/film.zarr lies in",
        "chart x.png.shot",
    ),
    (
        "shoot film.zarr new.png --lens phone --sensor example-2um --keep .",
        "--keep ./film.zarr",
        "chart film.zarr",
    ),
    (
        "validate --lens figures.csv --timing film.zarr --out film.zarr",
        "--out film.zarr/report.html lies in",
        "film film.zarr",
    ),
];

#[test]
fn output_in_place_of_an_input_is_refused_before_anything_is_written() {
    let folder = inputs();
    let before = state(folder.path());
    for (line, output, input) in REFUSED {
        let line = line.replace('$', "--overwrite");
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        let ran = command.args(line.split_whitespace()).current_dir(folder.path()).output().unwrap();
        let ran = CommandResult::new(&ran);
        assert_error_line(&ran, USAGE, &[output, input, "choose another path"]);
        assert!(state(folder.path()) == before, "{line} changed the files");
    }
}

#[test]
fn outputs_beside_inputs_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    Picture::noise(5, Size::new(40, 50), 3).write(&at("chart.zarr"));
    // A second name of a file, and a directory in which an input lies.
    let words = [
        "export chart.zarr u.npy",
        "export u.npy cube.hdr --wavelengths 450,500,550",
        "export cube.hdr u.npy --overwrite",
    ];
    for line in words
        .iter()
        .chain(&["measure cube.hdr --profile 0,0,30,30 --csv a.csv --json a.json --plot cube.svg"])
    {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        let ran = command.args(line.split_whitespace()).current_dir(folder.path()).output().unwrap();
        CommandResult::new(&ran).ok();
    }
}
