"""Test of the checks: each injected damage must be found, and an undamaged round must have no finding.

Rounds run a wrapper that calls the real program and then damages its result, so that the complete path from the command to the
finding is tested.
"""
import json
import os
import re
import shutil
import stat
import subprocess
import sys
import time
from pathlib import Path

from films import TEMP, Job
from machines import identity
from script import Script

LAYOUT = ("--shard", "64", "--chunk", "32")
# Damage: the command after which it is done, and a pattern of the finding.
CASES = {
    "none": ("run", None),
    "a shard of another job": ("run", r"film/c/1/0/0 differs"),
    "a flipped byte": ("run", r"film/c/1/0/0 differs"),
    "a truncated shard": ("run", r"film/c/1/0/0 differs"),
    "a missing shard": ("run", r"film/c/1/0/0 is missing"),
    "an extra shard": ("run", r"film/c/9/0/0 is not part"),
    "changed metadata": ("run", r"name a job that no|differs"),
    "no film": ("run", r"there is no film"),
    "a temp file of an ended process": ("run", r"left behind: .*\.tmp-"),
    "a temp file beside the film": ("run", r"left behind: \.tmp-"),
    "a lock of an ended process": ("run", r"left behind: .*whole\.lock"),
    "a changed chart": ("run", r"chart-zarr was changed"),
    "a foreign file removed": ("run", r"notes.txt, not of the program, is gone"),
    "a foreign file changed": ("run", r"notes.txt, not of the program, was changed"),
    "an export of other pixels": ("export", r"not the export of one film"),
    "exit code 101": ("run", r"ended with 101"),
    "an abort": ("run", r"ended with -6"),
    "a panic": ("run", r"panicked"),
    "no end": ("run", r"did not end in"),
    "always 75": ("run", r"still ends with 75"),
    "valid film reported as damaged": ("verify", r"verify finds the complete film wrong"),
}


