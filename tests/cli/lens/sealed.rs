//! `lenscube lens trace --sealed`: packs, and films made with them, without what their design is made of.

use super::*;

/// Title, names of glass, of files of the design, coatings and tolerances.
const TITLE: &str = "Marktitle";
const GLASS: &str = "MARKGLAS";
const DESIGN_FILE: &str = "markdesign";
const COATINGS: &str = "markcoatings";
const TOLERANCES: &str = "marktolerances";
/// A word of the title and a comment that no other file has.
const NOTE: &str = "Marknote";
const MARKS: [&str; 6] = [TITLE, GLASS, DESIGN_FILE, COATINGS, TOLERANCES, NOTE];
const NAME: &str = "Lens A of a maker";

/// A marked design with its catalogue, coatings and tolerances in a folder of its own, and a place for packs beside it.
struct Marked {
    dir: tempfile::TempDir,
}

impl Marked {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let own = Self { dir };
        let folder = own.at("marked");
        fs::create_dir(&folder).unwrap();
        // Sellmeier coefficients of N-SK16.
        let glass = "2 0 1.62 60\nCD 1.34317774 0.00704687339 0.241144399 0.0229005 0.994317969 92.7508526\nLD 0.3 2.5\n";
        fs::write(own.marked("markcatalogue.agf"), format!("NM {GLASS} {glass}")).unwrap();
        let title = DESIGN.lines().find(|line| line.starts_with("NAME ")).unwrap();
        let design =
            DESIGN.replace("N-SK16", GLASS).replace(title, &format!("NAME {TITLE} {NOTE}\nNOTE 0 {NOTE}"));
        fs::write(own.marked("markdesign.zmx"), design).unwrap();
        fs::write(
            own.marked("markcoatings.toml"),
            "default = \"quarter\"\n[coating.quarter]\nlayers = [[\"M\", 99.6]]\n[material.M]\nn = 1.38\n",
        )
        .unwrap();
        let errors = "[[element]]\nsurfaces = [10, 11]\ndecentre_um = 30\n[criterion]\nkind = \"rms-spot\"\n";
        fs::write(own.marked("marktolerances.toml"), errors).unwrap();
        own
    }

    fn at(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn marked(&self, name: &str) -> PathBuf {
        self.at("marked").join(name)
    }

    /// Traces the design into the pack `name`.
    fn trace(&self, name: &str, flags: &[&str]) -> CommandResult {
        let catalogue = self.marked("markcatalogue.agf");
        let given = ["--glass-catalog", text(&catalogue)];
        trace(text(&self.marked("markdesign.zmx")), &self.at(name), &[&given[..], flags].concat())
    }

    fn trace_coated(&self, name: &str, flags: &[&str]) {
        let coatings = self.marked("markcoatings.toml");
        self.trace(name, &[&["--coatings", text(&coatings)], flags].concat()).ok();
    }
}

/// Which of the marks the bytes of the files at `path` hold, in any case.
fn marks(path: &Path) -> Vec<&'static str> {
    let all: Vec<u8> = match path.is_dir() {
        true => files(path).into_values().flatten().collect(),
        false => fs::read(path).unwrap(),
    };
    let all = String::from_utf8_lossy(&all).to_lowercase();
    MARKS.into_iter().filter(|mark| all.contains(&mark.to_lowercase())).collect()
}

