"""Prints a summary of scripts/check: seconds of each step and test binary, and all skipped checks with the reason.

    python3 check_summary.py REPORT LOG [--ci] [--full]

REPORT is the file of scripts/report.sh, LOG the output of `cargo test`. Exit code 1 with --ci if a required check was skipped: all
are required except those with unavailable hardware (a GPU, an instruction set), the tests of --full, and measurements.
"""
import re
import sys
from collections import namedtuple

Missing = namedtuple("Missing", "what reason allowed")

ISA = {"avx512": "no AVX-512", "avx2": "no AVX2 with FMA"}
HARDWARE = {"no GPU", "a CUDA driver is installed", "one instruction set", "every instruction set is there"}


def steps(report):
    """(step, state, seconds or None, reason) of each line."""
    for line in report.splitlines():
        name, state, seconds, reason = line.split("\t")
        yield name, state, float(seconds) if seconds else None, reason


def binaries(log):
    """(test binary, seconds, number of tests) in the order of the log, which contains stdout and stderr."""
    name = "?"
    for line in log.splitlines():
        if found := re.match(r"\s+Running (?:unittests )?(\S+) \((?:\S*/)?(\S+?)-[0-9a-f]{16}(?:\.exe)?\)", line):
            name = f"{found[2]} ({found[1]})"
        elif found := re.match(r"\s+Doc-tests (\S+)", line):
            name = f"doc tests ({found[1]})"
        elif found := re.match(r"test result: \S+ (\d+) passed; (\d+) failed; .*finished in ([\d.]+)s", line):
            yield name, float(found[3]), int(found[1]) + int(found[2])
            name = "?"


def ignored(log):
    """(test, reason) of each ignored test."""
    for line in log.splitlines():
        found = re.match(r"test (?:\[([^\]]*)\] )?(.+?)\s+\.\.\. ignored(?:, (.*))?$", line)
        if not found:
            continue
        kind, name, reason = found.groups()
        isa = name.split("::")[0]
        if isa in ISA:
            reason = f"unavailable: {ISA[isa]}"
        yield name, reason or (f"unavailable: {kind}" if kind in HARDWARE else kind) or "no reason given"


def passed(log):
    return set(re.findall(r"^test (?:\[[^\]]*\] )?(.+?)\s+\.\.\. ok$", log, re.MULTILINE))


def missing(report, log):
    """All checks that did not run."""
    found = []
    for name, state, _, reason in steps(report):
        if state == "skipped":
            found.append(Missing(name, reason, reason.startswith("unavailable: ")))
        elif state == "failed":
            found.append(Missing("every step after it", f"{name} failed", False))
    passed_later = passed(log)
    by_reason = {}
    for test, reason in ignored(log):
        if test not in passed_later:
            by_reason.setdefault(reason, []).append(test)
    for reason, tests in by_reason.items():
        allowed = reason.startswith(("unavailable: ", "long: ", "measurement: "))
        shown = ", ".join(tests[:3]) + (f" and {len(tests) - 3} more" if len(tests) > 3 else "")
        found.append(Missing(f"{len(tests)} test{'s' * (len(tests) > 1)}: {shown}", reason, allowed))
    return found


def main(report, log, ci, full):
    done = [s for s in steps(report) if s[1] != "skipped"]
    print("== seconds of each test binary")
    for name, seconds, count in sorted(binaries(log), key=lambda b: -b[1]):
        print(f"{seconds:8.1f}  {name}, {count} tests")
    print("== seconds of each step")
    for name, state, seconds, reason in done:
        print(f"{seconds:8.1f}  {name}" + (f"  {state}: {reason}" if state != "ran" else ""))
    print(f"{sum(s[2] for s in done):8.1f}  in all")
    skipped = missing(report, log)
    if not full:
        skipped.append(Missing("regenerated golden data, 200 kills, longer fuzzing, advisories, the oldest Rust", "long: scripts/check --full", True))
    print("== not checked" if skipped else "== everything was checked")
    for item in skipped:
        print(f"  {item.what}: {item.reason}" + ("" if item.allowed or not ci else "  <- MUST RUN IN CI"))
    if any(s[1] == "failed" for s in done):
        print("== FAILED")
        return 1
    if ci and not all(item.allowed for item in skipped):
        print("== FAILED: what must run in CI did not")
        return 1
    print(f"== all {len(done)} steps that ran passed; {len(skipped)} entries under \"not checked\"")
    return 0


if __name__ == "__main__":
    report_path, log_path, *options = sys.argv[1:]
    texts = [open(p, errors="replace").read() for p in (report_path, log_path)]
    sys.exit(main(*texts, "--ci" in options, "--full" in options))
