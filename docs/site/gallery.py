"""Runs the studies of the gallery and shows their figures.

``python docs/site/gallery.py`` runs them in ``target/gallery``; what is simulated there is kept.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from palpate import Plugins
from palpate.run.directory import RunDirectory

STUDIES = ("first-press", "forearm-demo", "treloar")
"""Ready studies in their order on the page, which begins with a fit that succeeds."""

RUNS = Path(os.environ.get("PALPATE_GALLERY") or Path(__file__).parents[2] / "target" / "gallery")
FIGURES = {
    "intervals.png": "Parameters with their 95 % intervals",
    "response_*.png": "Measured and fitted curves",
    "nmse_distribution.png": "NMSE of all sets, by channel",
    "generalised.png": "One set for all spots",
}
"""Captions by the files that they are for; a study without a sweep has no distribution."""

LOCAL = ("Page", "Time")
"""Lines of a run that hold on the machine where it was made."""


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
            yield from ((_name(study, file), file) for _, shown in _figures(study) for file in shown)


def _results(study: str) -> Iterator[str]:
    """Last lines of a run, as the terminal shows them, and its figures."""
    lines = RunDirectory(RUNS / study).result()
    if not lines:
        yield "Not run yet: `make docs` does.\n"
        return
    yield f"[Open its report](gallery/{study}/report.html).\n"
    yield "".join(f"- **{label}**: {text}\n" for label, text in lines.items() if label not in LOCAL)
    for caption, shown in _figures(study):
        yield f"{caption}:\n"
        yield from (f"![{caption}]({_name(study, file)})\n" for file in shown)


def _figures(study: str) -> Iterator[tuple[str, list[Path]]]:
    """Captions, each with the files that the report of a study has for it."""
    folder = RUNS / study / "report" / "figures"
    for pattern, caption in FIGURES.items():
        if shown := sorted(folder.glob(pattern)):
            yield caption, shown


def _name(study: str, file: Path) -> str:
    return f"gallery/{study}/{file.name}"


if __name__ == "__main__":
    run()
