"""lenscube-dask: executes the missing units of a plan on a Dask cluster.

    lenscube plan CHART FILM -o job.json
    lenscube-dask job.json --scheduler tcp://HOST:8786
    lenscube-dask job.json --slurm 20 --cpus 16 --memory 32GiB --walltime 04:00:00 --partition main
    lenscube-dask job.json --local 2 --gpu -- --memory 8GiB

Arguments after -- are flags of `lenscube run`. After an interruption or a failure the same command resumes the job.
Exit codes are those of lenscube: 0 complete, 1 failed, 2 usage, 3 chart, lens or film are not the planned ones, 4 units are
missing at the end, 75 worth a retry, 130 interrupted.
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


def arguments(argv: list[str]) -> argparse.Namespace:
    argv, flags = (argv[: argv.index("--")], argv[argv.index("--") + 1 :]) if "--" in argv else (argv, [])
    head, _, rest = __doc__.partition("\n")
    parser = argparse.ArgumentParser("lenscube-dask", description=head, epilog=rest, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plan", type=Path, help="plan file of lenscube plan")
    where = parser.add_argument_group("workers (one of these)").add_mutually_exclusive_group(required=True)
    where.add_argument("--scheduler", metavar="ADDRESS", help="an existing scheduler, such as tcp://HOST:8786")
    where.add_argument("--local", type=int, metavar="N", help="N workers on this machine")
    where.add_argument("--slurm", type=int, metavar="N", help="up to N Slurm jobs of one worker each")
    where.add_argument("--kubernetes", type=int, metavar="N", help="N pods of the Dask operator")
    what = parser.add_argument_group("units")
    what.add_argument("--gpu", action="store_true", help="one GPU per unit: tasks need the resource GPU=1, lenscube gets --device cuda")
    what.add_argument("--lenscube", default="lenscube", metavar="PROGRAM", help="the program, here and on the workers [%(default)s]")
    what.add_argument("--worker-lenscube", metavar="PROGRAM", help="the program on the workers, if its path differs")
    what.add_argument("--here", nargs=2, default=[], metavar=("CHART", "FILM"), help="paths on this machine, if not those of the plan")
    what.add_argument("--there", nargs=2, default=[], metavar=("CHART", "FILM"), help="paths on the workers, if not those of the plan")
    what.add_argument("--retries", type=int, default=10, metavar="N", help="maximum retries of a unit after exit code 75 or a lost worker [%(default)s]")
    what.add_argument("--retry-pause", type=float, default=5.0, metavar="S", help="pause before the first retry; doubled each time, up to 60 s [%(default)s]")
    what.add_argument("--log", type=Path, metavar="FILE", help="file to which events of units are appended, one JSON object per line")
    jobs = parser.add_argument_group("Slurm jobs and pods")
    jobs.add_argument("--cpus", type=int, default=8, metavar="N", help="[%(default)s]")
    jobs.add_argument("--memory", default="8GiB", metavar="SIZE", help="[%(default)s]")
    jobs.add_argument("--walltime", default="04:00:00", metavar="HH:MM:SS", help="[%(default)s]")
    jobs.add_argument("--partition", metavar="NAME")
    jobs.add_argument("--account", metavar="NAME")
    jobs.add_argument("--interface", metavar="NAME", help="network interface common to the nodes and this machine, such as ib0")
    jobs.add_argument("--directive", action="append", default=[], metavar="WORDS", help="an #SBATCH line, such as --constraint=a100")
    jobs.add_argument("--image", metavar="NAME", help="image of the pods, with Python, Dask and lenscube")
    jobs.add_argument("--namespace", metavar="NAME")
    jobs.add_argument("--env", action="append", default=[], metavar="NAME=VALUE", help="environment variable of the pods")
    jobs.add_argument("--volume", action="append", default=[], metavar="CLAIM:PATH", help="persistent volume claim mounted in the pods")
    args = parser.parse_args(argv)
    args.flags = flags
    return args


def settings(args: argparse.Namespace) -> Settings:
    flags = list(args.flags)
    given = {flag.partition("=")[0] for flag in flags}
    if args.gpu and "--device" not in given:
        flags += ["--device", "cuda"]
    if args.local and args.local > 1 and "--threads" not in given:
        flags += ["--threads", str(max(1, len(os.sched_getaffinity(0)) // args.local))]
    program = args.worker_lenscube or args.lenscube
    return Settings(program, args.there, flags, args.gpu, bool(args.local), args.retries, args.retry_pause)


def advise(client: Client, display: Display) -> None:
    """Prints notes about settings of an existing scheduler that slow the job down."""
    ttl = client.run_on_scheduler(lambda dask_scheduler: dask_scheduler.worker_ttl)
    if not ttl or ttl > 60:
        wait = f"{ttl:.0f} s" if ttl else "without limit"
        display.print_line(f"note: this scheduler waits {wait} for a worker that does not respond; DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL=30s in its environment")
    threads = client.nthreads()
    if busy := [w for w, n in threads.items() if n > 1]:
        display.print_line(f"note: {len(busy)} of {len(threads)} workers run several units at once, each with all cores; start them with --nthreads 1")


def drive(args: argparse.Namespace, plan: Plan, todo: list[int], display: Display) -> None:
    """Executes the units; a cluster created for them is always closed."""
    address, created = clusters.open_cluster(args)
    with contextlib.ExitStack() as stack:
        if created:
            stack.callback(created.close)
        try:
            client = stack.enter_context(Client(address, timeout="30s"))
        except OSError as e:
            raise Failure(f"connecting to the scheduler {address}: {e}", 75) from e
        if not created:
            advise(client, display)
        elif client.dashboard_link:
            display.print_line(f"dashboard: {client.dashboard_link}")
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
        display.print_line(f"{plan.film}: {len(todo)} of {len(plan.tiles)} units to do")
        try:
            drive(args, plan, todo, display)
        except (OSError, CancelledError) as e:
            raise Failure(f"the connection to the scheduler is lost: {e}", 75) from e
        if missing := plan.missing(args.lenscube, args.here):
            raise Failure(f"all units ended with 0, but {format_units(missing)} are missing: do all workers use the same film?", 4)
    display.print_line(f"{plan.film}: complete, {len(plan.tiles)} units")
    return 0


def main() -> int:
    args = arguments(sys.argv[1:])
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, interrupted)
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # relevant errors are reported here
    command = shlex.join(["lenscube-dask", *sys.argv[1:]])
    try:
        return job(args)
    except KeyboardInterrupt:
        print(f"lenscube-dask: interrupted; complete shards are kept. Resume with: {command}", file=sys.stderr)
        return 130
    except Failure as e:
        print(f"lenscube-dask: {e}", file=sys.stderr)
        if e.code in (1, 75):
            print(f"complete shards are kept; resume with: {command}", file=sys.stderr)
        return e.code


if __name__ == "__main__":
    sys.exit(main())
