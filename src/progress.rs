//! Output to the user: log lines on stderr, results on stdout, progress bars on a terminal, progress lines elsewhere. `--quiet` leaves
//! errors and results, `--verbose` adds details.

pub mod interrupt;
pub mod jsonl;
pub mod terminal;

use crate::args::ProgressArg;
use crate::failure;
use formats::durable::Sweep;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use pipeline::clock::Phase;
use pipeline::executor::Progress;
use pipeline::executor::Summary;
use pipeline::tiling::ShardId;
use std::fmt::Display;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, OnceLock, Weak};
use std::time::{Duration, Instant};

/// Amount of output on stderr.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verbosity {
    /// Errors only.
    Quiet,
    /// What a run does, remarks, progress.
    Normal,
    /// Figures of the run as well.
    Verbose,
}

/// Set once, by [`set_verbosity`].
static VERBOSITY: OnceLock<Verbosity> = OnceLock::new();

/// Sets the amount of output of this process.
pub fn set_verbosity(verbosity: Verbosity) {
    VERBOSITY.get_or_init(|| verbosity);
}

fn verbosity() -> Verbosity {
    VERBOSITY.get().copied().unwrap_or(Verbosity::Normal)
}

/// What receives the log lines of a library; none in the command.
static SINK: OnceLock<fn(&str)> = OnceLock::new();

/// Gives all log lines to `sink`, and none to stderr: this process is another program, which uses lenscube as a library. The first call counts.
pub fn log_to(sink: fn(&str)) {
    SINK.get_or_init(|| sink);
    set_verbosity(Verbosity::Quiet);
}

/// Whether the current work is a step of another command.
static IS_STEP: AtomicBool = AtomicBool::new(false);

/// Runs `work`, a step of another command: its log lines are details.
pub fn as_step<T>(work: impl FnOnce() -> T) -> T {
    let outer = IS_STEP.swap(true, Relaxed);
    let result = work();
    IS_STEP.store(outer, Relaxed);
    result
}

/// Writes a line to stderr, unless `--quiet`, or to where [`log_to`] says. Errors are ignored: stderr may be closed.
pub fn log_line(line: impl AsRef<str>) {
    if let Some(sink) = SINK.get() {
        return sink(line.as_ref());
    }
    let least = if IS_STEP.load(Relaxed) { Verbosity::Verbose } else { Verbosity::Normal };
    if verbosity() >= least {
        error_line(line);
    }
}

/// Writes a line to stderr with `--verbose`.
pub fn detail_line(line: impl AsRef<str>) {
    if verbosity() == Verbosity::Verbose {
        error_line(line);
    }
}

/// Writes a line to stderr in any case.
pub fn error_line(line: impl AsRef<str>) {
    terminal::error_line(line.as_ref());
}

/// Writes a line of the result to stdout. A closed pipe (`| head`) is not an error.
pub fn print(line: impl Display) {
    match terminal::result_line(&line.to_string()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            let error = anyhow::Error::from(e).context("writing the result");
            error_line(format!("lenscube: {}", failure::line(&error)));
            std::process::exit(failure::exit_code(&error).into());
        }
        _ => (),
    }
}

/// A number and its noun: `1 band`, `2 bands`.
pub fn plural(n: impl Display, noun: &str) -> String {
    let n = n.to_string();
    format!("{n} {noun}{}", if n == "1" { "" } else { "s" })
}

/// How an interrupted command is resumed: `--overwrite` would remove what there is of the output.
pub fn resume_note(overwrite: bool) -> &'static str {
    match overwrite {
        false => "the same command resumes",
        true => "without `--overwrite` the same command resumes",
    }
}

/// A path as a JSON string; bytes that are not UTF-8 become U+FFFD.
pub fn json_path(path: &Path) -> serde_json::Value {
    path.to_string_lossy().into_owned().into()
}

