#!/usr/bin/env python3
"""Test of a job on three hosts: the worker of one is killed, another is disconnected for a while.

    scripts/cluster/test_hosts.py LENSCUBE [--netns] [--keep FOLDER]

The film must equal that of one run byte for byte; the unit of the killed worker must end with it; and only units of the two lost
hosts may be started twice. With --netns (root, iproute2) each host is a network namespace with its own host name, and its link is
cut; otherwise hosts are process groups, and the worker is stopped. Run with a Python with distributed. Ends with 1 after any error.
"""
import argparse, collections, hashlib, json, os, shutil, signal, socket, subprocess, sys, tempfile, time
from pathlib import Path

HERE = Path(__file__).resolve().parent
PACKAGE = HERE.parent / "python"
TTL_S = 3


def digest(film):
    """Digests of the film's arrays and metadata."""
    files = (p for p in sorted(film.rglob("*")) if p.is_file() and not p.name.startswith(".tmp-"))
    return {str(p.relative_to(film)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files if p.relative_to(film).parts[0] != "runs"}


def wait_until(condition, what, seconds=120):
    end = time.monotonic() + seconds
    while not (found := condition()):
        if time.monotonic() > end:
            sys.exit(f"ERROR: timeout after {seconds} s: {what}")
        time.sleep(0.05)
    return found


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


def parent(pid):
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


class Processes:
    """Hosts as process groups of this machine."""

    address, bind = "127.0.0.1", []
    kind = "processes"

    def __init__(self, names):
        self.names = names

    def prefix(self, name):
        return []

    def cut(self, name, worker):
        self.stopped = [parent(worker), worker]  # its nanny first, which would restart it
        for pid in self.stopped:
            os.kill(pid, signal.SIGSTOP)

    def heal(self, name, worker):
        for pid in self.stopped:
            os.kill(pid, signal.SIGCONT)

    def close(self):
        pass


class Namespaces:
    """Hosts as network namespaces on a bridge, each with its host name."""

    address = "10.99.7.1"
    kind = "network namespaces"

    def __init__(self, names):
        self.names = names
        ip = self.ip
        ip("link add lcbr type bridge")
        ip(f"addr add {self.address}/24 dev lcbr")
        ip("link set lcbr up")
        for number, name in enumerate(names, 2):
            ip(f"netns add {name}")
            ip(f"link add v{name} type veth peer name eth0 netns {name}")
            ip(f"link set v{name} master lcbr up")
            ip(f"-n {name} addr add 10.99.7.{number}/24 dev eth0")
            ip(f"-n {name} link set eth0 up")
            ip(f"-n {name} link set lo up")

    def ip(self, arguments):
        subprocess.run(["ip", *arguments.split()], check=True)

    def prefix(self, name):
        return ["unshare", "--uts", "sh", "-c", f'hostname {name}; exec ip netns exec {name} "$@"', "sh"]

    def cut(self, name, worker):
        self.ip(f"link set v{name} down")

    def heal(self, name, worker):
        self.ip(f"link set v{name} up")

    def close(self):
        for name in self.names:
            subprocess.run(["ip", "netns", "del", name])
        subprocess.run(["ip", "link", "del", "lcbr"])


class Cluster:
    """A scheduler and a worker with its nanny on each host."""

    def __init__(self, hosts, place):
        self.hosts, self.place, self.running = hosts, place, {}
        with socket.socket() as s:
            s.bind((hosts.address, 0))
            self.scheduler = f"tcp://{hosts.address}:{s.getsockname()[1]}"
        port = self.scheduler.rpartition(":")[2]
        env = {"DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": f"{TTL_S}s"}
        arguments = ["dask_scheduler", "--host", hosts.address, "--port", port, "--no-dashboard"]
        self.start("scheduler", [], arguments, env)
        for name in hosts.names:
            arguments = ["dask_worker", self.scheduler, "--nthreads", "1", "--name", name, "--no-dashboard"]
            arguments += ["--local-directory", str(place / name), "--memory-limit", "0"]
            restarted = ["sh", "-c", 'while :; do "$@"; sleep 1; done', "sh"]  # a worker that lost its scheduler ends
            self.start(name, [*hosts.prefix(name), *restarted], arguments, {})

    def start(self, name, prefix, arguments, env):
        argv = [*prefix, sys.executable, "-m", f"distributed.cli.{arguments[0]}", *arguments[1:]]
        log = open(self.place / f"{name}.log", "w")
        env = dict(os.environ, **env)
        self.running[name] = subprocess.Popen(argv, env=env, stdout=log, stderr=log, start_new_session=True)

    def close(self):
        for process in self.running.values():
            try:
                os.killpg(process.pid, signal.SIGKILL)
            except ProcessLookupError:
                pass
            process.wait()


class Log:
    """The log of the driver, read while it is written."""

    def __init__(self, path):
        self.path = path

    def events(self):
        try:
            return [json.loads(line) for line in self.path.read_text().splitlines(keepends=True) if line.endswith("\n")]
        except OSError:
            return []

    def running_unit(self, name):
        """The start event of the unit that has been running on a host for at least 0.2 s, or None."""
        last = None
        for e in self.events():
            if e.get("name") == name and e["event"] in ("start", "end"):
                last = e if e["event"] == "start" else None
        return last if last and time.time() - last["time"] > 0.2 and alive(last["pid"]) else None


class Test:
    """The job, the injected failures and the errors found."""

    def __init__(self, lenscube, place, hosts, sizes):
        self.lenscube, self.place, self.hosts, self.errors = lenscube, place, hosts, []
        self.film, self.plan, self.log = place / "film.zarr", place / "job.json", Log(place / "units.jsonl")
        size, rows = sizes
        chart = place / "chart.zarr"
        self.call("chart", "composite", chart, "--size", size, "--wavelengths", "450,500,550,600", "--pitch-um", f"{24000 / int(size.split('x')[0]):.3f}")
        flags = ["--lens", "double-gauss-28-npz", "--azimuths", "4", "--shard", "256", "--chunk", "64"]
        flags += ["--threads", "1"]
        start = time.monotonic()
        self.call("run", chart, place / "whole.zarr", *flags)
        self.reference = digest(place / "whole.zarr")
        self.seconds = time.monotonic() - start
        self.call("plan", chart, self.film, *flags, "--unit-rows", rows, "-o", self.plan)
        self.units = len(json.loads(self.plan.read_text())["units"])

    def call(self, *arguments):
        done = subprocess.run([self.lenscube, *map(str, arguments)], capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"ERROR: lenscube {' '.join(map(str, arguments))}: {done.returncode}\n{done.stderr}")
        return done.stdout

    def run(self, cluster, cut_s):
        """Runs the driver and injects both failures."""
        argv = [sys.executable, "-m", "lenscube.dask.main", self.plan, "--scheduler", cluster.scheduler]
        argv += ["--lenscube", self.lenscube, "--log", self.log.path, "--retry-pause", "1"]
        env = dict(os.environ, PYTHONPATH=f"{PACKAGE}:{os.environ.get('PYTHONPATH', '')}")
        with open(self.place / "driver.log", "w") as out:
            drive = subprocess.Popen(list(map(str, argv)), env=env, stderr=out)
            try:
                self.inject_failures(drive, cut_s)
                code = drive.wait(300)
            finally:
                drive.kill()
        if code:
            self.errors.append(f"the driver ended with {code}")

    def inject_failures(self, drive, cut_s):
        one, two = self.hosts.names[:2]
        self.killed = wait_until(lambda: self.log.running_unit(one) or drive.poll() is not None, f"a unit on {one}")
        if self.killed is True:
            sys.exit(f"ERROR: the driver ended too early\n{(self.place / 'driver.log').read_text()}")
        worker = parent(self.killed["pid"])
        os.kill(worker, signal.SIGKILL)
        start = time.monotonic()
        wait_until(lambda: not alive(self.killed["pid"]), f"the end of the unit of {one}", 10)
        print(f"{one}: worker killed in unit {self.killed['unit']}, whose process ended within {time.monotonic() - start:.2f} s")
        self.severed = wait_until(lambda: self.log.running_unit(two) or drive.poll() is not None, f"a unit on {two}")
        if self.severed is True:
            sys.exit("ERROR: the driver ended before the second failure: the job must be larger")
        worker = parent(self.severed["pid"])
        self.cut_at = time.time()
        self.hosts.cut(two, worker)
        time.sleep(cut_s)
        self.hosts.heal(two, worker)
        self.healed_at = time.time()
        print(f"{two}: cut off in unit {self.severed['unit']}, connected again after {cut_s} s (lost after {TTL_S} s without a message, 30 s later for its nanny)")

    def check(self):
        actual = digest(self.film)
        self.errors += [f"{k} differs" for k in sorted(actual.keys() | self.reference.keys()) if actual.get(k) != self.reference.get(k)]
        starts = [e for e in self.log.events() if e["event"] == "start"]
        records = [json.loads(p.read_text()) for p in sorted((self.film / "runs").glob("*.json"))]
        done = collections.Counter(int(r["units"]) for r in records if r["outcome"] == "complete" and r["shards"])
        begun = collections.Counter(e["unit"] for e in starts)
        again = sorted(n for n in range(self.units) if max(begun[n], done[n]) > 1)
        held = self.held_units(starts, records)
        self.errors += [f"unit {n} was not executed" for n in range(self.units) if not done[n]]
        self.errors += [f"unit {n} was executed again, although no host had lost it" for n in again if n not in held]
        if len(held) > 4:
            self.errors.append(f"two workers had {len(held)} units")
        two = self.hosts.names[1]
        back = sum(e["name"] == two and e["time"] > self.healed_at for e in starts)
        hosts = collections.Counter(e["name"] for e in starts)
        temps = list(self.film.rglob(".tmp-*"))
        print(f"units of the two hosts: {sorted(held)}; started again: {again}, of {self.units}")
        print(f"started by host: {dict(sorted(hosts.items()))}; {two} after its reconnection: {back}")
        print(f"run records of the film: {len(records)}; temporary files left by killed processes: {len(temps)}")
        print(f"{len(actual)} files: {'same bytes as one run' if actual == self.reference else 'DIFFERENT'}")

    def held_units(self, starts, records):
        """Units of the lost hosts: the running ones, and those that the disconnected worker executed afterwards."""
        two = self.hosts.names[1]
        started = {e["unit"] for e in starts if e["worker"] == self.severed["worker"] and e["time"] >= self.cut_at}
        recorded = {int(r["units"]) for r in records if r["host"] == two and self.cut_at <= r["finished_unix_s"] <= self.healed_at + 1}
        return {self.killed["unit"], self.severed["unit"]} | started | recorded


def main():
    args = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    args.add_argument("lenscube", type=Path)
    args.add_argument("--netns", action="store_true", help="hosts are network namespaces (root)")
    args.add_argument("--size", default="1500x1500", help="size of the film")
    args.add_argument("--unit-rows", default="1")
    args.add_argument("--cut", type=float, default=15, help="seconds for which the second host is disconnected")
    args.add_argument("--keep", type=Path, help="folder for the logs")
    args = args.parse_args()
    with tempfile.TemporaryDirectory(prefix="lenscube-hosts-") as place:
        place = Path(place)
        hosts = (Namespaces if args.netns else Processes)(["lch1", "lch2", "lch3"])
        cluster = None
        try:
            test = Test(args.lenscube.resolve(), place, hosts, (args.size, args.unit_rows))
            print(f"{test.units} units of {args.size} px x 4 bands, {len(test.reference)} files, {test.seconds:.1f} s in one process; hosts: {hosts.kind}")
            cluster, start = Cluster(hosts, place), time.monotonic()
            test.run(cluster, args.cut)
            print(f"driver: {time.monotonic() - start:.1f} s, including start of the workers and failures")
            test.check()
        finally:
            if cluster:
                cluster.close()
            hosts.close()
            if args.keep:
                args.keep.mkdir(parents=True, exist_ok=True)
                for log in [*place.glob("*.log"), *place.glob("*.jsonl")]:
                    shutil.copy(log, args.keep)
    for error in test.errors:
        print(f"ERROR: {error}")
    print("FAILED" if test.errors else "all checks passed")
    sys.exit(bool(test.errors))


if __name__ == "__main__":
    main()
