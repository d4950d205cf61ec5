"""One round: the script is executed, everything is let end, interrupted work is resumed, and the result is checked."""
import os
import random
import shutil
import signal
import time
from dataclasses import dataclass, field
from pathlib import Path

from films import CleanFilm, compare, leftovers, provenance, same_or_missing
from inputs import digest, files
from script import Writer

LIMIT_S = 120  # for one command; none of them takes a second alone
POLL_S = 0.01
AGAIN = 8  # commands again while they end with 75 or 130
EXPORTS = ["npy", "png"]  # the others name the film's path
# Exit codes that are documented, by kind of command.
CODES = {"run": {0, 1, 3, 75, 130}, "unit": {0, 1, 3, 75, 130}, "plan": {0, 1, 3, 75, 130}, "repair": {0, 1, 3, 4, 75, 130},
         "verify": {0, 1, 3, 4, 75, 130}, "status": {0, 1, 3, 4, 75}, "status-plan": {0, 1, 3, 4, 75},
         "pyramid": {0, 1, 3, 4, 75, 130}, "export": {0, 1, 3, 4, 75, 130}}
ENDED_BY_US = {-signal.SIGKILL, -signal.SIGINT, -signal.SIGTERM}


@dataclass
class Command:
    name: str
    kind: str
    job: str
    machine: object
    argv: list
    fault: str
    process: int = 0
    began: float = 0.0
    code: int = None
    seconds: float = 0.0
    signals: list = field(default_factory=list)
    phase: str = "script"


