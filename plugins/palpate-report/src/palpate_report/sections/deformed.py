"""The limb as the press deforms it."""

from collections.abc import Iterator

from palpate.api import SurfaceStates, convert
from palpate.api.report import Block, Drawing, Paragraph, Section, Table
from palpate_report.report_data import ReportData
from palpate_report.result import Report
from palpate_report.skin import deepest


class Deformed(Section):
    """The skin along the path, with what was found."""

    name, title, entry = "deformed", "The limb under the press", "Deformed limb"
    summary = "the skin along the path with displacement and contact pressure"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Show the skin, and the numbers of its deepest state."""
        found = {spot: data.surfaces[spot] for spot in data.spots if spot in data.surfaces}
        if not any(states.depth_mm.size for states in found.values()):
            return
        yield Paragraph(
            "The skin at equilibrium states of the press, simulated once more at each spot with what was "
            "found for all of them. The line is the edge of the indenter. Move the slider along the path."
        )
        yield Drawing("skin")
        unit = data.modulus_unit
        heads = ["spot", "depth [mm]", "rotation [°]", "largest displacement [mm]"]
        yield Table(
            "The first state at the greatest depth",
            [*heads, f"largest pressure [{unit}]", "contact area [mm²]"],
            [
                [spot, *_numbers(states, 1.0 / convert(f"1 {unit}", "MPa"))]
                for spot, states in found.items()
                if states.depth_mm.size
            ],
        )


def _numbers(states: SurfaceStates, factor: float) -> list[float]:
    k = deepest(states)
    moved = (states.displacements_mm[k] ** 2).sum(axis=1).max(initial=0.0) ** 0.5
    area = (states.areas_mm2[k] * states.touching[k]).sum()
    peak = states.pressures_MPa[k].max(initial=0.0)
    found = (states.depth_mm[k], states.rotation_deg[k], moved, factor * peak, area)
    return [float(value) for value in found]
