//! Damaged and invented input for the doors: any answer but a panic or a heap of memory is right.
//!
//! Normal test runs take a few hundred cases; `LENSCUBE_FUZZ_CASES` raises the number and prints one line a door
//! (`scripts/fuzz` makes a table of them). Seeds are fixed, so a finding is found again; its input goes to the temp folder.
#![allow(missing_docs, dead_code, reason = "shared by tests that each use a part")]

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Once;
use std::time::Instant;

/// The whole test process may hold this much at its worst.
const MOST_MEMORY: u64 = 2 << 30;

/// Cases of a door: `few` unless the environment says more.
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

/// Feeds `make`'s cases to `eat`, which tells whether it could use them. Fails on panics, on memory, and if nothing passes.
pub fn fuzz(
    door: &str,
    few: usize,
    mut make: impl FnMut(&mut Random) -> Vec<u8>,
    mut eat: impl FnMut(&[u8]) -> bool,
) {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| match FUZZING.get() {
            true => LAST.set(info.to_string().replace('\n', " ")),
            false => before(info),
        }));
    });
    let (total, start) = (cases(few), Instant::now());
    let mut r = Random(door.bytes().fold(1, |seed: u64, b| seed.wrapping_mul(31).wrapping_add(b.into())));
    let mut findings: BTreeMap<String, usize> = BTreeMap::new();
    let mut used = 0;
    for _ in 0..total {
        let case = make(&mut r);
        FUZZING.set(true);
        let result = catch_unwind(AssertUnwindSafe(|| eat(&case)));
        FUZZING.set(false);
        match result {
            Ok(good) => used += usize::from(good),
            Err(_) => {
                let place = LAST.take();
                let count = findings.entry(place).or_default();
                *count += 1;
                if *count == 1 {
                    let path = std::env::temp_dir().join(format!("lenscube-fuzz-{door}-{}", findings.len()));
                    std::fs::write(path, &case).expect("the case is kept");
                }
            }
        }
    }
    tell(door, total, start.elapsed().as_secs_f64(), findings.len(), used);
    assert!(findings.is_empty(), "{door}: {findings:#?}");
    assert!(used > 0 && used < total, "{door}: {used} of {total} cases passed, so nothing was tried");
    let peak = peak_memory();
    assert!(peak < MOST_MEMORY, "{door}: the process held {peak} bytes");
}

/// One line for `scripts/fuzz`.
pub fn tell(door: &str, cases: usize, seconds: f64, findings: usize, used: usize) {
    if asked().is_some() {
        let (used, peak) = (100.0 * used as f64 / cases as f64, peak_memory() >> 20);
        println!("\nFUZZ\t{door}\t{cases}\t{seconds:.1}\t{findings}\t{used:.1}\t{peak}");
    }
}

/// Most memory this process ever held; 0 where the system does not tell.
fn peak_memory() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    line.and_then(|l| l.split_whitespace().next()?.parse::<u64>().ok()).map_or(0, |kib| kib << 10)
}

/// Flips bits, sets bytes, cuts, repeats a piece.
pub fn damage(bytes: &mut Vec<u8>, r: &mut Random) {
    for _ in 0..=r.below(3) {
        let at = r.below(bytes.len());
        match r.below(8) {
            0 => bytes.truncate(at),
            1 if at < bytes.len() => {
                let end = at + r.below(256).min(bytes.len() - at);
                let piece = bytes[at..end].to_vec();
                bytes.extend(piece);
            }
            2 if at < bytes.len() => bytes[at] = [0, 0xFF, 0x7F, 0x80][r.below(4)],
            _ if at < bytes.len() => bytes[at] ^= 1 << r.below(8),
            _ => {}
        }
    }
}

/// Words that have broken parsers before.
const WORDS: [&str; 40] = [
    "nan",
    "inf",
    "-inf",
    "-nan(ind)",
    "1e999",
    "-1e999",
    "1e-320",
    "-1",
    "0",
    "-0",
    "1",
    "0.5",
    "2147483648",
    "4294967296",
    "1000000000000000000",
    "18446744073709551615",
    "18446744073709551616",
    "1e18",
    "1e300",
    "1e-300",
    "1,5",
    "1.5,2",
    ",",
    ";",
    "=",
    ":",
    "'",
    "[",
    "]",
    "(",
    ")",
    "%",
    "\n",
    "\r\n",
    "\t",
    " ",
    "µ",
    "\0",
    "\u{feff}",
    "#",
];

/// Changes words and lines of a text, and now and then its bytes.
pub fn damage_text(bytes: &mut Vec<u8>, r: &mut Random) {
    for _ in 0..=r.below(3) {
        match r.below(8) {
            0 => damage(bytes, r),
            1 | 2 => {
                let at = r.below(bytes.len() + 1);
                bytes.splice(at..at, r.one(&WORDS).bytes());
            }
            3 => {
                let line = line(bytes, r);
                bytes.drain(line);
            }
            4 => {
                let (from, to) = (line(bytes, r), line(bytes, r).start);
                let copy = bytes[from].to_vec();
                bytes.splice(to..to, copy);
            }
            _ => {
                let at = r.below(bytes.len());
                let blank = |b: &u8| b.is_ascii_whitespace() || b"=,:;&?\"".contains(b);
                let start = bytes[..at.min(bytes.len())].iter().rposition(blank).map_or(0, |i| i + 1);
                let end = bytes[start..].iter().position(blank).map_or(bytes.len(), |i| start + i);
                bytes.splice(start..end, r.one(&WORDS).bytes());
            }
        }
    }
}

fn line(bytes: &[u8], r: &mut Random) -> std::ops::Range<usize> {
    let at = r.below(bytes.len());
    let start = bytes[..at].iter().rposition(|b| *b == b'\n').map_or(0, |i| i + 1);
    let end = bytes[start..].iter().position(|b| *b == b'\n').map_or(bytes.len(), |i| start + i + 1);
    start..end
}
