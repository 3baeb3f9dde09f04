"""Settings of the solver ``jax``."""

from pathlib import Path
from typing import Literal
from urllib.parse import quote

from pydantic import Field

from palpate.api import Settings

STEP_ITERATIONS = 20
"""Newton iterations for each load step, on average over a path, after which a path is given up."""


class JaxSettings(Settings):
    """Settings of the solver ``jax``."""

    depth_steps: int = Field(
        10,
        ge=2,
        description="equilibrium states from the surface to the greatest depth; "
        "a point has no friction in the step of its first contact, so too few steps reduce the force",
    )
    rotation_step_deg: float = Field(
        4.5, gt=0.0, description="largest step of rotation between equilibrium states [degrees]"
    )
    tolerance: float = Field(
        1e-4,
        gt=0.0,
        lt=1e-2,
        description="imbalance, relative to the forces, at which a state counts as balanced",
    )
    step_iterations: int = Field(
        STEP_ITERATIONS,
        ge=1,
        description="Newton iterations for each load step, on average over the path; a path that halves its "
        "steps until it needs more is given up, and its simulation counts as diverged",
    )
    penalty: float = Field(
        1500.0,
        gt=0.0,
        description="contact penalty in units of the initial shear modulus over the radius of the "
        "contact; 1500 keeps the penetration below 0.5 % of the depth",
    )
    mean_dilatation: bool | tuple[str, ...] = Field(
        True,
        description="one volume change per element, or per patch of about eight tet4, which keeps nearly "
        "incompressible tissue from locking: in all regions, in none, or in the named ones; without it, "
        "for comparison with other programs, tet4 overstates force by half and more",
    )
    warm_starts: bool = Field(
        True,
        description="start the sets of a sweep from an interpolation between its first sets, the warm "
        "starts, and the sets of a fit from its first one; their displacements are kept in the user's cache "
        "folder; without it, every set is solved alone",
    )
    fields: Literal["none", "end", "all"] = Field(
        "none",
        description="VTU files with displacement, stress, stretches and contact tractions: of no load "
        "step, of the last one of each set of the design, or of all",
    )
    fields_folder: str = Field(
        "fields",
        min_length=1,
        description="where the VTU files go, as <folder>/<spot>/set-<number>/path.pvd; relative to the "
        "current folder of palpate",
    )

    def folder_of(self, spot: str) -> Path:
        """Folder of a spot's VTU files; characters that could leave ``fields_folder`` are escaped."""
        return Path(self.fields_folder) / quote(spot, safe=" ").replace(".", "%2E")
