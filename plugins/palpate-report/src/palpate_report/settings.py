"""Settings of the report's figures: ``[stages.report]`` of a study."""

from typing import Annotated, Literal

from pydantic import Field

from palpate.api import Quantity, Settings

Width = Annotated[float, Quantity("mm")]


class ReportSettings(Settings):
    """Width, font, panel letters and scenarios of figures, as a journal asks for them."""

    single_column: Width = Field(default=85.0, ge=40.0, description="width of figures of one column")
    double_column: Width = Field(default=175.0, ge=80.0, description="width of figures of two columns")
    font: str = Field(
        default="Arial",
        min_length=1,
        description="font of figures; where it is not installed, PNG and PDF have a similar one",
    )
    letters: Literal["a", "A", "none"] = Field(default="a", description="letters of panels")
    scenarios: tuple[str, ...] = Field(
        default=(), description="scenarios that figures show; without a name, all"
    )


BY_ITSELF = ReportSettings()
"""Settings of figures that no study gives any."""
