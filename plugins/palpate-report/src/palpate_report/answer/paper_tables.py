"""Tables 1 and 2 in the paper's own shape, spots by scenarios, for one material or several."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from palpate.api.fit import ALL_SPOTS, FIT, MODULI, explained, mark_of
from palpate_report.answer.law import searched_laws
from palpate_report.answer.model_verdict import model_verdict
from palpate_report.data.best import Best, weighted_channels
from palpate_report.data.marks import Headline
from palpate_report.data.report_data import ReportData
from palpate_report.data.table_files import escaped, head, number, power_of_ten, row, tabular


def materials_of(data: ReportData) -> str:
    """Materials that are searched, each with its region where there are several."""
    return ", ".join(searched_laws(data.study.space)) or "fixed material"


def paper_tables(runs: Mapping[str, ReportData]) -> dict[str, str]:
    """LaTeX of the paper's tables by file name, with a block for each run under its title.

    Table 1 comes for one column of a page, and for both; table 2 for one.
    """
    blocks = [block for title, data in runs.items() if (block := _Block(title, data)).found]
    if not blocks:
        return {}
    return {
        "paper_table1": _table1(blocks, wide=False),
        "paper_table1_wide": _table1(blocks, wide=True),
        "paper_table2": _table2(blocks),
    }


@dataclass(frozen=True)
class _Block:
    """One run's part of a table: the fits by spot and scenario, or the selected sets without a fit."""

    title: str
    data: ReportData

    @cached_property
    def found(self) -> dict[tuple[str, str], Best]:
        fits = [best for best in self.data.bests if best.found == FIT]
        return {(best.spot, best.scenario): best for best in fits or self.data.bests}

    @cached_property
    def cells(self) -> dict[tuple[str, str], dict[str, Headline]]:
        """Parameters and initial shear moduli by spot and scenario, then by full name and by region."""
        cells = {}
        for at, best in self.found.items():
            shown = (v if v.level else replace(v, lower=None, upper=None) for v in best.values)
            shear = (each for each in best.moduli if each.parameter.startswith(MODULI[0]))
            cells[at] = {v.name: v for v in shown} | {_region(self.data, v): v for v in shear}
        return cells

    @property
    def has_intervals(self) -> bool:
        return any(each.lower is not None for row in self.cells.values() for each in row.values())

    @property
    def spots(self) -> list[str]:
        found = {spot for spot, _ in self.found}
        return [spot for spot in (*self.data.spots, ALL_SPOTS) if spot in found]

    @property
    def scenarios(self) -> list[str]:
        found = {scenario for _, scenario in self.found}
        return [s.name for s in self.data.study.scenarios if s.name in found]

    @cached_property
    def largest(self) -> dict[str, float]:
        """Largest magnitude of each parameter and modulus."""
        names = dict.fromkeys(name for row in self.cells.values() for name in row)
        values = {n: [row[n].value for row in self.cells.values() if n in row] for n in names}
        return {n: max((abs(v) for v in found if v is not None), default=0.0) for n, found in values.items()}

    @property
    def heads(self) -> list[str]:
        parameters, regions = self.data.searched, len(self.data.study.space.regions)
        heads = []
        for name, most in self.largest.items():
            p = parameters.get(name)
            brief = p.name if p else f"{name}.mu0" if regions > 1 else "mu0"
            heads.append(head(brief, p.unit if p else self.data.modulus_unit, power_of_ten(most)))
        return [*heads, "$R^2$"]

    def values(self, spot: str, scenario: str) -> list[str]:
        """Parameters and moduli with their marks, then the least R² of the fitted channels."""
        row = self.cells.get((spot, scenario), {})
        texts = [
            self._number(name, row[name].value) + escaped(mark_of(row[name].verdict)) if name in row else "--"
            for name in self.largest
        ]
        best = self.found.get((spot, scenario))
        fitted = self.data.scenario(scenario).weighed if best else ()
        r2 = [at for name, at in (best.r2 if best else {}).items() if at is not None and name in fitted]
        return [*texts, number(f"{min(r2):.4f}") if r2 else "--"]

    def ranges(self, spot: str, scenario: str) -> list[str]:
        """The interval of each value; empty where there is none."""
        row, texts = self.cells.get((spot, scenario), {}), []
        for name in self.largest:
            each = row.get(name)
            ends = (each.lower, each.upper) if each and each.lower is not None else ()
            texts.append(", ".join(self._number(name, end) for end in ends))
        return [rf"\scriptsize {{[}}{text}{{]}}" if text else "" for text in (*texts, "")]

    @property
    def marks(self) -> set[str]:
        return {mark_of(each.verdict) for row in self.cells.values() for each in row.values()}

    def _number(self, name: str, value: float | None) -> str:
        """A value with as many decimals as make three or four digits of the largest."""
        if value is None:
            return "--"
        size = 10.0 ** power_of_ten(self.largest[name])
        digits = 2 if self.has_intervals else 3
        decimals = (
            digits - math.floor(math.log10(self.largest[name] / size)) if self.largest[name] else digits
        )
        return number(f"{value / size:.{max(0, decimals)}f}")


def _region(data: ReportData, modulus: Headline) -> str:
    """Region of a modulus, which its name has where there are several."""
    regions = [each.region for each in data.study.space.regions]
    return next((r for r in regions if modulus.parameter.endswith(f" of {r}")), regions[0])


