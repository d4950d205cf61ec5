//! Fuzz harness: damaged and generated input for every reader. A finding is a panic, or a case that exceeds the bounds of time or memory.
//!
//! Normal test runs execute a few hundred cases. `LENSCUBE_FUZZ_CASES` sets the number, applies the bounds to each case and prints one line
//! per target, which `scripts/fuzz` collects in a table. Seeds are fixed, so findings are reproducible; the input of a finding is written
//! to the temporary directory.
#![allow(missing_docs, dead_code, unused_imports, reason = "shared by tests that each use a part")]

mod damage;
pub mod extreme;

pub use damage::{damage, damage_text};

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Once};
use std::time::{Duration, Instant};

/// Maximum peak memory of the test process in bytes.
const MAX_PROCESS_BYTES: u64 = 2 << 30;
/// Maximum growth of the process during one case in bytes. Seeds are below 1 MiB, stated chunk sizes below 8 MiB.
const MAX_CASE_BYTES: u64 = 256 << 20;
/// Maximum processor time of a case in the thread that reads it.
const MAX_CASE_TIME: Duration = Duration::from_secs(1);
/// A case that has not ended after this time (seconds, also of other work on the machine) ends the process.
const HANG_S: u64 = 60;

/// Number of cases of a target: `default`, or that of the environment.
pub fn cases(default: usize) -> usize {
    cases_from_environment().unwrap_or(default)
}

fn cases_from_environment() -> Option<usize> {
    let text = std::env::var("LENSCUBE_FUZZ_CASES").ok()?;
    Some(text.parse().expect("LENSCUBE_FUZZ_CASES is a number"))
}

/// splitmix64 (Steele, Lea, Flood 2014).
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }

    pub fn pick<'a, T: ?Sized>(&mut self, items: &[&'a T]) -> &'a T {
        items[self.below(items.len())]
    }
}

thread_local! {
    static FUZZING: Cell<bool> = const { Cell::new(false) };
    static LAST_PANIC: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Result of one case.
enum Outcome {
    /// Whether the reader accepted it.
    Read(bool),
    Finding(String),
}

/// Reads one case; the text of a panic is the finding.
fn read_case(case: &[u8], read: &mut impl FnMut(&[u8]) -> bool) -> Outcome {
    FUZZING.set(true);
    let result = catch_unwind(AssertUnwindSafe(|| read(case)));
    FUZZING.set(false);
    match result {
        Ok(accepted) => Outcome::Read(accepted),
        Err(_) => Outcome::Finding(LAST_PANIC.take()),
    }
}

/// Reads one case within the bounds of time and memory.
fn read_case_bounded(case: &[u8], read: &mut impl FnMut(&[u8]) -> bool) -> Outcome {
    reset_peak_memory();
    let before = peak_memory();
    let start = processor_time();
    let first = read_case(case, read);
    let used = processor_time().saturating_sub(start);
    let grown = peak_memory().saturating_sub(before);
    if matches!(first, Outcome::Finding(_)) {
        return first;
    }
    if grown > MAX_CASE_BYTES {
        return Outcome::Finding("a case uses more than 256 MiB".into());
    }
    if used > MAX_CASE_TIME {
        return Outcome::Finding("a case takes more than 1 s of the processor".into());
    }
    first
}

/// Processor time of this thread.
#[cfg(unix)]
fn processor_time() -> Duration {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Duration::new(time.tv_sec.unsigned_abs(), time.tv_nsec.unsigned_abs() as u32)
}

/// The clock, where there is none of a thread.
#[cfg(not(unix))]
fn processor_time() -> Duration {
    std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default()
}

/// Passes the cases of `make` to `read`, which returns whether it accepted them. Fails on panics, on time and memory beyond the
/// bounds, and if no case or every case was accepted.
pub fn fuzz(
    target: &str,
    default_cases: usize,
    mut make: impl FnMut(&mut Random) -> Vec<u8>,
    mut read: impl FnMut(&[u8]) -> bool,
) {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| match FUZZING.get() {
            true => LAST_PANIC.set(info.to_string().replace('\n', " ")),
            false => before(info),
        }));
    });
    let file = |name: String| {
        std::env::temp_dir().join(format!("lenscube-fuzz-{}-{name}", target.replace(' ', "-")))
    };
    let long = cases_from_environment().is_some();
    let current = file(format!("current-{}", std::process::id()));
    let current = memory_directory().join(current.file_name().expect("a file's path"));
    let watch = long.then(|| Watchdog::start(target, current.clone()));
    let (total, start) = (cases(default_cases), Instant::now());
    let mut r = Random(target.bytes().fold(1, |seed: u64, b| seed.wrapping_mul(31).wrapping_add(b.into())));
    let mut findings: BTreeMap<String, usize> = BTreeMap::new();
    let mut accepted = 0;
    for _ in 0..total {
        let case = make(&mut r);
        let outcome = match &watch {
            None => read_case(&case, &mut read),
            Some(watch) => {
                // Kept if the case ends the process.
                std::fs::write(&current, &case).expect("the input is written");
                watch.begin();
                read_case_bounded(&case, &mut read)
            }
        };
        match outcome {
            Outcome::Read(ok) => accepted += usize::from(ok),
            Outcome::Finding(what) => {
                let number = findings.len() + 1;
                let count = findings.entry(what).or_default();
                *count += 1;
                if *count == 1 {
                    std::fs::write(file(number.to_string()), &case).expect("the input is written");
                }
            }
        }
    }
    drop(watch);
    let _ = std::fs::remove_file(&current);
    print_row(target, total, start.elapsed().as_secs_f64(), findings.len(), accepted);
    assert!(findings.is_empty(), "{target}: {findings:#?}");
    assert!(
        accepted > 0 && accepted < total,
        "{target}: {accepted} of {total} cases were accepted, so the target tests nothing"
    );
    let peak = peak_memory();
    assert!(peak < MAX_PROCESS_BYTES, "{target}: the process used {peak} bytes");
}

