"""Tests of check_summary.py: `python3 scripts/test_check_summary.py`. scripts/check runs them first."""
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


def every_ignored_test_and_skipped_step_is_listed_with_its_reason():
    assert missing_of(REPORT, LOG) == {
        "node is missing": ("check-view", False),
        "measurement: run alone": ("1 test: speed", True),
        "long: scripts/check --full": ("1 test: tables", True),
        "unavailable: no AVX-512": ("1 test: avx512::chain", True),
        "unavailable: no GPU": ("1 test: device::sum", True),
        "no g++": ("1 test: emulated::sum", False),
    }


def an_ignored_test_that_a_later_step_ran_was_checked():
    assert "long: scripts/check --full" not in missing_of(REPORT, LOG + "test tables ... ok\n")


def each_binary_has_its_seconds():
    assert list(c.binaries(LOG)) == [("lenscube_formats (src/lib.rs)", 1.25, 1), ("golden (tests/golden.rs)", 30.0, 1)]


def ci_fails_on_what_can_be_installed_and_only_on_that():
    code, out = run(REPORT, LOG)
    assert code == 0 and "check-view: node is missing" in out, out
    code, out = run(REPORT, LOG, ci=True)
    assert code == 1 and "node is missing  <- MUST RUN IN CI" in out and "no GPU  <-" not in out, out
    code, out = run("tests\tran\t1.0\t\n", LOG.replace("no g++", "no GPU"), ci=True)
    assert code == 0 and "unavailable: no GPU" in out, out


def a_failed_step_fails():
    code, out = run("tests\tfailed\t3.0\texit code 101\n", "")
    assert code == 1 and "failed: exit code 101" in out and "every step after it: tests failed" in out, out


def only_a_full_run_on_a_machine_with_everything_says_so():
    whole = "tests\tran\t1.0\t\n"
    assert "everything was checked" in run(whole, "test a ... ok\n", full=True)[1]
    assert "not checked" in run(whole, "test a ... ok\n")[1]


for name, test in list(globals().items()):
    if callable(test) and name not in ("run", "missing_of") and not isinstance(test, type):
        test()
print("check_summary.py: tests passed")
