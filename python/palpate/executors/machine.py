"""Cores, threads for each and memory that this machine has for workers."""

import contextlib
import os
from pathlib import Path

_CGROUP, _OWN_GROUP = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")


def n_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def n_fitting(memory_MB: float) -> int:
    """Number of workers that this machine has room for: one per core, as many as its free memory holds.

    ``memory_MB`` is what each of them may take; 0 where it is not known.
    """
    free_MB = free_memory()
    if not memory_MB or free_MB is None:
        return n_cores()
    return max(1, min(n_cores(), int(free_MB // memory_MB)))


def free_memory() -> float | None:
    """Memory [MB] that can be taken yet, of the machine and of this job's share of it; None if unknown."""
    found = [free for free in (_free_of_machine(), _free_of_group()) if free is not None]
    return min(found, default=None)


def _free_of_machine() -> float | None:
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        kibibytes = next(line.split()[1] for line in lines if line.startswith("MemAvailable:"))
    except (OSError, StopIteration):
        return None
    return int(kibibytes) * 1.024e-3


def _free_of_group() -> float | None:
    """Free part of what a batch system or a container allows, to this process or a group around it."""
    found: list[float] = []
    for folder in _groups():
        with contextlib.suppress(OSError, ValueError):  # "max" is no number: no limit
            most = int((folder / "memory.max").read_text())
            found.append((most - int((folder / "memory.current").read_text())) * 1e-6)
    return min(found, default=None)


def _groups() -> list[Path]:
    """Folders of this process's control group and of those around it."""
    try:
        lines = _OWN_GROUP.read_text().splitlines()
    except OSError:
        lines = []
    own = next((line.removeprefix("0::/") for line in lines if line.startswith("0::/")), "")
    return [folder for folder in (_CGROUP / own / "x").parents if folder.is_relative_to(_CGROUP)]


def thread_limits(n_threads: int) -> dict[str, str]:
    """Environment that holds numerical libraries to ``n_threads`` threads, set before they load.

    OpenBLAS has one: on small matrices its threads wait for each other.
    """
    names = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS", "RAYON_NUM_THREADS")
    # XLA takes NPROC for the size of its pools.
    others = ("VECLIB_MAXIMUM_THREADS", "POLARS_MAX_THREADS", "NPROC")
    limits = dict.fromkeys((*names, *others), str(n_threads)) | {"OPENBLAS_NUM_THREADS": "1"}
    if n_threads == 1:
        flags = os.environ.get("XLA_FLAGS", "")
        limits["XLA_FLAGS"] = f"{flags} --xla_cpu_multi_thread_eigen=false".strip()
    return limits
