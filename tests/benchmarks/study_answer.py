"""From a real forearm's surface to its layers' moduli: ``python tests/benchmarks/study_answer.py FOLDER``.

``forearm-real`` with 1.5 mm of skin at two spots: ``palpate limb`` meshes it twice, ``palpate synthesise``
makes the measured curves of a press of 8 mm and a twist on the finer meshes, ``palpate run`` fits both
moduli on the coarser ones by force and torque (I). Printed are the fits with their 95 % intervals next to
the truth. Both have the same few load steps, to save time. What is in FOLDER is not made again.
"""

import re
import sys
from pathlib import Path

import polars as pl

from palpate.cli.app import main as palpate

SPOTS = {"p1": "ulna:70%,0deg", "p2": "ulna:50%,90deg"}
SIZES = {"finer": "2 mm", "meshes": "3 mm"}
TRUTH = {"skin.E": 0.15, "soft_tissue.c1": 0.009}
CHANGES = {
    'depth = "10 mm"': 'depth = "8 mm"',
    'name = "jax"': 'name = "jax"\nsettings = { depth_steps = 5, rotation_step_deg = 11.25 }',
    'scenarios = ["I", "II", "III"]': 'scenarios = ["I"]',
}


def call(*arguments: str) -> None:
    """Call palpate, or end."""
    if palpate(list(arguments)):
        raise SystemExit(f"palpate {' '.join(arguments)} failed")


def study(text: str, meshes: str) -> str:
    """The ready study at two spots, with the meshes of a folder."""
    blocks = re.split(r"(?=^\[)", text, flags=re.MULTILINE)
    others = [f'name = "{name}"' for name in ("p3", "p4")]
    text = "".join(block for block in blocks if not any(other in block for other in others))
    for old, new in CHANGES.items():
        assert old in text
        text = text.replace(old, new)
    return text.replace('"meshes/', f'"{meshes}/')


def main(folder: Path) -> None:
    """From surface to both layers' moduli."""
    if not folder.exists():
        call("init", "--study", "forearm-real", str(folder))
    file = folder / "study.toml"
    ready = (
        (folder / "ready.toml") if (folder / "ready.toml").exists() else file.rename(folder / "ready.toml")
    )
    for meshes, size in SIZES.items():
        file.write_text(study(ready.read_text(), meshes))
        if not all((folder / meshes / f"{name}.json").exists() for name in SPOTS):
            places = [word for name, place in SPOTS.items() for word in ("--spot", f"{name}={place}")]
            options = ["--options", str(folder / "limb.toml"), "--size", size, "--into", str(folder / meshes)]
            call("limb", str(folder / "skin.ply"), *options, *places)
        if meshes == "finer" and not (folder / "measured").exists():
            call("synthesise", str(folder))
    call("run", str(folder), "--out", str(folder / "run"))
    found = pl.read_parquet(folder / "run" / "intervals.parquet")
    with pl.Config(tbl_rows=30, tbl_cols=20, tbl_width_chars=150):
        sys.stdout.write(f"truth: {TRUTH}\n{found}\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
