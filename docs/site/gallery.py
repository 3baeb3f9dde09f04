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
TABLES = ("table2_nmse.md", "generalised.md")
FIGURES = {
    "response_*.png": "Measured curves, and the curves of the selected sets",
    "nmse_distribution.png": "NMSE of all sets, by channel",
    "generalised.png": "The one set for all spots",
}


def run() -> None:
    """Run every study of the gallery."""
    for study in STUDIES:
        palpate, copy = [sys.executable, "-m", "palpate"], RUNS / "studies" / study
        if not copy.exists():
            subprocess.run([*palpate, "init", "--study", study, str(copy)], check=True)
        subprocess.run([*palpate, "run", str(copy), "--out", str(RUNS / study)], check=True)


def page() -> str:
    """Write the gallery as Markdown."""
    templates = Plugins.load().studies
    lines = ["# Gallery", "", "Each study is a template of palpate and was run by `make docs`.", ""]
    for study in STUDIES:
        lines += [f"## {study}", "", f"{templates[study].summary.capitalize()}.", ""]
        lines += [f"    palpate init --study {study} {study}", f"    palpate run {study}", ""]
        lines += _results(study)
    return "\n".join(lines)


def files() -> Iterator[tuple[str, Path]]:
    """Name in the site and path of every figure and report."""
    for study in STUDIES:
        report = RUNS / study / "report" / "index.html"
        if report.is_file():
            yield f"gallery/{study}/report.html", report
            yield from (
                (_name(study, file), file) for pattern in FIGURES for file in _figures(study, pattern)
            )


def _results(study: str) -> Iterator[str]:
    report = RUNS / study / "report"
    if not (report / "index.html").is_file():
        yield "Not run yet: `make docs` does.\n"
        return
    yield f"[Open its report](gallery/{study}/report.html).\n"
    for table in TABLES:
        yield (report / "tables" / table).read_text(encoding="utf-8") + "\n"
    for pattern, caption in FIGURES.items():
        yield f"{caption}:\n"
        yield from (f"![{caption}]({_name(study, file)})\n" for file in _figures(study, pattern))


def _figures(study: str, pattern: str) -> list[Path]:
    return sorted((RUNS / study / "report" / "figures").glob(pattern))


def _name(study: str, file: Path) -> str:
    return f"gallery/{study}/{file.name}"


if __name__ == "__main__":
    run()
