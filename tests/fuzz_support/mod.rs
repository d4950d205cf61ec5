//! Damaged and invented input for everything that reads: any result is right but a panic, a case that takes long, or one that takes
//! much memory.
//!
//! Normal test runs take a few hundred cases. `LENSCUBE_FUZZ_CASES` raises the number, bounds each case (below) and prints one line a
//! target, of which `scripts/fuzz` makes a table. Seeds are fixed, so that a finding is found again; its input goes to the temp folder.
#![allow(missing_docs, dead_code, unused_imports, reason = "shared by tests that each use a part")]

mod damage;
pub mod strange;

pub use damage::{damage, damage_text};

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Once};
use std::time::{Duration, Instant};

/// Bound of the memory of the test process at its largest.
const PROCESS_MEMORY: u64 = 2 << 30;
/// Bound of what one case may add to the memory of the process. Seeds are below 1 MiB, declared pieces below 8 MiB.
const CASE_MEMORY: u64 = 256 << 20;
/// Bound of a case's time; one beyond it is read again, as the machine may have been busy.
const CASE_TIME: Duration = Duration::from_secs(1);
/// A case that has not ended after this time ends the process.
const HANG: u64 = 60;

/// Cases of a target: `few` unless the environment asks for another number.
pub fn cases(few: usize) -> usize {
    asked().unwrap_or(few)
}

fn asked() -> Option<usize> {
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

    pub fn one<'a, T: ?Sized>(&mut self, of: &[&'a T]) -> &'a T {
        of[self.below(of.len())]
    }
}

thread_local! {
    static FUZZING: Cell<bool> = const { Cell::new(false) };
    static LAST: RefCell<String> = const { RefCell::new(String::new()) };
}

/// What came of one case.
enum Outcome {
    Used(bool),
    Finding(String),
}

/// Reads one case, the panic's text being the finding.
fn outcome(case: &[u8], read: &mut impl FnMut(&[u8]) -> bool) -> Outcome {
    FUZZING.set(true);
    let result = catch_unwind(AssertUnwindSafe(|| read(case)));
    FUZZING.set(false);
    match result {
        Ok(used) => Outcome::Used(used),
        Err(_) => Outcome::Finding(LAST.take()),
    }
}

/// Reads one case within the bounds of time and memory.
fn bounded(case: &[u8], read: &mut impl FnMut(&[u8]) -> bool) -> Outcome {
    reset_peak_memory();
    let before = peak_memory();
    let start = Instant::now();
    let first = outcome(case, read);
    let grown = peak_memory().saturating_sub(before);
    if matches!(first, Outcome::Finding(_)) {
        return first;
    }
    if grown > CASE_MEMORY {
        return Outcome::Finding("a case takes more than 256 MiB".into());
    }
    if start.elapsed() > CASE_TIME {
        let again = Instant::now();
        let _ = outcome(case, read);
        if again.elapsed() > CASE_TIME {
            return Outcome::Finding("a case takes more than 1 s, twice".into());
        }
    }
    first
}

/// Feeds `make`'s cases to `read`, which returns whether it could use them. Fails on panics, on time and memory beyond the
/// bounds, and if no case was used or every case was.
pub fn fuzz(
    target: &str,
    few: usize,
    mut make: impl FnMut(&mut Random) -> Vec<u8>,
    mut read: impl FnMut(&[u8]) -> bool,
) {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| match FUZZING.get() {
            true => LAST.set(info.to_string().replace('\n', " ")),
            false => before(info),
        }));
    });
    let kept = |name: String| {
        std::env::temp_dir().join(format!("lenscube-fuzz-{}-{name}", target.replace(' ', "-")))
    };
    let long = asked().is_some();
    let current = kept(format!("current-{}", std::process::id()));
    let current = memory_folder().join(current.file_name().expect("a file's path"));
    let watch = long.then(|| Watchdog::start(target, current.clone()));
    let (total, start) = (cases(few), Instant::now());
    let mut r = Random(target.bytes().fold(1, |seed: u64, b| seed.wrapping_mul(31).wrapping_add(b.into())));
    let mut findings: BTreeMap<String, usize> = BTreeMap::new();
    let mut used = 0;
    for _ in 0..total {
        let case = make(&mut r);
        let outcome = match &watch {
            None => outcome(&case, &mut read),
            Some(watch) => {
                // What a case leaves that ends the process.
                std::fs::write(&current, &case).expect("the case is kept");
                watch.begin();
                bounded(&case, &mut read)
            }
        };
        match outcome {
            Outcome::Used(good) => used += usize::from(good),
            Outcome::Finding(what) => {
                let number = findings.len() + 1;
                let count = findings.entry(what).or_default();
                *count += 1;
                if *count == 1 {
                    std::fs::write(kept(number.to_string()), &case).expect("the case is kept");
                }
            }
        }
    }
    drop(watch);
    let _ = std::fs::remove_file(&current);
    print_row(target, total, start.elapsed().as_secs_f64(), findings.len(), used);
    assert!(findings.is_empty(), "{target}: {findings:#?}");
    assert!(used > 0 && used < total, "{target}: {used} of {total} cases passed, so nothing was tried");
    let peak = peak_memory();
    assert!(peak < PROCESS_MEMORY, "{target}: the process held {peak} bytes");
}

/// Where a file may be written for every case: in memory where the system has such a place.
pub fn memory_folder() -> PathBuf {
    let shared = PathBuf::from("/dev/shm");
    if shared.is_dir() { shared } else { std::env::temp_dir() }
}

/// Ends the process when a case does not end.
struct Watchdog(Arc<(AtomicU64, Instant)>);

impl Watchdog {
    fn start(target: &str, current: PathBuf) -> Self {
        let (target, state) = (target.to_owned(), Arc::new((AtomicU64::new(0), Instant::now())));
        let watched = Arc::downgrade(&state);
        std::thread::spawn(move || {
            while let Some(state) = watched.upgrade() {
                if state.1.elapsed().as_secs() > state.0.load(Ordering::Relaxed) + HANG {
                    eprintln!(
                        "{target}: a case has not ended after {HANG} s; its input: {}",
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
pub fn print_row(target: &str, cases: usize, seconds: f64, findings: usize, used: usize) {
    if asked().is_some() {
        let (used, peak) = (100.0 * used as f64 / cases as f64, peak_memory() >> 20);
        println!("\nFUZZ\t{target}\t{cases}\t{seconds:.1}\t{findings}\t{used:.1}\t{peak}");
    }
}

/// Largest resident memory of this process since the last reset; 0 where the system does not report it.
fn peak_memory() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    line.and_then(|l| l.split_whitespace().next()?.parse::<u64>().ok()).map_or(0, |kib| kib << 10)
}

/// The peak begins anew (Linux, proc(5)); elsewhere it is that of the whole process, and only new records count.
fn reset_peak_memory() {
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}
