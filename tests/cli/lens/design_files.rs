//! `lenscube lens convert | list`, and designs in formats that are not read.

use super::*;

fn at(dir: &tempfile::TempDir, name: &str) -> PathBuf {
    dir.path().join(name)
}

#[test]
fn converted_designs_are_converted_back_to_the_same_file() {
    let dir = tempfile::tempdir().unwrap();
    let convert = |a: &str, b: &Path| lenscube(&["lens", "convert", a, text(b)]);
    for lens in ["phone", "telephoto", "double-gauss-28"] {
        let path = |end: &str| at(&dir, &format!("{lens}-{end}"));
        let (zmx, csv, json, again) = (path("1.zmx"), path("2.csv"), path("3.json"), path("4.zmx"));
        convert(lens, &zmx).ok();
        convert(text(&zmx), &csv).ok();
        convert(text(&csv), &json).ok();
        convert(text(&csv), &again).ok();
        assert_eq!(fs::read_to_string(&zmx).unwrap(), fs::read_to_string(&again).unwrap(), "{lens}");
        let file: Value =
            serde_json::from_str(&fs::read_to_string(&json).unwrap().replace("Infinity", "1e300")).unwrap();
        assert!(file["surface_group"]["surfaces"].as_array().unwrap().len() > 8, "{lens}");
    }
    let taken = at(&dir, "phone-1.zmx");
    assert_exit(&convert("phone", &taken), OTHER_JOB, &["phone-1.zmx", "exists", "--overwrite"]);
    lenscube(&["lens", "convert", "telephoto", text(&taken), "--overwrite"]).ok();
    assert_ne!(fs::read(&taken).unwrap(), fs::read(at(&dir, "phone-4.zmx")).unwrap());
    assert_exit(
        &convert("phone", &at(&dir, "phone.len")),
        USAGE,
        &["phone.len", "expected a file ending with .zmx, .csv", ".json"],
    );
}

#[test]
fn own_glasses_are_written_beside_the_design_and_found_there() {
    let dir = tempfile::tempdir().unwrap();
    let table = "stop radius,3\ncatalogues,MINE\nsurface,radius,thickness,glass\nstop,50,4,OWN\n2,-50,\n";
    fs::write(at(&dir, "a.csv"), table).unwrap();
    fs::write(at(&dir, "mine.AGF"), "NM OWN 2 0 1.5 60\nCD 1.2 0.01\nLD 0.4 0.7\nNM BAD 2\nLD 0 0\n")
        .unwrap();
    let (a, b) = (at(&dir, "a.csv"), at(&dir, "my lens.zmx"));
    let converted = lenscube(&["lens", "convert", text(&a), text(&b)]).ok();
    assert!(converted.stderr.contains("glass catalogue mine: entries not used: 1"), "{}", converted.stderr);
    assert!(fs::read_to_string(at(&dir, "my-lens.agf")).unwrap().contains("NM OWN 2"));
    // Both files or none: after a failure the same command writes both.
    let (d, catalogue) = (at(&dir, "d.zmx"), at(&dir, "d.agf"));
    let words = ["lens", "convert", text(&a), text(&d)];
    let mut failing = std::process::Command::new(env!("CARGO_BIN_EXE_lenscube"));
    let failed = failing.args(words).env("LENSCUBE_FAULT", "rename:2:28").output().unwrap();
    assert!(!failed.status.success() && !d.exists() && !catalogue.exists());
    lenscube(&words).ok();
    assert!(d.exists() && catalogue.exists());
    fs::remove_file(at(&dir, "mine.AGF")).unwrap();
    lenscube(&["lens", "convert", text(&b), text(&at(&dir, "again.csv"))]).ok();
    // In a catalogue of the folder that the design does not name, and in none.
    let other = lenscube(&["lens", "convert", text(&a), text(&at(&dir, "c.zmx"))]).ok();
    assert!(other.stderr.contains("catalogue my-lens of the design's folder"), "{}", other.stderr);
    for name in ["my-lens.agf", "d.agf", "c.agf", "again.agf"] {
        let _ = fs::remove_file(at(&dir, name));
    }
    assert_exit(
        &lenscube(&["lens", "convert", text(&a), text(&at(&dir, "e.zmx"))]),
        FAILED,
        &["OWN", "line 4"],
    );
}

#[test]
fn formats_that_are_not_read_name_the_way_out() {
    let dir = tempfile::tempdir().unwrap();
    for (name, bytes, words) in [
        ("a.zos", b"ZoS\0".as_slice(), ["save the lens as .zmx", "a.zos"]),
        ("b.len", b"// OSLO 5.00 1 2\nLEN NEW \"x\" 1 2\nRD x\n", ["line 3", "`x` is not a number"]),
        ("c.len", b"\x01\0\0CODE", ["binary", "WRL"]),
        ("d.zar", b"ZAR before 2010", ["not a ZAR archive", "save the lens as .zmx"]),
        ("e.json", b"{\"surfaces\": []}", ["Optiland", "e.json"]),
        ("f.csv", b"a,b\n1,2\n", ["header row", "f.csv"]),
        ("g.seq", b"rdm;len\nfor ^i 1 3\nend for\n", ["line 2", "macro"]),
        ("h.zmx", b"", ["h.zmx", "the file is empty"]),
        ("i.zmx", b"PK\x03\x04MODE SEQ\n", ["zip archive", "unpack"]),
        ("l.zmx", "\n".repeat(9 << 20).as_bytes(), ["more than", "not a lens design"]),
        ("j.csv", b"radius\0\0thickness\n", ["binary", "text"]),
        ("k.zmx", b"MODE SEQ\nENPD 33,3\n", ["line 2", "decimal point"]),
    ] {
        fs::write(at(&dir, name), bytes).unwrap();
        assert_exit(&lenscube(&["lens", "show", text(&at(&dir, name))]), FAILED, &words);
    }
    let out = at(&dir, "x.csv");
    let configuration = ["lens", "convert", "phone", text(&out), "--configuration", "2"];
    assert_exit(&lenscube(&configuration), USAGE, &["phone has one configuration"]);
}

#[test]
fn list_names_every_builtin_lens_with_its_source() {
    let words = lenscube(&["lens", "list"]).ok().stdout;
    for word in [
        "phone",
        "triplet",
        "machine vision",
        "Sasián",
        "US 2021/0263286",
        "macro-100",
        "double-gauss-28-npz",
    ] {
        assert!(words.contains(word), "`{word}` is not in: {words}");
    }
    let listed: Value = serde_json::from_str(&lenscube(&["lens", "list", "--json"]).ok().stdout).unwrap();
    assert!(listed["designs"].as_array().unwrap().len() >= 9);
}