/// Reports temporary files that could not be removed; they do not affect the output.
pub fn report_kept(sweep: &Sweep) {
    if let Some((path, reason)) = sweep.kept.first() {
        log_line(format!(
            "note: {} temporary files of ended processes could not be removed, the first is {}: {reason}",
            sweep.kept.len(),
            path.display()
        ));
    }
}

/// A bar for countable work, named `doing`, and the function that updates it with (done, total). Without a terminal: a line every ten
/// seconds.
pub fn counting(doing: &str) -> (ProgressBar, impl Fn(u64, u64) + Sync + use<>) {
    let style = ProgressStyle::with_template("{msg}  [{bar:32}] {percent:>3} %  {eta_precise} left");
    let bar = ProgressBar::new(1).with_style(style.expect("a valid template")).with_message(doing.to_owned());
    if verbosity() == Verbosity::Quiet {
        bar.set_draw_target(ProgressDrawTarget::hidden());
    }
    let (updated, doing, start) = (bar.clone(), doing.to_owned(), Instant::now());
    let lines = (!terminal::is_stderr()).then(|| Mutex::new(start));
    let update = move |done: u64, all: u64| {
        updated.set_length(all);
        updated.set_position(done);
        if let Some(mut last) = lines.as_ref().and_then(|l| l.try_lock().ok())
            && last.elapsed() >= LINE_EVERY
        {
            *last = Instant::now();
            let share = done as f64 / all.max(1) as f64;
            let left = start.elapsed().as_secs_f64() * (1.0 / share - 1.0);
            log_line(format!("{doing}: {:.0} %, {} left", 100.0 * share, duration(left)));
        }
    };
    (bar, update)
}

/// Progress of tracing a lens band by band: a bar on a terminal, else a line every ten seconds.
pub struct TracingBar {
    bar: ProgressBar,
    step: Arc<Mutex<String>>,
}

impl TracingBar {
    /// For `bands` bands.
    pub fn new(bands: usize) -> Self {
        let style = ProgressStyle::with_template(
            "{msg}  [{bar:32}] {pos}/{len} bands  {elapsed} elapsed, {eta} left",
        );
        let bar = ProgressBar::new(bands as u64).with_style(style.expect("a valid template"));
        if verbosity() == Verbosity::Quiet {
            bar.set_draw_target(ProgressDrawTarget::hidden());
        }
        let step = Arc::default();
        if !terminal::is_stderr() {
            let (step, bar) = (Arc::downgrade(&step), bar.clone());
            // It ends with this value, at its next line.
            std::thread::spawn(move || tracing_lines(&step, &bar));
        }
        Self { bar, step }
    }

    /// The step that is computed.
    pub fn step(&self, step: String) {
        self.step.lock().expect("no panic while held").clone_from(&step);
        self.bar.set_message(step);
    }

    /// One more band is traced.
    pub fn band_done(&self) {
        self.bar.inc(1);
    }

    /// `bands` bands are traced.
    pub fn set_bands(&self, bands: usize) {
        self.bar.set_position(bands as u64);
    }

