"""Does the units of a lenscube plan with Dask: one unit a task, one process of lenscube a unit.

What is right does not depend on anything here: units are idempotent, any two may run at the same time, and a shard is
absent or complete. So the driver only has to keep every worker busy and to ask for what is missing:

    main      flags, start and end
    plan      the plan and unit lists; what is missing, asked of lenscube itself
    clusters  the workers: those of a scheduler, or of this machine, Slurm, Kubernetes
    drive     units in flight, retries, lost workers, the end
    worker    runs on the workers, sent there by value: they need Dask and lenscube, not this package
    progress  what is shown meanwhile
"""
