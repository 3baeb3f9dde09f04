"""Which sections a page has, in which order, and what they warn of."""

from collections.abc import Iterator, Mapping

from palpate.api import PluginError
from palpate.api.report import ReportWarning, Section, is_own
from palpate.api.runs import answering_for
from palpate_report.report_data import ReportData


def ordered(sections: Mapping[str, type[Section]]) -> list[type[Section]]:
    """Sections in the order of the page: each plugin's follows the one that it names, or is the last."""
    order = [section for section in sections.values() if is_own(section)]
    for section in sections.values():
        if not is_own(section):
            names = [each.name for each in order]
            place = names.index(section.after) + 1 if section.after in names else len(order)
            order.insert(place, section)
    return order


def section_warnings(data: ReportData) -> Iterator[ReportWarning]:
    """Warnings of the sections."""
    for section in ordered(data.sections):
        try:
            with answering_for(section, "warning of its section"):
                found = tuple(section().warnings(data))
            for each in found:
                if not isinstance(each, ReportWarning):
                    raise PluginError(
                        f"section '{section.name}' warns of {each!r}, which is no palpate.api.ReportWarning"
                    )
            yield from found
        except PluginError as error:
            yield ReportWarning("A section of the report has failed", f"{error}.")
