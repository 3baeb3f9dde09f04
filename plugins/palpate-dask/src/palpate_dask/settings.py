"""Where the cluster is, and how it is reached."""

from ipaddress import ip_address
from pathlib import Path
from typing import Annotated, Any, Literal, Self
from urllib.parse import urlsplit

from pydantic import Field, model_validator

from palpate.api import Quantity, Settings


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
