"""The core's sections of the page, provided through the same hook as those of plugins."""

from palpate.plugins.sections import Section
from palpate.report.sections.certainty import Certainty, Identifiability
from palpate.report.sections.deformed import Deformed
from palpate.report.sections.fits import Curves, Fits, Values, Warnings
from palpate.report.sections.material import MaterialItself
from palpate.report.sections.origins import LimbAndContact, Provenance
from palpate.report.sections.pictures import Pictures
from palpate.report.sections.sweep import Convergence, Distribution, Generalisation, OtherChannels, Space

SECTIONS: tuple[type[Section], ...] = (
    Curves,
    Warnings,
    Certainty,
    Values,
    Fits,
    Space,
    MaterialItself,
    Distribution,
    OtherChannels,
    Generalisation,
    Identifiability,
    Convergence,
    LimbAndContact,
    Deformed,
    Pictures,
    Provenance,
)
"""In the order of the page."""
