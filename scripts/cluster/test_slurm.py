#!/usr/bin/env python3
"""Test of a job as an array of slurm.sbatch on the three nodes of slurm-on-one-machine; one node is killed during a unit.

Called by `slurm-on-one-machine test`, which starts and stops Slurm. The film must equal that of one run byte for byte.
"""
import json, os, shutil, signal, subprocess, sys, time
from pathlib import Path

from test_hosts import HERE, PACKAGE, digest, wait_until

SIZE = 6000


def output(*arguments, **options):
    done = subprocess.run(list(map(str, arguments)), capture_output=True, text=True, **options)
    if done.returncode:
        sys.exit(f"ERROR: {' '.join(map(str, arguments))}: {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout.strip()


class Test:
    def __init__(self, place, lenscube):
        self.place, self.lenscube, self.errors = place, lenscube, []
        self.film, self.plan, self.chart = place / "film.zarr", place / "job.json", place / "chart.zarr"
        pitch = f"{24000 / SIZE:.3f}"
        output(lenscube, "chart", "composite", self.chart, "--size", SIZE, "--wavelengths", "450,500,550,600", "--pitch-um", pitch)
        self.flags = ["--lens", "double-gauss-28-npz", "--azimuths", "4", "--shard", "256", "--chunk", "64", "--threads", "1"]
        output(lenscube, "run", self.chart, place / "whole.zarr", *self.flags)
        self.reference = digest(place / "whole.zarr")
        self.plan_new_film()

    def plan_new_film(self):
        """Plans a new film."""
        shutil.rmtree(self.film, ignore_errors=True)
        self.plan.unlink(missing_ok=True)
        output(self.lenscube, "plan", self.chart, self.film, *self.flags, "--unit-rows", "4", "-o", self.plan)
        self.units = len(json.loads(self.plan.read_text())["units"])

    def missing(self):
        return output(self.lenscube, "status", "--plan", self.plan, "--missing")

    def submit(self):
        arguments = ["sbatch", "--parsable", f"--array={self.missing()}", "--cpus-per-task=1", "--mem=1G", f"--output={self.place}/%a.out"]
        return output(*arguments, HERE / "slurm.sbatch", self.plan, env=dict(os.environ, LENSCUBE_PAUSE="1"))

    def kill_a_node(self):
        """Kills a node with its steps and their processes during a unit. Returns the unit."""
        node = "n2"
        child = wait_until(lambda: self.unit_on(node), f"a unit on {node}")
        unit = Path(f"/proc/{child}/environ").read_bytes().split(b"SLURM_ARRAY_TASK_ID=")[1].split(b"\0")[0].decode()
        job = Path(f"/proc/{child}/environ").read_bytes().split(b"SLURM_JOB_ID=")[1].split(b"\0")[0].decode()
        slurmd = int((self.place / f"slurmd-{node}.own").read_text())
        for pid in [slurmd, *steps(job), child]:
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                pass
        print(f"{node}: slurmd and its steps killed in unit {unit}")
        return int(unit)

    def unit_on(self, node):
        """The lenscube process on a node, if it has started a unit."""
        for entry in Path("/proc").iterdir():
            try:
                arguments = (entry / "cmdline").read_bytes().split(b"\0")
                env = (entry / "environ").read_bytes().split(b"\0")
            except (OSError, ValueError):
                continue
            is_unit = arguments[1:2] == [b"run"] and str(self.plan).encode() in arguments
            if is_unit and f"SLURMD_NODENAME={node}".encode() in env:
                time.sleep(0.5)
                return int(entry.name) if entry.exists() else None
        return None

    def check(self, what):
        found = digest(self.film)
        self.errors += [f"{what}: {k} differs" for k in sorted(found.keys() | self.reference.keys()) if found.get(k) != self.reference.get(k)]
        if missing := self.missing():
            self.errors.append(f"{what}: {missing} are missing")
        records = [json.loads(p.read_text()) for p in sorted((self.film / "runs").glob("*.json"))]
        print(f"{what}: {self.units} units, {len(records)} run records, {len(found)} files: "
              f"{'same bytes as one run' if found == self.reference else 'DIFFERENT'}")


def steps(job):
    """Process ids of slurmstepd and of the batch script of a job."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            name = (entry / "comm").read_text().strip()
            arguments = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            env = (entry / "environ").read_bytes()
        except OSError:
            continue
        if (name == "slurmstepd" and f"[{job}." in arguments) or (f"SLURM_JOB_ID={job}\0".encode() in env and name != "python3"):
            found.append(int(entry.name))
    return found


def array(test):
    start = time.monotonic()
    job = test.submit()
    unit = test.kill_a_node()
    wait_until(lambda: not output("squeue", "-h", "-j", job, "-t", "all", "-o", "%T").replace("COMPLETED", "").strip() or gone(job), "the array ends", 300)
    told = (test.place / f"{unit}.out").read_text()
    attempts = told.count("shards in ") + told.count("shard in ")
    if test.missing():
        print(f"resubmitted: {test.missing()}")
        job = test.submit()
        wait_until(lambda: gone(job), "the second array ends", 200)
    log = (test.place / "slurmctld.log").read_text().splitlines()
    for line in [line.partition("] ")[2] for line in log if "n2 not resp" in line or "equeu" in line]:
        print(f"slurmctld: {line}")
    print(f"the array: {time.monotonic() - start:.0f} s; unit {unit} ended with 0 {attempts} time, after the node was lost")
    test.check("array of slurm.sbatch, a node killed")


def gone(job):
    done = subprocess.run(["squeue", "-h", "-j", job, "-o", "%T"], capture_output=True, text=True)
    return not done.stdout.strip()


def dask(test, python):
    """lenscube-dask --slurm, with workers of SLURMCluster of dask-jobqueue."""
    test.plan_new_film()
    arguments = [python, "-m", "lenscube.dask.main", test.plan, "--slurm", "2", "--cpus", "1", "--memory", "1GiB", "--partition", "main"]
    arguments += ["--walltime", "00:10:00", "--interface", "lo", "--lenscube", test.lenscube]
    start = time.monotonic()
    env = dict(os.environ, PYTHONPATH=f"{PACKAGE}:{os.environ.get('PYTHONPATH', '')}")
    done = subprocess.run(list(map(str, arguments)), cwd=test.place, env=env, capture_output=True, text=True, timeout=400)
    print(done.stderr.strip().replace(str(test.place), "FOLDER"))
    if done.returncode:
        test.errors.append(f"lenscube-dask --slurm: exit code {done.returncode}")
    print(f"lenscube-dask --slurm 2: {time.monotonic() - start:.0f} s")
    test.check("lenscube-dask --slurm")


def main():
    place, lenscube, python = Path(sys.argv[1]), sys.argv[2], sys.argv[3]
    test = Test(place, lenscube)
    print(f"{output('sinfo', '--version')}, nodes n1 n2 n3 of one CPU; {test.units} units of {SIZE}x{SIZE} px x 4 bands", flush=True)
    array(test)
    if python:
        here = Path(__file__).with_name("slurm-on-one-machine")
        subprocess.run([here, "node", place, "n2"], check=True)
        dask(test, python)
    for error in test.errors:
        print(f"ERROR: {error}")
    print("FAILED" if test.errors else "all checks passed")
    sys.exit(bool(test.errors))


if __name__ == "__main__":
    main()
