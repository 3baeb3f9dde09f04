"""Runs the studies of the gallery and shows their figures.

``python docs/site/gallery.py`` runs them in ``target/gallery``; what is simulated there is kept.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from palpate import Plugins

STUDIES = ("treloar", "forearm-demo")
RUNS = Path(os.environ.get("PALPATE_GALLERY") or Path(__file__).parents[2] / "target" / "gallery")
FIGURES = {
    "response_*.png": "Measured curves, and the curves of the selected sets",
    "nmse_distribution.png": "NMSE of all sets, by channel",
    "generalised.png": "The one set for all spots",
}


def run() -> None:
    """Run every study of the gallery."""
    for study in STUDIES:
        command = [sys.executable, "-m", "palpate", "demo", "--study", study, "--out", str(RUNS / study)]
        subprocess.run(command, check=True)


def figures() -> Iterator[tuple[str, Path]]:
    """Name in the site and file of every figure."""
    for study in STUDIES:
        for pattern in FIGURES:
            for file in sorted((RUNS / study / "report" / "figures").glob(pattern)):
                yield f"gallery/{study}/{file.name}", file


def page() -> str:
    """Write the gallery as Markdown."""
    templates = Plugins.load().studies
    lines = ["# Gallery", "", "Each study is a template of palpate and was run by `make docs`.", ""]
    for study in STUDIES:
        lines += [f"## {study}", "", f"{templates[study].summary.capitalize()}.", ""]
        lines += [f"    palpate demo --study {study}", ""]
        lines += _shown(study)
    return "\n".join(lines)


def _shown(study: str) -> Iterator[str]:
    tables = RUNS / study / "report" / "tables"
    if not (tables / "table1_coefficients.md").is_file():
        yield "Not run yet: `make docs` does."
        yield ""
        return
    for table in ("table1_coefficients.md", "table2_nmse.md"):
        yield (tables / table).read_text(encoding="utf-8")
        yield ""
    for pattern, caption in FIGURES.items():
        for name, file in figures():
            if name.startswith(f"gallery/{study}/") and file.match(pattern):
                yield f"{caption}:\n\n![{caption}]({name})\n"


if __name__ == "__main__":
    run()
