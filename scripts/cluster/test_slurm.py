#!/usr/bin/env python3
"""A real job as an array of slurm.sbatch on the three nodes of slurm-on-one-machine; one node is killed in the middle of a unit.

Called by `slurm-on-one-machine test`, which starts and ends Slurm. The film must be that of one plain run, byte for byte.
"""
import json, os, shutil, signal, subprocess, sys, time
from pathlib import Path

from test_hosts import HERE, digest, until

SIZE = 6000


def output(*words, **more):
    done = subprocess.run(list(map(str, words)), capture_output=True, text=True, **more)
    if done.returncode:
        sys.exit(f"FAULT: {' '.join(map(str, words))}: {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout.strip()


class Trial:
    def __init__(self, place, lenscube):
        self.place, self.lenscube, self.faults = place, lenscube, []
        self.film, self.plan, self.chart = place / "film.zarr", place / "job.json", place / "chart.zarr"
        pitch = f"{24000 / SIZE:.3f}"
        output(lenscube, "chart", "composite", self.chart, "--size", SIZE, "--wavelengths", "450,500,550,600", "--pitch-um", pitch)
        self.flags = ["--lens", "double-gauss-28-npz", "--azimuths", "4", "--shard", "256", "--chunk", "64", "--threads", "1"]
        output(lenscube, "run", self.chart, place / "whole.zarr", *self.flags)
        self.whole = digest(place / "whole.zarr")
        self.begin()

    def begin(self):
        """A new film, nothing of it done."""
        shutil.rmtree(self.film, ignore_errors=True)
        self.plan.unlink(missing_ok=True)
        output(self.lenscube, "plan", self.chart, self.film, *self.flags, "--unit-rows", "4", "-o", self.plan)
        self.units = len(json.loads(self.plan.read_text())["units"])

    def missing(self):
        return output(self.lenscube, "status", "--plan", self.plan, "--missing")

    def submit(self):
        words = ["sbatch", "--parsable", f"--array={self.missing()}", "--cpus-per-task=1", "--mem=1G", f"--output={self.place}/%a.out"]
        return output(*words, HERE / "slurm.sbatch", self.plan, env=dict(os.environ, LENSCUBE_PAUSE="1"))

    def kill_a_node(self):
        """A node, its steps and what runs in them, all at once, in the middle of a unit: the unit."""
        node = "n2"
        child = until(lambda: self.unit_on(node), f"a unit on {node}")
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
        """The process of lenscube that a node runs, if it has begun its unit."""
        for entry in Path("/proc").iterdir():
            try:
                words = (entry / "cmdline").read_bytes().split(b"\0")
                env = (entry / "environ").read_bytes().split(b"\0")
            except (OSError, ValueError):
                continue
            mine = words[1:2] == [b"run"] and str(self.plan).encode() in words
            if mine and f"SLURMD_NODENAME={node}".encode() in env:
                time.sleep(0.5)
                return int(entry.name) if entry.exists() else None
        return None

    def judge(self, what):
        own = digest(self.film)
        self.faults += [f"{what}: {k} differs" for k in sorted(own.keys() | self.whole.keys()) if own.get(k) != self.whole.get(k)]
        if missing := self.missing():
            self.faults.append(f"{what}: {missing} are missing")
        records = [json.loads(p.read_text()) for p in sorted((self.film / "runs").glob("*.json"))]
        print(f"{what}: {self.units} units, {len(records)} run records, {len(own)} files: "
              f"{'same bytes as one plain run' if own == self.whole else 'DIFFERENT'}")


def steps(job):
    """Processes of slurmstepd and the batch script of a job."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            name = (entry / "comm").read_text().strip()
            words = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            env = (entry / "environ").read_bytes()
        except OSError:
            continue
        if (name == "slurmstepd" and f"[{job}." in words) or (f"SLURM_JOB_ID={job}\0".encode() in env and name != "python3"):
            found.append(int(entry.name))
    return found


def array(trial):
    start = time.monotonic()
    job = trial.submit()
    unit = trial.kill_a_node()
    until(lambda: not output("squeue", "-h", "-j", job, "-t", "all", "-o", "%T").replace("COMPLETED", "").strip() or gone(job), "the array ends", 300)
    attempts = (trial.place / f"{unit}.out").read_text().count("shards in ")
    if trial.missing():
        print(f"resubmitted: {trial.missing()}")
        job = trial.submit()
        until(lambda: gone(job), "the second array ends", 200)
    log = (trial.place / "slurmctld.log").read_text().splitlines()
    for line in [line.partition("] ")[2] for line in log if "n2 not resp" in line or "equeu" in line]:
        print(f"slurmctld: {line}")
    print(f"the array: {time.monotonic() - start:.0f} s; unit {unit} ended well {attempts} time, after the node was lost")
    trial.judge("array of slurm.sbatch, a node killed")


def gone(job):
    done = subprocess.run(["squeue", "-h", "-j", job, "-o", "%T"], capture_output=True, text=True)
    return not done.stdout.strip()


def dask(trial, python):
    """lenscube-dask --slurm: SLURMCluster of dask-jobqueue makes the workers."""
    trial.begin()
    words = [python, "-m", "lenscube_dask.main", trial.plan, "--slurm", "2", "--cpus", "1", "--memory", "1GiB", "--partition", "main"]
    words += ["--walltime", "00:10:00", "--interface", "lo", "--lenscube", trial.lenscube]
    start = time.monotonic()
    env = dict(os.environ, PYTHONPATH=f"{HERE}:{os.environ.get('PYTHONPATH', '')}")
    done = subprocess.run(list(map(str, words)), cwd=trial.place, env=env, capture_output=True, text=True, timeout=400)
    print(done.stderr.strip().replace(str(trial.place), "FOLDER"))
    if done.returncode:
        trial.faults.append(f"lenscube-dask --slurm: exit code {done.returncode}")
    print(f"lenscube-dask --slurm 2: {time.monotonic() - start:.0f} s")
    trial.judge("lenscube-dask --slurm")


def main():
    place, lenscube, python = Path(sys.argv[1]), sys.argv[2], sys.argv[3]
    trial = Trial(place, lenscube)
    print(f"{output('sinfo', '--version')}, nodes n1 n2 n3 of one CPU; {trial.units} units of {SIZE}x{SIZE} px x 4 bands", flush=True)
    array(trial)
    if python:
        here = Path(__file__).with_name("slurm-on-one-machine")
        subprocess.run([here, "node", place, "n2"], check=True)
        dask(trial, python)
    for fault in trial.faults:
        print(f"FAULT: {fault}")
    print("FAILED" if trial.faults else "all is well")
    sys.exit(bool(trial.faults))


if __name__ == "__main__":
    main()