def damage(case, arguments, code):
    """Damages the result of the command; returns the exit code of the wrapper."""
    if arguments[0] == "export":
        out = Path(arguments[2])
        data = bytearray(out.read_bytes())
        data[-1] ^= 1
        out.write_bytes(data)
        return code
    if case == "valid film reported as damaged":
        return 4
    film = Path(arguments[2])
    shard, place = film / "film/c/1/0/0", film.parent
    me = identity()
    dead = {"host": re.sub(r"[^0-9A-Za-z]", "_", me["host"]), "boot": me["boot"].replace("-", "")[:16],
            "namespace": re.sub(r"\D", "", me["processes"]), "pid": 4_194_300, "start": 1}
    temp = TEMP + "-".join(str(v) for v in [*dead.values(), 0])
    if case == "a shard of another job":
        shard.write_bytes(Path(os.environ["OTHER_FILM"], "film/c/1/0/0").read_bytes())
    elif case == "a flipped byte":
        data = bytearray(shard.read_bytes())
        data[len(data) // 2] ^= 1
        shard.write_bytes(data)
    elif case == "a truncated shard":
        shard.write_bytes(shard.read_bytes()[:-1])
    elif case == "a missing shard":
        shard.unlink()
    elif case == "an extra shard":
        (film / "film/c/9/0").mkdir(parents=True)
        (film / "film/c/9/0/0").write_bytes(shard.read_bytes())
    elif case == "changed metadata":
        text = (film / "zarr.json").read_text()
        changed = re.sub(r'("numeric_version": *)\d+', r"\g<1>999", text)
        assert changed != text, "the metadata name no numeric version"
        (film / "zarr.json").write_text(changed)
    elif case == "no film":
        shutil.rmtree(film)
    elif case == "a temp file of an ended process":
        (film / "film" / temp).write_text("")
    elif case == "a temp file beside the film":
        (place / temp).write_text("")
    elif case == "a lock of an ended process":
        (film / "runs/whole.lock").write_text(json.dumps({"unit": "whole", **dead, "since_unix_s": 1}))
    elif case == "a changed chart":
        path = next((place.parent / "chart-zarr").rglob("c/0/0/0"))
        data = bytearray(path.read_bytes())
        data[100] ^= 1
        path.write_bytes(data)
    elif case == "a foreign file removed":
        (place / "notes.txt").unlink(missing_ok=True)
    elif case == "a foreign file changed" and (place / "notes.txt").exists():
        (place / "notes.txt").write_text("")
    elif case == "exit code 101":
        return 101
    elif case == "an abort":
        os.abort()
    elif case == "a panic":
        print("thread 'main' panicked at src/main.rs", file=sys.stderr)
    elif case == "no end":
        time.sleep(60)
    elif case == "always 75":
        return 75
    return code


def wrapper_program(folder, program, case):
    """An executable that runs the program and then does the damage."""
    path = folder / f"wrapper-{re.sub(r'[^a-z0-9]+', '-', case)}"
    path.write_text(f"#!{sys.executable}\nimport sys\nsys.path.insert(0, {str(Path(__file__).parent)!r})\nimport self_test\n"
                    f"self_test.run_and_damage({str(program)!r}, {case!r}, sys.argv[1:])\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


def run_and_damage(program, case, arguments):
    code = subprocess.run([program, *arguments]).returncode
    if code == 0 and arguments[0] == CASES[case][0]:
        code = damage(case, arguments, code)
    sys.exit(code)


def script():
    """An undisturbed round: the film is made, a foreign file is put beside it, the film is exported."""
    jobs = {"A": Job("A", "zarr", "built-in", ("--azimuths", "4", *LAYOUT)), "B": Job("B", "zarr", "built-in", ("--azimuths", "8", *LAYOUT))}
    start = {"do": "start", "machine": "A", "job": "A", "arguments": [], "fault": None}
    steps = [{"at": 0.0, **start, "name": "1-run-A", "kind": "run"}, {"at": 0.1, "do": "wait", "names": ["1-run-A"]},
             {"at": 0.2, "do": "foreign_file", "place": "notes.txt"}, {"at": 0.3, **start, "name": "2-export-A", "kind": "export"}]
    return Script("self-test", jobs, "A", False, 1, False, "A", steps, verify=True)


def main(session, workspace_type, round_type):
    """Exit code of the self-test."""
    workspace, failed = workspace_type(session, 0), 0
    plan = script()
    other = session.clean.get(plan.jobs["B"], session.inputs.charts["zarr"][0], None)
    workspace.env = workspace.env | {"OTHER_FILM": str(other.path)}
    workspace.timeout_s = 5
    for number, (case, (_, expected)) in enumerate(CASES.items()):
        workspace.program = wrapper_program(session.folder, session.program, case)
        done = round_type(workspace, 0, number * 2, plan).run()
        done.clear()
        hit = not done.findings if expected is None else any(re.search(expected, f) for f in done.findings)
        failed += not hit
        print(f"{'found' if expected and hit else 'ok' if hit else 'NOT FOUND'}: {case}: {'; '.join(done.findings)[:160]}", flush=True)
    stopped = round_type(workspace, 0, 0, plan)
    failed += not must_fail_is_found(stopped)
    workspace.close()
    print(f"{len(CASES) + 1} cases, {failed} failed")
    return int(failed > 0)


def must_fail_is_found(done):
    """A worker that was stopped while its film was replaced and that ends with 0 must be found."""
    done.prepare()
    done.start = time.monotonic()
    done.workspace.program = "/bin/true"
    command = done.begin("1-run-A", "run", "A", "A", [])
    done.must_fail.add("1-run-A")
    done.wait_for_end(command)
    done.clear()
    hit = any("was replaced while it was stopped" in f for f in done.findings)
    print(f"{'found' if hit else 'NOT FOUND'}: a worker ends with 0 although its film was replaced")
    return hit