#[test]
fn sealed_packs_and_their_films_hold_nothing_of_the_design() {
    let lens = Marked::new();
    lens.trace_coated("open.lens.zarr", &[]);
    lens.trace_coated("sealed.lens.zarr", &["--sealed", "--name", NAME]);
    let [open, sealed] = ["open.lens.zarr", "sealed.lens.zarr"].map(|name| lens.at(name));
    // The search finds what a pack of the same design records.
    assert_eq!(marks(&open), [TITLE, DESIGN_FILE, COATINGS, NOTE]);
    assert_eq!(marks(&sealed), [""; 0]);
    let attributes = |pack: &Path| -> Value {
        serde_json::from_slice::<Value>(&fs::read(pack.join("zarr.json")).unwrap()).unwrap()["attributes"]
            .take()
    };
    let of = attributes(&sealed);
    assert_eq!((&of["sealed"], &of["name"]), (&Value::Bool(true), &NAME.into()));
    assert!(["image_plane", "defocus_mm", "errors"].iter().all(|key| of[*key].is_null()), "{of}");
    assert_eq!(of["source"].as_object().unwrap().keys().collect::<Vec<_>>(), ["program"]);
    assert!(attributes(&open).get("sealed").is_none());
    // Tables and PSFs are those of the other pack, byte for byte.
    let data = |pack: &Path| {
        let all = files(pack).into_iter().filter(|(name, _)| name != Path::new("zarr.json"));
        all.collect::<Vec<_>>()
    };
    assert!(data(&open) == data(&sealed));

    let film = lens.at("film.zarr");
    let run = |pack: &Path, film: &Path| {
        let size = ["--film-size", "64x48", "--film-pitch-um", "5"];
        let words =
            ["run", "gen:siemens?size=64", text(film), "--lens", text(pack), "--wavelengths", "500,600"];
        lenscube(&[&words[..], &size].concat())
    };
    let said = run(&sealed, &film).ok();
    assert_eq!(marks(&film), [""; 0]);
    // Nor where the pack is.
    let provenance = lenscube(&["status", text(&film), "--json"]).ok().stdout;
    assert!(provenance.contains(NAME) && !provenance.contains("sealed.lens.zarr"), "{provenance}");
    assert!(
        !String::from_utf8_lossy(&files(&film).into_values().flatten().collect::<Vec<u8>>())
            .contains("sealed.lens.zarr")
    );
    let shown = [
        said.stdout + &said.stderr,
        provenance,
        lenscube(&["lens", "show", text(&sealed)]).ok().stdout,
        lenscube(&["lens", "show", text(&sealed), "--json"]).ok().stdout,
        lenscube(&["verify", text(&film)]).ok().stdout,
        lenscube(&["lens", "export", text(&sealed), "--as", "opencv", "--film-size", "500"]).ok().stdout,
    ];
    for text in &shown {
        let found = MARKS.iter().find(|mark| text.to_lowercase().contains(&mark.to_lowercase()));
        assert_eq!(found, None, "{text}");
    }
    assert!(shown[2].contains("sealed") && shown[3].contains("\"sealed\": true"), "{}", shown[2]);
    // A film of the other pack has the same pixels, and says where it comes from.
    let of_open = lens.at("open.zarr");
    run(&open, &of_open).ok();
    assert_eq!(bits(&pixels(&of_open, "film").1), bits(&pixels(&film, "film").1));
    assert_eq!(marks(&of_open), [TITLE, NOTE]);
    assert!(lenscube(&["status", text(&of_open), "--json"]).ok().stdout.contains("open.lens.zarr"));
}

#[test]
fn drawn_errors_are_left_out() {
    let lens = Marked::new();
    let tolerances = lens.marked("marktolerances.toml");
    let drawn = ["--tolerances", text(&tolerances), "--film-size", "200", "--film-pitch-um", "10"];
    lens.trace("open.lens.zarr", &drawn).ok();
    lens.trace("sealed.lens.zarr", &[&drawn[..], &["--sealed"]].concat()).ok();
    let [open, sealed] = ["open.lens.zarr", "sealed.lens.zarr"].map(|name| lens.at(name));
    assert_eq!(marks(&open), [TITLE, DESIGN_FILE, NOTE]);
    assert_eq!(marks(&sealed), [""; 0]);
    let root = |pack: &Path| fs::read_to_string(pack.join("zarr.json")).unwrap();
    let digest = blake3::hash(&fs::read(&tolerances).unwrap()).to_hex().to_string();
    assert!(root(&open).contains(&digest) && !root(&sealed).contains(&digest));
    assert!(root(&open).contains("decentre") && root(&open).contains("film_shift_mm"));
    assert!(!root(&sealed).contains("decentre") && !root(&sealed).contains("film_shift_mm"));
    assert!(
        root(&sealed).contains("\"reference_point\": \"chief ray\"")
            || root(&sealed).contains("\"reference_point\":\"chief ray\"")
    );
    assert_eq!(LensPack::open(&sealed).unwrap().lens().name, "sealed lens");
}

#[test]
fn pupil_functions_are_refused_and_names_are_of_one_line() {
    let lens = Marked::new();
    let refused = |flags: &[&str], words: &[&str]| {
        assert_exit(&lens.trace("no.lens.zarr", flags), USAGE, words);
        assert!(!lens.at("no.lens.zarr").exists());
    };
    refused(&["--sealed", "--store", "pupils"], &["--store pupils", "wavefronts", "--sealed"]);
    refused(&["--name", "A"], &["--sealed"]);
    refused(&["--sealed", "--name", " "], &["a name of 1 to 120 characters"]);
}
