"""Tests of check_summary.py: `python3 scripts/test_check_summary.py`, the first step of scripts/check."""
import contextlib
import io

import check_summary as c

LOG = """     Running unittests src/lib.rs (target/debug/deps/lenscube_formats-0123456789abcdef)
test a::b ... ok
test speed ... ignored, measurement: run alone
test tables ... ignored, long: scripts/check --full
test result: ok. 1 passed; 0 failed; 2 ignored; 0 measured; 0 filtered out; finished in 1.25s
     Running tests/golden.rs (/somewhere/target/debug/deps/golden-fedcba9876543210)
test avx512::chain   ... ignored
test avx2::chain     ... ok
test [no GPU] device::sum ... ignored
test [no g++] emulated::sum ... ignored
test result: ok. 1 passed; 0 failed; 3 ignored; 0 measured; 0 filtered out; finished in 30.00s
"""
REPORT = "tests\tran\t40.5\t\ncheck-view\tskipped\t\tnode is missing\n"


def run(report, log, ci=False, full=False):
    with contextlib.redirect_stdout(io.StringIO()) as out:
        code = c.main(report, log, ci, full)
    return code, out.getvalue()


def missing_of(report, log):
    return {m.reason: (m.what, m.allowed) for m in c.missing(report, log)}


def ignored_tests_and_skipped_steps_are_listed_with_reason():
    assert missing_of(REPORT, LOG) == {
        "node is missing": ("check-view", False),
        "measurement: run alone": ("1 test: speed", True),
        "long: scripts/check --full": ("1 test: tables", True),
        "unavailable: no AVX-512": ("1 test: avx512::chain", True),
        "unavailable: no GPU": ("1 test: device::sum", True),
        "no g++": ("1 test: emulated::sum", False),
    }


def ignored_test_that_passes_in_a_later_step_is_not_listed():
    assert "long: scripts/check --full" not in missing_of(REPORT, LOG + "test tables ... ok\n")


def test_binaries_have_their_seconds():
    assert list(c.binaries(LOG)) == [("lenscube_formats (src/lib.rs)", 1.25, 1), ("golden (tests/golden.rs)", 30.0, 1)]


def ci_fails_on_skipped_checks_that_are_not_unavailable():
    code, out = run(REPORT, LOG)
    assert code == 0 and "check-view: node is missing" in out, out
    code, out = run(REPORT, LOG, ci=True)
    assert code == 1 and "node is missing  <- MUST RUN IN CI" in out and "no GPU  <-" not in out, out
    code, out = run("tests\tran\t1.0\t\n", LOG.replace("no g++", "no GPU"), ci=True)
    assert code == 0 and "unavailable: no GPU" in out, out


def failed_step_exits_1_and_prints_its_exit_code():
    code, out = run("tests\tfailed\t3.0\texit code 101\n", "")
    assert code == 1 and "failed: exit code 101" in out and "every step after it: tests failed" in out, out


def everything_was_checked_is_printed_only_after_a_full_run():
    report = "tests\tran\t1.0\t\n"
    assert "everything was checked" in run(report, "test a ... ok\n", full=True)[1]
    assert "not checked" in run(report, "test a ... ok\n")[1]


for name, test in list(globals().items()):
    if callable(test) and name not in ("run", "missing_of") and not isinstance(test, type):
        test()
print("check_summary.py: tests passed")
