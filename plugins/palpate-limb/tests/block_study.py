"""A small study of layered blocks on bone, each pressed by a sphere."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate.api import NO_FIELDS
from palpate.domain import FloatArray
from palpate.mesh.specimens import block
from palpate_limb.limb_files import write_limb

SPOT = """
[[spot]]
name = "NAME"
measured = { force = "NAME.csv" }
mesh = "NAME.vtu"
"""
STUDY = """
[study]
name = "block"
data = "simulated"
SPOTS
[experiment]
loader = "csv"

[limb]
source = "meshio"

[limb.settings]
regions = { REGIONS }

[protocol]
indenter = { shape = "sphere", radius = "4 mm" }
depth = "1 mm"
friction = 0.0

[sampling]
n_sets = 0

[solver]
name = "jax"
settings = { depth_steps = 2 }

[executor]
name = "in_process"

[selection]
scenarios = ["III"]
"""


def study_of(spots: tuple[str, ...], regions: tuple[str, ...]) -> str:
    """The study, without the materials of its regions."""
    numbers = ", ".join(f"{name} = {number}" for number, name in enumerate(regions))
    return STUDY.replace("SPOTS", "".join(SPOT.replace("NAME", name) for name in spots)).replace(
        "REGIONS", numbers
    )


def write_block(
    path: Path,
    layers_mm: Mapping[str, float],
    height_mm: float = 6.0,
    n_down: int = 2,
    fields: Mapping[str, FloatArray] = NO_FIELDS,
) -> None:
    """Write a block with fields that are the same in every element."""
    limb = block("hex8", n_across=4, n_down=n_down, width_mm=12.0, height_mm=height_mm, layers_mm=layers_mm)
    cell_fields = {name: {"hex8": np.tile(of, (limb.mesh.n_cells, 1))} for name, of in fields.items()}
    write_limb(path, replace(limb, mesh=replace(limb.mesh, cell_fields=cell_fields)))
