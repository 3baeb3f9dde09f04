"""A study of one person's presses: flat layered blocks, a probe, and the straight lines of the table.

``palpate init --study multis`` copies the one that :func:`write_study` makes of a person of MULTIS.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars as pl

from palpate.api import FloatArray, IntArray, PalpateError
from palpate_multis.layered_block import LENGTH_MM, POISSON, coordinates, hexahedra
from palpate_multis.population import SKIN_MPA
from palpate_multis.presses import of_multis, read_presses

LAYERS = ("skin", "fat", "muscle")

EDGE_MM = 2.0
"""Radius of the probe's rounded edges, assumed."""

N_POINTS = 6
"""Of a measured curve, which is a straight line."""

FAT_OVER_MUSCLE = 0.38
"""Ratio of their moduli in the fit to all people, to which fat is tied."""

PROBE = (
    f'{{ shape = "box", length = "{LENGTH_MM:g} mm", width = "WIDTH mm", '
    f'height = "20 mm", edge = "{EDGE_MM:g} mm" }}'
)

STUDY = f"""\
# Presses of one living person with an ultrasound probe (MULTIS), and the modulus of muscle as the answer.
# Each measured curve is a straight line: the slope of the press up to its largest force. README.md says more.

[study]
name = "multis"
description = "muscle of one person, pressed by hand with an ultrasound probe"
data = "measured"
SPOTS
[experiment]
loader = "csv"

[limb]
source = "meshio"

[limb.settings]
regions = {{ {", ".join(f"{name} = {number}" for number, name in enumerate(LAYERS))} }}

[protocol]
indenter = {PROBE.replace("WIDTH", "8")}
depth = "5 mm"                      # each spot has its own, and its own probe
friction = 0.0                      # gel between probe and skin

[region.skin]
material = "neo_hookean"

[region.skin.parameters]
E = "{SKIN_MPA:g} MPa"                       # assumed: the presses do not identify it
nu = {POISSON:g}

[region.fat]
material = "neo_hookean"

[region.fat.parameters]
E = "{FAT_OVER_MUSCLE:g} * muscle.E"             # the ratio in the fit to all people
nu = {POISSON:g}

[region.muscle]
material = "neo_hookean"

[region.muscle.parameters]
E = {{ lower = "2 kPa", upper = "100 kPa" }}
nu = {POISSON:g}

[sampling]
n_sets = 0
seed = 1

[solver]
name = "jax"
settings = {{ depth_steps = 4 }}

[fit]

[budget]
# The ratio of fat to muscle as uncertain as both moduli of all people: 20 % and 11 %.
parameters = {{"skin.E" = "50 %", "skin.nu" = "1 %", "fat.E" = "25 %", "fat.nu" = "1 %", "muscle.nu" = "1 %"}}

[selection]
scenarios = ["III"]
generalise_by = "III"
"""

SPOT = """
[[spot]]
name = "NAME"
measured = { force = "measured/NAME.csv" }
mesh = "meshes/NAME.vtu"
protocol = { depth = "DEPTH mm", indenter = PROBE }
"""


def write_study(folder: Path, person: str, sites: Sequence[str], table: Path | None = None) -> None:
    """Write study, meshes and curves of one person's presses.

    The depth of a press is its largest force over its slope, so that its curve is a straight line.

    Parameters
    ----------
    folder : Path
        To make, or to write into.
    person : str
        As the table has it.
    sites : sequence of str
        In the table's column ``site``; each becomes a spot.
    table : Path, optional
        As for :func:`read_presses`; MULTIS by default.

    Raises
    ------
    PalpateError
        The table cannot be read, or has no press or several of this person at a site.
    """
    presses = read_presses(table)[_rows(table, person, sites)]
    for name in ("measured", "meshes"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    widths = presses.width_mm
    depths = presses.force_N * presses.compliance / (LENGTH_MM * widths)
    spots = []
    for k, site in enumerate(sites):
        rise = np.linspace(0.0, 1.0, N_POINTS)
        curve = {"depth_mm": (rise * depths[k]).round(4), "force_N": (rise * presses.force_N[k]).round(4)}
        pl.DataFrame(curve).write_csv(folder / "measured" / f"{site}.csv")
        _write_block(folder / "meshes" / f"{site}.vtu", presses.layers_mm[k], float(widths[k]))
        probe = PROBE.replace("WIDTH", f"{widths[k]:g}")
        spots.append(SPOT.replace("NAME", site).replace("DEPTH", f"{depths[k]:.4f}").replace("PROBE", probe))
    (folder / "study.toml").write_text(STUDY.replace("SPOTS", "".join(spots)), encoding="utf-8")


def _rows(table: Path | None, person: str, sites: Sequence[str]) -> IntArray:
    """The row of each site."""
    where = table or of_multis()
    with where.open("rb") as stream:
        columns = pl.read_csv(stream, infer_schema=False)
    if "site" not in columns.columns:
        raise PalpateError(f"{where}: no column 'site'; add it, with a name for each press of a person")
    own = columns.with_row_index().filter(pl.col("person") == person)
    rows = []
    for site in sites:
        found = own.filter(pl.col("site") == site)["index"].to_list()
        if len(found) != 1:
            raise PalpateError(
                f"{where}: {len(found)} presses of person '{person}' at '{site}', not one; the sites of this "
                f"person are {', '.join(own['site'].to_list()) or 'none'}"
            )
        rows += found
    return np.array(rows)


def _write_block(path: Path, layers_mm: FloatArray, width_mm: float) -> None:
    """Write the whole block of which :mod:`layered_block` simulates a quarter, as VTU."""
    import meshio  # here: slow to import

    x, y, depths = coordinates(layers_mm.tolist(), width_mm)
    axes = (np.concatenate([-x[:0:-1], x]), np.concatenate([-y[:0:-1], y]), -depths[::-1])
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    cells = hexahedra((len(axes[0]), len(axes[1]), len(axes[2])))
    layer = np.searchsorted(np.cumsum(layers_mm)[:2], -points[cells, 2].mean(axis=1))
    height = points[:, 2]
    meshio.write_points_cells(
        path,
        points,
        [("hexahedron", cells)],
        point_data={
            "fixed": (height == height.min()).astype(np.uint8),
            "contact": (height == 0.0).astype(np.uint8),
        },
        cell_data={"region": [layer.astype(np.int32)]},
    )
