"""Makes the pictures of the guides, ``docs/pictures``, from runs and meshes of ready studies.

``python docs/site/pictures.py`` runs the studies and commands that have no result in ``target/gallery`` yet,
copies figures that palpate has written there, and draws the others (:mod:`drawings`). A headless Chromium
takes the picture of a report, ``docs/report.png``.
"""

import os
import runpy
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import drawings
from gallery import RUNS, run
from matplotlib import rc_context
from PIL import Image

from palpate_forearm import write_phantom
from palpate_report.figures.style import STYLE

DOCS = Path(__file__).parents[1]
PICTURES = DOCS / "pictures"
SCREEN = (1180, 945)
"""Size of the window of the report in pixels."""

SCALE = 0.5
"""Pixels of a picture over pixels of the figure, which has 300 dpi."""

WIDTH = 1000
"""Largest width in pixels."""

COPIED: Mapping[str, str] = MappingProxyType(
    {
        "demo_intervals": "forearm-demo/report/figures/intervals.png",
        "demo_causes": "forearm-demo/report/figures/causes.png",
        "demo_limbs": "forearm-demo/report/figures/limbs.png",
        "demo_response": "forearm-demo/report/figures/response_p1.png",
        "demo_parameter_space": "forearm-demo/report/figures/parameter_space.png",
        "demo_stress": "forearm-demo/report/figures/stress_strain.png",
        "demo_generalised": "forearm-demo/report/figures/generalised.png",
        "first_response": "first-press/report/figures/response_p1.png",
        "first_intervals": "first-press/report/figures/intervals.png",
        "treloar_response": "treloar/report/figures/response_specimen.png",
        "treloar_nmse": "treloar/report/figures/nmse_distribution.png",
        "log_as_read": "log/measured/plots/p1/simulated_p1/1_as_read.png",
        "log_tared": "log/measured/plots/p1/simulated_p1/2_tared.png",
        "log_phases": "log/measured/plots/p1/simulated_p1/3_phases.png",
        "log_onset": "log/measured/plots/p1/simulated_p1/4_onset.png",
        "log_curves": "log/measured/plots/p1/simulated_p1/5_curves.png",
        "phantom_spot": "phantom/meshes/p2.png",
        "real_limb": "studies/forearm-real/made/p1.png",
        "next": "forearm-demo/next.png",
        "plate": "forearm-demo/predictions/plate/prediction.png",
        "compared": "compared/figures/curves.png",
    }
)
"""Pictures by name, and the files of palpate that they are copies of."""


def palpate(made: str, *arguments: str) -> None:
    """Run a command in the gallery, unless there is already what it makes."""
    if not (RUNS / made).exists():
        subprocess.run([sys.executable, "-m", "palpate", *arguments], check=True, cwd=RUNS)


def make() -> None:
    """Make the results that the pictures show."""
    run()
    for study in ("robot-log", "forearm-layered", "forearm-relaxing", "forearm-real"):
        palpate(f"studies/{study}", "init", "--study", study, f"studies/{study}")
    palpate("log", "experiment", "studies/robot-log", "--plots", "--out", "log")
    palpate(
        "forearm-demo/predictions", "predict", "forearm-demo", "--tool", "studies/forearm-demo/plate.toml"
    )
    palpate("forearm-demo/next.png", "next", "forearm-demo", "--quick")
    palpate("compared", "compare", "first-press", "forearm-demo", "--into", "compared")
    real = "studies/forearm-real"
    surface = ("limb", f"{real}/skin.ply", "--options", f"{real}/limb.toml", "--into", f"{real}/made")
    palpate(f"{real}/made", *surface)
    if not (RUNS / "phantom").exists():
        write_phantom(RUNS / "phantom")
    bones = ("--bones", "phantom/radius.stl", "--bones", "phantom/ulna.stl")
    palpate("phantom/meshes", "limb", "phantom/scan.ply", *bones, "--into", "phantom/meshes")


def first_screen(report: Path, picture: Path) -> None:
    """Take a picture of the first screen of a report."""
    chromium = runpy.run_path(str(DOCS.parent / "plugins" / "palpate-report" / "tests" / "chromium.py"))
    if chromium["COMMAND"] is None:
        raise SystemExit(f"Chromium is missing: {picture} is as it was")
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        chromium["Chromium"](Path(folder)) as browser,
    ):
        browser.open(report, SCREEN[0], height=SCREEN[1])
        browser.picture(picture, whole=False)
    save(picture, picture, scale=1.0, most=SCREEN[0])


def save(source: Path, picture: Path, scale: float = SCALE, most: int = WIDTH) -> None:
    """Save a picture in few colours and at most ``most`` pixels wide."""
    with Image.open(source) as image:
        flat = image.convert("RGB")
    width = min(most, round(scale * flat.width))
    flat = flat.resize((width, round(width * flat.height / flat.width)), Image.Resampling.LANCZOS)
    # The default drops colours of few pixels, such as the line of the true value.
    flat.quantize(256, method=Image.Quantize.FASTOCTREE).save(picture, optimize=True)


def write() -> None:
    """Write every picture."""
    PICTURES.mkdir(exist_ok=True)
    for name, source in COPIED.items():
        save(RUNS / source, PICTURES / f"{name}.png")
    style: dict[Any, Any] = {**STYLE, "axes.grid": False, "figure.dpi": 150}
    with rc_context(style):
        for name, draw in drawings.DRAWINGS.items():
            draw(RUNS).savefig(PICTURES / f"{name}.png")
    first_screen(RUNS / "first-press" / "report" / "index.html", DOCS / "report.png")


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    make()
    write()
