"""The paper's study: a simulated forearm, ready studies, and the command that repeats the paper.

Names are imported when they are first used, so that loading the plugin is fast.
"""

from importlib.resources import files
from typing import TYPE_CHECKING

from palpate.api import deferred, hookimpl

if TYPE_CHECKING:
    from palpate.api import StudyTemplate
    from palpate.api.cli import Command
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
    """Provide the forearm studies, all on simulated data."""
    from palpate.api import StudyTemplate

    summaries = {
        "first-press": "one press and twist, one parameter, found within its interval (simulated)",
        "forearm-demo": "four spots on coarse meshes; six minutes of processor time (simulated)",
        "forearm": "four spots in the paper's manner, 250 sets; hours (simulated)",
        "forearm-fibres": "muscle with fibres, from slides along and across them at one spot (simulated)",
        "forearm-layered": "skin over soft tissue, identified together at one spot (simulated)",
    }
    folder = files("palpate_forearm") / "studies"
    return [
        StudyTemplate(name=name, summary=summary, directory=str(folder / name))
        for name, summary in summaries.items()
    ]


@hookimpl
def palpate_commands() -> "list[Command]":
    """Provide the command that repeats the paper's study."""
    from palpate.api.cli import RUN, Command, examples
    from palpate_forearm.reproduce_command import reproduce

    calls = examples("palpate reproduce --sets 20", "palpate reproduce", "palpate reproduce --fine")
    return [Command(function=reproduce, panel=RUN, epilog=calls)]
