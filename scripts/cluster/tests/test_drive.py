"""The driver with real workers of Dask on this machine and a stand-in for lenscube."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from distributed import LocalCluster

from lenscube_dask import main

PACKAGE = str(Path(__file__).parent.parent)


@pytest.fixture(scope="module")
def cluster():
    """Two workers that never saw this package: what they need comes to them."""
    with LocalCluster(2, threads_per_worker=1, dashboard_address=":0", resources={"GPU": 1}) as made:
        yield made


def driver(job, fake, *words, **more):
    """The driver as a user starts it."""
    argv = [sys.executable, "-m", "lenscube_dask.main", str(job.plan), "--lenscube", fake, "--retry-pause", "0.1", *words]
    env = dict(os.environ, PYTHONPATH=f"{PACKAGE}:{os.environ.get('PYTHONPATH', '')}")
    return subprocess.Popen(argv, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **more)


@pytest.fixture
def drive(fake, cluster, monkeypatch, capsys):
    """The driver in this process, which has imported Dask already: exit code and words."""

    def call(job, *words):
        argv = ["lenscube-dask", str(job.plan), "--scheduler", cluster.scheduler_address, "--lenscube", fake]
        monkeypatch.setattr(sys, "argv", [*argv, "--retry-pause", "0.1", *words])
        code = main.main()
        return code, capsys.readouterr().err

    return call


def until(true, seconds=60):
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.05)


def test_every_unit_is_done_once(job, drive):
    job = job(12)
    code, told = drive(job)
    assert (code, job.done()) == (0, 12), told
    assert [job.tries(n) for n in range(12)] == [1] * 12
    assert "complete, 12 units" in told


def test_only_what_is_missing_is_done(job, drive, tmp_path):
    job = job(6)
    for unit in (0, 1, 4):
        (job.film / "done" / str(unit)).touch()
    log = tmp_path / "log.jsonl"
    code, told = drive(job, "--log", str(log))
    assert (code, job.done()) == (0, 6), told
    assert [job.tries(n) for n in range(6)] == [0, 0, 1, 1, 0, 1]
    events = [json.loads(line) for line in log.read_text().splitlines()]
    assert sorted(e["unit"] for e in events if e["event"] == "start") == [2, 3, 5]
    code, told = drive(job)
    assert code == 0 and "complete" in told and job.tries(2) == 1


def test_what_is_worth_a_retry_is_retried(job, drive):
    job = job(4, {"1": {"code": 75, "times": 2, "message": "store unreachable"}, "2": {"code": -9, "times": 1}})
    code, told = drive(job)
    assert (code, job.done(), job.tries(1), job.tries(2)) == (0, 4, 3, 2), told
    assert "store unreachable" in told and "killed by signal 9" in told


def test_retries_end(job, drive):
    job = job(2, {"1": {"code": 75}})
    code, told = drive(job, "--retries", "2")
    assert (code, job.tries(1)) == (75, 3), told
    assert "go on with" in told


@pytest.mark.parametrize("wrong, words", [(1, "no such lens"), (2, "words of the parser"), (3, "no such lens")])
def test_a_failure_for_good_stops_all(job, drive, wrong, words):
    fakes = {"0": {"code": wrong, "message": "no such lens"}, "1": {"seconds": 60}}
    job = job(40, fakes)
    start = time.monotonic()
    code, told = drive(job)
    assert code == wrong and words in told and "unit 0 failed" in told, told
    assert job.tries(0) == 1 and job.done() < 40 and time.monotonic() - start < 40


def test_a_program_that_is_not_there_is_told(job, drive):
    code, told = drive(job(3), "--worker-lenscube", "/none/lenscube")
    assert code == 1 and "starting /none/lenscube: No such file" in told, told


def test_a_gpu_a_unit(job, drive):
    job = job(4)
    code, told = drive(job, "--gpu")
    assert (code, job.done()) == (0, 4), told


def test_interrupted_it_ends_its_units_and_says_how_to_go_on(job, fake):
    job = job(8, {str(n): {"seconds": 120} for n in range(8)})
    run = driver(job, fake, "--local", "2", start_new_session=True)
    until(lambda: job.tries(0) and job.tries(1))
    os.killpg(run.pid, signal.SIGINT)  # as a terminal sends it
    _, told = run.communicate(timeout=60)
    assert run.returncode == 130 and "Go on with: " in told, told
    assert "Traceback" not in told and "gave no answer" not in told, told
    assert not running(job)


def test_a_driver_that_is_killed_leaves_nothing_running(job, fake):
    job = job(4, {str(n): {"seconds": 120} for n in range(4)})
    run = driver(job, fake, "--local", "2")
    until(lambda: job.tries(0) and job.tries(1))
    run.kill()
    run.communicate()
    until(lambda: not running(job), 30)


def running(job) -> list[str]:
    """Stand-ins that still have this job's film open for tries: told by the plan they were given."""
    found = subprocess.run(["ps", "-eo", "pid,args"], capture_output=True, text=True).stdout.splitlines()
    mine = [line for line in found if "fake_lenscube.py run" in line]
    return [line for line in mine if plan_of(line) == str(job.film)]


def plan_of(line: str) -> str:
    words = line.split()
    try:
        return json.loads(Path(words[words.index("--plan") + 1]).read_text())["command"]["film"]
    except (OSError, ValueError):
        return "gone with its worker"


def test_a_worker_that_is_killed_loses_only_its_unit(job, fake, cluster):
    job = job(12, {str(n): {"seconds": 0.2} for n in range(12)})
    run = driver(job, fake, "--scheduler", cluster.scheduler_address)
    until(lambda: job.done() >= 4)
    victim = next(iter(cluster.workers.values())).pid
    os.kill(victim, signal.SIGKILL)
    _, told = run.communicate(timeout=120)
    tries = [job.tries(n) for n in range(12)]
    assert (run.returncode, job.done()) == (0, 12), told
    assert sum(tries) <= 13, tries


def test_many_units_need_little_memory(tmp_path, cluster):
    """LENSCUBE_DASK_UNITS=10000 for the figure that is kept; a shell script stands in, to start fast."""
    units = int(os.environ.get("LENSCUBE_DASK_UNITS", "100"))
    from conftest import Job

    job = Job(tmp_path, units)
    script = tmp_path / "lenscube"
    script.write_text(FAST.replace("FILM", str(job.film)).replace("LAST", str(units - 1)))
    script.chmod(0o755)
    start = time.monotonic()
    run = driver(job, str(script), "--scheduler", cluster.scheduler_address)
    peak = 0
    while run.poll() is None:
        peak = max(peak, resident(run.pid) or 0)
        time.sleep(0.1)
    told = run.communicate()[1]
    assert (run.returncode, job.done()) == (0, units), told
    print(f"{units} units in {time.monotonic() - start:.1f} s, driver's peak memory {peak >> 10} MiB")
    assert 0 < peak < 200 << 10


def resident(pid: int) -> int | None:
    """KiB."""
    try:
        words = Path(f"/proc/{pid}/status").read_text().split()
        return int(words[words.index("VmRSS:") + 1])
    except (OSError, ValueError):
        return None


FAST = r"""#!/bin/sh
if [ "$1" = status ]; then
    missing=$(for i in $(seq 0 LAST); do [ -e FILM/done/$i ] || printf ,$i; done)
    echo "${missing#,}"
    exit 0
fi
while [ "$1" != --unit ]; do shift; done
: >FILM/done/$2
echo '{"event":"done","code":0,"tiles":10,"pixels":1000}'
"""
