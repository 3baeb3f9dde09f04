"""The core's sections of the page, provided through the same hook as sections of plugins."""

from palpate.api.report import Section
from palpate_report.sections.certainty import Certainty, Identifiability
from palpate_report.sections.fits import Curves, Fits, MaterialItself, Values, Warnings
from palpate_report.sections.origins import Cite, LimbAndDeformation, Pictures, Provenance
from palpate_report.sections.sweep import Convergence, Distribution, Generalisation, OtherChannels, Space

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
    LimbAndDeformation,
    Pictures,
    Cite,
    Provenance,
)
"""In the order of the page."""
