"""A client of the cluster that the settings name."""

import contextlib
import importlib
import logging
from collections.abc import Iterator
from typing import Any

import dask
from distributed import Client, LocalCluster
from distributed.security import Security

from palpate.api.executors import ExecutorError
from palpate_dask.executor import DaskSettings, JobQueueSettings

_CLUSTERS = {
    "slurm": "SLURMCluster",
    "pbs": "PBSCluster",
    "sge": "SGECluster",
    "lsf": "LSFCluster",
    "oar": "OARCluster",
    "moab": "MoabCluster",
    "htcondor": "HTCondorCluster",
    "local": "LocalCluster",
}


@contextlib.contextmanager
def connected(settings: DaskSettings, n_workers: int) -> Iterator[Client]:
    """Client of the cluster, which ends with it where it was made for it.

    Parameters
    ----------
    n_workers : int
        Workers of a cluster on this machine.

    Raises
    ------
    ExecutorError
        No scheduler answers, no worker comes, or dask-jobqueue is missing.
    """
    with contextlib.ExitStack() as stack:
        stack.enter_context(_quiet())
        # No automatic retry: an unknown name or port is an error at once.
        alone: dict[str, Any] = {"distributed.comm.retry.count": 0}
        # By itself Dask serves pages over HTTP, to everybody.
        alone |= {f"distributed.{part}.http.routes": [] for part in ("scheduler", "worker")}
        stack.enter_context(dask.config.set(alone))
        if settings.jobqueue is not None:
            cluster = stack.enter_context(_of_batch_system(settings, settings.jobqueue))
        elif settings.address is None and settings.scheduler_file is None:
            cluster = stack.enter_context(_here(n_workers))
        else:
            cluster = None
        yield stack.enter_context(_client(settings, cluster))


@contextlib.contextmanager
def _here(n_workers: int) -> Iterator[LocalCluster]:
    """A cluster inside this process, without a port: other users of the machine cannot reach it."""
    with LocalCluster(
        n_workers=1,
        threads_per_worker=n_workers,
        processes=False,
        protocol="inproc://",
        dashboard_address="127.0.0.1:0",
        scheduler_kwargs={"dashboard": False},
        memory_limit=0,
    ) as cluster:
        # Dask opens a port for its pages whether or not there are any.
        for server in (cluster.scheduler, *cluster.workers.values()):
            server.http_server.stop()
        yield cluster


def _of_batch_system(settings: DaskSettings, queue: JobQueueSettings) -> Any:  # noqa: ANN401 - by name
    module = "dask_jobqueue.local" if queue.system == "local" else "dask_jobqueue"
    try:
        kind = getattr(importlib.import_module(module), _CLUSTERS[queue.system])
    except ImportError:
        raise ExecutorError(
            "executor.settings.jobqueue needs dask-jobqueue, which is not installed; "
            'pip install "palpate-dask[jobqueue]"'
        ) from None
    security = {} if settings.plain_tcp else {"security": _security(settings) or True, "protocol": "tls://"}
    wanted = {
        "cores": queue.cores,
        "processes": 1,
        "memory": f"{queue.memory:.0f} MB",
        "scheduler_options": {"dashboard_address": None},
        **security,
        **queue.options,
    }
    try:
        cluster = kind(**wanted)
        cluster.scale(jobs=queue.n_jobs)
    except Exception as error:
        raise ExecutorError(
            f"executor.settings.jobqueue: the {queue.system} cluster cannot be started "
            f"({type(error).__name__}: {error}); see the options of dask-jobqueue's {_CLUSTERS[queue.system]}"
        ) from error
    return cluster


def _client(settings: DaskSettings, cluster: Any) -> Client:  # noqa: ANN401 - of any kind
    where = settings.address or settings.scheduler_file or "its own cluster"
    try:
        known = {"scheduler_file": settings.scheduler_file, "security": _security(settings)}
        client = Client(
            settings.address if cluster is None else cluster,
            timeout=settings.timeout,
            set_as_default=False,
            **(known if cluster is None else {}),
        )
    except Exception as error:
        raise ExecutorError(
            f"no Dask scheduler answers at {where} within {settings.timeout:g} s "
            f"({type(error).__name__}: {error}); start it, or correct the address or the certificates"
        ) from error
    # Jobs of a batch system may wait for hours; workers of a scheduler at an address are there.
    patience = None if settings.jobqueue is not None else settings.timeout
    try:
        client.wait_for_workers(1, timeout=patience)
    except TimeoutError:
        client.close()
        raise ExecutorError(
            f"the Dask scheduler at {where} has had no worker for {settings.timeout:g} s; start one with "
            f"`dask worker {client.scheduler.address if client.scheduler else where}`"
        ) from None
    return client


def _security(settings: DaskSettings) -> Security | None:
    tls = settings.tls
    if tls is None:
        return None
    pairs: dict[str, str] = {}
    for role in ("client", "scheduler", "worker"):
        pairs |= {f"tls_{role}_cert": tls.cert, f"tls_{role}_key": tls.key}
    return Security(tls_ca_file=tls.ca_file, require_encryption=True, **pairs)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Silence Dask's loggers; palpate reports the errors."""
    loggers = [logging.getLogger(name) for name in ("distributed", "asyncio", "tornado")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
