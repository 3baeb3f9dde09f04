"""Names that other plugins may import of palpate-report; each is imported when it is first used."""

from typing import TYPE_CHECKING

from palpate.api import deferred

if TYPE_CHECKING:
    from palpate_report.answer.law import formula_of as formula_of, paragraphs_of as paragraphs_of
    from palpate_report.answer.model_verdict import (
        ModelVerdict as ModelVerdict,
        model_verdict as model_verdict,
    )
    from palpate_report.answer.result import Report as Report
    from palpate_report.data.display_units import rows_in_display_units as rows_in_display_units
    from palpate_report.data.marks import (
        Headline as Headline,
        in_words as in_words,
        with_unit as with_unit,
    )
    from palpate_report.data.report_data import ReportData as ReportData, brief_names as brief_names
    from palpate_report.data.table_files import markdown as markdown
    from palpate_report.figures.limb_drawing import ABOVE as ABOVE, draw_limb as draw_limb
    from palpate_report.figures.limb_view import limb_view as limb_view
    from palpate_report.figures.scene import coarsened as coarsened
    from palpate_report.figures.skin_map import draw_map as draw_map
    from palpate_report.figures.style import (
        LINES as LINES,
        STYLE as STYLE,
        column_mm as column_mm,
        lettered as lettered,
        save as save,
        sized as sized,
        styled as styled,
    )
    from palpate_report.from_run import report_data as report_data
    from palpate_report.page.html import comparison_page as comparison_page

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)