/// Directory for files written for every case: in memory if the system has one.
pub fn memory_directory() -> PathBuf {
    let shared = PathBuf::from("/dev/shm");
    if shared.is_dir() { shared } else { std::env::temp_dir() }
}

/// Ends the process if a case does not end.
struct Watchdog(Arc<(AtomicU64, Instant)>);

impl Watchdog {
    fn start(target: &str, current: PathBuf) -> Self {
        let (target, state) = (target.to_owned(), Arc::new((AtomicU64::new(0), Instant::now())));
        let watched = Arc::downgrade(&state);
        std::thread::spawn(move || {
            while let Some(state) = watched.upgrade() {
                if state.1.elapsed().as_secs() > state.0.load(Ordering::Relaxed) + HANG_S {
                    eprintln!(
                        "{target}: a case has not ended after {HANG_S} s; its input: {}",
                        current.display()
                    );
                    std::process::exit(101);
                }
                drop(state);
                std::thread::sleep(Duration::from_secs(1));
            }
        });
        Self(state)
    }

    fn begin(&self) {
        self.0.0.store(self.0.1.elapsed().as_secs(), Ordering::Relaxed);
    }
}

/// One line for `scripts/fuzz`.
pub fn print_row(target: &str, cases: usize, seconds: f64, findings: usize, accepted: usize) {
    if cases_from_environment().is_some() {
        let (accepted, peak) = (100.0 * accepted as f64 / cases as f64, peak_memory() >> 20);
        println!("\nFUZZ\t{target}\t{cases}\t{seconds:.1}\t{findings}\t{accepted:.1}\t{peak}");
    }
}

/// Peak resident memory of this process since the last reset; 0 if the system does not report it.
fn peak_memory() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    line.and_then(|l| l.split_whitespace().next()?.parse::<u64>().ok()).map_or(0, |kib| kib << 10)
}

/// Resets the peak (Linux, proc(5)); elsewhere the peak is that of the process since its start.
fn reset_peak_memory() {
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}
