"""Work lost in the twist: a stage in one file, ``palpate --plugin loop_work.py loop_work STUDY``.

With ``[stages.loop_work]`` in study.toml ``palpate run`` includes it, and the page has its section.
"""

from types import MappingProxyType

import numpy as np
import polars as pl
from pydantic import Field

from palpate.api import Progress, Run, Settings, Stage, StageTable, StudyError, Summary, TableColumn, hookimpl
from palpate.api.runs import Files


class LoopWorkSettings(Settings):
    """Settings of the stage."""

    channel: str = Field(default="torque", description="Channel whose ordinate is integrated along its path.")


class LoopWork(Stage[LoopWorkSettings]):
    """∮ ordinate d(abscissa), measured and fitted: what friction dissipates in a closed twist."""

    name = "loop_work"
    summary = "Work lost in the twist, measured and fitted"
    needs = ("experiment", "fit")
    tables = MappingProxyType(
        {
            "loop_work": StageTable(
                "Work of each spot's loop.",
                {
                    "spot": TableColumn("Name of the spot.", pl.String),
                    "curve": TableColumn("'measured', or the fit.", pl.String),
                    "work": TableColumn("Work of the loop.", unit="N·mm·deg"),
                },
            )
        }
    )

    def run(self, inputs: Run, progress: Progress) -> Files:
        """Work of each loop by the trapezium rule; N·mm·degrees for a torque."""
        curves = [(spot, "measured", response) for spot, response in inputs.measured.items()]
        for (fit, scenario, spot), response in inputs.fit().responses.items():
            curves.append((spot, f"fit of {fit}, scenario {scenario}", response))
        rows = [
            {"spot": spot, "curve": name, "work": np.trapezoid(curve.ordinate, curve.abscissa)}
            for spot, name, response in curves
            if (curve := response.curves.get(self.settings.channel))
        ]
        if not rows:
            raise StudyError(f"no spot measures '{self.settings.channel}'; set channel in [stages.loop_work]")
        return {"loop_work": pl.DataFrame(rows)}

    def summarise(self, inputs: Run) -> Summary:
        """Largest difference from what was measured, and the table."""
        table = inputs.table("loop_work")
        both = table.join(table.filter(curve="measured").select("spot", measured="work"), on="spot")
        apart = both.select((both["work"] / both["measured"] - 1.0).abs().max()).item()
        line = f"Fitted loops differ from measured ones by {apart:.1%} at most."
        return Summary(lines=[line], tables={"Work of the loop": table})


@hookimpl
def palpate_stages() -> list[type[Stage]]:
    """Provide the stage."""
    return [LoopWork]
