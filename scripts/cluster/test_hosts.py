#!/usr/bin/env python3
"""Test of a job on three hosts: the worker of one is killed, another is disconnected for a while.

    scripts/cluster/test_hosts.py LENSCUBE [--netns] [--keep FOLDER]

The film must equal that of one run byte for byte; the unit of the killed worker must end with it; and a unit may be started again only
if the scheduler had lost the worker that had it. Both hosts are held at the start of a unit (HELD) until the test has them both, so that
neither failure comes after the end of the job. Which records there are is not checked: a worker may be killed after the last shard of
its unit and before the unit's record. With --netns (root, iproute2) each host is a network namespace with its own host name, and its link is
cut; otherwise hosts are process groups, and the worker is stopped. Run with a Python with distributed. Ends with 1 after any error.
"""
import argparse, collections, hashlib, json, os, re, shutil, signal, socket, subprocess, sys, tempfile, time
from pathlib import Path

HERE = Path(__file__).resolve().parent
PACKAGE = HERE.parent / "python"
# A worker without a message for this time is lost, 30 s later for its nanny. Longer than a busy machine keeps one waiting.
TTL_S = 10
# The program for the workers: the first unit of a host, which its plan's path names, waits for the file `released-HOST`.
HELD = """#!/bin/sh
for host in {hosts}; do
    case "$*" in
    *"{place}/$host/"*)
        if mkdir "{place}/held-$host" 2>/dev/null; then
            while [ ! -e "{place}/released-$host" ]; do sleep 0.05; done
        fi ;;
    esac
done
exec "{lenscube}" "$@"
"""


def digest(film):
    """Digests of the film's arrays and metadata."""
    files = (p for p in sorted(film.rglob("*")) if p.is_file() and not p.name.startswith(".tmp-"))
    return {str(p.relative_to(film)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files if p.relative_to(film).parts[0] != "runs"}


def wait_until(condition, what, seconds=600):
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


def program(pid):
    """The file that a process executes; None after its end."""
    try:
        return Path(os.readlink(f"/proc/{pid}/exe"))
    except OSError:
        return None


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

    def worker_of(self, started):
        """Process id of the worker that started a unit which has not ended."""
        worker = parent(started["pid"])
        if os.getsid(worker) != self.running[started["name"]].pid:
            sys.exit(f"ERROR: the worker on {started['name']} ended before the test: {(self.place / started['name']).with_suffix('.log').read_text()[-2000:]}")
        return worker

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

    def started_unit(self, name):
        """The first start event of a host, or None."""
        return next((e for e in self.events() if e.get("name") == name and e["event"] == "start"), None)


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
        self.held = place / "lenscube-held"
        self.held.write_text(HELD.format(place=place, lenscube=lenscube, hosts=" ".join(hosts.names[:2])))
        self.held.chmod(0o755)

    def call(self, *arguments):
        done = subprocess.run([self.lenscube, *map(str, arguments)], capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"ERROR: lenscube {' '.join(map(str, arguments))}: {done.returncode}\n{done.stderr}")
        return done.stdout

    def run(self, cluster, cut_s):
        """Runs the driver and injects both failures."""
        argv = [sys.executable, "-m", "lenscube.dask.main", self.plan, "--scheduler", cluster.scheduler]
        argv += ["--lenscube", self.lenscube, "--worker-lenscube", self.held, "--log", self.log.path, "--retry-pause", "1"]
        env = dict(os.environ, PYTHONPATH=f"{PACKAGE}:{os.environ.get('PYTHONPATH', '')}")
        with open(self.place / "driver.log", "w") as out:
            drive = subprocess.Popen(list(map(str, argv)), env=env, stderr=out)
            try:
                self.inject_failures(drive, cluster, cut_s)
                code = drive.wait(1800)
            finally:
                drive.kill()
        if code:
            self.errors.append(f"the driver ended with {code}")

    def start_of_held_unit(self, name, drive):
        """The start event of the unit that is held on a host; the driver cannot end before it is released."""
        held = lambda: (self.place / f"held-{name}").exists() and self.log.started_unit(name)
        found = wait_until(lambda: held() or drive.poll() is not None, f"a unit on {name}")
        if found is True:
            sys.exit(f"ERROR: the driver ended before a unit on {name}\n{(self.place / 'driver.log').read_text()}")
        return found

    def release(self, name):
        (self.place / f"released-{name}").touch()

    def inject_failures(self, drive, cluster, cut_s):
        one, two = self.hosts.names[:2]
        killed, severed = (self.start_of_held_unit(name, drive) for name in (one, two))
        worker = cluster.worker_of(killed)
        self.release(one)
        wait_until(lambda: program(killed["pid"]) in (None, self.lenscube), f"the program of the unit of {one}")
        os.kill(worker, signal.SIGKILL)
        start = time.monotonic()
        wait_until(lambda: not alive(killed["pid"]), f"the end of the unit of {one}")
        print(f"{one}: worker killed in unit {killed['unit']}, whose process ended within {time.monotonic() - start:.2f} s")
        worker = cluster.worker_of(severed)
        self.hosts.cut(two, worker)
        self.release(two)
        time.sleep(cut_s)
        self.hosts.heal(two, worker)
        self.healed_at = time.time()
        print(f"{two}: cut off in unit {severed['unit']}, connected again after {cut_s} s (lost after {TTL_S} s without a message, 30 s later for its nanny)")

    def check(self):
        actual = digest(self.film)
        self.errors += [f"{k} differs" for k in sorted(actual.keys() | self.reference.keys()) if actual.get(k) != self.reference.get(k)]
        starts, lost = collections.defaultdict(list), self.lost_workers()
        for e in self.log.events():
            if e["event"] == "start":
                starts[e["unit"]].append(e)
        for unit in range(self.units):
            # A lost worker may have executed a unit without the driver's knowledge, but none is complete without a start.
            if not starts[unit]:
                self.errors.append(f"unit {unit} was not started")
            for e in starts[unit][:-1]:
                if e["worker"] not in lost:
                    self.errors.append(f"unit {unit} was started again, although its worker {e['worker']} on {e['name']} was not lost")
        again = sorted(unit for unit, events in starts.items() if len(events) > 1)
        two = self.hosts.names[1]
        events = [e for of_unit in starts.values() for e in of_unit]
        back = sum(e["name"] == two and e["time"] > self.healed_at for e in events)
        hosts = collections.Counter(e["name"] for e in events)
        records, temps = list((self.film / "runs").glob("*.json")), list(self.film.rglob(".tmp-*"))
        print(f"workers that the scheduler lost: {len(lost)}; units started again: {again}, of {self.units}")
        print(f"started by host: {dict(sorted(hosts.items()))}; {two} after its reconnection: {back}")
        print(f"run records of the film: {len(records)}; temporary files left by killed processes: {len(temps)}")
        print(f"{len(actual)} files: {'same bytes as one run' if actual == self.reference else 'DIFFERENT'}")

    def lost_workers(self):
        """Addresses of the workers that the scheduler removed, from its log."""
        lines = (line for line in (self.place / "scheduler.log").read_text().splitlines() if "Remove addr" in line or "Remove worker" in line)
        return {address for line in lines for address in re.findall(r"tcp://[\d.]+:\d+", line)}


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
