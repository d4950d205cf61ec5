#!/usr/bin/env python3
"""A real job on three hosts: one loses its worker to SIGKILL, one is cut off for a while and comes back.

    scripts/cluster/test_hosts.py LENSCUBE [--netns] [--keep FOLDER]

The film must be that of one plain run, byte for byte; the killed worker's unit must have died with it; and no unit may have
been begun twice but those that the two hosts had in hand. With --netns (root, iproute2) each host is a network namespace with
a name of its own, and the cut is its link; otherwise hosts are process groups, and the cut is a worker that is stopped.
Run with a Python that has distributed. Ends with 1 if anything was not as it must be.
"""
import argparse, collections, hashlib, json, os, shutil, signal, socket, subprocess, sys, tempfile, time
from pathlib import Path

HERE = Path(__file__).resolve().parent
TTL_S = 3


def digest(film):
    """The film's arrays and metadata."""
    files = (p for p in sorted(film.rglob("*")) if p.is_file() and not p.name.startswith(".tmp-"))
    return {str(p.relative_to(film)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files if p.relative_to(film).parts[0] != "runs"}


def until(true, what, seconds=120):
    end = time.monotonic() + seconds
    while not (found := true()):
        if time.monotonic() > end:
            sys.exit(f"FAULT: waited {seconds} s in vain: {what}")
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
    """Hosts that are process groups of this machine."""

    address, bind = "127.0.0.1", []
    words = "processes"

    def __init__(self, names):
        self.names = names

    def inside(self, name):
        return []

    def cut(self, name, worker):
        self.stopped = [parent(worker), worker]  # its nanny first, or that would replace it
        for pid in self.stopped:
            os.kill(pid, signal.SIGSTOP)

    def heal(self, name, worker):
        for pid in self.stopped:
            os.kill(pid, signal.SIGCONT)

    def close(self):
        pass


class Namespaces:
    """Hosts that are network namespaces on a bridge, each with its host name."""

    address = "10.99.7.1"
    words = "network namespaces"

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

    def ip(self, words):
        subprocess.run(["ip", *words.split()], check=True)

    def inside(self, name):
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
        words = ["dask_scheduler", "--host", hosts.address, "--port", port, "--no-dashboard"]
        self.start("scheduler", [], words, env)
        for name in hosts.names:
            words = ["dask_worker", self.scheduler, "--nthreads", "1", "--name", name, "--no-dashboard"]
            words += ["--local-directory", str(place / name), "--memory-limit", "0"]
            self.start(name, hosts.inside(name), words, {})

    def start(self, name, inside, words, env):
        argv = [*inside, sys.executable, "-m", f"distributed.cli.{words[0]}", *words[1:]]
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
    """The driver's log, read as it grows."""

    def __init__(self, path):
        self.path = path

    def events(self):
        try:
            return [json.loads(line) for line in self.path.read_text().splitlines(keepends=True) if line.endswith("\n")]
        except OSError:
            return []

    def at_work(self, name):
        """The start of the unit that a host is at and has had for a moment, or None."""
        last = None
        for e in self.events():
            if e.get("name") == name and e["event"] in ("start", "end"):
                last = e if e["event"] == "start" else None
        return last if last and time.time() - last["time"] > 0.2 and alive(last["pid"]) else None


class Trial:
    """The job, what was done to it, and what was wrong."""

    def __init__(self, lenscube, place, hosts, sizes):
        self.lenscube, self.place, self.hosts, self.faults = lenscube, place, hosts, []
        self.film, self.plan, self.log = place / "film.zarr", place / "job.json", Log(place / "units.jsonl")
        size, rows = sizes
        chart = place / "chart.zarr"
        self.call("chart", "composite", chart, "--size", size, "--wavelengths", "450,500,550,600", "--pitch-um", f"{24000 / int(size.split('x')[0]):.3f}")
        flags = ["--lens", "double-gauss-28-npz", "--azimuths", "4", "--shard", "256", "--chunk", "64"]
        flags += ["--threads", "1"]
        start = time.monotonic()
        self.call("run", chart, place / "whole.zarr", *flags)
        self.whole = digest(place / "whole.zarr")
        self.seconds = time.monotonic() - start
        self.call("plan", chart, self.film, *flags, "--unit-rows", rows, "-o", self.plan)
        self.units = len(json.loads(self.plan.read_text())["units"])

    def call(self, *words):
        done = subprocess.run([self.lenscube, *map(str, words)], capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"FAULT: lenscube {' '.join(map(str, words))}: {done.returncode}\n{done.stderr}")
        return done.stdout

    def run(self, cluster, cut_s):
        """The drive, with its two accidents: its words."""
        argv = [sys.executable, "-m", "lenscube_dask.main", self.plan, "--scheduler", cluster.scheduler]
        argv += ["--lenscube", self.lenscube, "--log", self.log.path, "--retry-pause", "1"]
        env = dict(os.environ, PYTHONPATH=f"{HERE}:{os.environ.get('PYTHONPATH', '')}")
        with open(self.place / "driver.log", "w") as out:
            drive = subprocess.Popen(list(map(str, argv)), env=env, stderr=out)
            try:
                self.accidents(drive, cut_s)
                code = drive.wait(300)
            finally:
                drive.kill()
        if code:
            self.faults.append(f"the driver ended with {code}")

    def accidents(self, drive, cut_s):
        one, two = self.hosts.names[:2]
        self.killed = until(lambda: self.log.at_work(one) or drive.poll() is not None, f"a unit on {one}")
        if self.killed is True:
            sys.exit(f"FAULT: the driver ended too early\n{(self.place / 'driver.log').read_text()}")
        worker = parent(self.killed["pid"])
        os.kill(worker, signal.SIGKILL)
        start = time.monotonic()
        until(lambda: not alive(self.killed["pid"]), f"the unit of {one} dies with its worker", 10)
        print(f"{one}: worker killed in unit {self.killed['unit']}, whose process died within {time.monotonic() - start:.2f} s")
        self.severed = until(lambda: self.log.at_work(two) or drive.poll() is not None, f"a unit on {two}")
        if self.severed is True:
            sys.exit("FAULT: the driver ended before the second accident: a larger job is needed")
        worker = parent(self.severed["pid"])
        self.cut_at = time.time()
        self.hosts.cut(two, worker)
        time.sleep(cut_s)
        self.hosts.heal(two, worker)
        self.healed_at = time.time()
        print(f"{two}: cut off in unit {self.severed['unit']}, back after {cut_s} s (given up after {TTL_S} to {2 * TTL_S} s)")

    def judge(self):
        own = digest(self.film)
        self.faults += [f"{k} differs" for k in sorted(own.keys() | self.whole.keys()) if own.get(k) != self.whole.get(k)]
        starts = [e for e in self.log.events() if e["event"] == "start"]
        records = [json.loads(p.read_text()) for p in sorted((self.film / "runs").glob("*.json"))]
        done = collections.Counter(int(r["units"]) for r in records if r["outcome"] == "complete" and r["shards"])
        begun = collections.Counter(e["unit"] for e in starts)
        again = sorted(n for n in range(self.units) if max(begun[n], done[n]) > 1)
        hand = self.in_hand(starts, records)
        self.faults += [f"unit {n} was never done" for n in range(self.units) if not done[n]]
        self.faults += [f"unit {n} was done again, and nobody had lost it" for n in again if n not in hand]
        if len(hand) > 4:
            self.faults.append(f"two workers had {len(hand)} units in hand")
        two = self.hosts.names[1]
        back = sum(e["name"] == two and e["time"] > self.healed_at for e in starts)
        hosts = collections.Counter(e["name"] for e in starts)
        temps = list(self.film.rglob(".tmp-*"))
        print(f"in hand of the two: units {sorted(hand)}; begun again: {again}, of {self.units}")
        print(f"begun by host: {dict(sorted(hosts.items()))}; {two} after it came back: {back}")
        print(f"run records of the film: {len(records)}; temp files left by what was killed: {len(temps)}")
        print(f"{len(own)} files: {'same bytes as one plain run' if own == self.whole else 'DIFFERENT'}")

    def in_hand(self, starts, records):
        """Units that the lost hosts had: what they were at, and what the second went on with while it was cut off."""
        two = self.hosts.names[1]
        told = {e["unit"] for e in starts if e["name"] == two and self.cut_at <= e["time"] <= self.healed_at}
        kept = {int(r["units"]) for r in records if r["host"] == two and self.cut_at <= r["finished_unix_s"] <= self.healed_at + 1}
        return {self.killed["unit"], self.severed["unit"]} | told | kept


def main():
    args = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    args.add_argument("lenscube", type=Path)
    args.add_argument("--netns", action="store_true", help="hosts are network namespaces (root)")
    args.add_argument("--size", default="1500x1500", help="of the film")
    args.add_argument("--unit-rows", default="1")
    args.add_argument("--cut", type=float, default=15, help="seconds that the second host is cut off")
    args.add_argument("--keep", type=Path, help="copy the logs there")
    args = args.parse_args()
    with tempfile.TemporaryDirectory(prefix="lenscube-hosts-") as place:
        place = Path(place)
        hosts = (Namespaces if args.netns else Processes)(["lch1", "lch2", "lch3"])
        cluster = None
        try:
            trial = Trial(args.lenscube.resolve(), place, hosts, (args.size, args.unit_rows))
            print(f"{trial.units} units of {args.size} px x 4 bands, {len(trial.whole)} files, {trial.seconds:.1f} s in one process; hosts: {hosts.words}")
            cluster, start = Cluster(hosts, place), time.monotonic()
            trial.run(cluster, args.cut)
            print(f"the drive: {time.monotonic() - start:.1f} s, workers' start and accidents included")
            trial.judge()
        finally:
            if cluster:
                cluster.close()
            hosts.close()
            if args.keep:
                args.keep.mkdir(parents=True, exist_ok=True)
                for log in [*place.glob("*.log"), *place.glob("*.jsonl")]:
                    shutil.copy(log, args.keep)
    for fault in trial.faults:
        print(f"FAULT: {fault}")
    print("FAILED" if trial.faults else "all is well")
    sys.exit(bool(trial.faults))


if __name__ == "__main__":
    main()
