//! `scripts/gpu-check` on an emulated GPU, with tests of a pack and tools of the CUDA toolkit that are shell scripts.

use super::*;
use std::os::unix::fs::{PermissionsExt, symlink};

/// Tests that pass, as their binary prints it.
const PASSING: &str = "printf 'running 2 tests\\n\\ntest result: ok. 2 passed; 0 failed; 0 ignored; 0 measured; 9 filtered out\\n\\n'";
/// Tests without a GPU.
const IGNORED: &str = "printf 'running 2 tests\\n\\ntest result: ok. 0 passed; 0 failed; 2 ignored; 0 measured; 9 filtered out\\n\\n'";
/// `compute-sanitizer` and `ncu`: every option has a value.
const TOOL: &str =
    "while [[ $1 == --* ]]; do shift 2; done\n\"$@\" && echo '========= ERROR SUMMARY: 0 errors'";

/// A pack of the script with one test, and a folder for its output.
struct Pack(tempfile::TempDir);

impl Pack {
    fn new(test: &str) -> Self {
        let pack = Self(tempfile::tempdir().unwrap());
        for folder in ["tests", "tools", "work"] {
            std::fs::create_dir(pack.at(folder)).unwrap();
        }
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/gpu-check");
        std::fs::copy(script, pack.at("gpu-check")).unwrap();
        for (path, text) in [("tests/cuda_psf", test), ("tools/compute-sanitizer", TOOL), ("tools/ncu", TOOL)]
        {
            std::fs::write(pack.at(path), format!("#!/usr/bin/env bash\n{text}\n")).unwrap();
            std::fs::set_permissions(pack.at(path), PermissionsExt::from_mode(0o755)).unwrap();
        }
        pack
    }

    fn at(&self, path: &str) -> PathBuf {
        self.0.path().join(path)
    }

    /// Runs steps with settings of the script, its tools first in the search path.
    fn check(&self, steps: &str, settings: Settings<'_>, emulated: Settings<'_>) -> CommandResult {
        let path = std::env::var("PATH").unwrap();
        self.check_with(&format!("{}:{path}", self.at("tools").display()), steps, settings, emulated)
    }

    fn check_with(
        &self,
        path: &str,
        steps: &str,
        settings: Settings<'_>,
        emulated: Settings<'_>,
    ) -> CommandResult {
        let mut command = Command::new(self.at("gpu-check"));
        command.arg(self.at("out")).env("LENSCUBE", env!("CARGO_BIN_EXE_lenscube"));
        command.env("TMPDIR", self.at("work")).env("PATH", path);
        command.envs(emulated_cuda::environment(PLAIN).unwrap()).envs(emulated_cuda::settings(emulated));
        let all = [
            ("SIZE", "600"),
            // Shards are finished band by band: the run is killed after one of them.
            ("BANDS", "3"),
            ("ROI", "64"),
            ("LENS", "double-gauss-28-npz"),
            ("FLAGS", "--shard 128 --chunk 64"),
            ("STEPS", steps),
        ];
        for (name, value) in all.iter().chain(settings) {
            command.env(format!("GPU_CHECK_{name}"), value);
        }
        let ran = CommandResult::new(&command.output().unwrap());
        assert!(self.at("out/gpu-check.tar.gz").metadata().unwrap().len() > 200, "{}", ran.stdout);
        assert_eq!(std::fs::read_dir(self.at("work")).unwrap().count(), 0, "files remain");
        ran
    }

    /// Records of the runs, from the archive.
    fn records(&self) -> Vec<Value> {
        let files = self.at("files");
        std::fs::create_dir(&files).unwrap();
        let mut tar = Command::new("tar");
        assert!(
            tar.arg("-xzf")
                .arg(self.at("out/gpu-check.tar.gz"))
                .arg("-C")
                .arg(&files)
                .status()
                .unwrap()
                .success()
        );
        let all = std::fs::read_dir(files).unwrap().map(|entry| entry.unwrap().path());
        let records = all.filter(|path| text(path).ends_with(".json"));
        records.map(|path| serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()).collect()
    }
}

/// The row of the final table that begins with `name`.
fn row<'a>(ran: &'a CommandResult, name: &str) -> &'a str {
    let rows = ran.stdout.lines().rev().find(|line| line.starts_with(name));
    rows.unwrap_or_else(|| panic!("no row {name}: {}{}", ran.stdout, ran.stderr))
}

/// Names of the kernels in the program.
fn kernels() -> Vec<&'static str> {
    use lenscube_pipeline::cuda::ptx::{OVERLAP_ADD, PSF, REMAP};
    let of = |text: &'static str| text.split(".entry ").skip(1).filter_map(|rest| rest.split('(').next());
    [&REMAP, &PSF, &OVERLAP_ADD].into_iter().flat_map(|kernels| of(kernels.ptx)).collect()
}

