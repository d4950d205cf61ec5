//! An emulated NVIDIA driver: a `libcuda.so.1` that g++ compiles from the C++ files in this folder and from the `.cu` files of the
//! project, which run thread by thread on the CPU (`cuda_cpu.h`). Stream order and injected faults are settings (`driver.h`,
//! `devices.cpp`).
//!
//! A process finds the library by `LD_LIBRARY_PATH`, so each [`Case`] runs in a child process: this test binary, with the name of the
//! case in [`CHILD`]. Without g++ or the sources these cases are reported as ignored. Cases without settings also run on the machine's
//! GPU, if it has one.
#![allow(dead_code, reason = "each test binary uses its part")]

use libtest_mimic::{Arguments, Failed, Trial};
use std::collections::hash_map::DefaultHasher;
use std::env;
use std::fs;
use std::hash::{Hash, Hasher};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Output};
use std::sync::{Mutex, OnceLock};

/// Environment variable of a child: the name of its case.
const CHILD: &str = "LENSCUBE_TEST_CASE";
/// With warnings: the kernels are compiled by two compilers.
const FLAGS: &str =
    "-std=c++17 -O2 -g1 -fPIC -march=native -Wall -Wextra -Wno-unused-variable -Wno-unknown-pragmas";
const SANITIZED: &str = "-fsanitize=address,undefined -fno-sanitize-recover=all";

/// Build options of the library.
#[derive(Clone, Copy, Debug, Default)]
pub struct Build {
    /// With AddressSanitizer and UBSan.
    pub sanitized: bool,
    /// `-D` flags for the kernels.
    pub defines: &'static str,
}

/// Default build.
pub const PLAIN: Build = Build { sanitized: false, defines: "" };
/// With sanitizers: an access beyond an allocation or beyond shared memory ends the process.
pub const SANITIZED_BUILD: Build = Build { sanitized: true, defines: "" };

/// Why a case is ignored; `scripts/check_summary.py` parses these texts.
pub const NO_COMPILER: &str = "no g++";
pub const LONG: &str = "long: scripts/check --full";
pub const A_DRIVER: &str = "a CUDA driver is installed";

/// A test in a separate process.
pub struct Case {
    pub name: String,
    pub run: fn(),
    pub target: Target,
    /// The child must fail at its check: with a mutated kernel, or with an access beyond memory.
    pub must_fail: bool,
    /// Runs only with `--ignored`.
    pub long: bool,
}

/// What a case runs on.
pub enum Target {
    /// The emulated driver with settings, names without `EMULATED_CUDA_`.
    Emulated(Build, &'static [(&'static str, &'static str)]),
    /// The machine's GPU.
    Device,
    /// A machine without a driver.
    NoDriver,
}

impl Case {
    pub fn emulated(name: &str, settings: &'static [(&'static str, &'static str)], run: fn()) -> Self {
        Self {
            name: format!("emulated::{name}"),
            run,
            target: Target::Emulated(PLAIN, settings),
            must_fail: false,
            long: false,
        }
    }

    pub fn device(name: &str, run: fn()) -> Self {
        Self { name: format!("device::{name}"), run, target: Target::Device, must_fail: false, long: false }
    }

    /// Why it cannot run here, if so.
    fn ignored(&self) -> Option<&'static str> {
        match self.target {
            Target::Emulated(..) if !has_compiler() => Some(NO_COMPILER),
            Target::Emulated(build, _) if build.sanitized && sanitizer().is_none() => {
                Some("g++ without AddressSanitizer")
            }
            Target::Device if !has_device() => Some("no GPU"),
            Target::NoDriver if has_driver() => Some(A_DRIVER),
            _ if self.long => Some(LONG),
            _ => None,
        }
    }

    fn execute(&self) -> Result<(), String> {
        let mut child = Command::new(env::current_exe().map_err(|e| e.to_string())?);
        child.env(CHILD, &self.name);
        if let Target::Emulated(build, settings) = self.target {
            for (name, value) in environment(build)?.into_iter().chain(self::settings(settings)) {
                child.env(name, value);
            }
        }
        let output = child.output().map_err(|e| e.to_string())?;
        let failed = !output.status.success();
        let report = report(&output);
        // A child that ends before its check has not failed it.
        let failed_at_check =
            ["panicked at", "ERROR: AddressSanitizer", "runtime error: "].iter().any(|s| report.contains(s));
        match (self.must_fail, failed) {
            (false, false) => Ok(()),
            (true, true) if failed_at_check => Ok(()),
            (true, false) => Err("it passes, but must fail".into()),
            _ => Err(report),
        }
    }
}

