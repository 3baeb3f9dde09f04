"""Convention in which an installed FEBio reads a material, by one element per deformation; kept in a cache.

A coefficient that is named alike may be read otherwise: FEBio 4.4 to 4.11 takes
a Yeoh c_k for what is k c_k in the textbook, against its own manual. So the
stress of a few deformations is compared with the derivative of palpate's energy
in every convention that the material knows, and the one that fits is used.
"""

import contextlib
import json
import re
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import platformdirs

from palpate.api import FloatArray, IsotropicMaterial, Material, MaterialError
from palpate.api.files import ProcessLimits, run_program, write_atomically
from palpate.api.mesh import CUBE
from palpate_febio.deck import DECK_NAME, LOG_NAME, add_material, hold, leaf, new_deck, to_bytes
from palpate_febio.log import read_log
from palpate_febio.outcome import RecordError, read_record
from palpate_febio.spelling import Written, written

TOLERANCE = 1e-6
"""Of the stress, relative to its largest component; a right convention fits to 1e-9, a wrong one to 1e-2."""

N_STEPS = 5
STRESS_NAME = "stress.csv"
STRESS_DATA = ("sx", "sy", "sz", "sxy", "syz", "sxz")
COMPONENTS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))

GRADIENTS = np.array(
    [
        [[0.8, 0.0, 0.0], [0.0, -0.25, 0.0], [0.0, 0.0, -0.25]],
        [[0.0, 1.2, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
        [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]],
        [[0.5, 0.1, 0.0], [0.05, -0.15, 0.075], [0.0, 0.025, -0.125]],
    ]
)
"""H of F = 1 + s H, s from 0 to 1: stretch, shear, volume and all at once."""
GRADIENTS.setflags(write=False)


@dataclass(frozen=True, slots=True)
class Fit:
    """Deviation of FEBio's stress by convention, and the convention that fits."""

    convention: str
    deviations: Mapping[str, float]


def probe_theta(material: Material) -> FloatArray:
    """Textbook values to probe with: the middle of each range, which is far from zero."""
    return np.array([0.5 * (p.lower + p.upper) for p in material.parameters])


def probe_deck(material: Written) -> bytes:
    """Deck of cubes, each deformed as a whole; one more, left alone, gives FEBio an equation to solve."""
    root, control = new_deck(np.arange(N_STEPS + 1.0))
    leaf(ET.SubElement(control, "solver", type="solid"), "symmetric_stiffness", "symmetric")
    add_material(ET.SubElement(root, "Material"), 1, "probed", material, digits=17)
    n = len(GRADIENTS)
    mesh = ET.SubElement(root, "Mesh")
    nodes = ET.SubElement(mesh, "Nodes", name="all")
    for k, point in enumerate(np.tile(CUBE, (n + 1, 1)).astype(np.float64).tolist(), start=1):
        leaf(nodes, "node", ",".join(map(str, point)), id=str(k))
    cells = ET.SubElement(mesh, "Elements", type="hex8", name="cubes")
    for k in range(n + 1):
        leaf(cells, "elem", _list(range(8 * k + 1, 8 * k + 9)), id=str(k + 1))
    for k in range(n):
        leaf(mesh, "NodeSet", _list(range(8 * k + 1, 8 * k + 9)), name=f"cube{k}")
    leaf(mesh, "NodeSet", _list(range(8 * n + 1, 8 * n + 5)), name="base")
    ET.SubElement(ET.SubElement(root, "MeshDomains"), "SolidDomain", name="cubes", mat="probed")
    _motion(root)
    log = ET.SubElement(ET.SubElement(root, "Output"), "logfile")
    for k in range(n):
        wanted = {"data": ";".join(STRESS_DATA), "delim": ",", "file": f"{k}{STRESS_NAME}"}
        leaf(log, "element_data", k + 1, **wanted)
    return to_bytes(root)


def _list(numbers: range) -> str:
    return ",".join(map(str, numbers))


def _motion(root: ET.Element) -> None:
    section = ET.SubElement(root, "Boundary")
    for k, H in enumerate(GRADIENTS):
        bc = ET.SubElement(
            section, "bc", name=f"deform{k}", node_set=f"cube{k}", type="prescribed deformation"
        )
        leaf(bc, "scale", 1, lc="1")
        leaf(bc, "F", ",".join(format(v, ".17g") for v in (np.eye(3) + H).ravel()))
    hold(section, "base")
    curve = ET.SubElement(ET.SubElement(root, "LoadData"), "load_controller", id="1", type="loadcurve")
    leaf(curve, "interpolate", "LINEAR")
    points = ET.SubElement(curve, "points")
    for k in (0, N_STEPS):
        leaf(points, "pt", f"{k},{k / N_STEPS:g}")


def read_stress(texts: list[str]) -> FloatArray:
    """Cauchy stress (n_deformations, N_STEPS, 6) from the records of the cubes.

    Raises
    ------
    RecordError
        A record is malformed, cut off, or not finite.
    """
    found = []
    for k, text in enumerate(texts):
        record = read_record(text, len(STRESS_DATA))
        keep = np.isin(record.times, np.arange(1.0, N_STEPS + 1))
        if keep.sum() != N_STEPS or not np.isfinite(record.values[keep]).all():
            raise RecordError(
                f"deformation {k}: {keep.sum()} of {N_STEPS} states, or values that are not finite"
            )
        found.append(record.values[keep])
    return np.array(found)


def fit(material: Material, sent: FloatArray, stress: FloatArray) -> Fit:
    """Convention in which the numbers in the deck give the recorded stress.

    Parameters
    ----------
    sent : (n_parameters,) array
        As they stood in the deck, in the material's order.
    stress : (n_deformations, N_STEPS, 6) array
        As :func:`read_stress` returns it.

    Raises
    ------
    MaterialError
        None fits; with the figures.
    """
    from palpate.api.mechanics import cauchy_stress

    s = np.arange(1, N_STEPS + 1)[:, None, None] / N_STEPS
    F = np.eye(3) + GRADIENTS[:, None] * s
    deviations = {}
    for convention in ("textbook", *material.conventions):
        theta = material.to_textbook(sent, convention)
        cauchy = np.asarray(cauchy_stress(material, F, theta))
        expected = np.stack([cauchy[..., i, j] for i, j in COMPONENTS], axis=-1)
        error = np.abs(stress - expected).max(axis=-1) / np.abs(expected).max(axis=-1)
        deviations[convention] = float(error.max())
    best = min(deviations, key=lambda name: deviations[name])
    if not deviations[best] < TOLERANCE:
        figures = ", ".join(f"{name} {value:.2e}" for name, value in deviations.items())
        raise MaterialError(
            f"material '{material.name}': the stress of this FEBio fits no known convention (largest "
            f"deviation of the stress: {figures}; {TOLERANCE:g} would fit); add the convention to the "
            "material, or use another solver"
        )
    return Fit(best, deviations)


def run_probe(material: Material, command: list[str], limits: ProcessLimits) -> Fit:
    """Convention that a run of the probe shows; a temporary folder holds the run.

    Parameters
    ----------
    command : list of str
        The program with its options, to which the deck's name is added.

    Raises
    ------
    MaterialError
        FEBio could not run it, or computes something that is not known.
    """
    sent = probe_theta(material)
    with tempfile.TemporaryDirectory(prefix="palpate-febio-") as name:
        folder = Path(name)
        (folder / DECK_NAME).write_bytes(probe_deck(written(material, sent, "textbook")))
        ended = run_program([*command, "-i", DECK_NAME, "-o", LOG_NAME], folder, limits, is_scratch=True)
        files = [folder / f"{k}{STRESS_NAME}" for k in range(len(GRADIENTS))]
        texts = [file.read_text(errors="replace") for file in files if file.is_file()]
    said = read_log(ended.tail)
    if ended.exit_code != 0 or said.finished is not True or len(texts) < len(GRADIENTS):
        why = ended.stopped or str(said.reason or f"exit code {ended.exit_code}")
        raise MaterialError(
            f"material '{material.name}': this FEBio could not run the probe of it "
            f"({re.sub(r'[. ]+$', '', why)})"
        )
    try:
        return fit(material, sent, read_stress(texts))
    except RecordError as error:
        raise MaterialError(
            f"material '{material.name}': the probe's record: {error}; run it again"
        ) from None


STRETCHES = np.array([[1.3, 0.9, 0.8], [0.7, 1.2, 1.1]])
GRADIENT = np.array([[1.2, 0.3, 0.0], [0.1, 0.9, -0.2], [0.0, 0.1, 1.1]])
for _array in (STRETCHES, GRADIENT):
    _array.setflags(write=False)


def remembered(material: Material, digest: str, probe: Callable[[], Fit], folder: Path | None = None) -> Fit:
    """Result of a probe of this material with this binary, from the cache if it is there.

    Parameters
    ----------
    digest : str
        Of the binary (:class:`palpate_febio.binary.Binary`).
    probe : callable
        Runs the probe; what it raises is not remembered.
    folder : Path, optional
        Default: ``febio`` in palpate's folder of the user's cache.
    """
    folder = folder or platformdirs.user_cache_path("palpate") / "febio"
    file = folder / f"{digest[:32]}.json"
    known = _read(file)
    key = _key(material)
    if key in known:
        return known[key]
    found = probe()
    _write(file, {**_read(file), key: found})
    return found


def _key(material: Material) -> str:
    """Key of a material: its code, settings, energy, spelling and conventions."""
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
            1,  # changes when a probe's meaning does
            f"{kind.__module__}.{kind.__qualname__} {material.fingerprint()}",
            material.settings.model_dump_json(),
            [f"{value:.9g}" for value in np.atleast_1d(energy)],
            conventions,
            None if spelled is None else [spelled[0], sorted(spelled[1].items())],
            [[p.name, p.lower, p.upper] for p in material.parameters],
        ]
    )


def _read(file: Path) -> dict[str, Fit]:
    """Results in a file; none where it is missing, damaged or of another format."""
    try:
        raw = json.loads(file.read_text())
        return {key: Fit(str(row["convention"]), dict(row["deviations"])) for key, row in raw.items()}
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return {}


def _write(file: Path, known: dict[str, Fit]) -> None:
    """Replace the file whole; a folder that cannot be written costs a probe more next time."""
    rows = {k: {"convention": f.convention, "deviations": dict(f.deviations)} for k, f in known.items()}
    with contextlib.suppress(OSError):
        write_atomically(file, json.dumps(rows, indent=1).encode())
