"""Executes the units of a lenscube plan with Dask: one task per unit, one process of lenscube per task.

Correctness does not depend on this package: units are idempotent, any two may run concurrently, and a shard is absent or
complete. The driver only keeps all workers busy and submits the missing units:

    main      command line, setup and exit codes
    plan      the plan and unit lists; the missing units as reported by lenscube
    clusters  the workers: of an existing scheduler, of this machine, Slurm or Kubernetes
    drive     units in flight, retries, lost workers
    worker    code for the workers, sent there by value: they need Dask and lenscube, not this package
    progress  progress display and log
"""
