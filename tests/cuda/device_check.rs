//! `lenscube device`: films of a GPU compared with the CPU's, and the stored verdicts, each of one card.

use super::*;
use emulated_cuda::Build;

/// A driver whose kernels lack a barrier, so that films are wrong.
const WRONG_KERNELS: Build = Build { sanitized: false, defines: "-DWITHOUT=3" };
/// A driver whose kernels read pixels that they did not store, so that films have NaN.
const NAN_KERNELS: Build = Build { sanitized: false, defines: "-DWITHOUT=2" };
/// Two cards of one name.
const TWO: Settings<'_> = &[("DEVICES", "2")];
/// The same cards with their numbers exchanged.
const EXCHANGED: Settings<'_> = &[("DEVICES", "2"), ("UUID", "2,1")];
const CHART: &str = "gen:siemens?size=256&wavelengths=550";

/// A command with a cache of its own.
struct Machine(tempfile::TempDir);

impl Machine {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn lenscube(&self, build: Build, settings: Settings<'_>, arguments: &[&str]) -> CommandResult {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(arguments).env("XDG_CACHE_HOME", self.0.path());
        command.envs(emulated_cuda::environment(build).unwrap()).envs(emulated_cuda::settings(settings));
        CommandResult::new(&command.output().unwrap())
    }

    /// The lines of `device list` on GPUs.
    fn gpus(&self, settings: Settings<'_>) -> Vec<String> {
        let listed = self.lenscube(PLAIN, settings, &["device", "list"]);
        listed.stdout.lines().filter(|line| line.starts_with("cuda:")).map(str::to_owned).collect()
    }

    /// A film with `--device auto`.
    fn run(&self, settings: Settings<'_>) -> CommandResult {
        let film = self.0.path().join("film.zarr");
        let flags = ["run", CHART, text(&film), "--overwrite", "--stages", "ri", "--no-fsync", "-v"];
        self.lenscube(PLAIN, settings, &flags)
    }
}

pub fn device_check_compares_films_and_auto_reports_unchecked_gpus() {
    let machine = Machine::new();
    let listed = machine.gpus(&[]);
    assert!(listed[0].contains("Emulated GPU 8.0") && listed[0].contains("not compared"), "{listed:?}");
    assert_exit(&machine.run(&[]), 0, &["have not been compared with the CPU's", "lenscube device check"]);
    let checked = machine.lenscube(PLAIN, &[], &["device", "check"]);
    assert_exit(&checked, 0, &[]);
    assert!(checked.stdout.contains("passed (tolerance 2e-6)"), "{}", checked.stdout);
    assert_eq!(checked.stdout.matches("largest difference").count(), 6, "{}", checked.stdout);
    assert!(machine.gpus(&[])[0].contains("equal to the CPU"));
    let ran = machine.run(&[]);
    assert!(ran.code == 0 && !ran.stderr.contains("device check"), "{}", ran.stderr);
    let check =
        |settings, device| machine.lenscube(PLAIN, settings, &["device", "check", "--device", device]);
    assert_exit(&check(&[], "cuda:3"), USAGE, &["GPU 3", "lenscube device list"]);
    assert_exit(&check(&[("FAULTS", "kernel:0:3")], "cuda"), FAILED, &["a kernel failed"]);
    let with_nan = machine.lenscube(NAN_KERNELS, &[], &["device", "check"]);
    assert_exit(&with_nan, WRONG, &[]);
    assert!(
        with_nan.stdout.contains("NaN at row") && with_nan.stdout.contains("FAILED"),
        "{}",
        with_nan.stdout
    );
    assert!(machine.gpus(&[])[0].contains("DIFFERENT"));
}

pub fn verdict_of_a_card_does_not_hold_for_another_of_its_name() {
    let machine = Machine::new();
    let verdicts = |settings| {
        let of = |line: &String| line.rsplit("; ").next().unwrap().split(' ').next().unwrap().to_owned();
        machine.gpus(settings).iter().map(of).collect::<Vec<_>>()
    };
    let check = |build, device| machine.lenscube(build, TWO, &["device", "check", "--device", device]);
    let failed = check(WRONG_KERNELS, "cuda:0");
    assert_exit(&failed, WRONG, &[]);
    assert!(failed.stdout.contains("cuda:0 (Emulated GPU 8.0): FAILED"), "{}", failed.stdout);
    assert_eq!(verdicts(TWO), ["DIFFERENT", "not"]);
    let used = ["note: device: GPU 1 (", "not used", "on GPU 0", "films of GPU 1"];
    assert_exit(&machine.run(TWO), 0, &used);
    // The card that passes comes second: the failure of the first one remains.
    assert_exit(&check(PLAIN, "cuda:1"), 0, &[]);
    assert_eq!(verdicts(TWO), ["DIFFERENT", "equal"]);
    assert_exit(&machine.run(TWO), 0, &used[..3]);
    // A verdict belongs to the card, not to its number.
    assert_eq!(verdicts(EXCHANGED), ["equal", "DIFFERENT"]);
    assert_exit(&machine.run(EXCHANGED), 0, &["device: GPU 0 (", "not used", "on GPU 1"]);
    assert_eq!(verdicts(&[("UUID", "9")]), ["not"]);
    // Without another GPU the CPU computes.
    assert_exit(&machine.run(&[]), 0, &["device: cpu (", "found other films", "on GPU 0"]);
}
