"""Limbs to begin with: a simulated forearm, ready studies of it, and ready studies of two real limbs.

Names are imported when they are first used, so that loading the plugin is fast.
"""

from importlib.resources import files
from typing import TYPE_CHECKING

from palpate.api import deferred, hookimpl

if TYPE_CHECKING:
    from palpate.api import StudyTemplate
    from palpate_forearm.phantom import (
        CrossSection as CrossSection,
        InkMark as InkMark,
        Phantom as Phantom,
        PhantomBone as PhantomBone,
        Scanner as Scanner,
        Surface as Surface,
        scan as scan,
        write_phantom as write_phantom,
    )


if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)


@hookimpl
def palpate_studies() -> "list[StudyTemplate]":
    """Provide the studies, all on simulated curves; the residual limb is meshed first."""
    from palpate.api import StudyTemplate

    summaries = {
        "first-press": "one press and twist, one parameter, found within its interval (simulated)",
        "forearm-demo": "four spots on coarse meshes; 12 minutes on a slow machine (simulated)",
        "forearm": "four spots in the paper's manner, 250 sets; hours (simulated)",
        "forearm-fibres": "muscle with fibres, from slides along and across them at one spot (simulated)",
        "forearm-layered": "skin over soft tissue, identified together at one spot (simulated)",
        "forearm-real": "skin and soft tissue of an adult's forearm at four spots (simulated; CC BY-SA)",
        "residual-limb": "a mean residual limb at four clinical spots; mesh it first (simulated; CC BY-SA)",
    }
    folder, mesh = files("palpate_forearm") / "studies", "limb {folder}/skin.ply --options {folder}/limb.toml"
    return [
        StudyTemplate(
            name=name,
            summary=summary,
            directory=str(folder / name),
            first_command=mesh if name == "residual-limb" else "check {folder}",
        )
        for name, summary in summaries.items()
    ]
