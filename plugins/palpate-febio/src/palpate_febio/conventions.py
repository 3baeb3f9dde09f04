"""Remembers what probes found, by the contents of the binary."""

import contextlib
import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from palpate.api import IsotropicMaterial, Material
from palpate_febio.probe import Fit, probe_theta

FORMAT = 1
"""Changes when a probe's meaning does."""

STRETCHES = np.array([[1.3, 0.9, 0.8], [0.7, 1.2, 1.1]])
GRADIENT = np.array([[1.2, 0.3, 0.0], [0.1, 0.9, -0.2], [0.0, 0.1, 1.1]])
for _array in (STRETCHES, GRADIENT):
    _array.setflags(write=False)


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
    """A material with its code, settings, energy and spelling, and how its coefficients may be written."""
    kind = type(material)
    theta = probe_theta(material)
    if isinstance(material, IsotropicMaterial):
        energy = material.energy(STRETCHES, theta)
    else:
        energy = material.energy_from_F(GRADIENT, theta)
    conventions = {name: list(factors) for name, factors in material.conventions.items()}
    spelled = getattr(material, "febio", None)
    return json.dumps(
        [
            FORMAT,
            f"{kind.__module__}.{kind.__qualname__} {material.fingerprint()}",
            material.settings.model_dump_json(),
            [f"{value:.9g}" for value in np.atleast_1d(energy)],
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
