//! Small job for fault tests: chart, lens pack, film, and the expected film files.

use super::{CommandResult, Picture, delta, files, identity_band, lens, scattered, text, write_pack};
use pipeline::geometry::Size;
use pipeline::lens::tail::{BandTail, Coefficients};
use pipeline::lens::{LensBand, PsfStack};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

pub struct TestJob {
    pub dir: tempfile::TempDir,
    pub chart: PathBuf,
    pub pack: PathBuf,
    pub film: PathBuf,
    layout: &'static [&'static str],
}

impl TestJob {
    /// Two bands of four shards each.
    pub fn small() -> Self {
        Self::new(Size::new(90, 100), &["--shard", "64", "--chunk", "32"])
    }

    /// Two bands of thirty shards each; the chart has four inner chunks a band.
    pub fn large() -> Self {
        Self::new(Size::new(631, 705), &["--shard", "128", "--chunk", "64"])
    }

    /// Two bands of one row of three tiles each, twelve shards.
    pub fn wide() -> Self {
        Self::new(Size::new(24, 1400), &["--shard", "128", "--chunk", "64", "--outside", "clamp"])
    }

    /// As [`TestJob::wide`], with eleven rows of shards a band.
    pub fn tall() -> Self {
        Self::new(Size::new(1400, 24), &["--shard", "128", "--chunk", "64", "--outside", "clamp"])
    }

    /// Two bands of 2300 x 2300 px of a generated chart, for jobs with many tiles.
    pub fn drawn(layout: &'static [&'static str]) -> Self {
        let chart = "gen:composite?size=2300&wavelengths=450,500&pitch_um=2".into();
        Self { chart, layout, ..Self::small() }
    }

    /// Two bands of `size`.
    pub fn new(size: Size, layout: &'static [&'static str]) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        let job =
            Self { chart: at("chart.zarr"), pack: at("pack.lens.zip"), film: at("film.zarr"), layout, dir };
        Picture::noise(11, size, 2).write(&job.chart);
        let lens = lens([450.0, 500.0].map(|nm| identity_band(nm, 1.0, 5)).into());
        let stacks = lens.bands.iter().zip(1..).map(|(b, seed)| scattered(seed, b)).collect();
        write_pack(&job.pack, &lens, stacks);
        job
    }

    /// With a lens whose PSFs have about 1 % of their light beyond windows of 21 px.
    pub fn with_tails(self) -> Self {
        self.with_pack_of_tails(1.0, true, scattered)
    }

    /// As [`TestJob::with_tails`], with points in the windows and the same round tails everywhere.
    pub fn with_point_tails(self) -> Self {
        self.with_pack_of_tails(0.0, true, |_, band| delta(band))
    }

    /// As [`TestJob::with_tails`], without what the lens has of the tails.
    pub fn with_cut_windows(self) -> Self {
        self.with_pack_of_tails(0.0, false, scattered)
    }

    /// Tails have harmonics, and change with the height, by `variation`.
    fn with_pack_of_tails(
        self,
        variation: f64,
        has_tails: bool,
        psfs: impl Fn(u64, &LensBand) -> PsfStack,
    ) -> Self {
        let (inner_mm, px) = (10.5 * 2e-3, 2e-3);
        let coefficients = |h: f64| -> Coefficients {
            let change = [0.003 * h * h, 0.0, 0.004 * h * h, 0.0, 0.001].map(|c| variation * c);
            let third = [0.0165 + change[0], change[1], change[2], change[3], change[4]].map(|c| c * px);
            third.map(|c| [c, 10.0 * c * px * px])
        };
        let height_mm: Vec<f64> = (0..=4).map(|i| 0.25 * f64::from(i)).collect();
        let coefficients = height_mm.iter().map(|h| coefficients(*h)).collect();
        let tail = BandTail { inner_mm, height_mm, coefficients, middle: None };
        let band = |nm| LensBand {
            psf_energy: vec![0.99; 4],
            tail: has_tails.then(|| tail.clone()),
            cones: None,
            planar: None,
            ..identity_band(nm, 1.0, 21)
        };
        let lens = lens([450.0, 500.0].map(band).into());
        let stacks = lens.bands.iter().zip(1..).map(|(b, seed)| psfs(seed, b)).collect();
        std::fs::remove_file(&self.pack).unwrap();
        write_pack(&self.pack, &lens, stacks);
        self
    }

    pub fn at(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// `lenscube run` of `film` with the injected `fault` (empty: none).
    pub fn command(&self, film: &Path, fault: &str, flags: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(["run", text(&self.chart), text(film), "--lens", text(&self.pack)]);
        command.args(["--threads", "2"]).args(self.layout).args(flags);
        if !fault.is_empty() {
            command.env("LENSCUBE_FAULT", fault);
        }
        command
    }

    /// [`TestJob::command`] on `threads` threads in place of its own number.
    pub fn command_on(&self, threads: &str, film: &Path, flags: &[&str]) -> Command {
        let command = self.command(film, "", flags);
        let words: Vec<String> = command.get_args().map(|a| a.to_string_lossy().into_owned()).collect();
        let at = words.iter().position(|w| w == "--threads").unwrap() + 1;
        let words = words.iter().enumerate().map(|(i, w)| if i == at { threads } else { w });
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(words);
        command
    }

    /// `lenscube plan` of `film`.
    pub fn plan(&self, film: &Path, flags: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(["plan", text(&self.chart), text(film), "--lens", text(&self.pack)]);
        command.args(["--threads", "2"]).args(self.layout).args(flags);
        command
    }

    pub fn run(&self, fault: &str, flags: &[&str]) -> CommandResult {
        CommandResult::new(&self.command(&self.film, fault, flags).output().unwrap())
    }

    /// Files of the film of a run without faults.
    pub fn expected_files(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        let film = self.at("whole.zarr");
        CommandResult::new(&self.command(&film, "", &[]).output().unwrap()).ok();
        let expected = files(&film);
        std::fs::remove_dir_all(film).unwrap();
        expected
    }

    /// Starts a run that stops itself (SIGSTOP) at `step`, and waits until it has stopped.
    pub fn stopped(&self, step: &str, flags: &[&str]) -> StoppedRun {
        let fault = format!("{step}:stop");
        let mut command = self.command(&self.film, &fault, flags);
        let child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let mut stopped = StoppedRun(child);
        assert!(stopped.wait_stopped(), "the run ended before {step}");
        stopped
    }

    /// Temporary files and locks in the film's directory.
    pub fn leftover_files(&self) -> Vec<PathBuf> {
        let all = files(self.dir.path()).into_keys();
        let records = |p: &PathBuf| text(p).contains(".tmp-") || text(p).ends_with(".lock");
        all.chain(std::fs::read_dir(self.film.join("runs")).into_iter().flatten().map(|e| e.unwrap().path()))
            .filter(records)
            .collect()
    }
}

