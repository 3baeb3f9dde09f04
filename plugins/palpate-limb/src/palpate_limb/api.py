"""Names that other plugins may import of palpate-limb; each is imported when it is first used."""

from typing import TYPE_CHECKING

from palpate.api import deferred

if TYPE_CHECKING:
    from palpate_limb.limb_files import write_limb as write_limb
    from palpate_limb.surfaces import read_surface as read_surface

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)
