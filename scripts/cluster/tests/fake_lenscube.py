#!/usr/bin/env -S python3 -SE
"""Fake of lenscube with the same command line, exit codes and events; a complete unit is a file in the film's folder `done`.

`fake` in the plan sets failures: {"7": {"code": 75, "times": 2}} fails unit 7 twice, {"5": {"held": true}} holds unit 5 until the film's
folder has a file `released`, {"5": {"endless": true}} until it is stopped.
"""
import ctypes, json, os, signal, sys, time

WITH_VALUE = {"--plan", "--unit", "--progress", "--threads"}


def arguments(argv):
    found, i = {}, 0
    while i < len(argv):
        found[argv[i]] = argv[i + 1] if argv[i] in WITH_VALUE else True
        i += 2 if argv[i] in WITH_VALUE else 1
    return found


def ranges(units):
    out = []
    for u in units:
        if out and out[-1][1] == u - 1:
            out[-1][1] = u
        else:
            out.append([u, u])
    return ",".join(str(a) if a == b else f"{a}-{b}" for a, b in out)


def send_event(event, **more):
    print(json.dumps({"event": event, **more}), flush=True)


def run(plan, film, unit, die):
    if die:
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)
    behaviour = plan.get("fake", {}).get(str(unit), {})
    stopped = []
    signal.signal(signal.SIGTERM, lambda *_: stopped.append(1))
    send_event("start", pid=os.getpid())
    with open(f"{film}/tries", "a") as tries:
        tries.write(f"{unit}\n")
    held = lambda: behaviour.get("endless") or behaviour.get("held") and not os.path.exists(f"{film}/released")
    while held() and not stopped:
        time.sleep(0.02)
    if stopped:
        send_event("error", code=130, retry=True, message="interrupted")
        return 130
    tried = open(f"{film}/tries").read().split().count(str(unit))
    if behaviour.get("code") and tried <= behaviour.get("times", 1 << 30):
        if behaviour["code"] < 0:
            os.kill(os.getpid(), -behaviour["code"])
        if behaviour["code"] != 2:
            send_event("error", code=behaviour["code"], retry=behaviour["code"] == 75, message=behaviour.get("message", "as configured"))
        else:
            print("usage error", file=sys.stderr)
        return behaviour["code"]
    send_event("progress", tiles=10, pixels=1000)
    open(f"{film}/done/{unit}", "w").close()
    send_event("done", code=0, tiles=10, pixels=1000, shards=1, wall_s=0.1)
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
