"""Hyperelastic materials and the Drucker stability filter."""

from palpate import hookimpl
from palpate.interfaces import Material, SetFilter
from palpate_materials.demiray import Demiray
from palpate_materials.mooney_rivlin import MooneyRivlin
from palpate_materials.neo_hookean import NeoHookean
from palpate_materials.ogden import Ogden
from palpate_materials.stability import Drucker
from palpate_materials.veronda_westmann import VerondaWestmann
from palpate_materials.yeoh import Yeoh

__all__ = ["Demiray", "Drucker", "MooneyRivlin", "NeoHookean", "Ogden", "VerondaWestmann", "Yeoh"]


@hookimpl
def palpate_materials() -> list[type[Material]]:
    """Provide the paper's three materials, and three more of the field."""
    return [Ogden, Yeoh, NeoHookean, MooneyRivlin, VerondaWestmann, Demiray]


@hookimpl
def palpate_set_filters() -> list[type[SetFilter]]:
    """Provide the Drucker filter."""
    return [Drucker]