/// All steps; the benchmark, too slow on an emulated GPU, with kernels and copies that do nothing.
pub fn gpu_check_script_passes_its_steps() {
    let pack = Pack::new(PASSING);
    let passes = |ran: &CommandResult, rows: &[(&str, &str)]| {
        assert_exit(ran, 0, &[]);
        for (name, expected) in rows {
            let row = row(ran, name);
            assert!(row.contains(expected) && !row.contains("FAILED"), "{row}: {}", ran.stdout);
        }
    };
    // What a command left that was killed is removed.
    std::fs::create_dir(pack.at("work/gpu-check.4194305.abcdef")).unwrap();
    let rows = [
        ("2 tests of cuda_psf", "ok. 2 passed"),
        ("3 regions, scale 0.7", "of the peak"),
        ("4 full job, cuda:0,0", "ms a band"),
        ("5 SIGKILL at 40 % and resume", "the same bytes"),
    ];
    passes(&pack.check("2 3 4 5", &[], &[]), &rows);
    passes(&pack.check("6", &[], &[("WORK", "none")]), &[("6 bench", "Gpx/s")]);
    // A traced lens, whose windows need transforms of both sides; the caller's limit on memory.
    let traced: Settings<'_> =
        &[("LENS", "double-gauss-28"), ("FLAGS", "--shard 128 --chunk 64 --memory 2GiB")];
    let ran = pack.check("1 7 8 9", traced, &[]);
    let rows = [
        ("1 loading of the kernels", "warm: 0 cubins, 3 of PTX"),
        ("1 registers, local memory", "spilled: nothing"),
        ("7 memcheck, a run on three queues", "SUMMARY: 0 errors"),
        ("7 memcheck, cuda_psf", "SUMMARY: 0 errors"),
        ("8 ncu, mean", ""),
        ("9 initcheck", "SUMMARY: 0 errors"),
    ];
    passes(&ran, &rows);
    for kernel in kernels() {
        assert!(ran.stdout.contains(&format!("\n{kernel} {{")), "{kernel} is not used: {}", ran.stdout);
    }
    let on_three_queues = |record: &Value| record["devices"].as_array().is_some_and(|all| all.len() == 3);
    let record = pack.records().into_iter().find(on_three_queues).expect("a run on three queues");
    let queues = record["devices"].as_array().unwrap();
    assert!(queues.iter().any(|queue| queue["did"]["batches"].as_u64() > Some(1)), "{record}");
    for side in ["psf_scatter_128", "psf_scatter_256"] {
        assert!(queues.iter().any(|queue| queue["kernels"]["threads"][side].is_object()), "{side}: {record}");
    }
}

/// Failures have their row and exit code 1.
pub fn gpu_check_script_reports_failures() {
    // A machine without python3, whose GPU the tests do not find.
    let pack = Pack::new(IGNORED);
    for folder in std::env::split_paths(&std::env::var("PATH").unwrap()) {
        for entry in std::fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap()) {
            if !entry.file_name().to_string_lossy().starts_with("python") {
                let _ = symlink(entry.path(), pack.at("tools").join(entry.file_name())); // the first of a name
            }
        }
    }
    let ran = pack.check_with(text(&pack.at("tools")), "1 2 3", &[], &[]);
    assert_exit(&ran, FAILED, &[]);
    assert!(row(&ran, "2 tests of cuda_psf").contains("FAILED (1): expected: test result"), "{}", ran.stdout);
    for step in ["1 kernels", "3 regions"] {
        assert!(row(&ran, step).contains("not available: python3"), "{}", ran.stdout);
    }
    // The row of a job has its error.
    let ran = pack.check("4", &[("LENS", "no-such-lens")], &[]);
    assert_exit(&ran, FAILED, &[]);
    let job = row(&ran, "4 full job, cpu");
    assert!(job.contains("FAILED (2)") && job.contains("no-such-lens"), "{job}");
    // A test that does not end at SIGTERM is killed.
    let pack = Pack::new("trap '' TERM\necho $$ >\"$TMPDIR/../pid\"\nexec sleep 600");
    let ran = pack.check("2", &[("SECONDS", "12")], &[]);
    assert_exit(&ran, FAILED, &[]);
    assert!(row(&ran, "2 tests of cuda_psf").contains("FAILED: not finished after"), "{}", ran.stdout);
    assert!(row(&ran, "2 lenscube device check").contains("not run"), "{}", ran.stdout);
    let pid = std::fs::read_to_string(pack.at("pid")).unwrap();
    let command = std::fs::read(format!("/proc/{}/cmdline", pid.trim())).unwrap_or_default();
    assert!(command.is_empty(), "it still runs");
}
