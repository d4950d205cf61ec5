"""lenscube-dask: does what a plan still misses, on a Dask cluster.

    lenscube plan CHART FILM -o job.json
    lenscube-dask job.json --scheduler tcp://HOST:8786
    lenscube-dask job.json --slurm 20 --cpus 16 --memory 32GiB --walltime 04:00:00 --partition main
    lenscube-dask job.json --local 2 --gpu -- --memory 8GiB

Words after -- are flags of `lenscube run`. Stopped or failed, the same command goes on from where it was.
Exit codes are those of lenscube: 0 complete, 1 failed, 2 usage, 3 not the planned thing, 4 something is missing at the end,
75 worth a retry, 130 interrupted.
"""

import argparse
import contextlib
import logging
import os
import shlex
import signal
import sys
from concurrent.futures import CancelledError
from pathlib import Path

from distributed import Client

from . import clusters
from .drive import Drive, Settings
from .plan import Failure, Plan, format_units
from .progress import Display


def arguments(words: list[str]) -> argparse.Namespace:
    words, flags = (words[: words.index("--")], words[words.index("--") + 1 :]) if "--" in words else (words, [])
    head, _, rest = __doc__.partition("\n")
    parser = argparse.ArgumentParser("lenscube-dask", description=head, epilog=rest, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plan", type=Path, help="made by lenscube plan")
    where = parser.add_argument_group("where the workers are (one of these)").add_mutually_exclusive_group(required=True)
    where.add_argument("--scheduler", metavar="ADDRESS", help="a scheduler that runs, such as tcp://HOST:8786")
    where.add_argument("--local", type=int, metavar="N", help="N workers on this machine")
    where.add_argument("--slurm", type=int, metavar="N", help="up to N Slurm jobs of one worker each")
    where.add_argument("--kubernetes", type=int, metavar="N", help="N pods of the Dask operator")
    what = parser.add_argument_group("units")
    what.add_argument("--gpu", action="store_true", help="a GPU a unit: tasks need GPU=1, lenscube gets --device cuda")
    what.add_argument("--lenscube", default="lenscube", metavar="PROGRAM", help="here and on the workers [%(default)s]")
    what.add_argument("--worker-lenscube", metavar="PROGRAM", help="on the workers, where it is another path there")
    what.add_argument("--here", nargs=2, default=[], metavar=("CHART", "FILM"), help="where this machine sees them, if not as planned")
    what.add_argument("--there", nargs=2, default=[], metavar=("CHART", "FILM"), help="where the workers see them, if not as planned")
    what.add_argument("--retries", type=int, default=10, metavar="N", help="of a unit, after exit code 75 or a lost worker [%(default)s]")
    what.add_argument("--retry-pause", type=float, default=5.0, metavar="S", help="before the first; then twice as long, up to 60 s [%(default)s]")
    what.add_argument("--log", type=Path, metavar="FILE", help="append what happens to units, a line of JSON each")
    jobs = parser.add_argument_group("Slurm jobs and pods")
    jobs.add_argument("--cpus", type=int, default=8, metavar="N", help="[%(default)s]")
    jobs.add_argument("--memory", default="8GiB", metavar="SIZE", help="[%(default)s]")
    jobs.add_argument("--walltime", default="04:00:00", metavar="HH:MM:SS", help="[%(default)s]")
    jobs.add_argument("--partition", metavar="NAME")
    jobs.add_argument("--account", metavar="NAME")
    jobs.add_argument("--interface", metavar="NAME", help="network interface that nodes and this machine share, such as ib0")
    jobs.add_argument("--directive", action="append", default=[], metavar="WORDS", help="an #SBATCH line, such as --constraint=a100")
    jobs.add_argument("--image", metavar="NAME", help="of pods: holds Python, Dask and lenscube")
    jobs.add_argument("--namespace", metavar="NAME")
    jobs.add_argument("--env", action="append", default=[], metavar="NAME=VALUE", help="in pods")
    jobs.add_argument("--volume", action="append", default=[], metavar="CLAIM:PATH", help="a persistent volume claim, in pods")
    args = parser.parse_args(words)
    args.flags = flags
    return args


def settings(args: argparse.Namespace) -> Settings:
    flags = list(args.flags)
    has = {word.partition("=")[0] for word in flags}
    if args.gpu and "--device" not in has:
        flags += ["--device", "cuda"]
    if args.local and args.local > 1 and "--threads" not in has:
        flags += ["--threads", str(max(1, len(os.sched_getaffinity(0)) // args.local))]
    program = args.worker_lenscube or args.lenscube
    return Settings(program, args.there, flags, args.gpu, bool(args.local), args.retries, args.retry_pause)


def advise(client: Client, display: Display) -> None:
    """Words on a scheduler that is not ours, where it would make the job slower than it must be."""
    ttl = client.run_on_scheduler(lambda dask_scheduler: dask_scheduler.worker_ttl)
    if not ttl or ttl > 60:
        wait = f"{ttl:.0f} s" if ttl else "for ever"
        display.say(f"note: this scheduler waits {wait} for a silent worker; DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL=30s in its environment")
    threads = client.nthreads()
    if busy := [w for w, n in threads.items() if n > 1]:
        display.say(f"note: {len(busy)} of {len(threads)} workers do several units at once, each with all cores; start them with --nthreads 1")


def drive(args: argparse.Namespace, plan: Plan, todo: list[int], display: Display) -> None:
    """Does the units; what is made for it is ended whatever happens."""
    address, made = clusters.open_cluster(args)
    with contextlib.ExitStack() as stack:
        if made:
            stack.callback(made.close)
        try:
            client = stack.enter_context(Client(address, timeout="30s"))
        except OSError as e:
            raise Failure(f"connecting to the scheduler {address}: {e}", 75) from e
        if not made:
            advise(client, display)
        elif client.dashboard_link:
            display.say(f"dashboard: {client.dashboard_link}")
        work = Drive(client, plan, settings(args), display)
        try:
            work.run(todo)
            work.close()
        except (KeyboardInterrupt, Failure):
            signal.signal(signal.SIGINT, signal.default_int_handler)  # a second Ctrl-C does not wait
            display.finish()
            work.stop()
            raise
        finally:
            display.finish()


def interrupted(*_) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    raise KeyboardInterrupt


def job(args: argparse.Namespace) -> int:
    plan = Plan.read(args.plan)
    todo = plan.missing(args.lenscube, args.here)
    log = args.log.open("a") if args.log else None
    display = Display(plan.tiles, todo, log)
    if todo:
        display.say(f"{plan.film}: {len(todo)} of {len(plan.tiles)} units to do")
        try:
            drive(args, plan, todo, display)
        except (OSError, CancelledError) as e:
            raise Failure(f"the scheduler is gone: {e}", 75) from e
        if missing := plan.missing(args.lenscube, args.here):
            raise Failure(f"all units ended well, yet {format_units(missing)} are missing: do the workers see the same film?", 4)
    display.say(f"{plan.film}: complete, {len(plan.tiles)} units")
    return 0


def main() -> int:
    args = arguments(sys.argv[1:])
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, interrupted)
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # what matters of it is said here
    again = shlex.join(["lenscube-dask", *sys.argv[1:]])
    try:
        return job(args)
    except KeyboardInterrupt:
        print(f"lenscube-dask: stopped; what is done is kept. Go on with: {again}", file=sys.stderr)
        return 130
    except Failure as e:
        print(f"lenscube-dask: {e}", file=sys.stderr)
        if e.code in (1, 75):
            print(f"what is done is kept; go on with: {again}", file=sys.stderr)
        return e.code


if __name__ == "__main__":
    sys.exit(main())