/// Runs each case in a child process; in the child, runs the case itself.
pub fn run(cases: Vec<Case>) -> ExitCode {
    if let Ok(name) = env::var(CHILD) {
        let case = cases.iter().find(|c| c.name == name).expect("the case of this process");
        if !case.must_fail || has_device() {
            (case.run)();
        }
        return ExitCode::SUCCESS;
    }
    let trials = cases.into_iter().map(|case| {
        let ignored = case.ignored();
        let name = case.name.clone();
        trial(name, ignored, move || Ok(case.execute()?))
    });
    libtest_mimic::run(&Arguments::from_args(), trials.collect()).exit_code()
}

/// A trial; if it cannot run it is reported as ignored, with the reason as its kind.
pub fn trial(
    name: String,
    ignored: Option<&'static str>,
    run: impl FnOnce() -> Result<(), Failed> + Send + 'static,
) -> Trial {
    Trial::test(name, run).with_kind(ignored.unwrap_or_default()).with_ignored_flag(ignored.is_some())
}

/// Environment in which a process loads the library, which is built if necessary.
pub fn environment(build: Build) -> Result<Vec<(String, String)>, String> {
    let place = library(build)?;
    let mut all = vec![("LD_LIBRARY_PATH".to_owned(), place.display().to_string())];
    if build.sanitized {
        let runtime = sanitizer().ok_or("g++ has no AddressSanitizer")?;
        all.push(("LD_PRELOAD".to_owned(), runtime));
        all.push(("ASAN_OPTIONS".to_owned(), "detect_leaks=0".to_owned()));
    }
    Ok(all)
}

/// Settings as environment variables.
pub fn settings(settings: &[(&str, &str)]) -> Vec<(String, String)> {
    settings.iter().map(|(name, value)| (format!("EMULATED_CUDA_{name}"), (*value).to_owned())).collect()
}

/// Exit status and output of a process.
fn report(output: &Output) -> String {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    format!("{}\n{}{}", output.status, text(&output.stdout), text(&output.stderr))
}

/// Whether g++ and the sources are present.
pub fn has_compiler() -> bool {
    static HERE: OnceLock<bool> = OnceLock::new();
    *HERE.get_or_init(|| {
        let runs = Command::new("g++").arg("--version").output().is_ok_and(|o| o.status.success());
        runs && sources().is_dir()
    })
}

/// Runtime of AddressSanitizer, which a process must load first.
fn sanitizer() -> Option<String> {
    let output = Command::new("g++").arg("-print-file-name=libasan.so").output().ok()?;
    let path = String::from_utf8(output.stdout).ok()?.trim().to_owned();
    Path::new(&path).is_absolute().then_some(path)
}

/// Whether this machine has a driver.
pub fn has_driver() -> bool {
    !matches!(lenscube_pipeline::cuda::devices(), Err(lenscube_pipeline::cuda::CudaError::NoDriver))
}

/// Whether this machine has a GPU.
fn has_device() -> bool {
    lenscube_pipeline::cuda::devices().is_ok()
}

/// `pipeline/`, from the tests of either package.
fn pipeline() -> PathBuf {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let within = here.join("pipeline");
    if within.is_dir() { within } else { here.to_owned() }
}

fn sources() -> PathBuf {
    pipeline().join("tests/emulated_cuda")
}

/// Directory of the library, which is built if necessary.
pub fn library(build: Build) -> Result<PathBuf, String> {
    let mut flags: Vec<String> = FLAGS.split(' ').map(str::to_owned).collect();
    if build.sanitized {
        flags.extend(SANITIZED.split(' ').map(str::to_owned));
    }
    // By one test thread at a time.
    static BUILDING: Mutex<()> = Mutex::new(());
    let _building = BUILDING.lock().map_err(|e| e.to_string())?;
    let place = Path::new(env!("CARGO_TARGET_TMPDIR")).join("emulated-cuda");
    fs::create_dir_all(&place).map_err(|e| format!("{}: {e}", place.display()))?;
    let headers = texts(&sources(), &["h"])?;
    let mut objects = Vec::new();
    for (source, _) in texts(&sources(), &["cpp"])? {
        objects.push(object(&place, &source, &headers, &flags)?);
    }
    let defined = build.defines.split_whitespace().map(str::to_owned);
    let kernel_flags: Vec<String> = flags.iter().cloned().chain(defined).collect();
    for (source, text) in kernels(&pipeline())? {
        let mut flags = kernel_flags.clone();
        flags.push(format!("-I{}", sources().display()));
        flags.extend(constants(&source, &text)?);
        let unit = unit(&place, &source, &text)?;
        let beside = texts(source.parent().expect("a file's folder"), &["cu", "cuh", "h"])?;
        objects.push(object(&place, &unit, &[&headers[..], &beside[..]].concat(), &flags)?);
    }
    let to = place.join(format!("{:016x}", digest(&(&objects, &flags))));
    let library = to.join("libcuda.so.1");
    if !library.exists() {
        fs::create_dir_all(&to).map_err(|e| format!("{}: {e}", to.display()))?;
        let linking =
            ["-shared", "-Wl,-soname,libcuda.so.1", "-Wl,-z,nodelete", "-pthread"].map(str::to_owned);
        let inputs = objects.iter().map(|o| o.display().to_string());
        compile(&library, flags.iter().cloned().chain(linking).chain(inputs))?;
    }
    Ok(to)
}

