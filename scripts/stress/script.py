"""Script of a round: steps and their times, drawn from the round's random generator before the start, so that it is repeatable.

Times are in units of the duration of one clean run on this machine. Steps:

    start   a command: its name, machine, kind, job, arguments, LENSCUBE_FAULT
    signal  KILL, STOP, CONT, INT or TERM to a command
    wait    until these commands have ended or stopped
    input   changes the chart or the pack: how, to which version
    disk    fills or frees the disk of the film
    remove  removes the film
    record_stopped, check_stopped  record which commands are stopped before and after the film is replaced
    foreign_file                   puts a file of another program beside or into the film
"""
from dataclasses import dataclass, field

from films import Job
from inputs import CHARTS

# Flags by which job B differs from A. With the first ones both films have files of equal names and sizes in pixels.
OTHERS = [("--azimuths", "8"), ("--stages", "ri"), ("--interp", "bilinear"), ("--surround", "black"), ("--bands", "0:2"),
          ("--codec", "none"), ("--dtype", "f16"), ("--veiling-glare", "2%")]
LAYOUTS = [("--shard", "64", "--chunk", "32"), ("--shard", "64", "--chunk", "64"), ("--shard", "128", "--chunk", "64")]
FAULTS = ["create", "write", "sync", "rename", "sync-directory", "remove", "read", "publish", "sweep"]
# Fault points at which the program can be stopped or killed, passed once or often in a run; see formats/src/durable/fault.rs.
ONCE = ["film-opened", "job-ready", "locked", "tiles-begin", "film-removed", "shards-made", "verified", "shard-aside"]
OFTEN = ["commit", "commit-checked", "layer-made", "layer-committed"]
VEIL = ("--scatter", "3%,r0=5,slope=2.2")
FOREIGN_FILES = ["notes.txt", "film.zarr/notes.txt", "film.zarr/film/c/notes.txt", ".tmp-notes", "film.zarr/.DS_Store"]
THEMES = {"workers": 4, "runs": 4, "sleeper": 5, "input": 4, "disk": 3, "mixture": 3, "built": 1}


@dataclass
class Script:
    theme: str
    jobs: dict
    second: str  # the other machine
    small: bool  # whether the film is on the small disk
    unit_rows: int
    restore: bool  # whether changed charts are restored before work is resumed
    last: str  # the job for --overwrite if none can be resumed
    steps: list = field(default_factory=list)
    verify: bool = False


