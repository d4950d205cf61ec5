"""The templates: kubernetes.yaml against the schema of Kubernetes, slurm.sbatch with fakes of srun and scontrol."""

import os
import subprocess
from pathlib import Path

import pytest

HERE = Path(__file__).parent.parent


@pytest.fixture
def job_yaml() -> dict:
    yaml = pytest.importorskip("yaml")
    return yaml.safe_load((HERE / "kubernetes.yaml").read_text())


def test_kubernetes_job_is_valid_by_its_schema(job_yaml):
    validate = pytest.importorskip("kubernetes_validate")
    validate.validate(job_yaml, "1.33", strict=True)
    job_yaml["spec"]["podFailurePolicy"]["rules"][1]["operator"] = "In"  # invalid here: the check must fail
    with pytest.raises(validate.ValidationError):
        validate.validate(job_yaml, "1.33", strict=True)


def test_kubernetes_job_fulfils_rules_of_the_api_server(job_yaml):
    """Rules of the API server that are not in the schema."""
    spec = job_yaml["spec"]
    pod = spec["template"]["spec"]
    rules = spec["podFailurePolicy"]["rules"]
    codes = next(r["onExitCodes"] for r in rules if "onExitCodes" in r)
    assert pod["restartPolicy"] == "Never", "required by podFailurePolicy"
    assert spec["completionMode"] == "Indexed", "required by backoffLimitPerIndex"
    assert codes["containerName"] in [c["name"] for c in pod["containers"]]
    assert codes["values"] == sorted(set(codes["values"]))
    assert not {0, 75, 130} & set(codes["values"])
    mounted = {m["name"] for c in pod["containers"] for m in c["volumeMounts"]}
    assert mounted == {v["name"] for v in pod["volumes"]}


def sbatch(tmp_path, code: int, restarts: int | None = None) -> tuple[int, str, str]:
    """Runs the script like Slurm, with an `srun` that ends with `code`: exit code, arguments of srun and of scontrol."""
    for name, body in {"srun": f'echo "$@" >{tmp_path}/run; exit {code}', "scontrol": f'echo "$@" >{tmp_path}/requeued; kill $PPID'}.items():
        (tmp_path / name).write_text(f"#!/bin/sh\n{body}\n")
        (tmp_path / name).chmod(0o755)
    env = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "SLURM_CPUS_PER_TASK": "4", "SLURM_ARRAY_TASK_ID": "7", "SLURM_JOB_ID": "42"}
    env |= {"LENSCUBE_PAUSE": "0"} | ({"SLURM_RESTART_COUNT": str(restarts)} if restarts is not None else {})
    done = subprocess.run(["bash", HERE / "slurm.sbatch", "job.json", "--memory", "4GiB"], env=env, capture_output=True, timeout=600)
    read = [(tmp_path / n).read_text().strip() if (tmp_path / n).exists() else "" for n in ("run", "requeued")]
    return done.returncode, *read


@pytest.mark.parametrize("code, retried", [(0, False), (1, False), (2, False), (3, False), (75, True), (130, True), (137, True)])
def test_slurm_script_requeues_75_130_and_kills_only(tmp_path, code, retried):
    ended, run, requeued = sbatch(tmp_path, code)
    assert run.endswith("lenscube run --plan job.json --unit env:SLURM_ARRAY_TASK_ID --threads 4 --memory 4GiB")
    assert requeued == ("requeue 42" if retried else "")
    assert retried or ended == code


def test_slurm_script_requeues_at_most_10_times(tmp_path):
    assert sbatch(tmp_path, 75, restarts=9)[2] == "requeue 42"
    (tmp_path / "requeued").unlink()
    assert sbatch(tmp_path, 75, restarts=10)[0::2] == (75, "")
