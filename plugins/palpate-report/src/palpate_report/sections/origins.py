"""Sections on the origins of the numbers: limb, deformation, and what they depended on."""

import io
from collections.abc import Iterator, Mapping
from pathlib import Path

from palpate.api import SurfaceStates, convert
from palpate.api.report import (
    COST_HEADS,
    Block,
    Drawing,
    Fold,
    Paragraph,
    Picture,
    Section,
    Table,
    cost_rows,
    shown,
)
from palpate_report.answer.result import Report
from palpate_report.data.marks import in_words
from palpate_report.data.report_data import ReportData
from palpate_report.figures.scene import deepest


def _numbers(states: SurfaceStates, factor: float) -> list[float]:
    k = deepest(states)
    moved = (states.displacements_mm[k] ** 2).sum(axis=1).max(initial=0.0) ** 0.5
    area = (states.areas_mm2[k] * states.touching[k]).sum()
    peak = states.pressures_MPa[k].max(initial=0.0)
    found = (states.depth_mm[k], states.rotation_deg[k], moved, factor * peak, area)
    return [float(value) for value in found]


MOST_BYTES = 400_000
"""Most bytes of all pictures together: they are a part of one page."""

WIDTH = 900
"""Most pixels across."""

N_COLOURS = 64


class Pictures(Section):
    """Section with the pictures that were drawn of each spot before it was simulated."""

    name, title, entry = "pictures", "From limb and log to curves", "Limb and log"
    summary = "pictures of the scanned limb, and of how each press was processed"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Show the pictures of each spot, in the order of the spots, as far as there is room."""
        left, n_left_out = MOST_BYTES, 0
        folds = []
        for spot, paths in data.pictures.items():
            found = []
            for path in paths:
                content = _small(path)
                if content is None or len(content) > left:
                    n_left_out += 1
                    continue
                left -= len(content)
                step = in_words(path.stem)
                found.append(Picture(label=f"{spot}, {path.parent.name}: {step}", content=content))
            if found:
                folds.append(Fold(spot, found))
        if not folds and not n_left_out:
            return
        more = f" {n_left_out} more are in the run directory." if n_left_out else ""
        yield Paragraph(f"Pictures of the limb as it was meshed, and of each press as it was read.{more}")
        yield from folds

    def result(self, data: ReportData, report: Report) -> str:
        """Number of the pictures."""
        return f"{sum(map(len, data.pictures.values()))} pictures, spot by spot"


def _small(path: Path) -> bytes | None:
    """A picture with fewer pixels and colours, as lines and faces have few; None where it cannot be read."""
    from PIL import Image

    try:
        with Image.open(path) as picture:
            reduced = picture.convert("RGB")
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return None
    reduced.thumbnail((WIDTH, 2 * WIDTH))
    written = io.BytesIO()
    # Chosen to cover all hues: by their number those of thin lines would be lost.
    few = reduced.quantize(N_COLOURS, method=Image.Quantize.MAXCOVERAGE)
    few.save(written, "PNG", optimize=True)
    return written.getvalue()


class LimbAndDeformation(Section):
    """The mesh, and the skin under the press."""

    name, title, entry = "limb", "Limb and deformation", "Limb"
    summary = "the mesh with the indenter, and the skin along the path of the press"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Show the skin along the path, and the mesh."""
        yield from _deformed(data)
        if data.limbs:
            yield Paragraph(
                "The mesh around the spot, the indenter at first contact, and the direction of the press. "
                "Drag to turn; click a name to hide or show a part."
            )
            yield Drawing("limb")

    def result(self, data: ReportData, report: Report) -> str:
        """Largest contact pressure of the press."""
        factor = 1.0 / convert(f"1 {data.modulus_unit}", "MPa")
        peaks = [_numbers(states, factor)[3] for states in data.surfaces.values() if states.depth_mm.size]
        return f"largest contact pressure {max(peaks):.3g} {data.modulus_unit}" if peaks else ""


def _deformed(data: ReportData) -> Iterator[Block]:
    """Skin along the path with what was found, and the numbers of its deepest state."""
    found = {spot: data.surfaces[spot] for spot in data.spots if spot in data.surfaces}
    if not any(states.depth_mm.size for states in found.values()):
        return
    yield Paragraph(
        "The skin under the indenter, simulated with the joint fit. "
        "Move the slider from first contact to the end of the path."
    )
    yield Drawing("skin")
    unit = data.modulus_unit
    heads = ["spot", "depth (mm)", "rotation (°)", "largest displacement (mm)"]
    yield Table(
        "At full depth, before the rotation",
        [*heads, f"largest pressure ({unit})", "contact area (mm²)"],
        [
            [spot, *_numbers(states, 1.0 / convert(f"1 {unit}", "MPa"))]
            for spot, states in found.items()
            if states.depth_mm.size
        ],
    )


class Cite(Section):
    """A paragraph for the methods of a paper, and what to cite."""

    name, title, entry = "cite", "Methods and citation", "Cite"
    summary = "a paragraph on the methods from the run's settings, and references in BibTeX"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Show the text with a button that copies it."""
        yield Paragraph("The settings of this run as text; also in methods.md.")
        yield Drawing("methods")

    def result(self, data: ReportData, report: Report) -> str:
        """Contents."""
        return "a paragraph for a paper, and references"


class Provenance(Section):
    """Section on what every number depended on."""

    name, title = "provenance", "Provenance"
    summary = "versions, hashes, settings and conventions"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Show the manifest."""
        yield Paragraph("Inputs, versions and settings behind every number of this page.")
        found = [name for name in ("table1_fit", "table1_coefficients") if name in report.tables]
        if found:
            files = " and ".join(f"tables/{name}.csv" for name in found)
            yield Paragraph(f"Coefficients, each in its convention: {files}.")
        if not data.processor_time.is_empty():
            spent = cost_rows(data.processor_time)
            yield Table("Processor time, without this page", COST_HEADS, spent)
        deep = {key: value for key, value in data.manifest.items() if isinstance(value, (Mapping, list))}
        single = {key: value for key, value in data.manifest.items() if key not in deep}
        rows = [leaf for group, value in (("study", single), *deep.items()) for leaf in _leaves(value, group)]
        yield Drawing("copy")
        yield Table("Inputs, versions and settings", ["item", "value"], rows)

    def result(self, data: ReportData, report: Report) -> str:
        """Versions of palpate and of the solver."""
        versions = data.manifest.get("versions", {})
        found = {"palpate": versions.get("palpate"), "solver": data.study.solver.name}
        return ", ".join(f"{name} {shown(value)}" for name, value in found.items() if value)


def _leaves(value: object, path: str) -> Iterator[tuple[str, str]]:
    """Every number and text within, under the keys that lead to it; lists of plain values are one."""
    if isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
        value = dict(enumerate(value, 1))
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _leaves(item, f"{path} · {key}" if path else str(key))
    else:
        yield path, ", ".join(map(shown, value)) if isinstance(value, list) else shown(value)