    /// Writes log lines without the bar.
    pub fn suspend(&self, write: impl FnOnce()) {
        self.bar.suspend(write);
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// Logs the progress of `bar` until it is finished or `step` is dropped.
fn tracing_lines(step: &Weak<Mutex<String>>, bar: &ProgressBar) {
    loop {
        std::thread::sleep(LINE_EVERY);
        let Some(step) = step.upgrade().filter(|_| !bar.is_finished()) else { return };
        let step = step.lock().expect("no panic while held").clone();
        let (done, bands, elapsed_s) =
            (bar.position(), bar.length().unwrap_or(0), bar.elapsed().as_secs_f64());
        let left_s = elapsed_s * bands.saturating_sub(done) as f64 / done as f64;
        let left = if done == 0 { String::new() } else { format!(", {} left", duration(left_s)) };
        log_line(format!(
            "tracing: {done} of {}, {} elapsed{left}; {step}",
            plural(bands, "band"),
            duration(elapsed_s)
        ));
    }
}

/// Progress of a run: a bar on a terminal, else log lines.
pub struct Bars {
    bar: Option<ProgressBar>,
    /// Whether log lines replace the bar.
    lines: bool,
    names: Vec<String>,
    state: Mutex<State>,
}

struct State {
    start: Instant,
    last_line: Instant,
    done: u64,
    total: u64,
    band: usize,
    band_done: u64,
    band_total: u64,
    band_start: Instant,
}

/// Time between log lines without a terminal.
const LINE_EVERY: Duration = Duration::from_secs(10);

impl Bars {
    /// For bands `names`, with `pixels` film pixels to compute in each; `progress` is not `jsonl`.
    pub fn new(names: Vec<String>, pixels: &[u64], progress: ProgressArg) -> Self {
        let total = pixels.iter().sum();
        let is_shown = verbosity() > Verbosity::Quiet && progress != ProgressArg::None;
        let has_bar = match progress {
            ProgressArg::Bar => true,
            ProgressArg::Plain => false,
            _ => terminal::is_stderr(),
        };
        let bar = (is_shown && has_bar).then(|| {
            let style =
                "{spinner} {msg}  [{bar:32}] {percent:>3} %  {elapsed_precise} elapsed, {eta_precise} left";
            let style = ProgressStyle::with_template(style).expect("a valid template").progress_chars("=> ");
            ProgressBar::new(total).with_style(style)
        });
        let now = Instant::now();
        let state = State {
            start: now,
            last_line: now,
            done: 0,
            total,
            band: 0,
            band_done: 0,
            band_total: 0,
            band_start: now,
        };
        Self { bar, lines: is_shown && !has_bar, names, state: Mutex::new(state) }
    }

    /// Removes the bar from the terminal.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Seconds, minutes or hours.
pub fn duration(seconds: f64) -> String {
    if !seconds.is_finite() {
        return "?".into();
    }
    match seconds.round() as u64 {
        s @ ..60 => format!("{s} s"),
        s @ 60..3600 => format!("{} min {:02} s", s / 60, s % 60),
        s => format!("{} h {:02} min", s / 3600, s % 3600 / 60),
    }
}

impl Progress for Bars {
    fn band(&self, position: usize, pixels: u64) {
        let mut s = self.state.lock().expect("no panic while held");
        (s.band, s.band_done, s.band_total, s.band_start) = (position, 0, pixels, Instant::now());
    }

    fn tile(&self, position: usize, pixels: usize) {
        let mut s = self.state.lock().expect("no panic while held");
        s.done += pixels as u64;
        if position == s.band {
            s.band_done += pixels as u64;
        }
        let rate = s.done as f64 / s.start.elapsed().as_secs_f64();
        let band_rate = s.band_done as f64 / s.band_start.elapsed().as_secs_f64();
        let left = |done: u64, total: u64, rate: f64| duration(total.saturating_sub(done) as f64 / rate);
        if let Some(bar) = &self.bar {
            bar.set_message(format!(
                "{} ({}/{}, {} left)  {:.1} Mpx/s",
                self.names[s.band],
                s.band + 1,
                self.names.len(),
                left(s.band_done, s.band_total, band_rate),
                rate * 1e-6
            ));
            bar.set_position(s.done);
        } else if self.lines && s.last_line.elapsed() >= LINE_EVERY {
            s.last_line = Instant::now();
            log_line(format!(
                "{} (band {} of {}): {:.0} %, {} left; job {:.0} %, {:.1} Mpx/s, {} left",
                self.names[s.band],
                s.band + 1,
                self.names.len(),
                100.0 * s.band_done as f64 / s.band_total.max(1) as f64,
                left(s.band_done, s.band_total, band_rate),
                100.0 * s.done as f64 / s.total.max(1) as f64,
                rate * 1e-6,
                left(s.done, s.total, rate),
            ));
        }
    }

    fn shard(&self, _id: ShardId, _bytes: u64) {}
}

/// The line at the end of a run.
pub fn summary_line(s: &Summary) -> String {
    let rate = s.pixels as f64 / s.wall_s * 1e-6;
    format!(
        "{} in {}, {rate:.1} Mpx/s, {}; {} written",
        plural(s.shards, "shard"),
        duration(s.wall_s),
        plural(s.tiles, "tile"),
        data_size(s.bytes_written)
    )
}

/// The figures of a run that `--verbose` adds.
pub fn summary_details(
    s: &Summary,
    bytes_read: u64,
    peak: Option<u64>,
    outside_window: (f64, f64),
    has_tails: bool,
) -> Vec<String> {
    let phase = |phase: &Phase| {
        let spectra =
            if *phase == Phase::Svpsf { format!(" ({} spectra)", s.spectra) } else { String::new() };
        format!("{} {:.1}{spectra}", phase.name(), s.core.of(*phase))
    };
    let waiting = |phase| s.times.of(phase) - s.core.of(phase);
    let mut lines = vec![format!(
        "core seconds: {}; waiting for the disk: read {:.1}, write {:.1}",
        Phase::ALL.iter().map(phase).collect::<Vec<_>>().join(", "),
        waiting(Phase::Read),
        waiting(Phase::Write)
    )];
    lines.extend(s.gpus.iter().map(|d| {
        let busy = |seconds: f64| 100.0 * seconds / d.span_s.max(1e-9);
        format!(
            "GPU {} ({}): {} tiles in {} batches; of {:.1} s busy: upload {:.0} %, compute {:.0} %, download {:.0} %",
            d.index,
            d.name,
            d.tiles,
            d.batches,
            d.span_s,
            busy(d.upload_s),
            busy(d.compute_s),
            busy(d.download_s)
        )
    }));
    let peak = peak.map_or(String::new(), |p| format!(", peak memory {} MiB", p >> 20));
    lines.push(format!("read {}, wrote {}{peak}", data_size(bytes_read), data_size(s.bytes_written)));
    if outside_window.1 > 0.0 {
        lines.push(format!(
            "energy outside the PSF windows: {:.1} % to {:.1} % by band (mean over heights); {}",
            100.0 * outside_window.0,
            100.0 * outside_window.1,
            if has_tails { "it is on the film as tails of the PSFs" } else { "each PSF is scaled to sum 1" }
        ));
    }
    lines
}

/// Number with at most four digits after the point, without trailing zeros.
pub fn short_number(v: f64) -> String {
    let text = format!("{v:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// Number with at most twelve significant digits, without the digits of rounding: 550.3 for 550.3000000000001.
pub fn number(v: f64) -> f64 {
    format!("{v:.11e}").parse().unwrap_or(v)
}

/// A number as it was given, with an exponent where it has many digits: 1e300.
pub fn given_number(v: f64) -> String {
    format!("{v:?}").trim_end_matches(".0").to_owned()
}

/// Bytes of files, in kB, MB or GB.
pub fn data_size(bytes: u64) -> String {
    match bytes as f64 {
        b if b < 1e5 => format!("{:.1} kB", b * 1e-3),
        b if b < 1e8 => format!("{:.1} MB", b * 1e-6),
        b => format!("{:.2} GB", b * 1e-9),
    }
}

/// Bytes in MiB, rounded up, for messages.
pub fn mib(bytes: usize) -> String {
    format!("{}MiB", bytes.div_ceil(1 << 20))
}

/// Defects that are named on the terminal; `--json` names all.
const NAMED: usize = 8;

/// Prints the first few lines, and how many there are.
pub fn print_first(lines: impl Iterator<Item = String>) {
    let lines: Vec<String> = lines.collect();
    lines.iter().take(NAMED).for_each(print);
    if lines.len() > NAMED {
        print(format!("and {} more; --json names all", lines.len() - NAMED));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_of_rounding_are_not_printed() {
        let wavelength = 550.1 + 2.0 * 0.1;
        assert_eq!((wavelength.to_string().len(), number(wavelength).to_string()), (17, "550.3".to_owned()));
        assert_eq!([100.0 * 0.007, 0.0, -1e-9, 1e300].map(number), [0.7, 0.0, -1e-9, 1e300]);
    }
}