/// Process that SIGSTOP has stopped.
pub struct StoppedRun(pub Child);

impl StoppedRun {
    /// Waits until the process has stopped or ended; whether it has stopped. Stopped: every thread; one that waits for the disk ends its
    /// system call first.
    pub fn wait_stopped(&mut self) -> bool {
        let start = Instant::now();
        loop {
            assert!(start.elapsed() < Duration::from_secs(300), "neither stopped nor ended");
            let states = self.states();
            if states.iter().all(|state| matches!(state, 'Z' | 'X')) {
                return false;
            }
            if states.iter().all(|state| matches!(state, 'T' | 'Z' | 'X')) {
                return true;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// States of the threads, of those that have not ended.
    fn states(&self) -> Vec<char> {
        let tasks = std::fs::read_dir(format!("/proc/{}/task", self.0.id())).into_iter().flatten().flatten();
        let stats = tasks.filter_map(|task| std::fs::read_to_string(task.path().join("stat")).ok());
        stats.filter_map(|stat| stat.rsplit_once(") ").and_then(|s| s.1.chars().next())).collect()
    }

    pub fn signal(&self, name: &str) {
        let sent = Command::new("kill").args(["-s", name, &self.0.id().to_string()]).status().unwrap();
        assert!(sent.success(), "kill -s {name}");
    }

    /// Continues the process until it ends.
    pub fn run_to_end(mut self) -> CommandResult {
        while self.wait_stopped() {
            self.signal("CONT");
            std::thread::sleep(Duration::from_millis(5));
        }
        CommandResult::new(&self.0.wait_with_output().unwrap())
    }
}
