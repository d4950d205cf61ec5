"""One round: executes the script, waits for all commands, resumes interrupted work, and checks the result."""
import os
import random
import shutil
import signal
import time
from dataclasses import dataclass, field
from pathlib import Path

from films import CleanFilm, compare, leftovers, provenance, same_or_missing
from inputs import digest, files
from script import ScriptWriter

TIMEOUT_S = 120  # of one command; each takes less than a second alone
POLL_S = 0.01
MAX_REPEATS = 8  # of a command that ends with 75 or 130
EXPORTS = ["npy", "png"]  # other formats contain the path of the film
# Documented exit codes of each kind of command.
CODES = {"run": {0, 1, 3, 75, 130}, "unit": {0, 1, 3, 75, 130}, "plan": {0, 1, 3, 75, 130}, "repair": {0, 1, 3, 4, 75, 130},
         "verify": {0, 1, 3, 4, 75, 130}, "status": {0, 1, 3, 4, 75}, "status-plan": {0, 1, 3, 4, 75},
         "pyramid": {0, 1, 3, 4, 75, 130}, "export": {0, 1, 3, 4, 75, 130}, "into-input": {2}}
BUILT_ROUND = 0  # has lenses as built, others have them at random
ENDED_BY_SIGNAL = {-signal.SIGKILL, -signal.SIGINT, -signal.SIGTERM}


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
    """`workspace` has the machines, disk, inputs, clean films and program; see scripts/chaos."""

    def __init__(self, workspace, seed, number, script=None):
        self.workspace, self.number = workspace, number
        self.rng = random.Random(f"{seed}/{number}")
        theme = workspace.theme or ("built" if number == BUILT_ROUND else None)
        self.script = script or ScriptWriter(self.rng, list(workspace.machines), bool(workspace.disk), theme).script
        self.folder = workspace.folder / f"round-{number}"
        self.place = (workspace.disk if self.script.small else self.folder) / "work"
        self.film = self.place / "film.zarr"
        self.commands, self.findings, self.foreign_files, self.events = {}, [], {}, []
        self.states = {}  # all states of each chart and of the pack
        # Workers that were stopped before their film was complete, and those whose film was then replaced.
        self.stopped_early, self.must_fail, self.stale_locks, self.removed = {}, set(), 0, False

    # Setup and command lines.

    def prepare(self):
        shutil.rmtree(self.folder, ignore_errors=True)
        shutil.rmtree(self.place, ignore_errors=True)
        for part in ("log", "out"):
            (self.folder / part).mkdir(parents=True)
        self.place.mkdir(parents=True, exist_ok=True)
        for job in self.script.jobs.values():
            self.put_input(f"chart-{job.chart}", self.workspace.inputs.charts[job.chart][0])
            if job.lens != "built-in":
                self.put_input("lens", self.workspace.inputs.lenses[job.lens][0])

    def put_input(self, name, state):
        self.workspace.inputs.blobs.place(state, self.folder / name)
        self.states.setdefault(name, [state])

    def argv(self, kind, job, arguments, name):
        chart, flags = self.script.jobs[job].arguments(self.folder)
        plan = self.place / f"plan-{job}.json"
        return [self.workspace.program, *{
            "run": ["run", chart, self.film, *flags, *arguments],
            "plan": ["plan", chart, self.film, "-o", plan, *flags, *arguments],
            "unit": ["run", "--plan", plan, *arguments],
            "repair": ["verify", self.film, "--repair", *arguments],
            "verify": ["verify", self.film, *arguments],
            "status": ["status", self.film, "--check", *arguments],
            "status-plan": ["status", "--plan", plan, "--missing", *arguments],
            "pyramid": ["pyramid", self.film, *arguments],
            "export": ["export", self.film, self.folder / "out" / f"{name}.{EXPORTS[self.number % 2]}", *arguments],
            "into-input": ["export", chart, chart, "--format", "npy", "--overwrite", *arguments],
        }[kind]]

    def begin(self, name, kind, job, machine, arguments, fault=None, phase="script"):
        argv = self.argv(kind, job, arguments, name)
        command = Command(name, kind, job, self.workspace.machines[machine], argv, fault, phase=phase)
        env = {"LENSCUBE_FAULT": fault} if fault else {}
        log = self.folder / "log" / name
        command.process = command.machine.start(argv, f"{log}.out", f"{log}.err", env | self.workspace.env)
        command.began = time.monotonic()
        self.commands[name] = command
        self.event(f"{name} on {machine}")
        return command

    def event(self, text):
        self.events.append([round(time.monotonic() - self.start, 3), text])

    def finding(self, text):
        self.findings.append(text)
        self.event(f"FINDING {text}")

    def poll(self, command):
        """State "running", "stopped" or "ended"; records the exit code."""
        if command.code is not None:
            return "ended"
        state, code = command.machine.state(command.process)
        seconds = time.monotonic() - command.began
        if state == "ended":
            command.code, command.seconds = code, seconds
            self.event(f"{command.name} ends with {code}")
            self.check_end(command)
        elif seconds > self.workspace.timeout_s and state == "running":
            self.finding(f"{command.name} did not end in {seconds:.0f} s: {command.machine.where(command.process)}")
            command.machine.signal(command.process, signal.SIGKILL)
            command.began = time.monotonic()
        return state

    def stderr_of(self, command):
        return (self.folder / "log" / f"{command.name}.err").read_text(errors="replace")

    def check_end(self, command):
        """Checks exit code and stderr of a command that has ended."""
        stderr = self.stderr_of(command)
        killed = command.code in ENDED_BY_SIGNAL and (command.signals or command.fault)
        if command.code not in CODES[command.kind] and not killed:
            self.finding(f"{command.name} ended with {command.code}: {stderr[-300:]!r}")
        if "panicked" in stderr or "RUST_BACKTRACE" in stderr:
            self.finding(f"{command.name} panicked: {stderr[-400:]!r}")
        if command.name in self.must_fail and command.code == 0:
            self.finding(f"{command.name} ended with 0, but its film was replaced while it was stopped, and not complete before")

    def wait_for_end(self, command):
        while self.poll(command) != "ended":
            if self.poll(command) == "stopped":
                command.machine.signal(command.process, signal.SIGCONT)
            time.sleep(POLL_S)
        return command.code

    def call(self, kind, job, machine="A", arguments=(), phase="after"):
        name = f"{len(self.commands) + 1}-{kind}-{job}"
        return self.wait_for_end(self.begin(name, kind, job, machine, [*arguments], phase=phase))

    # The script.

    def execute(self):
        self.start = time.monotonic()
        shift = self.start
        for step in self.script.steps:
            due = step["at"] * self.workspace.unit_s + shift
            while (left := due - time.monotonic()) > 0:
                time.sleep(min(left, 0.05))
            getattr(self, f"do_{step['do']}")(step)
            if step["do"] in ("wait", "input"):
                shift = time.monotonic() - step["at"] * self.workspace.unit_s

    def do_start(self, s):
        self.begin(s["name"], s["kind"], s["job"], s["machine"], s["arguments"], s["fault"])

    def do_signal(self, s):
        command = self.commands[s["name"]]
        if self.poll(command) != "ended":
            command.signals.append(s["signal"])
            command.machine.signal(command.process, signal.Signals[f"SIG{s['signal']}"])
            self.event(f"SIG{s['signal']} to {s['name']}")

    def do_wait(self, s):
        while any(self.poll(self.commands[n]) == "running" for n in s["names"]):
            time.sleep(POLL_S)

    def do_record_stopped(self, s):
        """Records which stopped runs have not completed their film."""
        clean = self.clean("A", self.states[f"chart-{self.script.jobs['A'].chart}"][0], self.lens_states("A")[0])
        for name in s["names"]:
            if self.poll(self.commands[name]) == "stopped" and self.commands[name].kind == "run":
                present = files(self.film) if self.film.exists() else []
                self.stopped_early[name] = not set(clean.files) <= set(present)

    def do_check_stopped(self, s):
        other = self.commands[s["other"]]
        if self.poll(other) == "ended" and other.code == 0 and self.owner() and self.owner()[0] == "B":
            for name in s["names"]:
                if self.stopped_early.get(name) and self.poll(self.commands[name]) == "stopped":
                    self.must_fail.add(name)
                    self.event(f"{name} is stopped while its film is replaced")

    def do_input(self, s):
        job = self.script.jobs["A"]
        name = f"chart-{job.chart}" if s["what"] == "chart" else "lens"
        versions = self.workspace.inputs.charts[job.chart] if s["what"] == "chart" else self.workspace.inputs.lenses[job.lens]
        folder, new, blobs = self.folder / name, versions[s["version"]], self.workspace.inputs.blobs
        now = blobs.state(folder)
        # Pixels and tables only: changed metadata make another chart, which is detected at once.
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
        filler = self.workspace.disk / "filler"
        if s["leave"] is None:
            filler.unlink(missing_ok=True)
            return self.event("the disk is freed")
        free = os.statvfs(self.workspace.disk)
        size = max(0, free.f_bavail * free.f_frsize - s["leave"])
        try:
            with open(filler, "ab") as f:
                f.write(bytes(size))
        except OSError:
            pass  # a command has filled the disk
        self.event(f"the disk is filled, {s['leave']} bytes left")

    def do_remove(self, s):
        self.event("the film is removed")
        self.removed = True
        self.must_fail.clear()  # a run that was stopped before it opened the film makes its own now
        for _ in range(20):
            shutil.rmtree(self.film, ignore_errors=True)
            if not self.film.exists():
                return
            time.sleep(0.01)

    def do_foreign_file(self, s):
        path = self.place / s["place"]
        try:
            path.write_text(f"not of the program: {s['place']}\n")
        except OSError:
            path.unlink(missing_ok=True) if path.parent.is_dir() else None
            return  # the film does not exist at this moment, or the disk is full
        self.foreign_files[s["place"]] = digest(path)
        self.event(f"foreign file {s['place']}")

    # Resuming and checking.

    def lens_states(self, job):
        return [None] if self.script.jobs[job].lens == "built-in" else self.states["lens"]

    def clean(self, job, chart, lens):
        return self.workspace.clean.get(self.script.jobs[job], chart, lens)

    def owner(self):
        """(job, clean film) of the job in the film's metadata, for any state of chart and pack; None if there is none."""
        found = provenance(self.film)
        if found is None:
            return None
        changing = {"chart", "chart_mtimes", "chart_sample", "lens_digest"}
        for name, job in self.script.jobs.items():
            charts = self.states[f"chart-{job.chart}"]
            for lens in self.lens_states(name):
                for chart in charts:
                    clean = self.clean(name, chart, lens)
                    if not isinstance(clean, CleanFilm):
                        continue
                    if clean.provenance == found:
                        return name, clean
                    same = lambda a, b: {k: v for k, v in a.items() if k not in changing} == {k: v for k, v in b.items() if k not in changing}
                    if not same(clean.provenance["job"], found["job"]) or clean.provenance["layout"] != found["layout"]:
                        break
        return None

    def check_film(self, when, complete):
        """Compares the film with the clean film of the job in its metadata."""
        if not self.film.exists():
            if complete:
                self.finding(f"{when}: reported as complete, but there is no film")
            return
        owner = self.owner()
        if owner is None:
            if complete:
                self.finding(f"{when}: the metadata name a job that no chart and pack of this round gives")
            return
        name, clean = owner
        pyramid = self.workspace.clean.pyramid(clean) if (self.film / "pyramid").exists() else None
        foreign_files = {s.removeprefix("film.zarr/") for s in self.foreign_files}
        wrong = compare(self.film, clean, pyramid, foreign_files, complete)
        if wrong:
            state = "reported as complete" if complete else "incomplete"
            self.finding(f"{when}: film of job {name}, {state}: {len(wrong)} wrong files: {wrong[:4]}")

    def end_all(self):
        """Continues stopped commands and waits for all."""
        for command in list(self.commands.values()):
            if self.poll(command) == "stopped":
                command.machine.signal(command.process, signal.SIGCONT)
        for command in list(self.commands.values()):
            self.wait_for_end(command)
        if self.workspace.disk:
            (self.workspace.disk / "filler").unlink(missing_ok=True)

    def repeat(self, kind, job, arguments=()):
        """Repeats a command while it ends with 75 or 130, alternating machines, and finally with --take-over."""
        machines = list(dict.fromkeys(["A", self.script.second]))
        for k in range(MAX_REPEATS):
            # Only the machine of an ended process detects that its lock is stale; elsewhere it needs --take-over.
            more = ["--take-over"] if k >= len(machines) else []
            code = self.call(kind, job, machines[k % len(machines)], [*arguments, *more])
            if code not in (75, 130):
                return code
        self.finding(f"{kind} of job {job} still ends with {code} when nothing else runs")
        return code

    def resume(self):
        """Resumes interrupted work. Returns the job whose film is complete, or None."""
        done = [c for c in self.commands.values() if c.phase == "script"]
        if self.restored():
            for name, states in self.states.items():
                self.workspace.inputs.blobs.place(states[0], self.folder / name)
            self.event("chart and pack are restored")
        if self.film.exists() and self.call("status", "A") == 0:
            self.check_film("status --check ended with 0", True)
        elif not self.changed():
            self.check_film("at rest", False)
        jobs = list(dict.fromkeys((c.kind, c.job) for c in done if c.kind in ("run", "unit", "plan")))
        for kind, job in jobs:
            if kind == "plan" or (kind == "unit" and not (self.place / f"plan-{job}.json").exists()):
                continue
            if self.repeat(kind, job) == 0:
                self.check_film(f"{kind} of job {job} resumed", True)
                owner = self.owner()
                if owner and owner[0] != job:
                    self.finding(f"{kind} of job {job} ended with 0 on the film of job {owner[0]}")
                return job
        return None

    def is_of_first_inputs(self, job):
        """Whether the film is that of the chart and pack of the beginning. Units compare the bands of the pack that they use, so those of a plan also
        complete the film of a pack that differed in other bands; a run of the restored pack is another job then."""
        chart = self.states[f"chart-{self.script.jobs[job].chart}"][0]
        clean = self.clean(job, chart, self.lens_states(job)[0])
        return isinstance(clean, CleanFilm) and clean.provenance == provenance(self.film)

    def finish(self):
        job = self.resume()
        if job is None or (self.changed() and not self.restored()) or not self.is_of_first_inputs(job):
            job = self.script.last
            if not self.overwrite(job):
                return
            self.check_film(f"job {job} overwritten", True)
        # Only the machine of an ended process can detect that it has ended and remove its files.
        for machine in dict.fromkeys((self.script.second, "A")):
            if self.call("run", job, machine) != 0:
                self.finding(f"run of job {job}, complete, does not end with 0 on machine {machine}")
        if (self.film / "pyramid").exists():
            if self.call("pyramid", job) == 0 and (owner := self.owner()):
                if wrong := [n for n in self.workspace.clean.pyramid(owner[1]) if not (self.film / n).exists()]:
                    self.finding(f"the pyramid is reported as complete, but lacks {wrong[:4]}")
            else:
                self.finding("the pyramid of a complete film cannot be made")
            self.check_film("after the pyramid", True)
        if self.script.verify and self.call("verify", job) != 0:
            self.finding("verify finds the complete film wrong")
        self.leftovers(job)

    def overwrite(self, job):
        """Makes the film with --overwrite. Returns whether that ended with 0; it may be rejected while the film has foreign files."""
        code = self.repeat("run", job, ["--overwrite"])
        inside = [place for place in self.foreign_files if place.startswith("film.zarr/")]
        if code == 3 and inside:
            self.check_foreign_files()
            for place in inside:
                self.event(f"{place} is removed")
                (self.place / place).unlink(missing_ok=True)
                del self.foreign_files[place]
            code = self.repeat("run", job, ["--overwrite"])
        if code != 0:
            self.finding(f"run --overwrite of job {job} ends with {code} when nothing else runs")
        return code == 0

    def leftovers(self, job):
        """Temporary files and locks. The lock of a killed worker remains if its units were not executed again; it must not prevent
        --overwrite."""
        found = leftovers(self.place, self.foreign_files)
        units = [name for name in found if Path(name).name.startswith("units-")]
        self.findings += [f"left behind: {name}" for name in found if name not in units]
        if units:
            self.stale_locks = len(units)
            if self.overwrite(job):
                self.check_film("overwritten in spite of locks", True)
            self.findings += [f"left behind: {name}" for name in leftovers(self.place, self.foreign_files)]

    def check_others(self):
        """Charts, packs and foreign files must be unchanged; exports that ended with 0 must be of one film."""
        for name, states in self.states.items():
            now = {n: sha for n, (sha, _) in self.workspace.inputs.blobs.state(self.folder / name).items()}
            last = states[0] if self.restored() else states[-1]
            if now != {n: sha for n, (sha, _) in last.items()}:
                self.finding(f"{name} was changed by the program")
        self.check_foreign_files()
        for command in self.commands.values():
            if command.kind == "export" and command.code == 0:
                self.check_export(command, Path(command.argv[3]))

    def changed(self):
        return any(len(states) > 1 for states in self.states.values())

    def restored(self):
        return self.script.restore and self.changed()

    def check_foreign_files(self):
        for place, sha in self.foreign_files.items():
            path = self.place / place
            removed = place.startswith("film.zarr/") and self.removed
            if not path.exists():
                if not removed:
                    self.finding(f"{place}, not of the program, is gone")
            elif digest(path) != sha:
                self.finding(f"{place}, not of the program, was changed")

    def check_export(self, command, out):
        """The export must be of one film; of an incomplete one with a message, and NaN for missing samples."""
        unfinished = "samples are missing" in self.stderr_of(command)
        if unfinished and out.suffix != ".npy":
            return
        found = out.read_bytes()
        for name, job in self.script.jobs.items():
            for lens in self.lens_states(name):
                for chart in self.states[f"chart-{job.chart}"]:
                    clean = self.clean(name, chart, lens)
                    if not isinstance(clean, CleanFilm):
                        continue
                    of_clean = self.workspace.clean.export(clean, out.suffix[1:])
                    if found == of_clean or (unfinished and same_or_missing(found, of_clean)):
                        return
        self.finding(f"{out.name} ended with 0 and is not the export of one film")

    def run(self):
        began = time.monotonic()
        self.prepare()
        self.execute()
        self.end_all()
        self.finish()
        self.check_others()
        self.seconds = time.monotonic() - began
        return self

    def record(self):
        """The log entry."""
        commands = [[c.name, c.machine.name, c.phase, c.code, round(c.seconds, 2), c.signals, c.fault] for c in self.commands.values()]
        jobs = {n: [j.chart, j.lens, *j.flags] for n, j in self.script.jobs.items()}
        return {"round": self.number, "theme": self.script.theme, "second": self.script.second, "small": self.script.small, "jobs": jobs,
                "seconds": round(self.seconds, 2), "commands": commands, "events": self.events, "findings": self.findings}

    def clear(self):
        shutil.rmtree(self.folder, ignore_errors=True)
        shutil.rmtree(self.place, ignore_errors=True)
