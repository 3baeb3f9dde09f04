"""Finds FEBio, asks its version, and knows it again by its contents."""

import hashlib
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from palpate.api import PluginError
from palpate.api.files import ProcessLimits, run_program

HOW_TO_GET_IT = (
    "install FEBio 4 (free, from https://febio.org/downloads, or built from "
    "https://github.com/febiosoftware/FEBio) and put febio4 on PATH, or name it in the solver's setting "
    "executable; solver 'jax' needs no other program"
)
MEASURED = ((4, 4), (4, 11))
"""Versions, first and last, whose conventions were measured."""


@dataclass(frozen=True, slots=True)
class Binary:
    """Installed FEBio: its path, version, and a digest of it and its libraries."""

    path: Path
    version: str
    digest: str

    @property
    def release(self) -> tuple[int, int]:
        """Major and minor version."""
        major, minor = self.version.split(".")[:2]
        return int(major), int(minor)

    @property
    def remark(self) -> str:
        """Remark on this version; empty where everything was measured with it."""
        first, last = MEASURED
        if first <= self.release <= last:
            return ""
        return (
            f"FEBio {self.version} was not measured ({first[0]}.{first[1]} to {last[0]}.{last[1]} were): "
            "`palpate --plugin benchmarks/certify.py certify`, in palpate's sources, checks its curves"
        )


def find_binary(executable: str = "") -> Path:
    """Path of febio4: the setting, else PATH, else the usual places.

    Raises
    ------
    PluginError
        Saying where it was looked for and how to get it.
    """
    if executable:
        found = shutil.which(os.path.expanduser(executable))
        if found is None:
            raise PluginError(
                f"setting executable: '{executable}' is no program that can be run; correct it, or "
                f"{HOW_TO_GET_IT}"
            )
        return Path(found).resolve()
    for place in (None, *map(str, _usual_places())):  # PATH comes first
        for name in ("febio4", "febio4.exe", "FEBio4"):
            if found := shutil.which(name, path=place):
                return Path(found).resolve()
    raise PluginError(f"no febio4 on PATH nor where FEBio is usually installed: {HOW_TO_GET_IT}")


def _usual_places() -> Iterator[Path]:
    # Where the installers put it; ``*`` stands for a version.
    for pattern in (
        "/opt/FEBioStudio*/bin",
        "/opt/febio*/bin",
        "/usr/local/FEBioStudio*/bin",
        "/usr/local/febio*/bin",
        "/Applications/FEBioStudio*/FEBioStudio.app/Contents/MacOS",
        "~/FEBioStudio*/bin",
        "~/febio*/bin",
    ):
        whole = Path(pattern).expanduser()
        yield from sorted(Path(whole.anchor).glob(str(whole.relative_to(whole.anchor))), reverse=True)


def examine(path: Path) -> Binary:
    """Ask a program its version and refuse what is not FEBio 4.

    Raises
    ------
    PluginError
    """
    with tempfile.TemporaryDirectory(prefix="palpate-febio-") as folder:
        # -norun ends FEBio before it asks for input; its exit code is then 1 by design.
        ended = run_program(
            [str(path), "-noconfig", "-nosplash", "-info", "-norun"],
            Path(folder),
            ProcessLimits(time_s=60.0, stall_s=60.0),
            is_scratch=True,
        )
    found = re.search(r"FEBio version\s*=\s*(\S+)", ended.tail)
    if found is None:
        said = " ".join(ended.tail.split())[:200] or "nothing"
        raise PluginError(f"{path}: does not say that it is FEBio (it said: {said}); {HOW_TO_GET_IT}")
    version = found.group(1)
    if not re.match(r"\d+\.\d+", version) or int(version.split(".")[0]) != 4:
        raise PluginError(
            f"{path}: FEBio {version}, and palpate writes decks for FEBio 4. FEBio 3 and older read no 4.0 "
            f"deck (rigid_bc, MeshDomains and load_controller are spelled otherwise); {HOW_TO_GET_IT}"
        )
    return Binary(path, version, _digest(path))


def _digest(path: Path) -> str:
    """SHA-256 over the program and its own libraries, which hold the mechanics."""
    digest = hashlib.sha256()
    for file in [path, *_libraries(path)]:
        digest.update(file.name.encode())
        with file.open("rb") as stream:
            digest.update(hashlib.file_digest(stream, "sha256").digest())
    return digest.hexdigest()


def _libraries(path: Path) -> list[Path]:
    folders = [path.parent, path.parent.parent / "lib", path.parent.parent / "Frameworks"]
    endings = (".so", ".dylib", ".dll")
    return sorted(
        file
        for folder in folders
        if folder.is_dir()
        for file in folder.iterdir()
        if file.is_file()
        and file.name.lower().removeprefix("lib").startswith(("fe", "numcore"))
        and any(ending in file.name for ending in endings)
    )
