"""Settings by which palpate drives FEBio."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Literal

from pydantic import Field

from palpate.api import Quantity, Settings

Method = Literal["broyden", "newton", "broyden_soft", "broyden_half_steps", "newton_half_steps"]
"""One way to solve: the update of the stiffness; ``soft`` is a contact a quarter as stiff."""

PENALTY: Mapping[str, float] = MappingProxyType({"right": 200.0, "paper": 20.0})
"""By form of contact. The stiffer, the faster augmentation converges; at 20 half a torque was forgotten."""

PAPER_CONTACT = (
    'contact = "paper": FEBio\'s penalty friction has no memory of where a point stuck, so its torque is the '
    "penalty times the slip of one step: it shrinks with the number of steps and decays in a hold. "
    "Use it to reproduce the paper, not to identify a material by torque"
)


class FebioSettings(Settings):
    """Settings of FEBio: where it is, how finely and how strictly it solves, and when it is given up.

    A field that is excluded changes no result, so that a change of it makes no simulation void.
    """

    executable: str = Field(
        "",
        exclude=True,
        description="path or name of febio4; empty: PATH, then the places where FEBio is usually installed",
    )
    threads: int = Field(
        1, ge=1, exclude=True, description="threads of one run; palpate runs several jobs side by side"
    )
    time_limit: Annotated[float, Quantity("s")] = Field(
        7200.0, gt=0.0, exclude=True, description="a run is stopped after this time"
    )
    stall_limit: Annotated[float, Quantity("s")] = Field(
        1200.0, gt=0.0, exclude=True, description="a run is stopped when nothing was written for so long"
    )
    depth_steps: int = Field(20, ge=1, description="steps from the surface to the greatest depth")
    rotation_step_deg: float = Field(
        4.5,
        gt=0.0,
        description="largest step of rotation [degrees]; friction history error grows with the step",
    )
    contact: Literal["right", "paper"] = Field(
        "right",
        description="right: augmented Lagrangian where there is friction, a stiff penalty without; "
        "paper: the penalty form, whose friction has no memory",
    )
    penalty: float | None = Field(
        None,
        gt=0.0,
        description="contact penalty in units of FEBio's automatic one (1 sinks the sphere about 1 mm into "
        "silicone); by default 200, and 20 for the paper's contact",
    )
    augmentation_tolerance: float = Field(
        0.1,
        gt=0.0,
        lt=1.0,
        description="relative change of the contact tractions at which augmentation ends; the rest is "
        "lost in the next step, and verification shows it",
    )
    gap_tolerance_mm: float = Field(
        0.01,
        ge=0.0,
        description="how far a point that sticks may drift in one step before augmentation ends [mm]; 0: "
        "no limit",
    )
    max_augmentations: int = Field(100, ge=1, description="augmentations of one step at most")
    facet_mm: float = Field(
        1.0,
        gt=0.0,
        description="longest edge of the facets of the sphere [mm]; 1.0 on a radius of 7.5 changes the "
        "force by 0.1 % or less from 1 mm depth on, and a finer sphere takes FEBio longer to search",
    )
    fallbacks: tuple[Method, ...] = Field(
        ("broyden", "newton", "broyden_soft", "broyden_half_steps", "newton_half_steps"),
        min_length=1,
        description="ways to solve, tried in turn while runs diverge; each try is recorded",
    )
    linear_solver: str = Field("", description="FEBio's name of the linear solver; empty: its default")
    verification: Literal["chosen", "every", "never"] = Field(
        "chosen",
        exclude=True,
        description="which sets to verify the torque of, by one more run up to the first turn, with halved "
        "steps and then held: those that a run chose, every one, or none; a set whose torque changes is "
        "marked",
    )
    verification_tolerance: float = Field(
        0.02, gt=0.0, exclude=True, description="relative change of the torque that verification allows"
    )
    keep_folder: str = Field(
        "",
        exclude=True,
        description="where to keep decks and logs, in a folder per job; empty: nothing is left behind",
    )
