"""Names that other plugins may import of palpate-prediction; each is imported when it is first used."""

from typing import TYPE_CHECKING

from palpate.api import deferred

if TYPE_CHECKING:
    from palpate_prediction.predict import refined_limbs as refined_limbs
    from palpate_prediction.summary import contact_of as contact_of, is_by_force as is_by_force

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)
