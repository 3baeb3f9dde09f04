"""From a real forearm's surface to its layers' moduli: ``python benchmarks/study_answer.py FOLDER``.

``forearm-real`` with 1.5 mm of skin at p1 and p2, or at ``--spots``: ``palpate limb`` meshes it twice,
``palpate synthesise`` makes the measured curves of a press of 8 mm and a twist on the finer meshes,
``palpate run`` fits both moduli on the coarser ones by force and torque (I). Printed are the fits with their
95 % intervals next to the truth. Both have the same few load steps, to save time. What is in FOLDER is not
made again.

``--logs`` presses the finer meshes in the solver's default steps, writes raw logs of a robot
(``simulated_robot.py``: tool's weight, bias, drift, noise, no first contact or normal known) and fits what
the loader ``robot_log`` makes of them, in the default steps too.
"""

import argparse
import re
import sys
from pathlib import Path

import polars as pl
from simulated_robot import write_log

from palpate.cli.app import main as palpate
from palpate_indentation import CsvLoader

SPOTS = {"p1": "ulna:70%,0deg", "p2": "ulna:50%,90deg"}
SIZES = {"finer": "2 mm", "meshes": "3 mm"}
TRUTH = {"skin.E": 0.15, "soft_tissue.c1": 0.009}
CHANGES = {
    'depth = "10 mm"': 'depth = "8 mm"',
    'scenarios = ["I", "II", "III"]': 'scenarios = ["I"]',
}
FEW_STEPS = {'name = "jax"': 'name = "jax"\nsettings = { depth_steps = 5, rotation_step_deg = 11.25 }'}
OF_LOGS = {
    'loader = "csv"': """loader = "robot_log"

[experiment.settings.channels]
time = "time_s"
position = { columns = ["x_m", "y_m", "z_m"] }
orientation = { columns = ["qx", "qy", "qz", "qw"] }
force = { columns = ["fx_N", "fy_N", "fz_N"] }
moment = { columns = ["tx_Nm", "ty_Nm", "tz_Nm"] }

[experiment.settings.gravity]
method = "known"
weight = "0.88 N"
centre = ["0 mm", "0 mm", "-30 mm"]""",
}


def call(*arguments: str) -> None:
    """Call palpate, or end."""
    if palpate(list(arguments)):
        raise SystemExit(f"palpate {' '.join(arguments)} failed")


def study(text: str, meshes: str, changes: dict[str, str], spots: list[str]) -> str:
    """The ready study at some spots, with the meshes of a folder."""
    blocks = re.split(r"(?=^\[)", text, flags=re.MULTILINE)
    others = [f'name = "{name}"' for name in ("p1", "p2", "p3", "p4") if name not in spots]
    text = "".join(block for block in blocks if not any(other in block for other in others))
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    return text.replace('"meshes/', f'"{meshes}/')


def mesh(folder: Path, into: str, size: str, spots: list[str]) -> None:
    """Mesh the spots, unless that was done before."""
    if all((folder / into / f"{name}.json").exists() for name in spots):
        return
    places = [word for name in spots for word in ("--spot", f"{name}={SPOTS[name]}")]
    options = ["--options", str(folder / "limb.toml"), "--size", size, "--into", str(folder / into)]
    call("limb", str(folder / "skin.ply"), *options, *places)


def main(folder: Path, spots: list[str], *, logs: bool) -> None:
    """From surface to both layers' moduli."""
    if not folder.exists():
        call("init", "--study", "forearm-real", str(folder))
        (folder / "study.toml").rename(folder / "ready.toml")
    ready, file = (folder / "ready.toml").read_text(), folder / "study.toml"
    changes = CHANGES if logs else CHANGES | FEW_STEPS
    for meshes, size in SIZES.items():
        file.write_text(study(ready, meshes, changes, spots))
        mesh(folder, meshes, size, spots)
        if meshes == "finer" and not (folder / "measured").exists():
            call("synthesise", str(folder))
    if logs:
        (folder / "logs").mkdir(exist_ok=True)
        for seed, name in enumerate(spots):
            made = CsvLoader().load(folder / "measured" / f"{name}.csv")
            write_log(folder / "logs" / f"{name}.parquet", made, seed)
        text = study(ready, "meshes", changes | OF_LOGS, spots)
        file.write_text(re.sub(r"measured/(.*)\.csv", r"logs/\1.parquet", text))
    call("run", str(folder), "--out", str(folder / "run"))
    found = pl.read_parquet(folder / "run" / "intervals.parquet")
    with pl.Config(tbl_rows=30, tbl_cols=20, tbl_width_chars=150):
        sys.stdout.write(f"truth: {TRUTH}\n{found}\n")


if __name__ == "__main__":
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("folder", type=Path)
    asked.add_argument("--logs", action="store_true", help="fit raw logs of a simulated robot")
    asked.add_argument("--spots", nargs="+", choices=SPOTS, default=list(SPOTS))
    given = asked.parse_args()
    main(given.folder, given.spots, logs=given.logs)
