"""The executor: jobs to a Dask cluster, results back as they come."""

import weakref
from collections.abc import Iterator
from ipaddress import ip_address
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self
from urllib.parse import urlsplit

from pydantic import Field, model_validator

from palpate.api import Quantity, Settings, Simulation
from palpate.api.executors import Batch, Executor, n_cores, packed_or_refused

if TYPE_CHECKING:
    from palpate_dask.flow import Connection


class TlsSettings(Settings):
    """TLS certificates; paths are relative to where palpate is started."""

    ca_file: str = Field(description="Certificate of the authority that signed all others.")
    cert: str = Field(description="Certificate of this side.")
    key: str = Field(description="Private key of this side.")

    @model_validator(mode="after")
    def _are_there(self) -> Self:
        for name in ("ca_file", "cert", "key"):
            if not Path(getattr(self, name)).is_file():
                raise ValueError(f"{name}: no file '{getattr(self, name)}'")
        return self


class JobQueueSettings(Settings):
    """Workers as jobs of a batch system, through dask-jobqueue."""

    system: Literal["slurm", "pbs", "sge", "lsf", "oar", "moab", "htcondor", "local"] = Field(
        description="The batch system; local: this machine plays one, to try a study out."
    )
    n_jobs: int = Field(1, ge=1, description="Jobs to submit, each with `cores` workers.")
    cores: int = Field(1, ge=1, description="Cores of a job; as many simulations run there side by side.")
    memory: Annotated[float, Quantity("MB")] = Field(description="Memory of a job.", gt=0.0)
    options: dict[str, Any] = Field(
        default={},
        description="Further arguments of dask-jobqueue's cluster, such as queue, account, walltime, "
        "interface, job_extra_directives, job_script_prologue.",
    )


class DaskSettings(Settings):
    """A cluster: at an address, by a scheduler file, of a batch system, or by itself on this machine."""

    address: str | None = Field(None, description='Of a scheduler, such as "tls://head:8786".')
    scheduler_file: str | None = Field(None, description="File in which a scheduler has left its address.")
    jobqueue: JobQueueSettings | None = Field(None, description="Jobs of a batch system to start workers by.")
    tls: TlsSettings | None = Field(None, description="Certificates for tls:// addresses.")
    plain_tcp: bool = Field(
        False,
        description="Talk to other machines unencrypted: whoever reaches the port can run programs there. "
        "Only on a network where everybody may.",
    )
    timeout: Annotated[float, Quantity("s")] = Field(
        30.0, gt=0.0, description="Longest wait for the scheduler, and for its first worker."
    )

    @model_validator(mode="after")
    def _is_one_place(self) -> Self:
        given = [
            name for name in ("address", "scheduler_file", "jobqueue") if getattr(self, name) is not None
        ]
        if len(given) > 1:
            raise ValueError(f"{' and '.join(given)} name different clusters; keep one")
        if self.address is not None:
            self._check_address(urlsplit(self.address))
        if self.scheduler_file is not None and not Path(self.scheduler_file).is_file():
            raise ValueError(f"scheduler_file: no file '{self.scheduler_file}'; start the scheduler first")
        return self

    def _check_address(self, parts: Any) -> None:  # noqa: ANN401 - what urlsplit returns
        if parts.scheme not in ("tcp", "tls") or not parts.hostname or parts.port is None:
            raise ValueError(
                f"address: '{self.address}' is not of the form tls://host:port or tcp://host:port"
            )
        if parts.scheme == "tls" and self.tls is None:
            raise ValueError("address: tls:// needs certificates; give tls = { ca_file, cert, key }")
        if parts.scheme == "tcp" and not is_loopback(parts.hostname) and not self.plain_tcp:
            raise ValueError(
                f"address: {self.address} would be reached unencrypted; use tls:// with tls = "
                "{ ca_file, cert, key }, or set plain_tcp = true on a network that nobody else reaches"
            )


def is_loopback(host: str) -> bool:
    """Whether a host can only be this machine."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


class DaskExecutor(Executor[DaskSettings]):
    """Runs the jobs on a Dask cluster, each in a worker process of palpate.

    Notes
    -----
    Each result is returned as it comes, so finished jobs are kept if the cluster fails. If the
    scheduler ends, the sweep stops with an error, and the next run continues it. Cluster and
    worker processes wait for the next batch until :meth:`close`.
    """

    name = "dask"
    summary = "a Dask cluster: this machine, an address, or the nodes of a batch system"

    _connection: "Connection | None" = None

    def results(self, batch: Batch) -> Iterator[tuple[int, Simulation]]:
        """Yield the result of each job as it comes.

        Raises
        ------
        ExecutorError
            No scheduler, no workers, workers with other versions, or the scheduler ended.
        PluginError
            The solver or a material cannot be sent, or a worker process cannot start.
        """
        if not batch.jobs:
            return
        packed_or_refused(batch.solver, f"solver '{batch.solver.name}'")
        packed_or_refused(batch.jobs[0], "a material of the study")
        connection, is_over = self._connected(batch.n_workers or n_cores()), False
        try:
            yield from connection.results(batch)
            is_over = True
        finally:
            if not is_over:  # the caller left early, or it failed
                self.close()

    def close(self) -> None:
        """End every process of a worker, and the cluster where it was made for this executor."""
        if self._connection is not None:
            self._close_connection()
            self._connection = None

    def _connected(self, n_workers: int) -> "Connection":
        """Keep the connection of the batch before where it has as many workers."""
        from palpate_dask.flow import Connection  # here: who lists plugins needs no Dask

        if self._connection is None or self._connection.n_workers != n_workers:
            self.close()
            self._connection = Connection(self.settings, n_workers)
            self._close_connection = weakref.finalize(self, self._connection.close)
        return self._connection
