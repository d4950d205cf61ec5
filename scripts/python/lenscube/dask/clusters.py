"""The Dask cluster: that of an existing scheduler, or one that is created for this job and closed with it.

Each worker of a cluster created here has one thread: one unit at a time, with all cores of the worker. Two settings of Dask are
changed unless the user's configuration sets them: a worker that does not respond for 30 s is considered lost (default 300 s), and a
unit may lose its worker ten times before Dask reports an error (default 3).
"""

import argparse
import os
from typing import Any

import dask

from .plan import Failure

WORKER_TTL, WORKER_TTL_DASK = "30s", "5 minutes"
ALLOWED_FAILURES, ALLOWED_FAILURES_DASK = 10, 3


def settings() -> dict[str, Any]:
    """Dask settings of schedulers created here."""
    found = {}
    if dask.config.get("distributed.scheduler.worker-ttl") == WORKER_TTL_DASK:
        found["distributed.scheduler.worker-ttl"] = WORKER_TTL
    if dask.config.get("distributed.scheduler.allowed-failures") == ALLOWED_FAILURES_DASK:
        found["distributed.scheduler.allowed-failures"] = ALLOWED_FAILURES
    return found


def resources(gpu: bool) -> dict[str, int]:
    return {"GPU": 1} if gpu else {}


def open_cluster(args: argparse.Namespace) -> tuple[Any, Any]:
    """The address or cluster for a Client, and the cluster to be closed at the end (None for an existing scheduler)."""
    if args.scheduler:
        return args.scheduler, None
    with dask.config.set(settings()):
        created = slurm(args) if args.slurm else kubernetes(args) if args.kubernetes else local(args)
    return created, created


def local(args: argparse.Namespace) -> Any:
    """Workers on this machine; with --gpu one per GPU, with only that GPU visible."""
    from distributed import Nanny, Scheduler, SpecCluster

    def spec(number: int) -> dict:
        env = {"CUDA_VISIBLE_DEVICES": str(number)} if args.gpu else {}
        options = {"nthreads": 1, "memory_limit": 0, "silence_logs": 50, "resources": resources(args.gpu), "env": env}
        return {"cls": Nanny, "options": options}

    scheduler = {"cls": Scheduler, "options": {"dashboard_address": ":0", "host": "127.0.0.1"}}
    return SpecCluster(workers={n: spec(n) for n in range(args.local)}, scheduler=scheduler, name="lenscube", silence_logs=50)


def slurm(args: argparse.Namespace) -> Any:
    """One worker per Slurm job; jobs that end early are replaced."""
    try:
        from dask_jobqueue import SLURMCluster
    except ImportError as e:
        raise Failure(f"--slurm needs dask-jobqueue (pip install 'lenscube[dask-slurm]'): {e}", 2) from e
    cluster = SLURMCluster(**slurm_options(args))
    cluster.adapt(minimum=0, maximum=args.slurm)
    return cluster


def slurm_options(args: argparse.Namespace) -> dict[str, Any]:
    gpu = args.gpu
    extra = [w for k, v in resources(gpu).items() for w in ("--resources", f"{k}={v}")]
    return {
        "cores": 1,
        "processes": 1,
        "job_cpu": args.cpus,
        "memory": args.memory,
        "walltime": args.walltime,
        "queue": args.partition,
        "account": args.account,
        "interface": args.interface,
        "job_extra_directives": (["--gres=gpu:1"] if gpu else []) + args.directive,
        "worker_extra_args": extra,
    }


def kubernetes(args: argparse.Namespace) -> Any:
    """Pods of the Dask operator."""
    try:
        from dask_kubernetes.operator import KubeCluster
    except ImportError as e:
        raise Failure(f"--kubernetes needs dask-kubernetes (pip install 'lenscube[dask-kubernetes]'): {e}", 2) from e
    return KubeCluster(custom_cluster_spec=kubernetes_spec(args), namespace=args.namespace, quiet=True)


def kubernetes_spec(args: argparse.Namespace) -> dict:
    """The DaskCluster resource: one worker per pod, with all its cores, and a GPU with --gpu."""
    from dask_kubernetes.operator import make_cluster_spec

    if not args.image:
        raise Failure("--kubernetes needs --image NAME: an image with Python, Dask and lenscube", 2)
    env = dict(pair.split("=", 1) for pair in args.env)
    names = {f"DASK_{k.replace('.', '__').replace('-', '_').upper()}": str(v) for k, v in settings().items()}
    command = "dask worker --nthreads 1 --memory-limit 0" + "".join(f" --resources {k}={v}" for k, v in resources(args.gpu).items())
    spec = make_cluster_spec(f"lenscube-{os.getpid()}", args.image, args.kubernetes, env=env | names, worker_command=command)
    pod = spec["spec"]["worker"]["spec"]
    pod["terminationGracePeriodSeconds"] = 30
    limits = {"cpu": str(args.cpus), "memory": kubernetes_bytes(args.memory)} | ({"nvidia.com/gpu": "1"} if args.gpu else {})
    pod["containers"][0]["resources"] = {"requests": dict(limits), "limits": limits}
    for number, volume in enumerate(args.volume):
        claim, _, mount = volume.partition(":")
        pod.setdefault("volumes", []).append({"name": f"v{number}", "persistentVolumeClaim": {"claimName": claim}})
        pod["containers"][0].setdefault("volumeMounts", []).append({"name": f"v{number}", "mountPath": mount})
    return spec


def kubernetes_bytes(memory: str) -> str:
    """`8GiB` in the notation of Kubernetes: `8Gi`."""
    return memory.removesuffix("B")
