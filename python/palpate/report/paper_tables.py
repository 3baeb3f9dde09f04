"""Tables 1 and 2 in the paper's own shape, spots by scenarios, for one material or several."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from palpate.report.latex import escaped, head, number, power_of_ten, row, tabular
from palpate.report.report_data import ReportData
from palpate.report.tables import weighted_channels
from palpate.run.result import ALL_SPOTS

Ends = tuple[float, float]


def intervals(data: ReportData) -> dict[tuple[str, str, str], Ends]:
    """Ends of the 95 % intervals by fit, scenario and full name of the parameter."""
    return {
        (r["fit"], r["scenario"], r["parameter"].removesuffix(f"@{r['fit']}")): (r["lower"], r["upper"])
        for r in data.fit.certainty.intervals.iter_rows(named=True)
    }


def materials_of(data: ReportData) -> str:
    """Materials that are searched, each with its region where there are several."""
    regions = [r for r in data.study.space.regions if data.study.space.columns_of(r.region)]
    if len(regions) == 1:
        return regions[0].material.name
    return ", ".join(f"{r.region}: {r.material.name}" for r in regions)


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
    def found(self) -> dict[tuple[str, str], dict[str, Any]]:
        best = self.data.selection if self.data.fit.ends.is_empty() else self.data.fit.ends
        return {(r["spot"], r["scenario"]): r for r in best.iter_rows(named=True)}

    @cached_property
    def intervals(self) -> dict[tuple[str, str, str], Ends]:
        return intervals(self.data)

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
        """Largest magnitude of each parameter."""
        values = {n: [r[n] for r in self.found.values() if r.get(n) is not None] for n in self.data.searched}
        return {name: max(map(abs, found), default=0.0) for name, found in values.items()}

    @property
    def heads(self) -> list[str]:
        parameters = self.data.searched
        return [head(p.name, p.unit, power_of_ten(self.largest[name])) for name, p in parameters.items()]

    def values(self, spot: str, scenario: str) -> list[str]:
        found = self.found.get((spot, scenario), {})
        return [self._number(name, found.get(name)) for name in self.data.searched]

    def ranges(self, spot: str, scenario: str) -> list[str]:
        """The interval of each value; empty where there is none."""
        texts = []
        for name in self.data.searched:
            ends = self.intervals.get((spot, scenario, name), ())
            texts.append(", ".join(self._number(name, end) for end in ends))
        return [rf"\scriptsize {{[}}{text}{{]}}" if text else "" for text in texts]

    def _number(self, name: str, value: float | None) -> str:
        """A value with as many decimals as make three or four digits of the largest."""
        if value is None:
            return "--"
        size = 10.0 ** power_of_ten(self.largest[name])
        digits = 2 if self.intervals else 3
        decimals = (
            digits - math.floor(math.log10(self.largest[name] / size)) if self.largest[name] else digits
        )
        return number(f"{value / size:.{max(0, decimals)}f}")


def _table1(blocks: Sequence[_Block], *, wide: bool) -> str:
    """Table 1: coefficients and their intervals, the scenarios side by side in a wide one, else as rows."""
    n = max(len(block.data.searched) for block in blocks)
    scenarios = list(dict.fromkeys(name for block in blocks for name in block.scenarios))
    columns = "l" + "r" * n * len(scenarios) if wide else "ll" + "r" * n
    what = "Coefficients by spot and scenario"
    if any(block.intervals for block in blocks):
        what += ", with their 95 % intervals in brackets"
    return tabular(
        columns,
        [line for block in blocks for line in _coefficients(block, scenarios, n, wide=wide)][1:],
        caption=_caption(what, blocks),
        label="coefficients-wide" if wide else "coefficients",
        wide=wide,
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
        fopt = {key: found["fopt"] for key, found in block.found.items()}
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
        "l" + "r" * len(scenarios), lines[1:], caption=_caption(what, blocks), label="nmse", wide=False
    )


def _title(block: _Block, n_columns: int) -> tuple[str, str]:
    """Title of a block, under the rule that ends the block above it."""
    return r"\midrule", rf"\multicolumn{{{n_columns}}}{{c}}{{{escaped(block.title)}}} \\"


def _caption(what: str, blocks: Sequence[_Block]) -> str:
    """What a table has, what each scenario is fitted to, and what the data are."""
    fitted = {s.name: weighted_channels(s) for block in blocks for s in block.data.study.scenarios}
    scenarios = ", ".join(f"{name} ({channels})" for name, channels in fitted.items())
    notices = dict.fromkeys(block.data.notice for block in blocks if block.data.notice)
    sentences = (f"{text[0].upper()}{text[1:]}." for text in (what, f"scenarios: {scenarios}", *notices))
    return escaped(" ".join(sentences))