def _table1(blocks: Sequence[_Block], *, wide: bool) -> str:
    """Table 1: coefficients and their intervals, the scenarios side by side in a wide one, else as rows."""
    n = max(len(block.heads) for block in blocks)
    scenarios = list(dict.fromkeys(name for block in blocks for name in block.scenarios))
    columns = "l" + "r" * n * len(scenarios) if wide else "ll" + "r" * n
    what = "Coefficients and initial shear moduli by spot and scenario"
    if any(block.has_intervals for block in blocks):
        what += ", with their 95 % intervals in brackets"
    what += "; R² is the least of the fitted channels and spots"
    laws = dict.fromkeys(
        region.material.summary for block in blocks for region in block.data.study.space.regions
    )
    counts = {b.title: sum(len(r.curves) for r in b.data.measured.values()) for b in blocks}
    of = {title: f"{title}: " if len(counts) > 1 else "" for title in counts}
    curves = ", ".join(f"{of[title]}{n} curve{'' if n == 1 else 's'}" for title, n in counts.items())
    return tabular(
        columns,
        [line for block in blocks for line in _coefficients(block, scenarios, n, wide=wide)][1:],
        caption=_caption(
            what,
            blocks,
            f"{'; '.join(laws)}; {curves}",
            explained(mark for block in blocks for mark in block.marks),
        ),
        label="coefficients-wide" if wide else "coefficients",
        wide=wide,
        warnings=_failures(blocks),
    )


def _coefficients(block: _Block, scenarios: Sequence[str], n: int, *, wide: bool) -> Iterator[str]:
    def padded(cells: Sequence[str]) -> list[str]:
        return [*cells, *[""] * (n - len(cells))]

    heads = padded(block.heads)
    yield from _title(block, n * len(scenarios) + 1 if wide else n + 2)
    if wide:
        yield row("", *(rf"\multicolumn{{{n}}}{{c}}{{{escaped(name)}}}" for name in scenarios))
        yield "".join(rf"\cmidrule(lr){{{2 + n * i}-{1 + n * (i + 1)}}}" for i in range(len(scenarios)))
    yield row("Spot", *(heads * len(scenarios) if wide else ["Scenario", *heads]))
    yield r"\midrule"
    for spot in block.spots:
        if not wide and spot != block.spots[0]:
            yield r"\addlinespace"
        for i, group in enumerate([scenarios] if wide else [[name] for name in scenarios]):
            label = ["" if i else escaped(spot), *([] if wide else map(escaped, group))]
            yield row(*label, *(cell for name in group for cell in padded(block.values(spot, name))))
            ranges = [cell for name in group for cell in padded(block.ranges(spot, name))]
            if any(ranges):
                yield row(*[""] * len(label), *ranges)


def _table2(blocks: Sequence[_Block]) -> str:
    """Table 2: Fopt, the least of each scenario in bold."""
    scenarios = list(dict.fromkeys(name for block in blocks for name in block.scenarios))
    lines: list[str] = []
    for block in blocks:
        fopt = {key: found.fopt for key, found in block.found.items()}
        least = {
            name: min((f for (_, of), f in fopt.items() if of == name), default=None) for name in scenarios
        }
        lines += [*_title(block, len(scenarios) + 1), row("Spot", *map(escaped, scenarios)), r"\midrule"]
        for spot in block.spots:
            found = {name: fopt.get((spot, name)) for name in scenarios}
            texts = {name: "--" if each is None else number(f"{each:.3g}") for name, each in found.items()}
            bold = {name for name, each in found.items() if each is not None and each == least[name]}
            cells = (rf"\boldmath{text}" if name in bold else text for name, text in texts.items())
            lines.append(row(escaped(spot), *cells))
    what = "Fopt (sum of weighted NMSE) by spot and scenario, the least of each scenario in bold"
    return tabular(
        "l" + "r" * len(scenarios),
        lines[1:],
        caption=_caption(what, blocks),
        label="nmse",
        wide=False,
        warnings=_failures(blocks),
    )


def _title(block: _Block, n_columns: int) -> tuple[str, str]:
    """Title of a block, under the rule that ends the block above it."""
    return r"\midrule", rf"\multicolumn{{{n_columns}}}{{c}}{{{escaped(block.title)}}} \\"


def _failures(blocks: Sequence[_Block]) -> list[str]:
    """Reasons why no parameters can be read from some of the runs."""
    sentences = ((block.title, model_verdict(block.data).sentence) for block in blocks)
    return [f"{title}: {sentence}" for title, sentence in sentences if sentence]


def _caption(what: str, blocks: Sequence[_Block], *more: str) -> str:
    """Caption of a table: its content, what each scenario is fitted to, the data, and what else is to say."""
    fitted = {s.name: weighted_channels(s) for block in blocks for s in block.data.study.scenarios}
    scenarios = ", ".join(f"{name} ({channels})" for name, channels in fitted.items())
    notices = dict.fromkeys(block.data.notice for block in blocks if block.data.notice)
    texts = (what, f"scenarios: {scenarios}", *notices, *_failures(blocks), *more)
    return escaped(" ".join(f"{text[0].upper()}{text[1:].rstrip('.')}." for text in texts if text))
