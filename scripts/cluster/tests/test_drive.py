"""The driver with real Dask workers on this machine and fake_lenscube.py."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from distributed import LocalCluster

from lenscube.dask import main

PACKAGE = str(Path(__file__).parent.parent.parent / "python")


@pytest.fixture(scope="module")
def cluster():
    """Two workers without this package: the driver sends them its code."""
    with LocalCluster(2, threads_per_worker=1, dashboard_address=":0", resources={"GPU": 1}) as cluster:
        yield cluster


def driver(job, fake, *arguments, **options):
    """The driver as a separate process."""
    argv = [sys.executable, "-m", "lenscube.dask.main", str(job.plan), "--lenscube", fake, "--retry-pause", "0.1", *arguments]
    env = dict(os.environ, PYTHONPATH=f"{PACKAGE}:{os.environ.get('PYTHONPATH', '')}")
    return subprocess.Popen(argv, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


@pytest.fixture
def drive(fake, cluster, monkeypatch, capsys):
    """The driver in this process, which has imported Dask already: exit code and stderr."""

    def call(job, *arguments):
        argv = ["lenscube-dask", str(job.plan), "--scheduler", cluster.scheduler_address, "--lenscube", fake]
        monkeypatch.setattr(sys, "argv", [*argv, "--retry-pause", "0.1", *arguments])
        code = main.main()
        return code, capsys.readouterr().err

    return call


def wait_until(condition, seconds=600):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "timeout"
        time.sleep(0.05)


def test_every_unit_is_executed_once(job, drive):
    job = job(12)
    code, stderr = drive(job)
    assert (code, job.done()) == (0, 12), stderr
    assert [job.tries(n) for n in range(12)] == [1] * 12
    assert "complete, 12 units" in stderr


def test_only_missing_units_are_executed(job, drive, tmp_path):
    job = job(6)
    for unit in (0, 1, 4):
        (job.film / "done" / str(unit)).touch()
    log = tmp_path / "log.jsonl"
    code, stderr = drive(job, "--log", str(log))
    assert (code, job.done()) == (0, 6), stderr
    assert [job.tries(n) for n in range(6)] == [0, 0, 1, 1, 0, 1]
    events = [json.loads(line) for line in log.read_text().splitlines()]
    assert sorted(e["unit"] for e in events if e["event"] == "start") == [2, 3, 5]
    code, stderr = drive(job)
    assert code == 0 and "complete" in stderr and job.tries(2) == 1


def test_exit_75_and_kills_are_retried(job, drive):
    job = job(4, {"1": {"code": 75, "times": 2, "message": "store unreachable"}, "2": {"code": -9, "times": 1}})
    code, stderr = drive(job)
    assert (code, job.done(), job.tries(1), job.tries(2)) == (0, 4, 3, 2), stderr
    assert "store unreachable" in stderr and "killed by signal 9" in stderr


def test_exit_75_after_the_last_retry(job, drive):
    job = job(2, {"1": {"code": 75}})
    code, stderr = drive(job, "--retries", "2")
    assert (code, job.tries(1)) == (75, 3), stderr
    assert "resume with" in stderr


@pytest.mark.parametrize("exit_code, message", [(1, "no such lens"), (2, "usage error"), (3, "no such lens")])
def test_permanent_failure_stops_the_driver_with_its_exit_code(job, drive, exit_code, message):
    # The driver ends although unit 1 would not.
    fakes = {"0": {"code": exit_code, "message": "no such lens"}, "1": {"endless": True}}
    job = job(40, fakes)
    code, stderr = drive(job)
    assert code == exit_code and message in stderr and "unit 0 failed" in stderr, stderr
    assert job.tries(0) == 1 and job.done() < 40


def test_missing_program_exits_1_and_names_the_path(job, drive):
    code, stderr = drive(job(3), "--worker-lenscube", "/none/lenscube")
    assert code == 1 and "starting /none/lenscube: No such file" in stderr, stderr


def test_gpu_resource_of_workers_is_used(job, drive):
    job = job(4)
    code, stderr = drive(job, "--gpu")
    assert (code, job.done()) == (0, 4), stderr


def test_interrupt_stops_units_exits_130_and_prints_the_command(job, fake):
    job = job(8, {str(n): {"endless": True} for n in range(8)})
    run = driver(job, fake, "--local", "2", start_new_session=True)
    wait_until(lambda: job.tries(0) and job.tries(1))
    os.killpg(run.pid, signal.SIGINT)  # as a terminal sends it
    _, stderr = run.communicate(timeout=600)
    assert run.returncode == 130 and "Resume with: " in stderr, stderr
    assert "Traceback" not in stderr, stderr
    wait_until(lambda: not running(job))


def test_killed_driver_leaves_no_unit_running(job, fake):
    job = job(4, {str(n): {"endless": True} for n in range(4)})
    run = driver(job, fake, "--local", "2")
    wait_until(lambda: job.tries(0) and job.tries(1))
    run.kill()
    run.communicate()
    wait_until(lambda: not running(job))


def running(job) -> list[str]:
    """Processes of fake_lenscube.py whose plan is for this job's film."""
    found = subprocess.run(["ps", "-eo", "pid,args"], capture_output=True, text=True).stdout.splitlines()
    fakes = [line for line in found if "fake_lenscube.py run" in line]
    return [line for line in fakes if plan_of(line) == str(job.film)]


def plan_of(line: str) -> str:
    arguments = line.split()
    try:
        return json.loads(Path(arguments[arguments.index("--plan") + 1]).read_text())["command"]["film"]
    except (OSError, ValueError):
        return "removed with its worker"


def test_killed_worker_costs_one_repeated_unit(job, fake, cluster, tmp_path):
    job = job(12, {str(n): {"held": True} for n in range(4, 12)})
    log = tmp_path / "log.jsonl"
    run = driver(job, fake, "--scheduler", cluster.scheduler_address, "--log", str(log))
    # Each worker holds a unit, and the driver knows of the end of all others: it keeps four in flight. The scheduler computes again what a dead worker has
    # computed and the driver has not released yet, which is not what is tested.
    submitted = lambda: log.exists() and log.read_text().count('"event": "submit"')
    released = lambda: all(task.state != "memory" for task in list(cluster.scheduler.tasks.values()))
    wait_until(lambda: sum(job.tries(n) for n in range(4, 12)) == 2 and submitted() == 8 and released())
    victim = next(iter(cluster.workers.values())).pid
    os.kill(victim, signal.SIGKILL)
    (job.film / "released").touch()
    _, stderr = run.communicate()
    tries = [job.tries(n) for n in range(12)]
    assert (run.returncode, job.done()) == (0, 12), stderr
    assert sum(tries) == 13, tries


def test_driver_memory_is_below_200_mib(tmp_path, cluster):
    """LENSCUBE_DASK_UNITS=10000 for a measurement; a shell script replaces lenscube, for a fast start."""
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
    stderr = run.communicate()[1]
    assert (run.returncode, job.done()) == (0, units), stderr
    print(f"{units} units in {time.monotonic() - start:.1f} s, driver's peak memory {peak >> 10} MiB")
    assert 0 < peak < 200 << 10


def resident(pid: int) -> int | None:
    """Resident memory, KiB."""
    try:
        fields = Path(f"/proc/{pid}/status").read_text().split()
        return int(fields[fields.index("VmRSS:") + 1])
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