class ScriptWriter:
    """Generates a random script."""

    def __init__(self, rng, machines, disk, theme=None):
        self.rng, self.began, self.count = rng, {}, 0
        themes = {k: v for k, v in THEMES.items() if k != "disk" or disk}
        drawn = rng.choices(list(themes), list(themes.values()))[0]
        theme = theme or drawn
        chart = rng.choice(list(CHARTS))
        lens = rng.choices(["built-in", "pack", "zip"], [5, 3, 1])[0]
        layout = rng.choice(LAYOUTS)
        other = rng.choices(OTHERS, [6, 3, 3, 1, 1, 1, 1, 1])[0]
        if theme == "built":
            lens, other = "built", ("--lens-sample", "1")
        # A run without --codec keeps the codec of an existing film, so that B would not be another job.
        codec = ("--codec", "lz4") if other[0] == "--codec" else ()
        # Light that spreads far: a layer per band, computed before its tiles.
        scatter = () if lens == "built" else rng.choice([(), (), VEIL])
        jobs = {"A": Job("A", chart, lens, ("--azimuths", "4", *codec, *scatter, *layout))}
        flags = (*other, *scatter, *layout) if other[0] == "--azimuths" else ("--azimuths", "4", *other, *scatter, *layout)
        jobs["B"] = Job("B", chart if rng.random() < 0.7 else rng.choice(list(CHARTS)), lens, flags)
        second = rng.choice([m for m in machines if m != "A"] or ["A"])
        small = theme == "disk" or (disk and rng.random() < 0.05)
        self.script = Script(theme, jobs, second, small, rng.choice([1, 1, 2]), rng.random() < 0.5, rng.choice("AB"))
        self.script.verify = rng.random() < 0.3
        getattr(self, theme)()
        self.other_commands()
        self.script.steps.sort(key=lambda s: s["at"])

    def machine(self):
        return self.rng.choice(["A", self.script.second])

    def step(self, do, at, **more):
        if do == "start":
            self.began[more["name"]] = at
        elif do == "signal":
            at = max(at, self.began[more["name"]] + 0.001)
        self.script.steps.append({"at": round(at, 3), "do": do, **more})

    def start(self, kind, job, at, machine=None, arguments=(), fault=None):
        self.count += 1
        name = f"{self.count}-{kind}-{job}"
        threads = [] if kind in ("status", "status-plan", "export", "into-input") else ["--threads", str(self.rng.choice([1, 2]))]
        arguments = [*threads, *arguments]
        self.step("start", at, name=name, machine=machine or self.machine(), kind=kind, job=job, arguments=arguments, fault=fault)
        return name

    def fault(self, what):
        """A fault point at which the program is killed or stopped, or a step that fails with an errno."""
        if what in ("stop", "kill") and self.rng.random() < 0.5:
            step, n = (self.rng.choice(ONCE), 1) if self.rng.random() < 0.6 else (self.rng.choice(OFTEN), self.rng.randint(1, 30))
            return f"{step}:{n}:{what}"
        step = self.rng.choices(FAULTS, [3, 3, 2, 8, 2, 1, 2, 2, 1])[0]
        return f"{step}:{self.rng.choice([1, 2, 3, 5, 8, 13, 20, 30])}:{what}"

    def send_signals(self, name, at, span=1.2):
        """Random signals to a command, at random moments of its run."""
        kind = self.rng.choices(["none", "KILL", "STOP", "INT", "TERM", "INT INT"], [3, 5, 4, 2, 1, 1])[0]
        at += self.rng.uniform(0, span)
        if kind == "STOP":
            self.step("signal", at, name=name, signal="STOP")
            self.step("signal", at + self.rng.uniform(0.2, 2), name=name, signal="CONT")
        elif kind != "none":
            for k, signal in enumerate(kind.split()):
                self.step("signal", at + 0.05 * k, name=name, signal=signal)

    def plan(self, job, at=0.0, overwrite=False):
        """Plans the job and waits for it; workers follow."""
        arguments = ["--overwrite"] if overwrite else []
        name = self.start("plan", job, at, arguments=[*arguments, "--unit-rows", str(self.script.unit_rows)])
        if self.rng.random() < 0.15:
            self.send_signals(name, at)
        self.step("wait", at + 0.001, names=[name])

    def unit(self, job, at, fault=None):
        units = self.rng.choice(["0", "0-1", "1", "1-2", "2", "0-2", "all"])
        if "2" in units and "--bands" in self.script.jobs[job].flags:
            units = "0-1"  # a job of two bands may have no third unit
        return self.start("unit", job, at, arguments=[] if units == "all" else ["--unit", units], fault=fault)

    def replace(self, at):
        """Replaces the film by that of another job."""
        over = ["--overwrite"] + (["--take-over"] if self.rng.random() < 0.7 else [])
        if self.rng.random() < 0.5:
            return self.start("run", "B", at, arguments=over)
        name = self.start("plan", "B", at, arguments=[*over, "--unit-rows", str(self.script.unit_rows)])
        if self.rng.random() < 0.6:
            self.unit("B", at + self.rng.uniform(0.6, 1.5))
        return name

    def workers(self):
        self.plan("A")
        for _ in range(self.rng.randint(2, 4)):
            at = self.rng.uniform(0.01, 1.0)
            fault = self.fault(self.rng.choice(["kill", "stop", "5", "28"])) if self.rng.random() < 0.3 else None
            self.send_signals(self.unit("A", at, fault), at)
        if self.rng.random() < 0.7:
            at = self.rng.uniform(0.1, 1.5)
            self.send_signals(self.replace(at), at)

    def runs(self):
        for _ in range(self.rng.randint(2, 3)):
            at = self.rng.uniform(0, 1.0)
            fault = self.fault(self.rng.choice(["kill", "stop", "torn", "5"])) if self.rng.random() < 0.3 else None
            arguments = ["--keep-going"] if self.rng.random() < 0.2 else []
            self.send_signals(self.start("run", "A", at, arguments=arguments, fault=fault), at)
        if self.rng.random() < 0.7:
            at = self.rng.uniform(0.1, 1.5)
            self.send_signals(self.replace(at), at)

    def built(self):
        """Films of lenses as built: a run is killed while its lens is traced or its film computed; further runs resume or replace it."""
        name = self.start("run", "A", 0.0, fault=self.fault("kill") if self.rng.random() < 0.5 else None)
        self.step("signal", self.rng.uniform(0.05, 3.0), name=name, signal="KILL")
        self.runs()

    def sleeper(self):
        """A worker is stopped, its film is replaced, the worker continues."""
        kind = self.rng.choice(["run", "run", "unit", "unit", "pyramid"])
        if kind == "unit":
            self.plan("A")
        if kind == "pyramid":
            self.step("wait", 0.001, names=[self.start("run", "A", 0.0)])
        # At a read: before it has the lock. At a rename: with the lock and an unnamed file.
        early, late = f"read:{self.rng.randint(1, 12)}:stop", f"rename:{self.rng.randint(1, 40)}:stop"
        fault = self.rng.choices([early, late, self.fault("stop"), None], [3, 3, 5, 3])[0]
        stopped = [self.unit("A", 0.01, fault) if kind == "unit" else self.start(kind, "A", 0.01, fault=fault)]
        if kind == "unit" and self.rng.random() < 0.4:
            stopped.append(self.unit("A", 0.02))
        at = 0.02 if fault else self.rng.uniform(0.05, 1.1)
        for name in stopped:
            if not fault:
                self.step("signal", at, name=name, signal="STOP")
        if fault:
            self.step("wait", at + 0.01, names=stopped[:1])
        self.step("record_stopped", at + 0.02, names=stopped[:1])
        other = self.replace(at + 0.03)
        if self.rng.random() < 0.6:
            self.step("wait", at + 0.04, names=[other])
        self.step("check_stopped", at + 0.05, names=stopped[:1], other=other)
        later = at + 0.05 + (0 if self.rng.random() < 0.6 else self.rng.uniform(0, 1.2))
        for name in stopped:
            self.step("signal", later, name=name, signal="CONT")

    def input(self):
        """Chart or pack are changed while they are read."""
        names = []
        if self.rng.random() < 0.4:
            self.plan("A")
            names = [self.unit("A", self.rng.uniform(0.01, 0.4)) for _ in range(2)]
        else:
            names = [self.start("run", "A", self.rng.uniform(0.0, 0.3))]
        self.change(self.rng.uniform(0.05, 1.2))
        if self.rng.random() < 0.3:
            self.send_signals(names[0], 0.1)

    def change(self, at):
        lens = self.script.jobs["A"].lens != "built-in" and self.rng.random() < 0.5
        how = self.rng.choice(["rename", "rename one", "in place", "in halves", "truncate"])
        self.step("input", at, what="lens" if lens else "chart", how=how, version=1, pause=self.rng.choice([0, 0.02, 0.1]))
        if self.rng.random() < 0.3:
            later = at + self.rng.uniform(0.05, 1.0)
            self.step("input", later, what="lens" if lens else "chart", how="rename", version=0, pause=0)

    def disk(self):
        for k in range(self.rng.randint(1, 2)):
            at = self.rng.uniform(0, 0.4)
            self.start("run", "A", at, arguments=["--keep-going"] if self.rng.random() < 0.3 else [])
        at = self.rng.uniform(0.0, 1.0)
        self.step("disk", at, leave=self.rng.choice([0, 4096, 50_000, 200_000]))
        if self.rng.random() < 0.6:
            self.step("disk", at + self.rng.uniform(0.1, 1.0), leave=None)
        if self.rng.random() < 0.4:
            self.replace(at + self.rng.uniform(0, 0.5))

    def mixture(self):
        if self.rng.random() < 0.5:
            self.plan("A")
        for _ in range(self.rng.randint(2, 4)):
            at = self.rng.uniform(0, 1.5)
            draw = self.rng.random()
            name = self.unit("A", at) if draw < 0.35 else self.start("run", "A", at) if draw < 0.6 else self.replace(at)
            self.send_signals(name, at)
        if self.rng.random() < 0.3:
            self.change(self.rng.uniform(0.1, 1.5))

    def other_commands(self):
        """Commands that inspect or repair the film, foreign files, and removal of the film."""
        for kind, share in [("repair", 0.15), ("status", 0.15), ("status-plan", 0.1), ("pyramid", 0.15), ("export", 0.2),
                            ("into-input", 0.1)]:
            if self.rng.random() < share:
                at = self.rng.uniform(0.2, 2.0)
                arguments = ["--take-over"] if kind in ("repair", "pyramid") and self.rng.random() < 0.3 else []
                fault = self.fault("stop") if kind in ("repair", "pyramid") and self.rng.random() < 0.3 else None
                name = self.start(kind, "A", at, arguments=arguments, fault=fault)
                if kind not in ("status", "status-plan") and self.rng.random() < 0.4:
                    self.send_signals(name, at, 0.5)
        if self.rng.random() < 0.1:
            self.step("remove", self.rng.uniform(0.1, 1.5))
        for place in FOREIGN_FILES:
            if self.rng.random() < 0.05:
                self.step("foreign_file", self.rng.uniform(0, 1.0), place=place)
