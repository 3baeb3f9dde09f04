"""Pictures of the limb and of the way from log to curves, where commands have drawn them."""

import io
from collections.abc import Iterator
from pathlib import Path

from palpate.api.report import Block, Fold, Paragraph, Picture, Section
from palpate_report.report_data import ReportData
from palpate_report.result import Report

MOST_BYTES = 400_000
"""Most bytes of all pictures together: they are a part of one page."""

WIDTH = 900
"""Most pixels across."""

N_COLOURS = 64


class Pictures(Section):
    """What was drawn of each spot before it was simulated."""

    name, title, entry = "pictures", "From limb and log to curves", "Limb and log"
    summary = "pictures of the scanned limb, and of how each press was processed"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Show the pictures of each spot, those of the first spots first, as far as there is room."""
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
                step = path.stem.replace("_", " ")
                found.append(Picture(label=f"{spot}, {path.parent.name}: {step}", content=content))
            if found:
                folds.append(Fold(spot, found))
        if not folds and not n_left_out:
            return
        more = f" {n_left_out} more are in the run directory." if n_left_out else ""
        yield Paragraph(
            f"What was drawn of the limb when it was meshed, and of each press when it was read.{more}"
        )
        yield from folds


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
