"""Ready studies of real limbs, whose surfaces are share-alike data of others."""

from importlib.resources import files
from typing import TYPE_CHECKING

from palpate.api import hookimpl

if TYPE_CHECKING:
    from palpate.api import StudyTemplate


@hookimpl
def palpate_studies() -> "list[StudyTemplate]":
    """Provide the limbs, with options to mesh each by one command."""
    from palpate.api import StudyTemplate

    summaries = {
        "forearm-real": "an adult's forearm with radius, ulna and skin; mesh it first (simulated; CC BY-SA)",
        "residual-limb": "a mean residual limb at four clinical spots; mesh it first (simulated; CC BY-SA)",
    }
    folder = files("palpate_anatomy") / "studies"
    return [
        StudyTemplate(
            name=name,
            summary=summary,
            directory=str(folder / name),
            first_command="limb {folder}/skin.ply --options {folder}/limb.toml",
        )
        for name, summary in summaries.items()
    ]
