"""Loaders of a robot's log, and of processed curves in MATLAB, HDF5, NumPy, Parquet and TDMS files."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from palpate.api import CurveError, ExperimentLoader, Response
from palpate.api.files import Inspection, TextFormat
from palpate_indentation.api import CurveSettings, read_curves
from palpate_robot_log.processing.settings import ProcessingSettings
from palpate_robot_log.reading.channel_map import ChannelMap, LogFiles
from palpate_robot_log.reading.formats import ReadingLimits, read_log

if TYPE_CHECKING:
    from palpate_robot_log.processing.chain import Processed
    from palpate_robot_log.reading.assembly import Reading

# SciPy, polars and matplotlib are imported where they are used: who lists the plugins needs none of them.


class RobotLogSettings(ProcessingSettings):
    """Settings of :class:`RobotLogLoader`: how the log is read, then every step of processing."""

    channels: ChannelMap = Field(description="Which columns are time, pose and wrench.")
    files: LogFiles | None = Field(
        default=None, description="Names of two files of each press; left out: one file has pose and wrench."
    )
    cycle: Literal["last", "all"] | Annotated[int, Field(ge=1, strict=True)] = Field(
        default="last",
        description="Of several presses in one log the one that counts: last, its number from 1, or all.",
    )
    text: TextFormat = Field(
        default_factory=TextFormat, description="Layout of delimited text; guessed where left out."
    )
    limits: ReadingLimits = Field(
        default_factory=ReadingLimits, description="Largest file, memory and time of reading."
    )


class RobotLogLoader(ExperimentLoader[RobotLogSettings]):
    """A press as a robot and a six-axis sensor logged it.

    The file gives the channels ``force`` (over depth), ``torque`` (over rotation) where the tool twists,
    with ``slide.enabled`` ``lateral_force`` (over shift), and with ``over_time.enabled`` ``force_over_time``,
    each with standard deviations. A file that the study gives for one channel gives that one alone.
    """

    name = "robot_log"
    summary = "pose and wrench over time: text, Parquet, MATLAB, NumPy or ROS bag, to force and torque"

    def load(self, path: Path, channel: str | None = None) -> Response:
        """Curves of the last press that counts of one log, or the one of the channel that is wanted.

        Raises
        ------
        CurveError
            Naming file, rows, time stamps and what to do.
        """
        return list(self.load_presses(path, channel).values())[-1]

    def load_presses(self, path: Path, channel: str | None = None) -> Mapping[str, Response]:
        """Curves of each press that counts, as :meth:`load` gives them."""
        from palpate_robot_log.processing.cycles import process_cycles

        reading = self._read(path)
        cycles = process_cycles(reading.recording, self.settings, self.settings.cycle)
        record = {"reading": dict(reading.record), **({"cycles": cycles.table} if cycles.table else {})}
        found = {
            label: self._response(path, processed, channel) for label, processed in cycles.labelled.items()
        }
        last, response = list(found.items())[-1]
        return found | {last: replace(response, record={**record, **response.record})}

    def _response(self, path: Path, processed: "Processed", channel: str | None) -> Response:
        from palpate_robot_log.checks import warnings_of

        curves = processed.curves
        if channel is not None and channel not in curves:
            remedy = "the log has no moment; measure it" if processed.lacks_torque else "log a twist"
            raise CurveError(
                f"{path}: no channel '{channel}' comes of this log (found: {', '.join(curves)}); "
                f"{remedy}, or leave the channel out"
            )
        wanted = curves if channel is None else {channel: curves[channel]}
        warnings = warnings_of(processed.raw, processed)
        record = {**processed.record, **({"warnings": warnings} if warnings else {})}
        relaxations = [item for item in processed.relaxations if item.channel in wanted]
        return Response(curves=wanted, relaxations=relaxations, record=record)

    def press_warnings(self, indenter: str, *, is_on_skin: bool) -> Iterator[str]:
        """Warnings about the default contact law where the press has another one."""
        onset = self.settings.onset
        is_default = onset.method == "law" and "exponent" not in onset.model_fields_set
        if is_default and indenter == "sphere" and is_on_skin:
            yield (
                "first contact is found by the law of a sphere on one tissue. On skin over softer tissue "
                "it is about 0.1 mm too early. Set exponent = 1.3 under [experiment.settings.onset], and "
                "search depth_offset under [fit.searched]"
            )

    def draw(self, path: Path, folder: Path, channel: str | None = None) -> tuple[Path, ...]:
        """Pictures of the log as it was read, tared, in its phases, its first contact and its curves.

        They show all channels; each press that counts has a folder where several do. An error is the
        same as in :meth:`load`; everything that could be read is drawn before.
        """
        from palpate_robot_log.pictures import draw_cycles, draw_processed, draw_recording
        from palpate_robot_log.processing.cycles import process_cycles

        reading = self._read(path)
        drawn = [draw_recording(reading.recording, folder)]
        cycles = process_cycles(reading.recording, self.settings, self.settings.cycle)
        for label, processed in cycles.labelled.items():
            own = folder / label
            own.mkdir(exist_ok=True)
            drawn += draw_processed(processed, own)
        return (*drawn, draw_cycles(cycles, folder)) if cycles.table else tuple(drawn)

    @classmethod
    def inspect(cls, path: Path, other: Path | None = None) -> Inspection:
        """Contents of a log and a channel map for it; a CurveError where it cannot be read at all.

        The first of two files has the pose.
        """
        from palpate_robot_log.reading.inspection import inspect_log
        from palpate_robot_log.reading.ros import bag_file

        return replace(inspect_log(path, other), file=bag_file(path))

    def _read(self, path: Path) -> "Reading":
        from palpate_robot_log.reading.assembly import read_recording

        settings = self.settings
        return read_recording(path, settings.channels, settings.text, settings.limits, settings.files)


class ColumnsSettings(CurveSettings):
    """Settings of :class:`ColumnsLoader`."""

    limits: ReadingLimits = Field(
        default_factory=ReadingLimits, description="Largest file, memory and time of reading."
    )


class ColumnsLoader(ExperimentLoader[ColumnsSettings]):
    """Processed curves in a file of columns.

    Columns, units, strains and stresses have the rules of the loader ``csv``. A vector in a MATLAB
    structure is named as MATLAB does, ``test.force_N``; a column of a matrix is ``data(:,2)``.
    """

    name = "columns"
    summary = "processed curves in MATLAB, HDF5, NumPy, Parquet or TDMS files"

    def load(self, path: Path, channel: str | None = None) -> Response:
        """Read one file; a CurveError with file, row and column where it cannot be read."""
        log = read_log(path, limits=self.settings.limits)
        if log.row_word == "line":
            raise CurveError(f'{path}: the file is delimited text; set loader = "csv"')
        return read_curves(log, self.settings.channels, channel)
