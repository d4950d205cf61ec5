"""Runs every command of README.md and of the guide from the text itself; run by scripts/try-as-user, which names the program as the first argument.

    python3 try_documents.py LENSCUBE [PAGE…]

The commands of a page run in its order in one new folder with the inputs of document_inputs.py, and must end with 0. `lenscube` is the program given, the
package `lenscube` that of scripts/python, with the native module beside the program. What cannot run is in NOT_RUN, with the reason, and is reported; a command with a placeholder in
capitals is compared with the help. Files of the repository that a page names must exist.
"""
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

import document_inputs
import documents

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "src/manual/guide").glob("*.md"))]
# First words of a command → why it does not run here. Each must occur in a document.
NOT_RUN = {
    "cargo run --release -- demo": "builds the program a second time and takes half a minute; scripts/try-release runs the demo",
    "scripts/check": "runs this test",
    "cargo install --path .": "builds the program a second time",
    "pip install": "the wheel is built, installed and used by scripts/check-python",
    "lenscube-dask": "needs a Dask cluster; scripts/check-cluster starts one",
    "sbatch": "needs Slurm; scripts/check-cluster tests the script",
    "kubectl": "needs a Kubernetes cluster; scripts/check-cluster checks the file",
    "export AWS_ACCESS_KEY_ID=": "credentials of the reader",
    "lenscube run s3://": "needs an S3 store; scripts/check-s3 starts one",
    "lenscube bench --device cuda": "needs a GPU",
    "lenscube demo --depth": "takes one to two minutes; run by tests/cli/depth_scene.rs",
}
# What README states of versions → the file that determines it.
STATED = {r"([\d.]+) is enough": ("Cargo.toml", r'rust-version = "([\d.]+)"'), r"python3 >= ([\d.]+)": ("scripts/python/pyproject.toml", r'requires-python = ">=([\d.]+)"')}
# As `lenscube view` prints it.
ADDRESS = re.compile(rb"http://127\.0\.0\.1:\d+/")


class Documents:
    def __init__(self, program, place):
        self.program, self.place, self.failed, self.used = program, place, [], set()
        programs = place / "programs"
        programs.mkdir()
        # A browser that shows nothing, and the interpreter of this script.
        for name, text in (("lenscube", f'exec {program} "$@"'), ("python", f'exec {sys.executable} "$@"'), ("xdg-open", "true")):
            (programs / name).write_text(f"#!/bin/sh\n{text}\n")
            (programs / name).chmod(0o755)
        package = place / "package"
        shutil.copytree(ROOT / "scripts/python/lenscube", package / "lenscube")
        shutil.copy(program.with_name("liblenscube_native.so"), package / "lenscube/_native.abi3.so")
        self.environment = os.environ | {
            "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}", "LENSCUBE": str(program), "MPLBACKEND": "Agg", "PYTHONWARNINGS": "ignore",
            "PYTHONPATH": os.pathsep.join(filter(None, [str(package), os.environ.get("PYTHONPATH")])),
            "XDG_CACHE_HOME": str(place / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}

    def report(self, state, where, text, detail=""):
        print(f"{state:8}{where}  {text.splitlines()[0]}{f'  ({detail})' if detail else ''}", flush=True)

    def page(self, path):
        text = path.read_text()
        links, named = documents.paths(text)
        for file in [path.parent / link for link in links if "://" not in link] + [ROOT / name for name in named]:
            if not file.exists():
                self.fail(path.name, f"{file} does not exist")
        commands = documents.commands(text)
        place = self.place / path.stem
        place.mkdir()
        document_inputs.make(path.name, "\n".join(c.text for c in commands), place, self.program, self.environment)
        for command in commands:
            self.command(f"{path.name}:{command.line}", command, place)

    def command(self, where, command, place):
        text = documents.without_comment(command.text) if command.kind != "python" else command.text
        if reason := next((key for key in NOT_RUN if text.startswith(key)), None):
            self.used.add(reason)
            return self.not_run(where, text, NOT_RUN[reason])
        begin = time.monotonic()
        if command.kind == "python":
            outcome = self.shell([sys.executable, "-c", document_inputs.python(text)], place)
        elif documents.is_synopsis(text):
            outcome = self.synopsis(text, place)
        elif documents.is_name(text) and text.split()[1] != "help":
            outcome = self.shell(["bash", "-c", f"{text} -h"], place)
        elif text.startswith("lenscube view "):
            outcome = self.view(text, place)
        else:
            outcome = self.shell(["bash", "-euo", "pipefail", "-c", text], place)
        if outcome:
            self.fail(where, f"{text}\n{outcome}")
        else:
            self.report("ok", where, text, f"{time.monotonic() - begin:.1f} s")

    def shell(self, words, place):
        """What is wrong with the command, or nothing."""
        done = subprocess.run(words, cwd=place, env=self.environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=300)
        return None if done.returncode == 0 and "panicked" not in done.stderr else f"exit code {done.returncode}\n{done.stdout}{done.stderr}"

    def synopsis(self, text, place):
        """The command exists, with its flags."""
        words = text.split()
        names = words[:next(i for i, word in enumerate(words) if not re.fullmatch(r"[a-z-]+", word))]
        done = subprocess.run(["bash", "-c", " ".join(names) + " --help"], cwd=place, env=self.environment, capture_output=True, text=True)
        unknown = [word for word in words if word.startswith("--") and word not in done.stdout]
        return f"exit code {done.returncode}, unknown {unknown}" if done.returncode or unknown else None

    def view(self, text, place):
        """The viewer prints its address, serves the page and ends by Ctrl-C."""
        process = subprocess.Popen(["bash", "-c", f"exec {text}"], cwd=place, env=self.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        address = ADDRESS.search(process.stdout.readline())
        served = b"<html" in urllib.request.urlopen(address[0].decode(), timeout=30).read() if address else False
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=30)
        return None if served and process.returncode == 0 else f"exit code {process.returncode}, served {served}\n{errors.decode()}"

    def not_run(self, where, text, reason):
        self.report("not run", where, text, reason)
        if report := os.environ.get("LENSCUBE_CHECK_REPORT"):
            with open(report, "a") as f:
                f.write(f"{where}: {text}\tskipped\t\tunavailable: {reason}\n")

    def fail(self, where, text):
        self.failed.append(where)
        self.report("FAILED", where, text)
        print("        " + "\n        ".join(text.splitlines()[1:]))


with tempfile.TemporaryDirectory() as folder:
    tried = Documents(Path(sys.argv[1]).resolve(), Path(folder))
    pages = [p for p in PAGES if p.name in sys.argv[2:]] or PAGES
    for page in pages:
        tried.page(page)
    if pages == PAGES:
        for pattern, (file, source) in STATED.items():
            found, true = re.search(pattern, PAGES[0].read_text()), re.search(source, (ROOT / file).read_text())[1]
            stated = found and found[1]
            if stated != true:
                tried.fail("README.md", f"{pattern}: {stated}; {file}: {true}")
        for entry in NOT_RUN.keys() - tried.used:
            tried.fail("scripts/try_documents.py", f"NOT_RUN: no document has the command {entry}")
print(f"{len(tried.failed)} commands of documents failed" + "".join(f"\n  {where}" for where in tried.failed))
sys.exit(bool(tried.failed))