fn digest(of: &impl Hash) -> u64 {
    let mut hasher = DefaultHasher::new();
    of.hash(&mut hasher);
    hasher.finish()
}

type Texts = Vec<(PathBuf, String)>;

fn read(path: &Path) -> Result<String, String> {
    fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))
}

/// Files of a folder with one of these extensions, in order.
fn texts(folder: &Path, ends: &[&str]) -> Result<Texts, String> {
    let entries = fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let mut paths: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
    paths.retain(|p| p.extension().is_some_and(|e| ends.iter().any(|end| e == *end)));
    paths.sort();
    paths.into_iter().map(|p| Ok((p.clone(), read(&p)?))).collect()
}

/// All `.cu` files below a folder.
fn kernels(folder: &Path) -> Result<Texts, String> {
    let mut all = texts(folder, &["cu"])?;
    let entries = fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let mut folders: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
    folders.retain(|p| p.is_dir() && !p.ends_with("target"));
    folders.sort();
    for folder in folders {
        all.extend(kernels(&folder)?);
    }
    Ok(all)
}

/// Constants that a .cu takes from Rust by its line `// From cuda.rs: A, B`, as in `scripts/compile_kernels.py`.
fn constants(source: &Path, text: &str) -> Result<Vec<String>, String> {
    let mut flags = Vec::new();
    for line in text.lines() {
        let Some((file, names)) = line.strip_prefix("// From ").and_then(|l| l.split_once(".rs: ")) else {
            continue;
        };
        let rust = read(&source.with_file_name(format!("{file}.rs")))?;
        for name in names.split(',').map(str::trim) {
            let after =
                rust.split_once(&format!("const {name}: ")).and_then(|(_, rest)| rest.split_once(" = "));
            let value =
                after.and_then(|(_, rest)| rest.split_once(';')).map(|(value, _)| value.replace('_', ""));
            let value = value.ok_or_else(|| format!("{}: no const {name} in {file}.rs", source.display()))?;
            flags.push(format!("-D{name}={value}"));
        }
    }
    Ok(flags)
}

/// A C++ file that registers the kernels of a .cu: the entries of its PTX.
fn unit(place: &Path, source: &Path, text: &str) -> Result<PathBuf, String> {
    let name = source.with_extension("ptx");
    let ptx = pipeline().join("ptx").join(name.file_name().expect("a file's name"));
    let ptx = read(&ptx).map_err(|e| format!("{e}: run scripts/ptx"))?;
    let names = ptx.split(".entry ").skip(1).filter_map(|rest| rest.split('(').next()).map(str::trim);
    let mut unit = format!("#include \"cuda_cpu.h\"\n#include \"{}\"\n", source.display());
    unit.extend(names.map(|name| format!("EMULATE({name})\n")));
    let path = place.join(format!("{:016x}.cpp", digest(&(&unit, text))));
    write_once(&path, |at| fs::write(at, &unit).map_err(|e| e.to_string()))?;
    Ok(path)
}

/// Compiles a C++ file unless its object exists; the object's path.
fn object(
    place: &Path,
    source: &Path,
    with: &[(PathBuf, String)],
    flags: &[String],
) -> Result<PathBuf, String> {
    let path = place.join(format!("{:016x}.o", digest(&(read(source)?, with, flags))));
    let arguments = ["-c".to_owned(), source.display().to_string()];
    write_once(&path, |at| compile(at, flags.iter().cloned().chain(arguments)))?;
    Ok(path)
}

fn compile(to: &Path, arguments: impl Iterator<Item = String>) -> Result<(), String> {
    write_once(to, |at| {
        let output =
            Command::new("g++").args(arguments).arg("-o").arg(at).output().map_err(|e| e.to_string())?;
        if output.status.success() { Ok(()) } else { Err(format!("g++: {}", report(&output))) }
    })
}

/// Creates a file under a temporary name, then renames it: several test processes build at once.
fn write_once(path: &Path, make: impl FnOnce(&Path) -> Result<(), String>) -> Result<(), String> {
    if path.exists() {
        return Ok(());
    }
    let extension = path.extension().unwrap_or_default().to_string_lossy().into_owned();
    let aside = path.with_extension(format!("{}.{extension}", std::process::id()));
    make(&aside)?;
    fs::rename(&aside, path).map_err(|e| format!("{}: {e}", path.display()))
}
