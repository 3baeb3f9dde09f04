"""Drift from cycle to cycle where a log holds several presses of a spot: the first ones prepare the tissue.

A loader puts ``cycles`` into the record of a file, a table for each: its number ``cycle``, whether it
``counts``, and by channel its relative ``changes`` since the one before, each a ``share`` with its ``std``.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from palpate.domain import Response
from palpate.domain.curves import SIGNIFICANT
from palpate.study.reading import Study


def cycles_of(measured: Mapping[str, Response]) -> Iterator[tuple[str, str, Sequence[Mapping[str, Any]]]]:
    """Spot, file and table of each log of several cycles."""
    for spot, response in measured.items():
        for file, record in response.record.get("files", {}).items():
            if rows := record.get("cycles"):
                yield spot, file, rows


def cycle_warnings(study: Study, measured: Mapping[str, Response]) -> tuple[str, ...]:
    """Warn of cycles that do not repeat yet, and of a model without what they leave behind.

    A cycle that counts may differ from the one before by the gain of the budget and by noise.
    """
    found, relaxes = list[str](), any(map(study.models_relaxation, study.scenarios))
    for spot, file, rows in cycles_of(measured):
        late = [row for row in rows if row["counts"] and row["cycle"] > 1]
        if not late:
            continue
        where, which = f"{file}: spot '{spot}'", f"cycle {late[-1]['cycle']} of {len(rows)}"
        for row in late:
            changed = [
                f"{channel} changes by {100.0 * change['share']:+.2g} %"
                for channel, change in row.get("changes", {}).items()
                if abs(change["share"]) > study.budget.gain + SIGNIFICANT * change["std"]
            ]
            if changed:
                found.append(
                    f"{where}: {' and '.join(changed)} from the cycle before to cycle "
                    f"{row['cycle']} of {len(rows)}, so the tissue may not be preconditioned; press more "
                    "cycles before the one that counts"
                )
        if relaxes:
            found.append(
                f"{where}: the fit takes the tissue as at rest before {which}; the model "
                "leaves out the recovery since the cycles before; rest longer between them"
            )
    return tuple(found)
