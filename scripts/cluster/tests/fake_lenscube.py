#!/usr/bin/env -S python3 -SE
"""Stands in for lenscube: the same command line, exit codes and events; a unit is a file in the film's folder `done`.

The plan's `fake` says what goes wrong: {"7": {"code": 75, "times": 2}} fails unit 7 twice, {"5": {"seconds": 3}} makes it long.
"""
import ctypes, json, os, signal, sys, time

READ = {"--plan", "--unit", "--progress", "--threads"}


def arguments(words):
    found, i = {}, 0
    while i < len(words):
        found[words[i]] = words[i + 1] if words[i] in READ else True
        i += 2 if words[i] in READ else 1
    return found


def ranges(units):
    out = []
    for u in units:
        if out and out[-1][1] == u - 1:
            out[-1][1] = u
        else:
            out.append([u, u])
    return ",".join(str(a) if a == b else f"{a}-{b}" for a, b in out)


def tell(event, **more):
    print(json.dumps({"event": event, **more}), flush=True)


def run(plan, film, unit, die):
    if die:
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)
    what = plan.get("fake", {}).get(str(unit), {})
    tell("start", pid=os.getpid())
    with open(f"{film}/tries", "a") as tries:
        tries.write(f"{unit}\n")
    stopped = []
    signal.signal(signal.SIGTERM, lambda *_: stopped.append(1))
    end = time.monotonic() + what.get("seconds", 0)
    while time.monotonic() < end and not stopped:
        time.sleep(0.02)
    if stopped:
        tell("error", code=130, retry=True, message="interrupted")
        return 130
    tried = open(f"{film}/tries").read().split().count(str(unit))
    if what.get("code") and tried <= what.get("times", 1 << 30):
        if what["code"] < 0:
            os.kill(os.getpid(), -what["code"])
        if what["code"] != 2:
            tell("error", code=what["code"], retry=what["code"] == 75, message=what.get("message", "as asked"))
        else:
            print("words of the parser", file=sys.stderr)
        return what["code"]
    tell("progress", tiles=10, pixels=1000)
    open(f"{film}/done/{unit}", "w").close()
    tell("done", code=0, tiles=10, pixels=1000, shards=1, wall_s=0.1)
    return 0


def main():
    command, found = sys.argv[1], arguments(sys.argv[2:])
    with open(found["--plan"]) as file:
        plan = json.load(file)
    film = plan["command"]["film"]
    if command == "status":
        done = set(os.listdir(f"{film}/done"))
        print(ranges([u["unit"] for u in plan["units"] if str(u["unit"]) not in done]), end="")
        return 0
    return run(plan, film, int(found["--unit"]), "--die-with-parent" in found)


sys.exit(main())
