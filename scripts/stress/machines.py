"""Processes on several machines: each machine has an agent that starts processes, sends signals and reports exit codes.

Machine A is this host. The others are separate Linux namespaces (host name, processes, mounts) with another boot id and machine
id, so that a lock or temporary file made there names a process that cannot be looked up here:

    B  other name, other boot id, other machine id          another host
    C  A's name, other boot id, other machine id            another host of the same name
    D  A's name, boot id and machine id, other processes    a container of this host
"""
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import uuid
from pathlib import Path

KINDS = {"A": "this host", "B": "another host", "C": "another host of the same name", "D": "a container of this host"}
BOOT = "/proc/sys/kernel/random/boot_id"
MACHINE = "/etc/machine-id"


class Machine:
    """One machine; methods may be called from one thread at a time."""

    def __init__(self, name, folder):
        self.name, self.lock, self.last = name, threading.Lock(), 0
        argv = [sys.executable, __file__, "--agent"]
        if name != "A":
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "boot_id").write_text(f"{uuid.uuid4()}\n")
            (folder / "machine-id").write_text(f"{uuid.uuid4().hex}\n")
            argv = ["unshare", "--uts", "--pid", "--mount", "--fork", "--kill-child", "--mount-proc", *argv, name, str(folder)]
        self.agent = subprocess.Popen(argv, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True)
        self.identity = self.request({"do": "identity"})["identity"]

    def request(self, request):
        with self.lock:
            try:
                self.agent.stdin.write(json.dumps(request) + "\n")
                self.agent.stdin.flush()
                line = self.agent.stdout.readline()
            except OSError as e:
                raise RuntimeError(f"the agent of machine {self.name} ended: {e}") from e
            if not line:
                raise RuntimeError(f"the agent of machine {self.name} ended")
        reply = json.loads(line)
        if "error" in reply:
            raise RuntimeError(f"machine {self.name}: {reply['error']}")
        return reply

    def start(self, argv, out, err, env):
        self.last += 1
        self.request({"do": "start", "id": self.last, "argv": [str(a) for a in argv], "out": str(out), "err": str(err), "env": env})
        return self.last

    def signal(self, process, number):
        self.request({"do": "signal", "id": process, "signal": int(number)})

    def state(self, process):
        """("running" | "stopped", None) or ("ended", exit code; -9 for SIGKILL)."""
        reply = self.request({"do": "state", "id": process})
        return reply["state"], reply.get("code")

    def where(self, process):
        return self.request({"do": "where", "id": process})["where"]

    def close(self):
        self.agent.stdin.close()
        self.agent.wait(10)


def namespaces_or_reason():
    """The reason why this process cannot create machines B, C and D; None if it can."""
    if not sys.platform.startswith("linux"):
        return "not Linux"
    try:
        folder = Path(BOOT)
        test = f"hostname probe && mount --bind {folder} {BOOT}"
        argv = ["unshare", "--uts", "--pid", "--mount", "--fork", "--mount-proc", "sh", "-c", test]
        done = subprocess.run(argv, capture_output=True, text=True, timeout=20)
    except (OSError, subprocess.TimeoutExpired) as e:
        return str(e)
    return None if done.returncode == 0 else f"unshare: {done.stderr.strip() or done.returncode}"


def set_identity(name, folder):
    """Sets host name, boot id and machine id of the namespaces of this process."""
    if name == "B":
        socket.sethostname("chaos-other-host")
    if name in "BC":
        subprocess.run(["mount", "--bind", f"{folder}/boot_id", BOOT], check=True)
        if os.path.exists(MACHINE):
            subprocess.run(["mount", "--bind", f"{folder}/machine-id", MACHINE], check=True)


def identity():
    def read(path):
        try:
            return Path(path).read_text().strip()
        except OSError:
            return None

    return {"host": os.uname().nodename, "boot": read(BOOT), "machine": read(MACHINE), "processes": os.readlink("/proc/self/ns/pid")}


def agent():
    """Serves requests, one JSON object per line, until the pipe is closed; then kills all its processes."""
    running = {}

    def start(r):
        with open(r["out"], "ab") as out, open(r["err"], "ab") as err:
            env = dict(os.environ, **r["env"])
            running[r["id"]] = subprocess.Popen(r["argv"], stdin=subprocess.DEVNULL, stdout=out, stderr=err, env=env, process_group=0)
        return {}

    def state(r):
        process = running[r["id"]]
        code = process.poll()
        if code is not None:
            return {"state": "ended", "code": code}
        # Stopped: every thread; one that waits for the disk ends its system call first.
        states = set()
        for task in Path(f"/proc/{process.pid}/task").glob("*"):
            try:
                states.add((task / "stat").read_text().rsplit(")", 1)[1].split()[0])
            except OSError:
                continue  # a thread that has ended
        return {"state": "stopped" if "T" in states and states <= set("TZX") else "running"}

    def send(r):
        process = running[r["id"]]
        if process.poll() is None:
            process.send_signal(r["signal"])
        return {}

    def where(r):
        """State of the threads of a process, to report a command that does not end."""
        found = []
        for task in Path(f"/proc/{running[r['id']].pid}/task").glob("*"):
            parts = [(task / part) for part in ("stat", "wchan", "syscall")]
            found.append(" ".join(p.read_text().strip()[:120] for p in parts if os.access(p, os.R_OK)))
        return {"where": found}

    tasks = {"identity": lambda r: {"identity": identity()}, "start": start, "state": state, "signal": send, "where": where}
    for line in sys.stdin:
        request = json.loads(line)
        try:
            reply = tasks[request["do"]](request)
        except OSError as e:
            reply = {"error": f"{request['do']}: {e}"}
        print(json.dumps(reply), flush=True)
    for process in running.values():
        if process.poll() is None:
            process.kill()
            process.wait()


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if len(sys.argv) == 4:
        set_identity(*sys.argv[2:])
    agent()
