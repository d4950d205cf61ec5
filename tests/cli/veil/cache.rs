//! The cache of reduced charts.

use super::*;

/// The entries of the cache of reduced charts.
fn reduced_charts(cache: &Path) -> Vec<PathBuf> {
    let files = fs::read_dir(cache.join("lenscube/lenses")).into_iter().flatten();
    let mut all: Vec<_> = files.map(|file| file.unwrap().path()).collect();
    all.retain(|path| path.extension().is_some_and(|extension| extension == "reduced"));
    all.sort();
    all
}

#[test]
fn reduced_chart_is_read_from_the_cache_with_the_same_film() {
    let scene = Scene::new(Size::new(300, 310), |y, x| ((y * 7 + x * 3) % 11) as f32);
    let written = std::time::Instant::now();
    let (cache, other) = (scene.dir.path().join("cache"), scene.dir.path().join("other"));
    let drawn = "gen:checker?size=256&wavelengths=450&pitch_um=2&noise=0.1";
    let command = |chart: &str, film: &Path, cache: &Path| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(["run", chart, text(film), "--lens", text(&scene.pack), "--outside", "clamp"]);
        command.args(["--threads", "2", "--verbose"]).args(VEIL).env("XDG_CACHE_HOME", cache);
        command
    };
    let film = |chart: &str, name: &str, cache: &Path| {
        let film = scene.dir.path().join(name);
        let ran = CommandResult::new(&command(chart, &film, cache).output().unwrap()).ok();
        (files(&film), ran.stderr)
    };
    const FOUND: &str = "reduced chart of band 0: from the cache";
    let (expected, first) = film(drawn, "first", &cache);
    assert!(!first.contains(FOUND), "{first}");
    let [entry] = &reduced_charts(&cache)[..] else { panic!("{:?}", reduced_charts(&cache)) };
    let (again, second) = film(drawn, "second", &cache);
    assert!(second.contains(FOUND) && again == expected, "{second}");
    let listed = std::process::Command::new(env!("CARGO_BIN_EXE_lenscube"));
    let mut listed = listed;
    let listed = listed.arg("cache").env("XDG_CACHE_HOME", &cache).output().unwrap();
    let listed = CommandResult::new(&listed).ok().stdout;
    assert!(listed.contains("0 traced bands, 1 reduced chart band, 0.0 MB"), "{listed}");
    // Another chart, bin or treatment of its values is another entry.
    film("gen:checker?size=256&wavelengths=450&pitch_um=2&noise=0.2", "noisier", &cache);
    assert_eq!(reduced_charts(&cache).len(), 2);
    // A damaged entry is made anew.
    let mut bytes = fs::read(entry).unwrap();
    bytes[300] ^= 1;
    fs::write(entry, &bytes).unwrap();
    let (again, third) = film(drawn, "third", &cache);
    assert!(third.contains("cannot be used (it is damaged); the chart is read again"), "{third}");
    assert!(again == expected && reduced_charts(&cache).len() == 2 && fs::read(entry).unwrap() != bytes);
    // A directory that cannot be one.
    fs::write(&other, "").unwrap();
    assert!(film(drawn, "without", &other).0 == expected);
    // Killed before the entry has its name, then two at once.
    let race = scene.dir.path().join("race");
    let killed = command(drawn, &scene.dir.path().join("killed"), &race)
        .env("LENSCUBE_FAULT", "reduced-chart-written:1:kill")
        .output()
        .unwrap();
    assert!(CommandResult::new(&killed).code == KILLED && reduced_charts(&race).is_empty());
    let both = ["one", "two"].map(|name| {
        let mut command = command(drawn, &scene.dir.path().join(name), &race);
        command.stdout(std::process::Stdio::null()).stderr(std::process::Stdio::null());
        command.spawn().unwrap()
    });
    both.into_iter().for_each(|mut run| assert!(run.wait().unwrap().success()));
    assert!(["one", "two"].iter().all(|name| files(&scene.dir.path().join(name)) == expected));
    assert_eq!(fs::read_dir(race.join("lenscube/lenses")).unwrap().count(), 1, "one entry and no other file");
    // A chart in a file is kept once its last change is as old as the steps of clocks.
    while written.elapsed() < std::time::Duration::from_millis(4200) {
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    let of_file = scene.dir.path().join("of-file");
    let (expected, first) = film(text(&scene.chart), "file-first", &of_file);
    let (again, second) = film(text(&scene.chart), "file-second", &of_file);
    assert!(!first.contains(FOUND) && second.contains(FOUND) && again == expected, "{second}");
    // Written again just now: it is read, and not kept.
    fs::remove_dir_all(&scene.chart).unwrap();
    Picture { size: Size::new(300, 310), bands: vec![vec![0.5; 300 * 310]] }.write(&scene.chart);
    let (changed, third) = film(text(&scene.chart), "file-third", &of_file);
    assert!(!third.contains(FOUND) && changed != expected && reduced_charts(&of_file).len() == 1, "{third}");
}
