"""Remembers what probes found, by the contents of the binary."""

import contextlib
import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path

from palpate.interfaces import Material
from palpate_febio.probe import Fit

FORMAT = 1
"""Changes when a probe's meaning does."""


def cache_folder() -> Path:
    """Where findings are kept: the user's cache."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "palpate" / "febio"


def remembered(material: Material, digest: str, probe: Callable[[], Fit], folder: Path | None = None) -> Fit:
    """What a probe of this material with this binary found, probing only once.

    Parameters
    ----------
    material : Material
    digest : str
        Of the binary (:class:`palpate_febio.binary.Binary`).
    probe : callable
        Runs the probe; what it raises is not remembered.
    folder : Path, optional
        Default: :func:`cache_folder`.
    """
    folder = cache_folder() if folder is None else folder
    file = folder / f"{digest[:32]}.json"
    known = _read(file)
    key = _key(material)
    if key in known:
        return known[key]
    found = probe()
    _write(file, {**_read(file), key: found})
    return found


def _key(material: Material) -> str:
    """A material with its settings, the way FEBio spells it, and how its coefficients may be written."""
    kind = type(material)
    conventions = {name: list(factors) for name, factors in material.conventions.items()}
    spelled = getattr(material, "febio", None)
    return json.dumps(
        [
            FORMAT,
            f"{kind.__module__}.{kind.__qualname__}",
            material.settings.model_dump_json(),
            conventions,
            None if spelled is None else [spelled[0], sorted(spelled[1].items())],
            [[p.name, p.lower, p.upper] for p in material.parameters],
        ]
    )


def _read(file: Path) -> dict[str, Fit]:
    """What is in the file; nothing where it is missing, damaged or of another time."""
    try:
        raw = json.loads(file.read_text())
        return {key: Fit(str(row["convention"]), dict(row["deviations"])) for key, row in raw.items()}
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return {}


def _write(file: Path, known: dict[str, Fit]) -> None:
    """Replace the file whole; a folder that cannot be written costs a probe more next time."""
    rows = {k: {"convention": f.convention, "deviations": dict(f.deviations)} for k, f in known.items()}
    with contextlib.suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=file.parent, prefix=".new-")
        with os.fdopen(handle, "w") as stream:
            json.dump(rows, stream, indent=1)
        Path(name).replace(file)
