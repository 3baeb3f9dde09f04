"""Functions that JAX compiled, kept on disk for the next process.

JAX's own cache: a file for each function, by a hash of the operations that it was traced to, of the
versions of JAX and XLA, and of their flags. A file that is missing or cut short costs a compilation and
nothing else, so the folder may be deleted at any time and used by any number of workers. JAX never replaces a
file, so damaged ones are deleted here, when they have changed since the last process looked at them.
"""

import hashlib
import platform
import warnings
import zlib
from contextlib import suppress
from pathlib import Path

import jax
import platformdirs


def keep_compilations() -> None:
    """Let JAX keep what it compiles in the user's cache folder, unless JAX has a folder already."""
    if jax.config.jax_compilation_cache_dir is not None:  # type: ignore[attr-defined]
        return
    folder = platformdirs.user_cache_path("palpate") / "compiled" / _processor()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return  # without a folder of its own, a user compiles each time
    delete_damaged(folder)
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache", UserWarning)
    for name, value in (
        ("jax_compilation_cache_dir", str(folder)),
        ("jax_persistent_cache_min_compile_time_secs", 0.0),
        ("jax_persistent_cache_min_entry_size_bytes", -1),
    ):
        jax.config.update(name, value)  # type: ignore[no-untyped-call]


def delete_damaged(folder: Path) -> None:
    """Delete files that are no whole stream of zlib, of those that changed since the last call."""
    # File whose time says when the folder was last looked at.
    mark = folder / "checked"
    with suppress(OSError):
        last = mark.stat().st_mtime_ns if mark.exists() else 0
        changed = [file for file in folder.glob("*-cache") if file.stat().st_mtime_ns >= last]
        mark.touch()
        for file in changed:
            content = file.read_bytes()
            # With another compressor at hand, JAX writes other streams.
            # First bytes of a stream of Zstandard.
            if not content.startswith(b"\x28\xb5\x2f\xfd") and not _is_whole(content):
                file.unlink(missing_ok=True)


def _is_whole(content: bytes) -> bool:
    try:
        stream = zlib.decompressobj()
        stream.decompress(content)
    except zlib.error:
        return False
    return stream.eof


def _processor() -> str:
    """Hash of what the processor can do: the machines of a cluster may share a home, but not their code."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        able = next(line for line in lines if line.startswith(("flags", "Features")))
    except (OSError, StopIteration):
        able = platform.processor()
    return hashlib.sha256(f"{platform.machine()} {able}".encode()).hexdigest()[:16]
