"""Unit lists, plans, progress lines and cluster specifications, without any process."""

import io

import pytest

from lenscube.dask import clusters, main
from lenscube.dask.plan import Failure, Plan, format_units, parse_units
from lenscube.dask.progress import Display, clock


@pytest.mark.parametrize("text, units", [("3,7-9\n", [3, 7, 8, 9]), ("", []), ("\n", []), ("0-0,2", [0, 2])])
def test_unit_lists_are_parsed(text, units):
    assert parse_units(text.strip()) == units


@pytest.mark.parametrize("text", ["3-", "a", "-3", "3--4", "0x1"])
def test_invalid_unit_list_is_an_error(text):
    with pytest.raises(ValueError, match="3,7-9"):
        parse_units(text)


def test_formatted_unit_lists_parse_to_the_same_units():
    for units in ([], [5], [0, 1, 2], [9, 7, 8, 3]):
        assert parse_units(format_units(units)) == sorted(units)
    assert format_units([9, 7, 8, 3]) == "3,7-9"


def test_invalid_or_missing_plan_exits_2(tmp_path):
    (tmp_path / "other.json").write_text('{"a": 1}')
    with pytest.raises(Failure, match="is not a plan") as caught:
        Plan.read(tmp_path / "other.json")
    assert caught.value.code == 2
    with pytest.raises(Failure, match="No such file"):
        Plan.read(tmp_path / "none.json")


def test_durations_are_in_s_min_or_h():
    assert [clock(s) for s in (0.4, 59.4, 59.7, 119.9, 3599.9, 7260, float("inf"))] == [
        "0 s", "59 s", "1 min 00 s", "2 min 00 s", "1 h 00 min", "2 h 01 min", "?",
    ]  # fmt: skip


def test_progress_line_counts_units_tiles_and_hosts(monkeypatch):
    monkeypatch.setattr("lenscube.dask.progress.time.monotonic", lambda: 1000.0)
    display = Display([10] * 4, [1, 2, 3], out=io.StringIO())
    assert "waiting for workers" in display.line()
    display.event({"event": "start", "unit": 1, "host": "a", "name": "a"})
    display.event({"event": "start", "unit": 2, "host": "b", "name": "b"})
    display.event({"event": "progress", "unit": 2, "host": "b", "name": "b", "tiles": 5, "pixels": 5_000_000})
    display.event({"event": "end", "unit": 1, "host": "a", "name": "a", "code": 0})
    display.done(1, 10_000_000)
    monkeypatch.setattr("lenscube.dask.progress.time.monotonic", lambda: 1010.0)
    assert display.line() == "2 of 4 units, 50 %, 1.5 Mpx/s, 1 running on 1 host, 10 s left"


def test_flags_after_dashes_are_passed_to_lenscube():
    args = main.arguments(["job.json", "--scheduler", "tcp://h:1", "--gpu", "--", "--memory", "8GiB"])
    assert main.settings(args).flags == ["--memory", "8GiB", "--device", "cuda"]
    args = main.arguments(["job.json", "--scheduler", "tcp://h:1", "--gpu", "--", "--device=cuda:1"])
    assert main.settings(args).flags == ["--device=cuda:1"]


def test_two_kinds_of_workers_exit_2():
    with pytest.raises(SystemExit) as caught:
        main.arguments(["job.json", "--local", "2", "--slurm", "3"])
    assert caught.value.code == 2


def test_slurm_job_has_one_worker_and_gpu():
    jobqueue = pytest.importorskip("dask_jobqueue")
    argv = ["job.json", "--slurm", "3", "--gpu", "--cpus", "16", "--memory", "32GiB", "--partition", "main", "--directive=--qos=low"]
    options = clusters.slurm_options(main.arguments(argv))
    with jobqueue.SLURMCluster(**options, n_workers=0, scheduler_options={"host": "127.0.0.1", "dashboard_address": ":0"}) as cluster:
        script = cluster.job_script()
    for line in ("--cpus-per-task=16", "--gres=gpu:1", "--qos=low", "-p main", "-t 04:00:00", "--mem=32G"):
        assert f"#SBATCH {line}\n" in script
    assert "--nthreads 1" in script and "--resources GPU=1" in script


def test_pod_has_one_worker_gpu_and_volume():
    pytest.importorskip("dask_kubernetes")
    argv = ["job.json", "--kubernetes", "5", "--gpu", "--image", "lenscube:1", "--cpus", "4", "--memory", "16GiB"]
    argv += ["--volume", "films:/films", "--env", "AWS_REGION=eu-west-1"]
    spec = clusters.kubernetes_spec(main.arguments(argv))["spec"]
    worker = spec["worker"]["spec"]["containers"][0]
    assert spec["worker"]["replicas"] == 5
    assert worker["resources"]["limits"] == {"cpu": "4", "memory": "16Gi", "nvidia.com/gpu": "1"}
    assert worker["volumeMounts"] == [{"name": "v0", "mountPath": "/films"}]
    assert " ".join(worker["args"]).startswith("dask worker --nthreads 1 --memory-limit 0 --resources GPU=1")
    scheduler = {e["name"]: e["value"] for e in spec["scheduler"]["spec"]["containers"][0]["env"]}
    assert scheduler["DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL"] == "30s" and scheduler["AWS_REGION"] == "eu-west-1"
    assert "resources" not in spec["scheduler"]["spec"]["containers"][0] or not spec["scheduler"]["spec"]["containers"][0]["resources"]


def test_kubernetes_without_image_is_an_error():
    pytest.importorskip("dask_kubernetes")
    with pytest.raises(Failure, match="--image"):
        clusters.kubernetes_spec(main.arguments(["job.json", "--kubernetes", "5"]))


def test_dask_settings_of_the_user_are_kept():
    import dask

    assert clusters.settings()["distributed.scheduler.worker-ttl"] == "30s"
    with dask.config.set({"distributed.scheduler.worker-ttl": "10s"}):
        assert "distributed.scheduler.worker-ttl" not in clusters.settings()