class Round:
    """`slot` has machines, disk, inputs, clean films, the program; see the main program."""

    def __init__(self, slot, seed, number, script=None):
        self.slot, self.number = slot, number
        self.rng = random.Random(f"{seed}/{number}")
        self.script = script or Writer(self.rng, list(slot.machines), bool(slot.disk), slot.theme).script
        self.folder = slot.folder / f"round-{number}"
        self.place = (slot.disk if self.script.small else self.folder) / "work"
        self.film = self.place / "film.zarr"
        self.commands, self.findings, self.strays, self.events = {}, [], {}, []
        self.states = {}  # states that each chart, and the pack, went through
        self.asleep, self.must_fail, self.stale_locks, self.removed = {}, set(), 0, False

    # Set-up, and what the commands are.

    def prepare(self):
        shutil.rmtree(self.folder, ignore_errors=True)
        shutil.rmtree(self.place, ignore_errors=True)
        for part in ("log", "out"):
            (self.folder / part).mkdir(parents=True)
        self.place.mkdir(parents=True, exist_ok=True)
        for job in self.script.jobs.values():
            self.put_input(f"chart-{job.chart}", self.slot.inputs.charts[job.chart][0])
            if job.lens != "built-in":
                self.put_input("lens", self.slot.inputs.lenses[job.lens][0])

    def put_input(self, name, state):
        self.slot.inputs.blobs.place(state, self.folder / name)
        self.states.setdefault(name, [state])

    def argv(self, kind, job, words, name):
        chart, flags = self.script.jobs[job].words(self.folder)
        plan = self.place / f"plan-{job}.json"
        return [self.slot.program, *{
            "run": ["run", chart, self.film, *flags, *words],
            "plan": ["plan", chart, self.film, "-o", plan, *flags, *words],
            "unit": ["run", "--plan", plan, *words],
            "repair": ["verify", self.film, "--repair", *words],
            "verify": ["verify", self.film, *words],
            "status": ["status", self.film, "--check", *words],
            "status-plan": ["status", "--plan", plan, "--missing", *words],
            "pyramid": ["pyramid", self.film, *words],
            "export": ["export", self.film, self.folder / "out" / f"{name}.{EXPORTS[self.number % 2]}", *words],
        }[kind]]

    def begin(self, name, kind, job, machine, words, fault=None, phase="script"):
        argv = self.argv(kind, job, words, name)
        command = Command(name, kind, job, self.slot.machines[machine], argv, fault, phase=phase)
        env = {"LENSCUBE_FAULT": fault} if fault else {}
        log = self.folder / "log" / name
        command.process = command.machine.start(argv, f"{log}.out", f"{log}.err", env | self.slot.env)
        command.began = time.monotonic()
        self.commands[name] = command
        self.event(f"{name} on {machine}")
        return command

    def event(self, text):
        self.events.append([round(time.monotonic() - self.start, 3), text])

    def finding(self, text):
        self.findings.append(text)
        self.event(f"FINDING {text}")

    def look(self, command):
        """"running", "stopped" or "ended"; notes the exit code."""
        if command.code is not None:
            return "ended"
        state, code = command.machine.state(command.process)
        taken = time.monotonic() - command.began
        if state == "ended":
            command.code, command.seconds = code, taken
            self.event(f"{command.name} ends with {code}")
            self.judge(command)
        elif taken > self.slot.limit_s and state == "running":
            self.finding(f"{command.name} did not end in {taken:.0f} s: {command.machine.where(command.process)}")
            command.machine.signal(command.process, signal.SIGKILL)
            command.began = time.monotonic()
        return state

    def words(self, command):
        return (self.folder / "log" / f"{command.name}.err").read_text(errors="replace")

    def judge(self, command):
        """Exit code and words of a command that has ended."""
        words = self.words(command)
        killed = command.code in ENDED_BY_US and (command.signals or command.fault)
        if command.code not in CODES[command.kind] and not killed:
            self.finding(f"{command.name} ended with {command.code}: {words[-300:]!r}")
        if "panicked" in words or "RUST_BACKTRACE" in words:
            self.finding(f"{command.name} panicked: {words[-400:]!r}")
        if command.name in self.must_fail and command.code == 0:
            self.finding(f"{command.name} ended with 0, but its film was replaced while it was stopped, and not complete before")

    def settle_one(self, command):
        while self.look(command) != "ended":
            if self.look(command) == "stopped":
                command.machine.signal(command.process, signal.SIGCONT)
            time.sleep(POLL_S)
        return command.code

    def call(self, kind, job, machine="A", words=(), phase="after"):
        name = f"{len(self.commands) + 1}-{kind}-{job}"
        return self.settle_one(self.begin(name, kind, job, machine, [*words], phase=phase))

    # The script.

    def execute(self):
        self.start = time.monotonic()
        shift = self.start
        for step in self.script.steps:
            due = step["at"] * self.slot.unit_s + shift
            while (left := due - time.monotonic()) > 0:
                time.sleep(min(left, 0.05))
            getattr(self, f"do_{step['do']}")(step)
            if step["do"] in ("wait", "input"):
                shift = time.monotonic() - step["at"] * self.slot.unit_s

    def do_start(self, s):
        self.begin(s["name"], s["kind"], s["job"], s["machine"], s["words"], s["fault"])

    def do_signal(self, s):
        command = self.commands[s["name"]]
        if self.look(command) != "ended":
            command.signals.append(s["signal"])
            command.machine.signal(command.process, signal.Signals[f"SIG{s['signal']}"])
            self.event(f"SIG{s['signal']} to {s['name']}")

    def do_wait(self, s):
        while any(self.look(self.commands[n]) == "running" for n in s["names"]):
            time.sleep(POLL_S)

    def do_sleep(self, s):
        """Notes which sleepers are stopped before the film is theirs and complete."""
        clean = self.clean("A", self.states[f"chart-{self.script.jobs['A'].chart}"][0], self.lens_states("A")[0])
        for name in s["names"]:
            if self.look(self.commands[name]) == "stopped" and self.commands[name].kind == "run":
                there = files(self.film) if self.film.exists() else []
                self.asleep[name] = not set(clean.files) <= set(there)

    def do_awake(self, s):
        other = self.commands[s["other"]]
        if self.look(other) == "ended" and other.code == 0 and self.owner() and self.owner()[0] == "B":
            for name in s["names"]:
                if self.asleep.get(name) and self.look(self.commands[name]) == "stopped":
                    self.must_fail.add(name)
                    self.event(f"{name} sleeps while its film is replaced")

    def do_input(self, s):
        job = self.script.jobs["A"]
        name = f"chart-{job.chart}" if s["what"] == "chart" else "lens"
        versions = self.slot.inputs.charts[job.chart] if s["what"] == "chart" else self.slot.inputs.lenses[job.lens]
        folder, new, blobs = self.folder / name, versions[s["version"]], self.slot.inputs.blobs
        now = blobs.state(folder)
        # Pixels and tables only: metadata that change are another chart, which is told at once.
        changed = [n for n in new if now[n][0] != new[n][0] and not n.endswith((".json", ".hdr"))]
        if s["how"] == "rename one":
            changed = changed[:1] if len(changed) > 1 else changed
        self.event(f"{name}: {len(changed)} files {s['how']}, version {s['version']}")
        for file in changed:
            if s["how"] in ("rename", "rename one"):
                blobs.put(*new[file], folder / file)
            else:
                halves = {"in place": ["whole"], "in halves": ["first half", "whole"], "truncate": ["truncate"]}[s["how"]]
                for half in halves:
                    blobs.put(*new[file], folder / file, half)
                    self.states[name].append(blobs.state(folder))
                    time.sleep(max(s["pause"], 0.02))
            self.states[name].append(blobs.state(folder))
            time.sleep(s["pause"])

    def do_disk(self, s):
        filler = self.slot.disk / "filler"
        if s["leave"] is None:
            filler.unlink(missing_ok=True)
            return self.event("the disk is freed")
        free = os.statvfs(self.slot.disk)
        size = max(0, free.f_bavail * free.f_frsize - s["leave"])
        try:
            with open(filler, "ab") as f:
                f.write(bytes(size))
        except OSError:
            pass  # a command was quicker: the disk is full either way
        self.event(f"the disk is filled, {s['leave']} bytes left")

    def do_remove(self, s):
        self.event("the film is removed")
        self.removed = True
        for _ in range(20):
            shutil.rmtree(self.film, ignore_errors=True)
            if not self.film.exists():
                return
            time.sleep(0.01)

    def do_stray(self, s):
        path = self.place / s["place"]
        try:
            path.write_text(f"not of the program: {s['place']}\n")
        except OSError:
            path.unlink(missing_ok=True) if path.parent.is_dir() else None
            return  # no such film now, or the disk is full
        self.strays[s["place"]] = digest(path)
        self.event(f"stray {s['place']}")

    # Afterwards.

    def lens_states(self, job):
        return [None] if self.script.jobs[job].lens == "built-in" else self.states["lens"]

    def clean(self, job, chart, lens):
        return self.slot.clean.get(self.script.jobs[job], chart, lens)

    def owner(self):
        """Whose film it is by its own metadata: (job, clean film), or None. Every state that chart and pack went through counts."""
        told = provenance(self.film)
        if told is None:
            return None
        changing = {"chart", "chart_mtimes", "lens_digest"}
        for name, job in self.script.jobs.items():
            charts = self.states[f"chart-{job.chart}"]
            for lens in self.lens_states(name):
                for chart in charts:
                    clean = self.clean(name, chart, lens)
                    if not isinstance(clean, CleanFilm):
                        continue
                    if clean.provenance == told:
                        return name, clean
                    same = lambda a, b: {k: v for k, v in a.items() if k not in changing} == {k: v for k, v in b.items() if k not in changing}
                    if not same(clean.provenance["job"], told["job"]) or clean.provenance["layout"] != told["layout"]:
                        break
        return None

    def check_film(self, when, complete):
        """Compares the film with the clean film of the job that its metadata name."""
        if not self.film.exists():
            if complete:
                self.finding(f"{when}: said to be complete, but there is no film")
            return
        owner = self.owner()
        if owner is None:
            if complete:
                self.finding(f"{when}: the film names a job that none of this round's charts and packs gives")
            return
        name, clean = owner
        pyramid = self.slot.clean.pyramid(clean) if (self.film / "pyramid").exists() else None
        strays = {s.removeprefix("film.zarr/") for s in self.strays}
        wrong = compare(self.film, clean, pyramid, strays, complete)
        if wrong:
            said = "said to be complete" if complete else "incomplete"
            self.finding(f"{when}: film of job {name}, {said}: {len(wrong)} files wrong: {wrong[:4]}")

    def rest(self):
        """Everything goes on and ends."""
        for command in list(self.commands.values()):
            if self.look(command) == "stopped":
                command.machine.signal(command.process, signal.SIGCONT)
        for command in list(self.commands.values()):
            self.settle_one(command)
        if self.slot.disk:
            (self.slot.disk / "filler").unlink(missing_ok=True)

    def again(self, kind, job, words=()):
        """The command until it ends with neither 75 nor 130, on each machine in turn, at last with --take-over."""
        machines = list(dict.fromkeys(["A", self.script.second]))
        for k in range(AGAIN):
            # A lock of a dead process of the other machine is known as such there; a person would say --take-over here.
            more = ["--take-over"] if k >= len(machines) else []
            code = self.call(kind, job, machines[k % len(machines)], [*words, *more])
            if code not in (75, 130):
                return code
        self.finding(f"{kind} of job {job} still ends with {code} when nothing else runs")
        return code

    def resume(self):
        """Interrupted work is gone on with. Whether some job's film is complete now."""
        done = [c for c in self.commands.values() if c.phase == "script"]
        if self.restored():
            for name, states in self.states.items():
                self.slot.inputs.blobs.place(states[0], self.folder / name)
            self.event("chart and pack are put back")
        if self.film.exists() and self.call("status", "A") == 0:
            self.check_film("status --check ended with 0", True)
        elif not self.changed():
            self.check_film("at rest", False)
        jobs = list(dict.fromkeys((c.kind, c.job) for c in done if c.kind in ("run", "unit", "plan")))
        for kind, job in jobs:
            if kind == "plan" or (kind == "unit" and not (self.place / f"plan-{job}.json").exists()):
                continue
            if self.again(kind, job) == 0:
                self.check_film(f"{kind} of job {job} gone on with", True)
                owner = self.owner()
                if owner and owner[0] != job:
                    self.finding(f"{kind} of job {job} ended with 0 on the film of job {owner[0]}")
                return job
        return None

    def finish(self):
        job = self.resume()
        if job is None or (self.changed() and not self.restored()):
            job = self.script.last
            if not self.anew(job):
                return
            self.check_film(f"job {job} made anew", True)
        # What the dead of a machine left, only that machine can know to be dead.
        for machine in dict.fromkeys((self.script.second, "A")):
            if self.call("run", job, machine) != 0:
                self.finding(f"run of job {job}, complete, does not end with 0 on machine {machine}")
        if (self.film / "pyramid").exists():
            if self.call("pyramid", job) == 0 and (owner := self.owner()):
                if wrong := [n for n in self.slot.clean.pyramid(owner[1]) if not (self.film / n).exists()]:
                    self.finding(f"the pyramid is said to be complete, but lacks {wrong[:4]}")
            else:
                self.finding("the pyramid of a complete film cannot be made")
            self.check_film("after the pyramid", True)
        if self.script.verify and self.call("verify", job) != 0:
            self.finding("verify finds the complete film wrong")
        self.leftovers(job)

    def anew(self, job):
        """The film is begun anew; whether that ended with 0. A film that holds files of nobody's may be refused until they are gone."""
        code = self.again("run", job, ["--overwrite"])
        inside = [place for place in self.strays if place.startswith("film.zarr/")]
        if code == 3 and inside:
            self.check_strays()
            for place in inside:
                self.event(f"{place} is taken away")
                (self.place / place).unlink(missing_ok=True)
                del self.strays[place]
            code = self.again("run", job, ["--overwrite"])
        if code != 0:
            self.finding(f"run --overwrite of job {job} ends with {code} when nothing else runs")
        return code == 0

    def leftovers(self, job):
        """Temp files, and locks in the way. That of a worker killed at units that nobody asked for again stays: the film can be made
        anew in spite of it."""
        found = leftovers(self.place, self.strays)
        units = [name for name in found if Path(name).name.startswith("units-")]
        self.findings += [f"left behind: {name}" for name in found if name not in units]
        if units:
            self.stale_locks = len(units)
            if self.anew(job):
                self.check_film("made anew in spite of locks", True)
            self.findings += [f"left behind: {name}" for name in leftovers(self.place, self.strays)]

    def check_others(self):
        """Charts, packs and files of nobody's are as the round left them; exports that ended with 0 are of one film."""
        for name, states in self.states.items():
            now = {n: sha for n, (sha, _) in self.slot.inputs.blobs.state(self.folder / name).items()}
            last = states[0] if self.restored() else states[-1]
            if now != {n: sha for n, (sha, _) in last.items()}:
                self.finding(f"{name} was changed by the program")
        self.check_strays()
        for command in self.commands.values():
            if command.kind == "export" and command.code == 0:
                self.check_export(command, Path(command.argv[3]))

    def changed(self):
        return any(len(states) > 1 for states in self.states.values())

    def restored(self):
        return self.script.restore and self.changed()

    def check_strays(self):
        for place, sha in self.strays.items():
            path = self.place / place
            removed = place.startswith("film.zarr/") and self.removed
            if not path.exists():
                if not removed:
                    self.finding(f"{place}, not of the program, is gone")
            elif digest(path) != sha:
                self.finding(f"{place}, not of the program, was changed")

    def check_export(self, command, out):
        """It is the export of one film; of an unfinished one with a note, and NaN for what was missing."""
        unfinished = "samples are missing" in self.words(command)
        if unfinished and out.suffix != ".npy":
            return
        found = out.read_bytes()
        for name, job in self.script.jobs.items():
            for lens in self.lens_states(name):
                for chart in self.states[f"chart-{job.chart}"]:
                    clean = self.clean(name, chart, lens)
                    if not isinstance(clean, CleanFilm):
                        continue
                    of_clean = self.slot.clean.export(clean, out.suffix[1:])
                    if found == of_clean or (unfinished and same_or_missing(found, of_clean)):
                        return
        self.finding(f"{out.name} ended with 0 and is not the export of one film")

    def run(self):
        began = time.monotonic()
        self.prepare()
        self.execute()
        self.rest()
        self.finish()
        self.check_others()
        self.seconds = time.monotonic() - began
        return self

    def record(self):
        """What the log keeps."""
        commands = [[c.name, c.machine.name, c.phase, c.code, round(c.seconds, 2), c.signals, c.fault] for c in self.commands.values()]
        jobs = {n: [j.chart, j.lens, *j.flags] for n, j in self.script.jobs.items()}
        return {"round": self.number, "theme": self.script.theme, "second": self.script.second, "small": self.script.small, "jobs": jobs,
                "seconds": round(self.seconds, 2), "commands": commands, "events": self.events, "findings": self.findings}

    def clear(self):
        shutil.rmtree(self.folder, ignore_errors=True)
        shutil.rmtree(self.place, ignore_errors=True)
