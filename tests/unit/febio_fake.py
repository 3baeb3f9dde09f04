"""Installs the stand-in for febio4."""

import os
import sys
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "data" / "febio_fake" / "fake_febio.py"


def install(folder: Path, name: str = "febio4") -> Path:
    """A program in ``folder`` that behaves as the words of FAKE_FEBIO say."""
    folder.mkdir(parents=True, exist_ok=True)
    program = folder / name
    program.write_text(f"#!{sys.executable}\n{SOURCE.read_text()}")
    program.chmod(0o755)
    return program


def alive(pid: int) -> bool:
    """Whether a process runs (a zombie does not)."""
    try:
        os.kill(pid, 0)
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except (ProcessLookupError, FileNotFoundError):
        return False
    return state != "Z"
